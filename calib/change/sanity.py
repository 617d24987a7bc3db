"""Sanity: whether a log can be compared with a model at all, and what looks wrong.

Exchanged columns and degrees are refused before a comparison; `lag_behind_body` looks for
positions that come some rows after their joints where nothing else explains a log.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arm.rotations import quaternion_of
from ..body.poses import knows_orientation
from ..common.arrays import Array
from ..common.rows import thinned
from ..errors import LogError
from ..model.model import Model
from ..model.space import Space
from ..samples.diagnosis import diagnose, refuse_mistakes
from ..samples.samples import Samples
from .reference import Reference, rigid_misfit

_LEAST_ROWS = 10  # fewest different rows that a judgement or a correction can rest on
_MISREAD = ("exchanged", "turns", "inverted")
_CORNER = 0.5  # share of a joint's range below which it is said how little was covered

_MOST_LAG = 30  # rows by which positions are moved against the joints, either way
_BETTER = 0.5
_MOST_ROWS = 0.8  # of the rows, which have to come nearer; the others may be wrong detections
_SMOOTH = 0.3  # steps of the joints over their spread, above which rows are no path


def comparable(model: Model, log: Samples) -> tuple[Array, Array, tuple[str, ...]]:
    """Find the rows that a model can be compared with.

    Returns u, x : (n, dof), (n, m), joints in the unit box and positions, repeated rows once
    Returns notes : what the user should be told
    Raises LogError if the log is of another arm, too short, or looks as if its columns were
    exchanged or in degrees.
    """
    log_q = model.about.joints_of(log)
    table = np.hstack([log_q, log.x])
    first = np.sort(np.unique(table, axis=0, return_index=True)[1])
    notes = []
    if len(first) < len(table):
        notes.append(f"{len(table) - len(first)} repeated rows count once")
    if len(first) < _LEAST_ROWS:
        raise LogError(
            f"the log has {len(first)} different rows, expected at least {_LEAST_ROWS}: measure "
            "more poses, spread over the joints' ranges"
        )
    q, x = log_q[first], log.x[first]
    u = model.motor.scale.to_unit(q)
    known = np.isfinite(model.expected_error(q))
    _check_degrees(model, q, known)
    if np.count_nonzero(known) < _LEAST_ROWS:
        why = model.outside(q[~known][0])
        raise LogError(
            f"{np.count_nonzero(known)} of the log's {len(first)} different rows lie within "
            f"what the model has learned, expected at least {_LEAST_ROWS}: {why}"
        )
    left_out = int(np.count_nonzero(~known))
    if left_out:
        notes.append(f"{left_out} rows outside of what the model has learned are left out")
    u, x, q = u[known], x[known], q[known]
    turns = None if log.orientation is None else log.orientation[first][known]
    notes += _misread(model, q, x, turns)
    for name, width in zip(model.about.joint_names, np.ptp(u, axis=0).tolist(), strict=True):
        if width < _CORNER:
            notes.append(
                f"the log covers {100 * width:.0f} % of the learned range of {name}: the result "
                "says little about the rest"
            )
    return u, x, tuple(notes)


def _check_degrees(model: Model, q: Array, known: NDArray[np.bool_]) -> None:
    """Refuse a log whose rows, most of them unknown, fit with turning joints in another unit."""
    turning = np.array(model.about.revolute)
    if np.mean(known) > 0.5 or not turning.any():
        return
    for factor, other, remedy in (
        (np.pi / 180, "degrees", "give `degrees=True`"),
        (180 / np.pi, "radians read as degrees", "leave out `degrees`"),
    ):
        if np.isfinite(model.expected_error(np.where(turning, q * factor, q))).mean() > 0.9:
            raise LogError(f"the log's joint values look like {other}: {remedy}")


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


def lag_behind_body(reference: Reference, q: Array, z: Array) -> int:
    """Rows by which positions follow the joints; 0 where no shift halves the misfit.

    reference : the old belief in the frame of the log
    q, z : (n, dof), (n, m), rows in the order in which they were measured
    """
    n = len(q)
    most = min(_MOST_LAG, n // 4)
    if float(np.median(np.abs(np.diff(q, axis=0)))) > _SMOOTH * float(np.median(np.ptp(q, axis=0))):
        return 0
    places = reference.structure.blocks[0]
    found = {}
    for shift in range(-most, most + 1):
        # positive: the position of a row belongs to joints of some rows before
        a, b = (q[: n - shift], z[shift:]) if shift >= 0 else (q[-shift:], z[: n + shift])
        rows = thinned(len(a), 60)
        predicted = reference.structure.predict(a[rows], reference.beta)
        p, seen = predicted[:, :places], b[rows, :places]
        residual = seen - p @ rigid_misfit(p, seen, scaled=False)[2].T
        residual -= np.median(residual, axis=0)
        # the median alone forgives what happens at the jumps between places
        found[shift] = float(np.quantile(np.linalg.norm(residual, axis=1), _MOST_ROWS))
    best = min(found, key=lambda k: (found[k], abs(k)))
    return best if found[best] < _BETTER * found[0] else 0
