"""Loads that bend joints: ``load_e = gravity . lever_e(q)``, of an arm in space or in the plane."""

from __future__ import annotations

from collections.abc import Hashable
from functools import lru_cache
from typing import Protocol

import numpy as np

from ..common.arrays import Array
from .parameters import Indices

_REMEMBERED = 2  # levers of the last rows: a fit needs them at each step


class BendingLoads(Hashable, Protocol):
    """Some loads of a chain, ``e`` in number."""

    @property
    def joints(self) -> Indices:
        """The joints (e,) that they bend."""

    def levers(self, q: Array) -> Array:
        """Levers (e, g, n) at joint values (n, dof)."""

    def slopes(self, q: Array, gravity: Array) -> Array:
        """Derivatives (e, dof, n) of the loads by the joint values."""


def loads_at(loads: BendingLoads, q: Array, gravity: Array) -> Array:
    """Loads (e, n) at joint values (n, dof) under gravity (g,)."""
    joints = np.asarray(q, dtype=float)
    levers = _levers(loads, joints.shape, joints.tobytes())
    return loads_of(levers, gravity)


def loads_of(levers: Array, gravity: Array) -> Array:
    """Loads (e, n) of levers (e, g, n) under gravity (g,)."""
    loads: Array = np.einsum("egn,g->en", levers, gravity)
    return loads


@lru_cache(_REMEMBERED)
def _levers(
    loads: BendingLoads, shape: tuple[int, ...], joints: bytes
) -> Array:
    q = np.frombuffer(joints).reshape(shape)
    return loads.levers(q)
