"""Notes on rows: what the joint values of a log cannot tell of an arm."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..common.arrays import Array


def warnings_of(
    q: Array,
    joint_names: Sequence[str],
    revolute: Sequence[bool],
    travel: Array | None = None,
) -> tuple[str, ...]:
    """Return short sentences on what rows cannot tell of an arm; empty where they can.

    q : (n, dof), joint values [rad or m]
    joint_names, revolute : names of the joints; which of them turn
    travel : (dof,), joint ranges; a joint that moved through less than a tenth of its is named
    """
    span = np.ptp(q, axis=0)
    ranges = np.full(q.shape[1], np.inf) if travel is None else travel
    notes: list[str] = []
    for name, turns, moved, most in zip(
        joint_names, revolute, span, ranges, strict=True
    ):
        if moved < 1e-6:
            notes.append(
                f"{name} never moves: the rows cannot tell its length, offset or sign"
            )
        elif turns and moved < np.radians(1.0):
            notes.append(f"{name} moves by {np.degrees(moved):.2g} deg only")
        elif moved < 0.1 * most < np.inf:
            notes.append(
                f"{name} moves through {100 * moved / most:.2g} % of its range only"
            )
    moving = np.flatnonzero(span >= 1e-6)
    rank = len(moving)
    if rank > 1:
        share = q[:, moving] / span[moving]
        away = share - share.mean(axis=0)
        rank = int(np.linalg.matrix_rank(away, rtol=1e-3))
    if rank < len(moving):
        names = ", ".join(joint_names[k] for k in moving.tolist())
        notes.append(
            f"{names} move together along {rank} of {len(moving)} directions: the rows cannot "
            "tell them apart"
        )
    if len(q) < 3 * q.shape[1] + 2:
        notes.append(f"{len(q)} rows are few for {q.shape[1]} joints")
    return tuple(notes)
