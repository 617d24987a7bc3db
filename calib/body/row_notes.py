"""Notes on rows: what the joint values of a log cannot determine of an arm."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ..common.arrays import Array, Mask

_STILL = 1e-6
"""A joint that moves by less [rad or m] is at rest."""

_LITTLE = float(np.radians(1.0))
"""A motion of joints through less [rad, or spans of a slide] hardly constrains them."""


def warnings_of(
    q: Array,
    joint_names: Sequence[str],
    revolute: Sequence[bool],
    travel: Array,
) -> tuple[str, ...]:
    """Short sentences on what rows cannot determine of an arm; empty if nothing.

    q : (n, dof), joint values [rad or m]
    joint_names, revolute : names of the joints; which of them turn
    travel : (dof,), joint ranges; a joint that moved through less than a tenth of its is named
    """
    span = np.ptp(q, axis=0)
    notes = [*_of_small_motions(span, travel, joint_names, revolute)]
    tied, directions = _tied_joints(q, np.asarray(revolute, dtype=bool))
    if tied.any():
        names = ", ".join(np.asarray(joint_names)[tied])
        notes.append(
            f"{names} move together along {directions} of {tied.sum()} directions: the rows "
            "cannot tell them apart"
        )
    if len(q) < 3 * len(span) + 2:
        notes.append(f"{len(q)} rows are few for {len(span)} joints")
    return tuple(notes)


def _of_small_motions(
    span: Array,
    ranges: Array,
    joint_names: Sequence[str],
    revolute: Sequence[bool],
) -> Iterator[str]:
    """Yield a sentence for each joint that moved through a small part (dof,) of its range."""
    for name, is_revolute, motion, range_of_joint in zip(
        joint_names, revolute, span, ranges, strict=True
    ):
        if motion < _STILL:
            yield f"{name} never moves: the rows cannot tell its length, offset or sign"
        elif is_revolute and motion < _LITTLE:
            yield f"{name} moves by {np.degrees(motion):.2g} deg only"
        elif motion < 0.1 * range_of_joint < np.inf:
            yield f"{name} moves through {100 * motion / range_of_joint:.2g} % of its range only"


def _tied_joints(q: Array, turning: Mask) -> tuple[Mask, int]:
    """Which joints (dof,) a linear relation ties, and in how many directions they move.

    Joints that hardly move by themselves are none of these.
    """
    span = np.ptp(q, axis=0)
    least = np.where(turning, _LITTLE, _STILL)
    moving = np.flatnonzero(span >= least)
    unit = np.where(turning, 1.0, span)
    values = q[:, moving]
    deviations = values - values.mean(axis=0)
    deviations /= unit[moving]
    covariance = deviations.T @ deviations / len(q)
    variance, axes = np.linalg.eigh(covariance)
    # of a motion that is spread evenly over so much
    is_small = variance < _LITTLE**2 / 12
    shares = np.abs(axes[:, is_small])
    least_part = 0.03  # in such a relation, of one, of a joint that counts
    tied = np.zeros(len(span), dtype=bool)
    tied[moving] = shares.max(axis=1, initial=0.0) > least_part
    return tied, int(tied.sum() - is_small.sum())
