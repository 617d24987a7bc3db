"""Comparison: a log beside a model, as `check`, `adapt` and their words for it see it.

One comparison holds the rows that count, the belief that they are compared with, the frame that
they were measured in, and how well each hypothesis explains them.  What several uses need is found
once, when it is first asked for.  Maps alone, without a body, are compared with their bound.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..body.belief import Body
from ..common.arrays import Array, Mask
from ..errors import ModelError
from ..model.model import Model
from ..samples.diagnosis import rows_behind
from ..samples.samples import Samples
from .bound import Bounded
from .comparable import Comparable, comparable
from .equations import Log, shared_columns, weighted
from .explain import Explanation, changed, explain
from .frame import Reference, carried_offset, kept_reference, reference_of
from .hypotheses import as_built
from .score import GroupTest, Tested, group_tests
from .settings import FEW_WRONG, OUTLIER, UNEXPLAINED
from .sockets import as_positions

_PROBES = 120  # joints all over the learned range at which predictions are compared
_SHARED_ERRORS = 2.0  # times a bound of 95 %: five standard deviations, so no chance at all
_SQUARED = 1e100  # positions beyond overflow where they are squared


@dataclass(frozen=True, eq=False)
class Comparison(Comparable):
    """A log beside a model."""

    predicted: Array  # (n, m) [unit], positions that the model predicts
    cause: str | None  # {"sensor", "joints"} or None, what the user knows about the change
    unit: str  # unit of the log's positions
    shared: float  # [unit], standard deviation that all of them share

    @property
    def body(self) -> Body:
        """The belief of the model, where it has one."""
        assert self.model.body is not None  # noqa: S101 - maps alone are compared with their bound
        return self.model.body

    @property
    def missed(self) -> Array:
        """Distance of the rows from their prediction, (n,) [unit]."""
        return np.asarray(np.linalg.norm(self.x - self.predicted, axis=1))

    @property
    def unit_seen(self) -> str:
        """Unit of the positions; "sensor" where their scale shows that it is not the model's."""
        same = self.model.body is None or self.reference.scale == 1.0
        return self.unit if same or self.unit != self.model.about.unit else "sensor"

    @cached_property
    def offset(self) -> Array:
        """What maps add to the body at the rows, (n, m) [unit]."""
        return self.predicted - self.body.predict(self.q)

    @cached_property
    def belief(self) -> Body:
        """The belief that a changed arm starts from."""
        return as_built(self.body)

    @cached_property
    def reference(self) -> Reference:
        """That belief in the frame of the log."""
        return reference_of(self.belief, self.q, self.x - self.offset, self.unit)

    @cached_property
    def log(self) -> Log:
        """Rows with robust weights, less what maps add to the body in the frame of the log."""
        to, offset = self.reference, self.offset
        if to.new:
            offset = carried_offset(self.body, to.body, to.beta, self.q, offset)
        # the model's own log shares as much
        shared = float(np.sqrt(2.0)) * self.shared
        return weighted(to, self.q, self.x - offset, self.cause, shared)

    @cached_property
    def kept(self) -> Mask:
        """Rows (n,) that do not contradict all others."""
        if self.model.body is not None:
            return self.log.kept
        usual = float(np.median(self.missed))
        return np.asarray(self.missed <= max(OUTLIER * usual, float(self._told.max())))

    @property
    def outliers(self) -> int:
        """Rows that contradict their neighbours or all others."""
        return self.wrong + int(np.count_nonzero(~self.kept))

    @property
    def left_out(self) -> int:
        """Rows of the log that are wrong, or outside of what the model has learned."""
        return self.lost + int(np.count_nonzero(~self.kept))

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
            baseline = self.model.baseline
            return Tested((), *2 * (baseline.noise if baseline else 0.0,))
        held = self.reference if self.reference.new else kept_reference(self.body)
        return group_tests(held, self.log, self.probes)

    @cached_property
    def _told(self) -> Array:
        """95 % bound [unit] on each row, as the model tells it; infinite where it does not."""
        told = np.nan_to_num(self.model.expected_error(self.q), nan=np.inf)
        if self.model.body is None:  # a corner's rows share the errors of a few nodes
            return np.asarray(_SHARED_ERRORS * told)
        return np.maximum(told, self.belief.bound(self.q))

    @cached_property
    def _bounded(self) -> Bounded:
        shared = np.full(len(self.x), self.shared**2)
        if self.shared and self.model.body is not None:  # model's frame and the log's own
            columns = shared_columns(self.reference, self.log, self.log.z)
            shared = (columns**2).sum(axis=(1, 2)) / columns.shape[1]
        k = np.flatnonzero(self.kept)
        return Bounded(k, self.u[k], (self.x - self.predicted)[k], self._told[k], shared[k])

    @property
    def beyond(self) -> float:
        """Share of the rows beyond what the model told."""
        return float(np.mean(self._bounded.beyond()))

    @cached_property
    def bound_test(self) -> GroupTest:
        """Whether too many are."""
        slope, noisy = None, self.tested.noisy
        if noisy is not None:
            slope = self.body.structure.slope(self.q[self.kept], self.body.beta)[..., noisy[0]]
        return self._bounded.test(self.tested, slope)

    @cached_property
    def explanations(self) -> tuple[Explanation, ...]:
        """Hypotheses with their evidence, best first; of a calm log that of no change."""
        return explain(self.reference, self.log, self.cause, calm=not self._suspect)

    @cached_property
    def _suspect(self) -> bool:
        """Whether a test fires, or half of the rows are further off than the model told."""
        fired = max(self.tested.score, self.bound_test.score) > 1.0
        return self.reference.new or fired or self.beyond > 0.5

    @cached_property
    def score(self) -> float:
        """How far the log is from an arm and a sensor as they were: above 1 they changed."""
        score = max(self.tested.score, self.bound_test.score)
        if self.model.body is None:
            return score
        score = max(score, 2.0 if self.reference.new else 0.0)
        return max(score, 1.0 + self.misfit) if self._suspect and not self.explained else score

    @cached_property
    def changed(self) -> bool:
        """Whether something changed, and a hypothesis explains the log better than no change.

        Evidence alone took what few rows had not told of an unchanged arm for waves of its joints:
        wherever nothing was measured they did harm.
        """
        return self.reference.new or (self.score > 1.0 and changed(self.explanations))

    @property
    def _left(self) -> float:
        """Typical distance of the rows from the best explanation [unit]."""
        return float(np.median(np.linalg.norm(self.explanations[0].residual, axis=1)))

    @property
    def misfit(self) -> float:
        """The same over the spread of positions: their typical distance from their middle."""
        spread = np.median(np.linalg.norm(self.x - np.median(self.x, axis=0), axis=1))
        return self._left / max(float(spread), 1e-300)

    @cached_property
    def explained(self) -> bool:
        """Whether any hypothesis comes near the rows: to a part of their spread, or as told.

        A sparse model may be wrong by a tenth of the few millimetres that rows of one place span.
        """
        if self.model.body is None or self.misfit < UNEXPLAINED:
            return True
        # rows that lag or whose joints are exchanged come near too, but for those at each jump
        few = self.outliers <= FEW_WRONG * len(self.q)
        return self._left < float(np.median(self._told[self.kept])) < np.inf and few

    def why_not(self) -> str:
        """One line on a log that nothing explains."""
        told = (
            f"nothing explains the log: its positions are {100 * self.misfit:.0f} % of their "
            "spread away from any change of the arm or the sensor"
        )
        check = "check that joints and positions of a row belong together and are of this arm"
        return f"{told}; {self._late or check}"

    @property
    def notes(self) -> list[str]:
        """What the user should be told of the rows, those that contradict all others included."""
        wrong = int(np.count_nonzero(~self.kept))
        if not wrong:
            return list(self.told)
        rows = "1 row contradicts" if wrong == 1 else f"{wrong} rows contradict"
        many = self.outliers > FEW_WRONG * len(self.q)
        late = f"; {self._late}" if many and self.explained and self._late else ""
        return [*self.told, f"{rows} all others: left out{late}"]

    @cached_property
    def _late(self) -> str:
        """What is said of positions that follow the joints by some rows, "" where they do not."""
        if self.model.body is None:
            return ""
        to = self.reference
        lag = rows_behind(lambda q: to.structure.predict(q, to.beta), self.q, self.log.z)
        if not lag:
            return ""
        return (
            f"positions follow the joints by {lag} rows: align the clocks of both, or "
            f"shift the columns by {lag} rows"
        )


def compare(model: Model, log: Samples, cause: str | None = None) -> Comparison:
    """Put a log beside a model.

    log : at least ten different rows of the same arm
    cause : {"sensor", "joints"}, what is known about a change
    Raises LogError if the log is not of this arm, too short, or looks wrong.
    Raises ModelError if the model is of an older format and keeps no belief.
    """
    if model.baseline is None or "body" not in model.about.options:
        raise ModelError(
            "the model has an older format without a posterior of its body: train it again"
        )
    told: list[str] = []
    if log.touch is not None:  # which no sensor saw
        cause = cause or "joints"
        log, told = as_positions(model, log)
    rows = comparable(model, log)
    rows = replace(rows, told=(*told, *rows.told))
    predicted = model.predictor.value(rows.u)
    alone = predicted if model.body is None else model.body.predict(rows.q)
    if not (np.abs([predicted, alone]) < _SQUARED).all():  # as in a forged file
        raise ModelError("the model predicts no finite positions for this log: train it again")
    return Comparison(
        **vars(rows), predicted=predicted, cause=cause, unit=log.unit, shared=log.shared
    )
