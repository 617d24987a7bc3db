"""Rows: the rows of a log that are compared with a model, with the model's predictions."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..body.belief import Body, knows_orientation
from ..body.fit import Fit
from ..body.parameters import Prior
from ..body.rows import Rows
from ..body.settings import STUDENT
from ..common.arrays import Array, Index, Mask
from ..common.rows import row_lengths, spread_rows
from ..common.scale import Scale
from ..errors import LogError, ModelError
from ..model.model import Model
from ..model.prediction import Prediction
from ..samples.diagnosis import diagnose
from ..samples.findings import interpretations, refuse_mistakes
from ..samples.motion import RowArrays
from ..samples.samples import Samples
from ..training.preparation import sound_log
from ..training.residuals import learned_rows
from ..training.socket_places import as_positions
from .causes import sd_if_changed, sd_of_creep
from .frame import Reference, offset_after

OUTLIER = 5.0  # noises from which a row contradicts all others

# fewest different rows for a verdict or a correction
LEAST_ROWS = 10
REPEATED_ROWS = "{} repeated rows count once"
LEARNED_ROWS = "the model has learned {} of these rows, which show nothing new"
_MISTAKES = ("exchanged", "turns")


@dataclass(frozen=True)
class RowSettings:
    """What rows have to be like, and how many are used."""

    # share of the positions' spread: rows whose residuals are smaller were read as they are meant
    near: float = 0.1
    # share of a joint's range below which a note says how little of it was covered
    corner: float = 0.5
    # `least_relative_spread` of rows along a line; the correlated joints of series C have .29
    line: float = 0.2
    # largest share of strays that still counts as few
    few_strays: float = 0.05
    # joint values all over the learned range at which predictions are compared
    probes: int = 120
    # least share of rows that the model answers, or that lie within its range, if their unit is the
    # model's
    answered: float = 0.5
    # least share of rows within the range after a conversion, if their unit is another one
    answered_in_other: float = 0.9
    # distance from the middle of the learned range, over that range, that counts as within
    range: float = 0.55
    # most steps of the robust fit that finds strays: with 12, exact rows of a longer link were
    # strays
    robust_steps: int = 60
    # most rows of the robust fit: enough for every parameter
    robust_rows: int = 400


ROWS = RowSettings()


@dataclass(frozen=True, eq=False)
class LogRows(RowArrays):
    """Rows of a log with a model's predictions; repeated rows count once."""

    model: Model
    log: Samples  # joints and positions as they were logged
    q: Array  # (n, dof), the joints' true values, by the play that the model knows [rad or m]
    unit: str  # unit of the log's positions
    shared: float  # standard deviation that all positions share [unit]
    predicted: Array  # (n, m), positions that the model predicts [unit]
    bound: Array  # (n,), the model's 95 % bound on each row, infinite where it has none [unit]
    strays: int  # rows that contradict the others and were left out
    left_out: int  # strays, and rows outside of what the model has learned
    notes: tuple[str, ...]
    # [rows]; likelihoods are raised to the power 1 / correlation_time: rows that err together
    # count once
    correlation_time: float = 1.0

    def __len__(self) -> int:
        return len(self.q)

    def in_sockets_of(self, model: Model) -> LogRows:
        """The rows with the sockets that they touched at the places of another model."""
        touch = self.log.touch
        if touch is None:
            return self
        places = touch.means(model.predictor.value(self.u))
        positions = touch.positions(self.x, places)
        return replace(self, log=replace(self.log, x=positions))

    @property
    def body(self) -> Body:
        """The belief of the model, where it has one."""
        assert self.model.body is not None  # noqa: S101 - maps alone are compared with their bound
        return self.model.body

    @property
    def x(self) -> Array:
        """Positions (n, m) [unit]."""
        return self.log.x

    @property
    def side(self) -> Array:
        """Sign of each joint's last motion, (n, dof), 0 where it is not known."""
        assert self.log.side is not None  # noqa: S101 - of samples it is known
        return self.log.side

    @property
    def clock_sd(self) -> Array:
        """Standard deviation (n, dof) by which the log's clock shifts the joints of all rows."""
        if self.log.clock_sd is None:
            return np.zeros_like(self.q)
        return self.log.clock_sd

    @property
    def u(self) -> Array:
        """Joints (n, dof) in the unit box."""
        return self.model.motor.scale.to_unit(self.q)

    @property
    def range_shares(self) -> Array:
        """Share (dof,) of each joint's learned range that the rows cover."""
        return np.asarray(np.ptp(self.u, axis=0))

    @cached_property
    def learned_u(self) -> Array | None:
        """Joints (k, dof) in the unit box that the model of a log has learned, None for all of it.

        None also for an adapted model, which keeps only the rows of its adaptation.
        """
        measured = self.model.rows
        if measured is None or self.model.history:
            return None
        return self.model.motor.scale.to_unit(measured.q)

    @property
    def learned_shares(self) -> Array:
        """Share (dof,) of each joint's range in the learned rows that the rows cover."""
        if self.learned_u is None:
            return self.range_shares
        learned = np.ptp(self.learned_u, axis=0)
        return np.asarray(self.range_shares / np.maximum(learned, 1e-12))

    @property
    def least_relative_spread(self) -> float:
        """Least spread of the joints in any direction, over that of the learned rows."""
        spread = np.atleast_2d(np.cov(self.u.T))
        identity = np.eye(len(spread))
        # uniform joints have a variance of 1 / 12 in every direction
        learned = identity / 12.0
        if self.learned_u is not None:
            learned = np.atleast_2d(np.cov(self.learned_u.T))
            learned += 1e-9 * identity
        root = np.linalg.inv(np.linalg.cholesky(learned))
        least = float(np.linalg.eigvalsh(root @ spread @ root.T)[0])
        return math.sqrt(max(least, 0.0))

    @property
    def widespread(self) -> bool:
        """Whether every joint covers half of what was learned, and rows are not along a line."""
        wide = bool((self.learned_shares > ROWS.corner).all())
        return wide and self.least_relative_spread > ROWS.line

    @property
    def distance(self) -> Array:
        """Distance of the rows from their prediction, (n,) [unit]."""
        return row_lengths(self.x - self.predicted)

    @property
    def map_offset(self) -> Array:
        """Offset (n, m) that the maps add to the body's prediction [unit]."""
        return np.asarray(self.predicted - self.body.predict(self.q))

    @cached_property
    def probes(self) -> Array:
        """Random joint values (p, dof) all over the learned range [rad or m]."""
        about = self.model.about
        shape = (ROWS.probes, len(about.joint_names))
        u = np.random.default_rng(0).random(shape)
        return np.asarray(about.lower + u * (about.upper - about.lower))

    @property
    def has_few_strays(self) -> bool:
        """Whether only few rows, or one, contradict all others."""
        count = len(self) + self.strays
        return self.strays <= max(ROWS.few_strays * count, 1)

    def at_most(self, count: int) -> LogRows:
        """Return at most `count` rows, evenly spread."""
        return self.take(spread_rows(len(self), count))

    @property
    def are_touches(self) -> bool:
        """Whether all rows are touches, without readings of a sensor."""
        touch = self.log.touch
        return touch is not None and bool(touch.is_touch.all())

    def about_sockets(self, residual: Array) -> Array:
        """Residuals (n, m) of touches minus their mean in each socket, of readings as they are."""
        touch = self.log.touch
        if touch is None:
            return residual
        means = touch.means(residual)
        places = touch.positions(np.zeros_like(residual), means)
        return residual - places

    def without_maps(self, reference: Reference) -> LogRows:
        """Return the rows for a comparison with a body alone, minus the maps' offset."""
        offset = self.map_offset
        if reference.has_discrete_cause:
            body = reference.body
            offset = offset_after(
                self.body, body, reference.beta, self.q, offset
            )
        return replace(self, log=replace(self.log, x=self.x - offset))

    def without_strays(self, sound: Mask) -> LogRows:
        """Return the sound rows, with a note on the number of strays."""
        strays = int(np.count_nonzero(~sound))
        if not strays:
            return self
        note = f"rows that contradict all others are left out: {strays}"
        return replace(
            self.take(sound),
            strays=self.strays + strays,
            left_out=self.left_out + strays,
            notes=(*self.notes, note),
        )


