"""Comparable rows: those of a log that a model can be compared with, and what looks wrong."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..arm.rotations import quaternion_of
from ..body.belief import knows_orientation
from ..common.arrays import Array, Mask
from ..errors import LogError
from ..model.model import Model
from ..model.space import Space
from ..samples.diagnosis import diagnose, refuse_mistakes
from ..samples.samples import Samples
from ..training.sound_rows import sound_log

_LEAST_ROWS = 10  # fewest different rows that a judgement or a correction can rest on
_MISREAD = ("exchanged", "turns", "inverted")
_CORNER = 0.5  # share of a joint's range below which it is said how little was covered


class Comparable(NamedTuple):
    """Rows of a log, repeated ones once."""

    u: Array  # (n, dof), joints in the unit box
    q: Array  # (n, dof) [rad or m]
    x: Array  # (n, m) [unit]
    orientation: Array | None  # (n, 4), qx, qy, qz, qw, where the log has them
    wrong: int  # rows that contradict their neighbours and were left out
    left_out: int  # these, and rows outside of what the model has learned
    notes: tuple[str, ...]  # what the user should be told


def comparable(model: Model, log: Samples) -> Comparable:
    """Find the rows that a model can be compared with.

    Raises LogError if the log is of another arm, too short, or looks as if its columns were
    exchanged or in degrees.
    """
    given = log.left_out + len(log)
    _refuse_other(model, log)
    before = log.left_out
    log, told = sound_log(model, log)
    wrong = log.left_out - before
    notes = list(told)
    first = np.sort(np.unique(np.hstack([log.q, log.x]), axis=0, return_index=True)[1])
    if len(first) < len(log):
        notes.append(f"{len(log) - len(first)} repeated rows count once")
    known = np.isfinite(model.expected_error(log.q[first]))
    _refuse_few(model, log.q[first], known)
    if not known.all():
        outside = np.count_nonzero(~known)
        notes.append(f"{outside} rows outside of what the model has learned are left out")
    rows = first[known]
    q, x = log.q[rows], log.x[rows]
    turns = None if log.orientation is None else log.orientation[rows]
    notes += _misread(model, q, x, turns)
    u = model.motor.scale.to_unit(q)
    for name, width in zip(model.about.joint_names, np.ptp(u, axis=0).tolist(), strict=True):
        if width < _CORNER:
            notes.append(
                f"the log covers {100 * width:.0f} % of the learned range of {name}: the result "
                "says little about the rest"
            )
    left_out = given - (len(log) - len(first)) - len(rows)
    return Comparable(u, model.motor.scale.from_unit(u), x, turns, wrong, left_out, tuple(notes))


def _refuse_other(model: Model, log: Samples) -> None:
    """Refuse a log of too few rows, or of joints in another unit."""
    q = model.about.joints_of(log)
    rows = len(np.unique(np.hstack([q, log.x]), axis=0))
    if rows < _LEAST_ROWS:
        raise LogError(
            f"the log has {rows} different rows, expected at least {_LEAST_ROWS}: measure "
            "more poses, spread over the joints' ranges"
        )
    turning = np.array(model.about.revolute)
    if np.isfinite(model.expected_error(q)).mean() > 0.5 or not turning.any():
        return
    for factor, other, remedy in (
        (np.pi / 180, "degrees", "give `degrees=True`"),
        (180 / np.pi, "radians read as degrees", "leave out `degrees`"),
    ):
        if np.isfinite(model.expected_error(np.where(turning, q * factor, q))).mean() > 0.9:
            raise LogError(f"the log's joint values look like {other}: {remedy}")


def _refuse_few(model: Model, q: Array, known: Mask) -> None:
    if np.count_nonzero(known) < _LEAST_ROWS:
        why = model.outside(q[~known][0]) if not known.all() else "others were left out as wrong"
        raise LogError(
            f"{np.count_nonzero(known)} of the log's {len(q)} different rows lie within "
            f"what the model has learned, expected at least {_LEAST_ROWS}: {why}"
        )


def _misread(model: Model, q: Array, x: Array, turns: Array | None) -> list[str]:
    """Refuse a log that fits only if it is read otherwise: what a change of the arm cannot be."""

    def pose(q: Array) -> tuple[Array, Array]:
        space = Space.of(model)
        place, rotation = space.to_sensor(*space.evaluate(q)[:2])
        return place, quaternion_of(rotation)

    found = diagnose(
        model.forward, q, x, model.about.joint_names, model.about.revolute,
        unit=model.about.unit, turns=turns, pose=pose if knows_orientation(model.body) else None,
    )  # fmt: skip
    # units, mirrors, signs and clocks are causes that the comparison itself tells
    return refuse_mistakes([each for each in found if each.kind in _MISREAD])
