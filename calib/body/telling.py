"""What the rows cannot tell: joints that never moved alone, a path instead of an area."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from ..common.arrays import Array

_STILL, _LITTLE = 1e-6, float(np.radians(1.0))
"""A joint that moves less than this [rad or m] is constant; one that turns less tells little."""

_SHARE = 1e-3
"""Joint directions with less than this share of the largest spread never moved."""

_CELLS, _AREA_ROWS = 24, 300
"""Cells along each joint's span that tell a path from an area, from this many rows on."""


def warnings_of(
    q: Array, joint_names: Sequence[str], revolute: Sequence[bool], travel: Array | None = None
) -> tuple[str, ...]:
    """Short sentences on what rows cannot tell of an arm; empty where they can.

    q : (n, dof), joint values [rad or m]
    joint_names, revolute : names of the joints; which of them turn
    travel : (dof,), joint ranges; a joint that moved through less than a tenth of its is named
    """
    span, whole = np.ptp(q, axis=0), np.full(q.shape[1], np.inf) if travel is None else travel
    notes = []
    for name, turns, moved, most in zip(joint_names, revolute, span, whole, strict=True):
        if moved < _STILL:
            notes.append(f"{name} never moves: the rows cannot tell its length, offset or sign")
        elif turns and moved < _LITTLE:
            notes.append(f"{name} moves by {np.degrees(moved):.2g} deg only")
        elif np.isfinite(most) and moved < 0.1 * most:
            notes.append(f"{name} moves through {100 * moved / most:.2g} % of its range only")
    moving = np.flatnonzero(span >= _STILL)
    if len(moving) > 1:
        scaled = (q[:, moving] - q[:, moving].mean(axis=0)) / span[moving]
        values = np.linalg.svd(scaled, compute_uv=False)
        rank = int((values > _SHARE * values[0]).sum())
        cells = np.minimum(((scaled - scaled.min(axis=0)) * _CELLS).astype(int), _CELLS - 1).T
        if rank < len(moving):
            notes.append(
                f"{', '.join(joint_names[int(i)] for i in moving)} move together along {rank} of "
                f"{len(moving)} directions: the rows cannot tell them apart"
            )
        elif len(q) >= _AREA_ROWS and all(
            # any two joints together visit no more cells than a few curves would
            len(np.unique(a * _CELLS + b)) < 7 * _CELLS
            for a, b in combinations(cells, 2)
        ):
            notes.append(
                "the joints move along a path, not over an area: beside it the bound is wide"
            )
    if len(q) < 3 * q.shape[1] + 2:
        notes.append(f"{len(q)} rows are few for {q.shape[1]} joints")
    return tuple(notes)
