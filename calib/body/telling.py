"""What the rows cannot tell: joints that never moved alone, a path instead of an area."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from ..common.arrays import Array

DEGREE = np.pi / 180

STILL = 1e-6
"""A joint that moves less than this [rad or m] is constant."""

SHARE = 1e-3
"""Joint directions with less than this share of the largest spread never moved."""

CELLS = 24
"""Cells along each joint's span that tell a path from an area."""

AREA_ROWS = 300
"""From this many rows on an area fills more cells than a path."""


def warnings_of(
    q: Array,
    joint_names: Sequence[str],
    revolute: Sequence[bool],
    z: Array | None = None,
    lower: Array | None = None,
    upper: Array | None = None,
) -> tuple[str, ...]:
    """Short sentences on what rows cannot tell of an arm; empty where they can.

    q : (n, dof), joint values [rad or m]
    joint_names, revolute : names of the joints; which of them turn
    z : (n, m), positions; where they do not move at all, that is said
    lower, upper : (dof,), joint ranges; a joint that moved through less than a tenth of its range
        is named
    """
    span = np.ptp(q, axis=0) if len(q) else np.zeros(q.shape[1])
    notes: list[str] = []
    moving: list[int] = []
    for i, name in enumerate(joint_names):
        if span[i] < STILL:
            notes.append(f"{name} never moves: the rows cannot tell its length, offset or sign")
            continue
        moving.append(i)
        if revolute[i] and span[i] < DEGREE:
            notes.append(f"{name} moves by {np.degrees(span[i]):.2g} deg only")
        elif lower is not None and upper is not None and span[i] < 0.1 * (upper[i] - lower[i]):
            share = 100 * span[i] / (upper[i] - lower[i])
            notes.append(f"{name} moves through {share:.2g} % of its range only")
    if z is not None and len(z) and not np.ptp(z, axis=0).any():
        notes.append("the position never changes: the rows say nothing of the arm")
    notes += _alike(q, joint_names, moving)
    if len(q) < 3 * q.shape[1] + 2:
        notes.append(f"{len(q)} rows are few for {q.shape[1]} joints")
    return tuple(notes)


def _alike(q: Array, names: Sequence[str], moving: list[int]) -> list[str]:
    """Columns that are copies of another, directions that never moved alone, paths."""
    notes: list[str] = []
    kept: list[int] = []
    for j in moving:
        largest = 1e-9 + float(np.abs(q[:, kept]).max(initial=0.0))  # but for rounding
        same = (i for i in kept if float(np.abs(q[:, i] - q[:, j]).max()) <= 1e-9 * largest)
        twin = next(same, None)
        if twin is None:
            kept.append(j)
        else:
            notes.append(f"{names[twin]} and {names[j]} hold the same values")
    if len(kept) < 2:
        return notes
    scaled = (q[:, kept] - q[:, kept].mean(axis=0)) / np.ptp(q[:, kept], axis=0)
    values = np.linalg.svd(scaled, compute_uv=False)
    rank = int((values > SHARE * values[0]).sum())
    if rank < len(kept):
        listed = ", ".join(names[i] for i in kept)
        notes.append(
            f"{listed} move together along {rank} of {len(kept)} directions: "
            "the rows cannot tell them apart"
        )
    elif len(q) >= AREA_ROWS and _is_path(scaled):
        notes.append("the joints move along a path, not over an area: beside it the bound is wide")
    return notes


def _is_path(scaled: Array) -> bool:
    """Whether any two joints together visit no more cells than a few curves would."""
    cells = np.minimum(((scaled - scaled.min(axis=0)) * CELLS).astype(int), CELLS - 1).T
    return all(len(np.unique(a * CELLS + b)) < 7 * CELLS for a, b in combinations(cells, 2))