def rows_of(model: Model, log: Samples) -> LogRows:
    """Compare a log of at least ten different rows of the same arm with a model.

    Raises LogError if the log is not of this arm, too short, or looks wrong.
    Raises ModelError if the model keeps no baseline.
    """
    if model.baseline is None:
        raise ModelError(
            "the model has no baseline of its distortions: train it again"
        )
    log, learned_notes = _without_learned(model, log)
    positions, notes = as_positions(model, log)
    notes += learned_notes
    _refuse_degrees(model, positions)
    sound, sound_notes = sound_log(model, positions)
    different = sound.take(first_of_equal_rows(sound))
    repeated = len(sound) - len(different)
    prediction = Prediction(model, different)
    answered = np.isfinite(prediction.reading_bound)
    _refuse_few(model, different, answered)
    rows_in_file = positions.left_out + len(positions)
    scale = model.motor.scale
    rows = LogRows(
        model=model,
        log=different,
        q=scale.from_unit(scale.to_unit(prediction.joints)),
        unit=positions.unit,
        shared=positions.common_sd,
        predicted=prediction.value,
        bound=np.nan_to_num(prediction.reading_bound, nan=np.inf),
        strays=sound.left_out - positions.left_out,
        left_out=rows_in_file - repeated - int(answered.sum()),
        notes=(),
    ).take(answered)
    notes += sound_notes
    if repeated:
        notes.append(REPEATED_ROWS.format(repeated))
    outside = np.count_nonzero(~answered)
    if outside:
        notes.append(
            f"{outside} rows outside of what the model has learned are left out"
        )
    return replace(rows, notes=(*notes, *_misreadings(rows)))


