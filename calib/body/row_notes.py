"""Notes on rows: what the joint values of a log cannot tell of an arm."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ..common.arrays import Array


@dataclass(frozen=True)
class RowNoteSettings:
    """When a note is due."""

    still: float = 1e-6  # [rad or m], motion of a joint that is constant
    little: float = float(np.radians(1.0))  # [rad], motion that tells little
    share: float = 0.1  # of a joint's range that tells little
    # of the largest spread: joint directions that never moved
    spread: float = 1e-3
    cells: int = 24  # along each span, that tell a path from an area
    area_rows: int = 300  # rows from which they do


NOTES = RowNoteSettings()


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
        if moved < NOTES.still:
            notes.append(
                f"{name} never moves: the rows cannot tell its length, offset or sign"
            )
        elif turns and moved < NOTES.little:
            notes.append(f"{name} moves by {np.degrees(moved):.2g} deg only")
        elif np.isfinite(most) and moved < NOTES.share * most:
            notes.append(
                f"{name} moves through {100 * moved / most:.2g} % of its range only"
            )
    moving = np.flatnonzero(span >= NOTES.still)
    if len(moving) > 1:
        names = [joint_names[k] for k in moving.tolist()]
        share = (q[:, moving] - q[:, moving].min(axis=0)) / span[moving]
        notes += _coupled(share, names)
    if len(q) < 3 * q.shape[1] + 2:
        notes.append(f"{len(q)} rows are few for {q.shape[1]} joints")
    return tuple(notes)


def _coupled(share: Array, names: Sequence[str]) -> Iterator[str]:
    """Say where joints move together; `share` (n, k) is how far each is through its span."""
    values = np.linalg.svd(share - share.mean(axis=0), compute_uv=False)
    rank = int((values > NOTES.spread * values[0]).sum())
    if rank < len(names):
        yield (
            f"{', '.join(names)} move together along {rank} of {len(names)} directions: the rows "
            "cannot tell them apart"
        )
        return
    count = NOTES.cells
    cells = np.minimum((share * count).astype(int), count - 1).T
    visited = max(
        len(np.unique(a * count + b)) for a, b in combinations(cells, 2)
    )
    # no more than a few curves would
    if len(share) >= NOTES.area_rows and visited < 7 * count:
        yield "the joints move along a path, not over an area: beside it the bound is wide"
