"""Spread: poses that cover the joint space, its border included.

A learned map is a smooth function fitted to noisy positions: it is least certain at the
border of what was measured, and beyond it. Farthest-point selection (Gonzalez 1985) puts
the first poses into corners and onto borders and fills what is left evenly, needs no model
of the arm, and continues any set of poses that there is already.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..common.scale import Scale
from ..maps.map import search_tree
from .pose_space import Space

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_INSIDE = 4000  # candidates within the box
_FACES = 3000  # candidates with one joint at an end of its range
_CORNERS = 256  # most corners, which are as many as 2^dof


def candidates(space: Space, rng: np.random.Generator) -> Array:
    """Draw poses to choose from: within the box, on its faces, at its corners.

    Parameters
    ----------
    space : Space
    rng : Generator

    Returns
    -------
    (m, dof) array
        In units of the joints' ranges.
    """
    dof = space.dof
    inside, faces = rng.random((_INSIDE, dof)), rng.random((_FACES, dof))
    rows = np.arange(_FACES)
    faces[rows, rng.integers(dof, size=_FACES)] = rng.integers(2, size=_FACES)
    corners = np.stack(np.meshgrid(*[[0.0, 1.0]] * min(dof, 8), indexing="ij"), axis=-1)
    corners = corners.reshape(-1, min(dof, 8))
    rest = rng.integers(2, size=(len(corners), dof - corners.shape[1]))
    points = np.concatenate([np.hstack([corners, rest])[:_CORNERS], faces, inside])
    low, high = space.corners
    return np.asarray(low + (high - low) * points)


def farthest(scale: Scale, points: Array, n: int, taken: Array) -> Index:
    """Choose points one by one, each as far as possible from all that were chosen before.

    Parameters
    ----------
    scale : Scale
        Knows the periodic joints.
    points : (m, dof) array
        What to choose from, in units of the joints' ranges.
    n : int
        How many, at most m.
    taken : (k, dof) array
        Points that there are already; without any the first point is the first corner.

    Returns
    -------
    (n,) int array
        Rows of `points`, in the order of choice.
    """
    away = np.full(len(points), np.inf)
    if len(taken):
        wrapped = np.where(scale.periodic, points % 1.0, points)
        away = np.asarray(search_tree(taken, scale).query(wrapped)[0], dtype=float)
    chosen = np.empty(n, dtype=np.intp)
    for k in range(n):
        chosen[k] = row = int(away.argmax())
        gap = np.linalg.norm(scale.difference(points, points[row]), axis=1)
        away = np.minimum(away, gap)
        away[row] = -1.0  # where points repeat, none is chosen twice
    return chosen
