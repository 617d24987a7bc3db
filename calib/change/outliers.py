"""Outliers: rows that no smooth correction of a map explains."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..body.basis import Basis
from ..common.robust import inliers
from ..common.scale import Scale
from .features import Frame, find_chain

Array = NDArray[np.float64]
Old = Callable[[Array], Array]
"""A map: joints of the unit box (n, dof) to positions (n, 2)."""


def find_outliers(
    old: Old, scale: Scale, turning: tuple[bool, ...], u: Array, x: Array
) -> NDArray[np.bool_]:
    """Whether each row agrees with any smooth correction of the old map, (n,) bool."""
    said = old(u)
    frame = Frame.of(said, 3).values(said)
    harmonic = harmonics(scale, turning, u)
    sets = [frame, np.concatenate([frame[:, :3], harmonic], axis=1), harmonic]
    chain = find_chain(scale, turning, *spread_points(old, u.shape[1]))
    if chain is not None:
        sets += [np.concatenate([frame[:, :3], chain.values(u)], axis=1)]
    return inliers(sets, x)


def spread_points(old: Old, dof: int) -> tuple[Array, Array]:
    """Points all over the unit box and what the old map says of them."""
    points = np.random.default_rng(0).random((400, dof))
    return points, old(points)


def harmonics(scale: Scale, turning: tuple[bool, ...], u: Array, degree: int = 2) -> Array:
    """Harmonics of the joints up to a total degree at `u` (n, dof), (n, terms)."""
    turns = tuple(float(s) if t else 0.0 for s, t in zip(scale.span, turning, strict=True))
    return Basis(turns, degree).values(u)
