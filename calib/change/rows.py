"""Rows: those of a log that count beside a model, with what the model predicts of them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..body.belief import Body, knows_orientation
from ..common.arrays import Array
from ..common.rows import thinned
from ..errors import LogError, ModelError
from ..maps.map import Map, search_tree
from ..model.model import Model
from ..model.prediction import predict
from ..samples.diagnosis import diagnose, readings, refuse_mistakes
from ..samples.motion import Motion
from ..samples.samples import Samples
from ..training.sound_rows import sound_log
from ..training.touched import as_positions

# fewest different rows that a judgement or a correction can rest on
_LEAST_ROWS = 10
_MISREAD = ("exchanged", "turns")
_CORNER = 0.5  # share of a joint's range below which it is said how little was covered
# joints all over the learned range at which predictions are compared
_PROBES = 120


@dataclass(frozen=True, eq=False)
class LogRows:
    """Rows of a log beside a model; repeated rows count once."""

    model: Model
    cause: (
        str | None
    )  # {"sensor", "joints"} or None, what is known about the change
    logged: Array  # (n, dof), joints as the log has them [rad or m]
    q: Array  # (n, dof), where they stand: with the play that the model knows taken up [rad or m]
    side: Array  # (n, dof), sign of each joint's last motion
    x: Array  # (n, m) [unit]
    orientation: Array | None  # (n, 4), qx, qy, qz, qw, where the log has them
    unit: str  # unit of the log's positions
    shared: float  # standard deviation that all positions share [unit]
    predicted: Array  # (n, m), positions that the model predicts [unit]
    bound: Array  # (n,), 95 % bound on each row as the model tells it, infinite for none [unit]
    wrong: int  # rows that contradict their neighbours and were left out
    lost: int  # these, and rows outside of what the model has learned
    notes: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.q)

    @property
    def body(self) -> Body:
        """The belief of the model, where it has one."""
        assert self.model.body is not None  # noqa: S101 - maps alone are compared with their bound
        return self.model.body

    @property
    def motion(self) -> Motion:
        """Their motion, as the log has it."""
        return Motion(self.logged, side=self.side)

    @property
    def u(self) -> Array:
        """Joints (n, dof) in the unit box."""
        return self.model.motor.scale.to_unit(self.q)

    @property
    def missed(self) -> Array:
        """Distance of the rows from their prediction, (n,) [unit]."""
        return np.asarray(np.linalg.norm(self.x - self.predicted, axis=1))

    @property
    def added(self) -> Array:
        """What the maps add to the body, (n, m) [unit]."""
        return np.asarray(self.predicted - self.body.predict(self.q))

    @cached_property
    def probes(self) -> Array:
        """Joints (p, dof) all over the learned range [rad or m]."""
        about = self.model.about
        u = np.random.default_rng(0).random((_PROBES, len(about.joint_names)))
        return np.asarray(about.lower + u * (about.upper - about.lower))


def rows_of(model: Model, log: Samples) -> LogRows:
    """Put a log of at least ten different rows of the same arm beside a model.

    Raises LogError if the log is not of this arm, too short, or looks wrong.
    Raises ModelError if the model keeps no baseline.
    """
    if model.baseline is None:
        raise ModelError(
            "the model has no baseline of its distortions: train it again"
        )
    notes: list[str] = []
    cause = None
    if log.touch is not None:  # which no sensor saw
        cause = "joints"
        log, notes = as_positions(model, log, log.touch)
    rows_in_file = log.left_out + len(log)
    left_out_before = log.left_out
    unit = log.unit
    shared = log.shared
    _refuse_degrees(model, log)
    log, told = sound_log(model, log)
    notes = [*notes, *told]
    first = np.sort(
        np.unique(np.hstack([log.q, log.x]), axis=0, return_index=True)[1]
    )
    repeated = len(log) - len(first)
    prediction = predict(model, log.take(first))
    answered = np.isfinite(prediction.bound)
    if answered.sum() < _LEAST_ROWS:
        why = "measure more poses, spread over the joints' ranges"
        if not answered.all():
            why = model.outside(log.q[first[~answered][0]]) or why
        raise LogError(
            f"{answered.sum()} of the log's {len(first)} different rows lie within what the model "
            f"has learned, expected at least {_LEAST_ROWS}: {why}"
        )
    if repeated:
        notes.append(f"{repeated} repeated rows count once")
    if not answered.all():
        outside = np.count_nonzero(~answered)
        notes.append(
            f"{outside} rows outside of what the model has learned are left out"
        )
    rows = first[answered]
    log = log.take(rows)
    notes += _misreadings(model, log)
    scale = model.motor.scale
    stands = scale.from_unit(scale.to_unit(prediction.joints[answered]))
    predicted = prediction.value[answered]
    assert log.side is not None  # noqa: S101 - of a log they are known
    return LogRows(
        model=model,
        cause=cause,
        logged=log.q,
        q=stands,
        side=log.side,
        x=log.x,
        orientation=log.orientation,
        unit=unit,
        shared=shared,
        predicted=predicted,
        bound=np.nan_to_num(prediction.bound[answered], nan=np.inf),
        wrong=log.left_out - left_out_before,
        lost=rows_in_file - repeated - len(rows),
        notes=tuple(notes),
    )


def _misreadings(model: Model, log: Samples) -> list[str]:
    """Notes on rows that were read wrongly, and on joints that cover little of their range.

    Units, mirrors, signs and clocks are causes that the judgement itself tells.
    """
    names = model.about.joint_names
    pose = model.pose if knows_orientation(model.body) else None
    same_unit = replace(log, unit=model.about.unit)
    findings = diagnose(same_unit, model.forward, pose)
    misread = []
    for finding in findings:
        if finding.kind in _MISREAD:
            misread.append(finding)
    notes = refuse_mistakes(misread)
    u = model.motor.scale.to_unit(log.q)
    widths = np.ptp(u, axis=0).tolist()
    for name, width in zip(names, widths, strict=True):
        if width < _CORNER:
            notes.append(
                f"the log covers {100 * width:.0f} % of the learned range of {name}: the result "
                "says little about the rest"
            )
    return notes


def _refuse_degrees(model: Model, log: Samples) -> None:
    """Refuse a log of joints in another unit, most of which the model has not learned."""
    q = model.about.joints_of(log)
    about = model.about
    if np.isfinite(model.expected_error(q)).mean() > 0.5 or not any(
        about.revolute
    ):
        return
    units, *_ = readings(q, about.joint_names, about.revolute, any_order=False)
    for q, other in units:
        if np.isfinite(model.expected_error(q)).mean() > 0.9:
            raise LogError(
                f"the log fits the model only if {other.words}", hint=other.hint
            )


_MOST = 1000  # rows that distortions are measured on


class Signal(NamedTuple):
    """One measure of how a log lies on the maps."""

    value: float  # of the log
    threshold: float  # what is usual where it lies


def distortions(rows: LogRows) -> dict[str, Signal]:
    """Return zeta of both maps, the reverse distortion, and the distance to the prediction.

    "reverse" is the mean squared distance of the nodes predicted for the joints to those that the
    positions visit, in the unit box; "links" the root mean square of the residuals [unit].
    """
    model = rows.model
    baseline = model.baseline
    assert baseline is not None  # noqa: S101 - checked where the rows are read
    some = thinned(len(rows), _MOST)
    sensory = model.sensory
    measured = sensory.scale.to_unit(rows.x[some])
    predicted = sensory.scale.to_unit(rows.predicted[some])
    nodes = sensory.units[sensory.nearest(measured)[1][:, 0]]
    nodes_predicted = sensory.units[sensory.nearest(predicted)[1][:, 0]]
    tree = search_tree(np.unique(nodes, axis=0), sensory.scale)
    away = np.asarray(tree.query(nodes_predicted)[0])
    bound = rows.bound[some]
    usual = np.where(np.isfinite(bound), bound, 0.0)
    links = np.sqrt(np.mean([rows.missed[some] ** 2, usual**2], axis=1))
    return {
        "motor": _zeta(model.motor, rows.u[some], baseline.motor),
        "sensory": _zeta(sensory, measured, baseline.sensory),
        "reverse": Signal(float(np.mean(away**2)), sensory.spacing**2),
        "links": Signal(*links.tolist()),
    }


def _zeta(network: Map, points: Array, expected: Array) -> Signal:
    """Distortion (eq. 9) of points (n, p) in the unit box, beside the winners' own (nodes,)."""
    distance, winner = network.nearest(points)
    usual = expected[winner[:, 0]].mean()
    return Signal(float(np.mean(distance[:, 0] ** 2)), float(usual))
