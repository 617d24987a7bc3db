"""Comparable rows: those of a log that a model can be compared with, and what looks wrong."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np

from ..arm.rotations import quaternion_of
from ..body.belief import knows_orientation
from ..common.arrays import Array
from ..errors import LogError
from ..model.model import Model
from ..model.space import Space
from ..samples.diagnosis import diagnose, readings, refuse_mistakes
from ..samples.samples import Samples
from ..training.sound_rows import sound_log

_LEAST_ROWS = 10  # fewest different rows that a judgement or a correction can rest on
_MISREAD = ("exchanged", "turns", "inverted")
_WIDE = 0.5  # least spread of rows in any direction, over that of the learned range
_CELLS = 5  # along each joint, for the share of the range that a log measured
_CORNER = 0.5  # share of a joint's range below which it is said how little was covered


@dataclass(frozen=True, eq=False)
class Comparable:
    """A model, and rows of a log that it can be compared with, repeated ones once."""

    model: Model
    u: Array  # (n, dof), joints in the unit box
    q: Array  # (n, dof) [rad or m]
    x: Array  # (n, m) [unit]
    orientation: Array | None  # (n, 4), qx, qy, qz, qw, where the log has them
    wrong: int  # rows that contradict their neighbours and were left out
    lost: int  # these, and rows outside of what the model has learned
    told: tuple[str, ...]  # what the user should be told

    @cached_property
    def spans(self) -> bool:
        """Whether the rows vary in every direction of the joints, as over the learned range.

        Held-out rows of a line or a corner say nothing of a prediction elsewhere.
        """
        spread = np.cov(self.u.T)
        # along each axis the variance of uniform rows is 1 / 12
        return bool(np.linalg.eigvalsh(np.atleast_2d(spread))[0] > _WIDE**2 / 12.0)

    @property
    def coverage(self) -> float:
        """Share of the learned range, in cells of a fifth of each joint's range, that rows visit.

        Six joints have 15,625 cells, which no log visits: it is the mean over all pairs of joints.
        """
        u = np.clip(self.u, 0.0, 1.0 - 1e-12)
        cells, dof = (u * _CELLS).astype(int), u.shape[1]
        some = combinations(range(dof), min(dof, 2))
        shares = [len(np.unique(cells[:, ix], axis=0)) / _CELLS ** len(ix) for ix in some]
        return float(np.mean(shares))


def comparable(model: Model, log: Samples) -> Comparable:
    """Find the rows that a model can be compared with.

    Raises LogError if the log is of another arm, too short, or looks as if its columns were
    exchanged or in degrees.
    """
    given, before = log.left_out + len(log), log.left_out
    _refuse_other(model, log)
    log, notes = sound_log(model, log)
    wrong = log.left_out - before
    first = np.sort(np.unique(np.hstack([log.q, log.x]), axis=0, return_index=True)[1])
    if len(first) < len(log):
        notes.append(f"{len(log) - len(first)} repeated rows count once")
    known = np.isfinite(model.expected_error(log.q[first]))
    if np.count_nonzero(known) < _LEAST_ROWS:
        outer = log.q[first][~known]
        why = model.outside(outer[0]) if len(outer) else "others were left out as wrong"
        raise LogError(
            f"{np.count_nonzero(known)} of the log's {len(first)} different rows lie within "
            f"what the model has learned, expected at least {_LEAST_ROWS}: {why}"
        )
    if not known.all():
        outside = np.count_nonzero(~known)
        notes.append(f"{outside} rows outside of what the model has learned are left out")
    rows = first[known]
    q, x = log.q[rows], log.x[rows]
    turns = None if log.orientation is None else log.orientation[rows]

    def pose(q: Array) -> tuple[Array, Array]:
        space = Space.of(model)
        place, rotation = space.to_sensor(*space.evaluate(q)[:2])
        return place, quaternion_of(rotation)

    found = diagnose(
        model.forward, q, x, model.about.joint_names, model.about.revolute,
        unit=model.about.unit, turns=turns, pose=pose if knows_orientation(model.body) else None,
    )  # fmt: skip
    # units, mirrors, signs and clocks are causes that the comparison itself tells
    notes += refuse_mistakes([each for each in found if each.kind in _MISREAD])
    u = model.motor.scale.to_unit(q)
    for name, width in zip(model.about.joint_names, np.ptp(u, axis=0).tolist(), strict=True):
        if width < _CORNER:
            notes.append(
                f"the log covers {100 * width:.0f} % of the learned range of {name}: the result "
                "says little about the rest"
            )
    lost, q = given - (len(log) - len(first)) - len(rows), model.motor.scale.from_unit(u)
    return Comparable(model, u, q, x, turns, wrong, lost, tuple(notes))


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
    units, *_ = readings(q, model.about.joint_names, model.about.revolute, any_order=False)
    for q, other in units:
        if np.isfinite(model.expected_error(q)).mean() > 0.9:
            raise LogError(f"the log fits the model only if {other.words}", hint=other.hint)
