"""Poses to measure: which of many, and in which order the joints travel little.

Where a belief of the body is known, the poses are those that tell most of it: D-optimal design
takes each pose that shrinks the volume of the posterior most, given all before it (Fedorov 1972;
for robots Borm and Menq 1991). Else farthest-point selection (Gonzalez 1985) puts the first poses
into corners and onto borders, where a fitted function is least certain, and fills the rest evenly.
"""

from __future__ import annotations

import numpy as np

from ..arm.arm import SpatialArm
from ..body.spatial import structure_of
from ..common.arrays import Array, Index
from ..common.scale import Scale
from ..maps.map import search_tree
from .pose_space import PoseSpace

_INSIDE = 4000  # candidates within the box
_FACES = 3000  # candidates with one joint at an end of its range
_CORNERS = 256  # most corners, which are as many as 2^dof
_SWEEPS = 50  # each lowers the length; far fewer are needed
_NOISE = 1e-4  # [m] of a sensor that is not known yet
_WIDEST = 10.0  # [m or rad] of a prior: a wider one leaves no digits for what 200 poses tell
_CHUNK = 200  # poses that are linearised at a time


def candidate_poses(space: PoseSpace, rng: np.random.Generator) -> Array:
    """Draw poses to choose from: within the box, on its faces, at its corners.

    Returns (m, dof), in units of the joints' ranges.
    """
    dof = len(space.joint_names)
    inside, faces = rng.random((_INSIDE, dof)), rng.random((_FACES, dof))
    rows = np.arange(_FACES)
    faces[rows, rng.integers(dof, size=_FACES)] = rng.integers(2, size=_FACES)
    # every corner of the first eight joints, beyond which there would be too many
    corners = np.stack(np.meshgrid(*[[0.0, 1.0]] * min(dof, 8), indexing="ij"), axis=-1)
    corners = corners.reshape(-1, min(dof, 8))
    rest = rng.integers(2, size=(len(corners), dof - corners.shape[1]))
    points = np.concatenate([np.hstack([corners, rest])[:_CORNERS], faces, inside])
    low, high = space.corners
    return np.asarray(low + (high - low) * points)


def farthest(scale: Scale, points: Array, n: int, taken: Array) -> Index:
    """Choose points one by one, each as far as possible from all that were chosen before.

    points : (m, dof), what to choose from, in units of the joints' ranges
    taken : (k, dof), points that there are already; without any the first point is the first corner
    Returns (n,), rows of `points`, in the order of choice.
    """
    away = np.full(len(points), np.inf)
    if len(taken):
        tree = search_tree(taken, scale)
        away = np.asarray(tree.query(scale.wrapped(points))[0], dtype=float)
    chosen = np.empty(n, dtype=np.intp)
    for k in range(n):
        chosen[k] = row = int(away.argmax())
        gap = np.linalg.norm(scale.difference(points, points[row]), axis=1)
        away = np.minimum(away, gap)
        away[row] = -1.0  # where points repeat, none is chosen twice
    return chosen


def shortest_tour(away: Array) -> Index:
    """Order points so that the way from the first one through all others is short.

    Nearest neighbours first, then 2-opt (Croes 1958: a stretch is turned round) until it gains
    nothing. The way is open: it does not return.

    away : (n, n), symmetric distances; the way starts at row 0
    Returns (n,), a permutation that begins with 0.
    """
    order = np.zeros(len(away), dtype=np.intp)
    left = np.arange(len(away)) > 0
    for k in range(1, len(away)):
        order[k] = np.where(left, away[order[k - 1]], np.inf).argmin()
        left[order[k]] = False
    for _ in range(_SWEEPS):
        before = length(away, order)
        order = _two_opt(away, order)
        if length(away, order) >= before * (1 - 1e-12):
            break
    return order


def length(away: Array, order: Index) -> float:
    """Length of the way through the points in this order."""
    return float(away[order[:-1], order[1:]].sum())


def _two_opt(away: Array, order: Index) -> Index:
    """Turn round the stretch from i to j that gains most, for each i in turn."""
    order = order.copy()
    n = len(order)
    for i in range(1, n - 1):
        a, b = order[i - 1], order[i]
        ends = order[i + 1 :]
        # of the ways a-b .. e-f and a-e .. b-f: d(a,b) + d(e,f) - d(a,e) - d(b,f)
        gain = away[a, b] - away[a, ends]
        gain[:-1] += away[ends[:-1], ends[1:]] - away[b, ends[1:]]  # the last has no successor
        j = int(gain.argmax())
        if gain[j] > 1e-12:
            order[i : i + j + 2] = order[i : i + j + 2][::-1]
    return order


def tells(arm: SpatialArm, q: Array, taken: Array) -> Array:
    """Directions (m, p, k) in which poses tell of the body, in units of noise and of the prior.

    q : (m, dof) [rad or m], poses to choose from
    taken : (t, dof) [rad or m], poses that were measured
    """
    structure = structure_of(arm, "rigid")
    free = ("view.rotation", "view.shift", "tool", "placement", "offset", "elastic", "curve")
    prior = structure.prior(free)
    every, beta = np.vstack([q, taken]), structure.neutral()
    parts = (every[i : i + _CHUNK] for i in range(0, len(every), _CHUNK))
    told = np.concatenate([structure.linearise(part, beta, prior.active)[1] for part in parts])
    told = told * (np.minimum(prior.sd[prior.active], _WIDEST) / _NOISE)
    told, known = told[: len(q)], told[len(q) :].reshape(-1, told.shape[2])
    if not len(known):
        return np.asarray(told)
    # the posterior (I + T' T)^-1 of the measured rows T is R^-T R^-1, so that told R^-T tells it
    root = np.linalg.cholesky(np.eye(told.shape[2]) + known.T @ known)
    flat = np.linalg.solve(root, told.reshape(-1, told.shape[2]).T)
    return np.asarray(flat.T.reshape(told.shape))
