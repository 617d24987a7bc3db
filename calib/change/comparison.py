"""Comparison: a log beside a model, as `check`, `adapt` and their words for it see it.

The rows that count, the belief in their frame, tests, and what explains them: each is found when it
is first asked for.  Maps alone, without a body, are compared with their bound.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..body.belief import Body, knows_orientation
from ..body.covariance import autocorrelation_time
from ..common.arrays import Array, Mask
from ..common.parallel import one_blas_thread
from ..errors import LogError, ModelError
from ..model.model import Model
from ..samples.diagnosis import diagnose, readings, refuse_mistakes, rows_behind
from ..samples.samples import Samples
from ..training.sound_rows import sound_log
from ..training.touched import as_positions
from .equations import Log, shared_columns, sound
from .explain import Explanation, explain, is_changed
from .frame import Reference, carried_offset, reference_of
from .hypotheses import as_built
from .orientation import TurnedTool, turned_tool
from .score import GroupTest, Tested, alike, fired, group_tests
from .settings import BEYOND, FEW_WRONG, OUTLIER, UNEXPLAINED

_LEAST_ROWS = 10  # fewest different rows that a judgement or a correction can rest on
_MISREAD = ("exchanged", "turns")
_CORNER = 0.5  # share of a joint's range below which it is said how little was covered
_PROBES = 120  # joints all over the learned range at which predictions are compared
_SHARED_ERRORS = 2.0  # times a bound of 95 %: five standard deviations, so no chance at all
_SQUARED = 1e100  # positions beyond overflow where they are squared


@dataclass(frozen=True, eq=False)
class Comparison:
    """A log beside a model; repeated rows count once."""

    model: Model
    cause: str | None  # {"sensor", "joints"} or None, what the user knows about the change
    u: Array  # (n, dof), joints in the unit box
    q: Array  # (n, dof) [rad or m]
    x: Array  # (n, m) [unit]
    orientation: Array | None  # (n, 4), qx, qy, qz, qw, where the log has them
    unit: str  # unit of the log's positions
    shared: float  # [unit], standard deviation that all of them share
    predicted: Array  # (n, m) [unit], positions that the model predicts
    wrong: int  # rows that contradict their neighbours and were left out
    lost: int  # these, and rows outside of what the model has learned
    told: tuple[str, ...]  # what the user should be told

    # The rows.

    @property
    def body(self) -> Body:
        """The belief of the model, where it has one."""
        assert self.model.body is not None  # noqa: S101 - maps alone are compared with their bound
        return self.model.body

    @cached_property
    def missed(self) -> Array:
        """Distance of the rows from their prediction, (n,) [unit]."""
        return np.asarray(np.linalg.norm(self.x - self.predicted, axis=1))

    @property
    def unit_seen(self) -> str:
        """Unit of the positions; "sensor" where their scale shows that it is not the model's."""
        same = self.model.body is None or self.reference.scale == 1.0
        return self.unit if same or self.unit != self.model.about.unit else "sensor"

    @cached_property
    def kept(self) -> Mask:
        """Rows (n,) that do not contradict all others."""
        if self.model.body is not None:
            return sound(self.reference, self.q, self._alone, self.cause)
        usual = float(np.median(self.missed))
        return np.asarray(self.missed <= max(OUTLIER * usual, float(self._told.max())))

    @property
    def strays(self) -> int:
        """Rows that contradict all others."""
        return int(np.count_nonzero(~self.kept))

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should be told of the rows."""
        stray = f"rows that contradict all others are left out: {self.strays}"
        return (*self.told, *[stray] * bool(self.strays))

    # The belief in their frame, and what is tested.

    @cached_property
    def belief(self) -> Body:
        """The belief that a changed arm starts from."""
        return as_built(self.body)

    @cached_property
    def reference(self) -> Reference:
        """That belief in the frame of the log."""
        alone = self.x - self.predicted + self.body.predict(self.q)
        return reference_of(self.belief, self.q, alone, self.unit)

    @cached_property
    def _alone(self) -> Array:
        """Positions (n, m) less what maps add to the body in the frame of the log."""
        to, offset = self.reference, self.predicted - self.body.predict(self.q)
        if to.new:
            offset = carried_offset(self.body, to.body, to.beta, self.q, offset)
        return np.asarray(self.x - offset)

    @cached_property
    def log(self) -> Log:
        """The rows that are kept; the model's own log shares as much as they do."""
        shared = float(np.sqrt(2.0)) * self.shared
        return Log(self.q[self.kept], self._alone[self.kept], shared)

    @cached_property
    def probes(self) -> Array:
        """Joints (p, dof) all over the learned range."""
        about = self.model.about
        u = np.random.default_rng(0).random((_PROBES, len(about.joint_names)))
        return np.asarray(about.lower + u * (about.upper - about.lower))

    @cached_property
    def tested(self) -> Tested:
        """Tests of single groups against the belief as the model holds it; maps have none."""
        if self.model.body is None:
            noise = self.model.baseline.noise if self.model.baseline else 0.0
            return Tested((), noise, noise)
        held = self.reference if self.reference.new else Reference(self.body, self.body.beta)
        return group_tests(held, self.log, self.probes)

    @cached_property
    def _told(self) -> Array:
        """95 % bound [unit] on each row, as the model tells it; infinite where it does not."""
        told = np.nan_to_num(self.model.expected_error(self.q), nan=np.inf)
        if self.model.body is None:  # a corner's rows share the errors of a few nodes
            return np.asarray(_SHARED_ERRORS * told)
        return np.maximum(told, self.belief.bound(self.q))

    @cached_property
    def bound_test(self) -> tuple[float, GroupTest]:
        """Share of the rows beyond the 95 % bound, and the chance of so many by noise."""
        from scipy.special import bdtrc, chdtri

        k, tested, shared = np.flatnonzero(self.kept), self.tested, np.asarray(self.shared**2)
        away, told = (self.x - self.predicted)[k], self._told[k]
        square, m = (away**2).sum(axis=1), away.shape[1]
        radius = float(chdtri(m, 0.05))  # squared, of 95 % of a Gaussian, in units of a deviation
        if self.shared and self.model.body is not None:  # model's frame and the log's own
            columns = shared_columns(self.reference, self.log, self.log.z)
            shared = (columns**2).sum(axis=(1, 2)) / m
        # half of the rows of a noisier sensor are nearer than its median
        noise = max(tested.noise**2, float(np.median(square)) / float(chdtri(m, 0.5)))
        noise = max(noise - tested.usual**2, 0.0)
        if noise and alike(k, self.u[k], away) * radius > float(np.median(told)) ** 2:
            noise = 0.0
        if tested.noisy is not None:
            slope = self.body.structure.slope(self.q[k], self.body.beta)[..., tested.noisy[0]]
            noise = noise + tested.noisy[1] ** 2 * (slope**2).sum(axis=1)
        over = square > told**2 + radius * (shared + noise)
        # rows that err together count once
        time = autocorrelation_time(over[:, None].astype(float)) if over.any() else 1.0
        count, n = int(over.sum() / time), math.ceil(len(over) / time)
        p = float(bdtrc(count - 1, n, BEYOND)) if count else 1.0
        beyond = float(np.mean(square > told**2 + radius * shared))
        return beyond, GroupTest("bound", p, -2.0 * math.log(max(p, 1e-300)))

    # What explains them.

    @cached_property
    def explanations(self) -> tuple[Explanation, ...]:
        """Hypotheses with their evidence, best first; of a calm log that of no change."""
        # the first joint's origin is the sensor's frame
        links = [f"placement:{name}" for name in self.model.about.joint_names[1:]]
        first = [group.name for group in fired(self.tested.groups)[:1]]
        link = first[0] if first and first[0] in links else None
        return explain(self.reference, self.log, self.cause, not self._suspect, link)

    @cached_property
    def _suspect(self) -> bool:
        """Whether a test fires, or half of the rows are further off than the model told."""
        beyond, test = self.bound_test
        return self.reference.new or max(self.tested.score, test.score) > 1.0 or beyond > 0.5

    @cached_property
    def score(self) -> float:
        """How far the log is from an arm and a sensor as they were: above 1 they changed."""
        score = max(self.tested.score, self.bound_test[1].score)
        if self.model.body is None or not self._suspect:
            return score
        score = max(score, 2.0 if self.reference.new else 0.0)
        return score if self.explained else max(score, 1.0 + self._left[1])

    @cached_property
    def changed(self) -> bool:
        """Whether something changed, and a hypothesis explains the log better than no change."""
        # Evidence alone took what few rows had not told for waves of the joints, which did harm.
        changed = self.reference.new or (self.score > 1.0 and is_changed(self.explanations))
        return changed and self.explained

    @cached_property
    def _left(self) -> tuple[float, float]:
        """Typical distance of the rows from the best explanation [unit], and of their spread."""
        residual, away = self.explanations[0].residual, self.x - np.median(self.x, axis=0)
        left, spread = (float(np.median(np.linalg.norm(r, axis=1))) for r in (residual, away))
        return left, left / max(spread, 1e-300)

    @cached_property
    def explained(self) -> bool:
        """Whether any hypothesis comes near the rows: to a part of their spread, or as told."""
        left, misfit = (0.0, 0.0) if self.model.body is None else self._left
        if misfit < UNEXPLAINED:
            return True
        # rows that lag or whose joints are exchanged come near too, but for those at each jump
        few = self.wrong + self.strays <= FEW_WRONG * len(self.q)
        return left < float(np.median(self._told[self.kept])) < np.inf and few

    @cached_property
    def tool(self) -> TurnedTool:
        """How the tool is turned beside the best explanation of the positions."""
        beta = self.explanations[0].beta if self.changed else self.body.beta
        structure = self.reference.structure if self.changed else self.body.structure
        return self.tool_beside(structure, beta, framed=self.changed)

    def tool_beside(self, structure: Any, beta: Array, *, framed: bool = False) -> TurnedTool:
        """How it is turned beside what parameters (d,) predict."""
        rows = self.q, self.x, self.orientation
        return turned_tool(self.body, structure, beta, *rows, framed=framed)

    def why_not(self) -> str:
        """One line on a log that nothing explains."""
        to = self.reference
        lag = rows_behind(lambda q: to.structure.predict(q, to.beta), self.q, self._alone)
        check = "check that joints and positions of a row belong together and are of this arm"
        if lag:
            check = f"positions follow the joints by {lag} rows: align the clocks of both"
        return (
            f"nothing explains the log: its positions are {100 * self._left[1]:.0f} % of their "
            f"spread away from any change of the arm or the sensor; {check}"
        )