def _without_learned(model: Model, log: Samples) -> tuple[Samples, list[str]]:
    """The rows that a model has not learned, or all where these are too few, and a note."""
    if log.touch is not None:
        return log, []
    is_learned = learned_rows(model, log)
    learned = int(np.count_nonzero(is_learned))
    notes = [LEARNED_ROWS.format(learned)] if learned else []
    if len(log) - learned >= LEAST_ROWS:
        log = log.take(~is_learned)
    return log, notes


def _refuse_few(model: Model, different: Samples, answered: Mask) -> None:
    """Refuse a log of `different` rows of which too few are `answered` (n,)."""
    if answered.sum() >= LEAST_ROWS:
        return
    why = "measure more poses, spread over the joints' ranges"
    if not answered.all():
        first = different.q[~answered][0]
        why = model.outside(first) or why
    raise LogError(
        f"{answered.sum()} of the log's {len(answered)} different rows lie within what the model "
        f"has learned, expected at least {LEAST_ROWS}: {why}"
    )


def first_of_equal_rows(log: Samples) -> Index:
    """Return the rows (k,) that equal no earlier row."""
    values = np.hstack([log.q, log.x])
    _, index = np.unique(values, axis=0, return_index=True)
    return np.sort(index)


def _misreadings(rows: LogRows) -> list[str]:
    """Notes on mistakes in reading the rows, and on joints that cover little of their range.

    Only exchanged and turned axes are examined; `judge` itself finds units, mirrors, signs, clocks.
    """
    model = rows.model
    log = replace(rows.log, unit=model.about.unit)
    notes: list[str] = []
    middle = np.median(log.x, axis=0)
    spread = np.median(np.abs(log.x - middle))
    if (
        log.orientation is not None
        or np.median(rows.distance) > ROWS.near * spread
    ):
        pose = model.pose if knows_orientation(model.body) else None
        findings = diagnose(log, model.forward, pose)
        notes = refuse_mistakes([f for f in findings if f.kind in _MISTAKES])
    names = model.about.joint_names
    for name, share in zip(names, rows.learned_shares.tolist(), strict=True):
        if share < ROWS.corner:
            notes.append(
                f"the log covers {100 * share:.0f} % of the learned range of {name}: the result "
                "says little about the rest"
            )
    return notes


def _refuse_degrees(model: Model, log: Samples) -> None:
    """Refuse a log whose joints are in another unit, such as degrees."""
    about = model.about
    q = about.joints_of(log)
    if not any(about.revolute):
        return
    scale = model.motor.scale
    answered = float(np.isfinite(model.expected_error(q)).mean())
    # coarse maps answer few rows within the range
    if max(answered, _share_inside(scale, q)) > ROWS.answered:
        return
    # a joint that moves through most of its range is in the model's unit
    moves = np.ptp(q, axis=0) / scale.span
    is_in_unit = (moves > ROWS.corner) & (moves < 2.0 * ROWS.range)
    if is_in_unit[list(about.revolute)].any():
        return
    units, *_ = interpretations(
        q, about.joint_names, about.revolute, any_order=False
    )
    for values, other in units:
        if _share_inside(scale, values) > ROWS.answered_in_other:
            raise LogError(other.words, hint=other.hint)


def _share_inside(scale: Scale, q: Array) -> float:
    """Share of rows (n, dof) within the learned range."""
    from_middle = np.abs((q - scale.lower) / scale.span - 0.5)
    return float((from_middle <= ROWS.range).all(axis=1).mean())


def sound_rows(reference: Reference, observations: LogRows) -> Mask:
    """Return which rows (n,) are near a robust fit of all that may have changed."""
    q = observations.q
    if (
        observations.log.touch is not None
    ):  # touches in no socket are already left out
        return np.ones(len(q), dtype=bool)
    z = observations.x
    structure = reference.structure
    body = reference.body
    noise = reference.expected_noise
    sd = np.hypot(sd_if_changed(body), sd_of_creep(body))
    prior = Prior(reference.beta, sd)
    rows = spread_rows(len(q), ROWS.robust_rows)
    measured = [Rows(q[rows], z[rows], floor=noise)]
    fit = Fit(structure, measured, prior.mean, prior, nu=STUDENT)
    fit.maximise(steps=ROWS.robust_steps)
    predicted = structure.predict(q, fit.beta)
    residual = structure.residual(z, predicted) / noise
    square = (residual**2).sum(axis=1)
    outputs = residual.shape[1]
    median = float(np.median(square[rows]))
    median_of_chi_square = outputs - 2 / 3
    variance = max(median / median_of_chi_square, 1.0)
    return np.asarray(square <= OUTLIER**2 * outputs * variance)