@contextmanager
def comparing() -> Iterator[None]:
    """One BLAS thread; a forged file, whose numbers no equation holds, is told."""
    try:
        with one_blas_thread():
            yield
    except np.linalg.LinAlgError:
        raise ModelError("no equation holds the model's numbers: train it again") from None


def compare(model: Model, log: Samples, cause: str | None = None) -> Comparison:
    """Put a log beside a model.

    log : at least ten different rows of the same arm
    cause : {"sensor", "joints"}, what is known about a change
    Raises LogError if the log is not of this arm, too short, or looks wrong.
    Raises ModelError if the model keeps no baseline.
    """
    if model.baseline is None:
        raise ModelError("the model has no baseline of its distortions: train it again")
    notes: list[str] = []
    if log.touch is not None:  # which no sensor saw
        cause = cause or "joints"
        log, notes = as_positions(model, log)
    given, before, unit, shared = log.left_out + len(log), log.left_out, log.unit, log.shared
    _refuse_degrees(model, log)
    log, told = sound_log(model, log)
    names = model.about.joint_names
    rows = np.sort(np.unique(np.hstack([log.q, log.x]), axis=0, return_index=True)[1])
    repeated = len(log) - len(rows)
    known = np.isfinite(model.expected_error(log.q[rows]))
    if known.sum() < _LEAST_ROWS:
        why = "measure more poses, spread over the joints' ranges"
        if not known.all():
            why = model.outside(log.q[rows[~known][0]]) or why
        raise LogError(
            f"{known.sum()} of the log's {len(rows)} different rows lie within what the model has "
            f"learned, expected at least {_LEAST_ROWS}: {why}"
        )
    if repeated:
        told.append(f"{repeated} repeated rows count once")
    if not known.all():
        outside = np.count_nonzero(~known)
        told.append(f"{outside} rows outside of what the model has learned are left out")
    rows = rows[known]
    q, x = log.q[rows], log.x[rows]
    turns = None if log.orientation is None else log.orientation[rows]
    found = diagnose(
        model.forward, q, x, names, model.about.revolute, unit=model.about.unit, turns=turns,
        pose=model.pose if knows_orientation(model.body) else None,
    )  # fmt: skip
    # units, mirrors, signs and clocks are causes that the comparison itself tells
    told += refuse_mistakes([each for each in found if each.kind in _MISREAD])
    u = model.motor.scale.to_unit(q)
    told += [
        f"the log covers {100 * width:.0f} % of the learned range of {name}: the result says "
        "little about the rest"
        for name, width in zip(names, np.ptp(u, axis=0).tolist(), strict=True)
        if width < _CORNER
    ]
    q, predicted = model.motor.scale.from_unit(u), model.predictor.value(u)
    alone = predicted if model.body is None else model.body.predict(q)
    if not (np.abs([predicted, alone]) < _SQUARED).all():  # as in a forged file
        raise ModelError("the model predicts no finite positions for this log: train it again")
    return Comparison(
        model, cause, u, q, x, turns, unit, shared, predicted, log.left_out - before,
        given - repeated - len(rows), (*notes, *told),
    )  # fmt: skip


def _refuse_degrees(model: Model, log: Samples) -> None:
    """Refuse a log of joints in another unit, most of which the model has not learned."""
    q, about = model.about.joints_of(log), model.about
    if np.isfinite(model.expected_error(q)).mean() > 0.5 or not any(about.revolute):
        return
    units, *_ = readings(q, about.joint_names, about.revolute, any_order=False)
    for q, other in units:
        if np.isfinite(model.expected_error(q)).mean() > 0.9:
            raise LogError(f"the log fits the model only if {other.words}", hint=other.hint)
