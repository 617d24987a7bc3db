"""Comparison: a log beside a model, as `check`, `adapt` and their words for it see it.

One comparison holds the rows that count, the belief that they are compared with, the frame that
they were measured in, and how well each member explains them.  What several uses need is found
once, when it is first asked for.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..body.belief import Body
from ..common.arrays import Array
from ..errors import ModelError
from .explain import Explanation, changed, explain, likely, unusual
from .group_tests import FALSE_ALARM, Tested, group_tests
from .members import as_built
from .reference import Reference, carried_offset, kept_reference, reference_of
from .rows import Log, weighted
from .sanity import Comparable, comparable, lag_of
from .seen import seen_body

if TYPE_CHECKING:
    from ..model.model import Model
    from ..samples.samples import Samples

PROBES = 120
"""Joints all over the learned range at which predictions are compared."""

_WIDE = 0.5  # least spread of rows in any direction, over that of the learned range

_SHARED_ERRORS = 2.0  # times a bound of 95 %: five standard deviations, so no chance at all

_CHECK = "check that joints and positions of a row belong together and are of this arm"

_SQUARED = 1e100  # positions beyond overflow where they are squared

_FEW = 0.05  # share of rows that may contradict all others where the rest is as near as told

UNEXPLAINED = 0.1
"""Share of the positions' spread: a log that is further off from every member is explained by
none."""


@dataclass(frozen=True, eq=False)
class Comparison:
    """A log beside a model."""

    model: Model
    rows: Comparable  # rows of the log that the model can be compared with
    # (n, dof), (n, m), their joints [rad or m] and positions [unit]
    q: Array
    x: Array
    offset: Array  # (n, m), what maps add to the body there [unit]
    body: Body  # the belief of the model; without a body, that of its sensor's view alone
    cause: str | None  # {"sensor", "joints"} or None, what the user knows about the change
    unit: str  # unit of the log's positions
    shared: float = 0.0  # [unit], standard deviation that all of them share

    @property
    def z(self) -> Array:
        """Positions (n, m) without what maps add to the body [unit]."""
        return self.x - self.offset

    @property
    def unit_seen(self) -> str:
        """Unit of the positions; "sensor" where their scale shows that it is not the model's."""
        told = self.unit != self.model.about.unit or self.reference.scale == 1.0
        return self.unit if told else "sensor"

    @cached_property
    def belief(self) -> Body:
        """The belief that a changed arm starts from."""
        return as_built(self.body)

    @cached_property
    def reference(self) -> Reference:
        """That belief in the frame of the log."""
        return reference_of(self.belief, self.q, self.z, self.unit)

    @cached_property
    def _weighted(self) -> tuple[Log, Array, NDArray[np.bool_]]:
        log, beta, kept = weighted(self.reference, self.q, self.x - self.moved_offset, self.cause)
        # the model's own log shares as much
        return replace(log, shared=float(np.sqrt(2.0)) * self.shared), beta, kept

    @cached_property
    def moved_offset(self) -> Array:
        """What maps add to the body, in the frame of the log, (n, m)."""
        if not self.reference.new:
            return self.offset
        return carried_offset(
            self.body, self.reference.body, self.reference.beta, self.q, self.offset
        )

    @property
    def log(self) -> Log:
        """Rows with robust weights."""
        return self._weighted[0]

    @property
    def kept(self) -> NDArray[np.bool_]:
        """Rows (n,) that do not contradict all others."""
        return self._weighted[2]

    @property
    def outliers(self) -> int:
        """Rows that contradict all others."""
        return int(np.count_nonzero(~self.kept))

    @cached_property
    def spans(self) -> bool:
        """Whether the rows vary in every direction of the joints, as over the learned range.

        Held-out rows of a line or a corner say nothing of a prediction elsewhere.
        """
        spread = np.cov(self.model.motor.scale.to_unit(self.q).T)
        # along each axis the variance of uniform rows is 1 / 12
        return bool(np.linalg.eigvalsh(np.atleast_2d(spread))[0] > _WIDE**2 / 12.0)

    @cached_property
    def probes(self) -> Array:
        """Joints (p, dof) all over the learned range."""
        about = self.model.about
        u = np.random.default_rng(0).random((PROBES, len(about.joint_names)))
        return np.asarray(about.lower + u * (about.upper - about.lower))

    @cached_property
    def tested(self) -> Tested:
        """Tests of single groups against the belief as the model holds it."""
        held = self.reference if self.reference.new else kept_reference(self.body)
        body = self.reference.body if self.reference.new else self.body
        return group_tests(body, held, self.log, self.probes)

    @cached_property
    def _told(self) -> Array:
        """95 % bound [unit] on each kept row, as the model tells it; infinite where it does not."""
        told = np.nan_to_num(self.model.expected_error(self.q), nan=np.inf)
        return np.maximum(told, self.belief.bound(self.q))[self.kept]

    @cached_property
    def beyond(self) -> tuple[float, float]:
        """Median distance of the rows from their prediction, over what 19 of 20 should stay below.

        The second value is the same if all of the log's own scatter is noise of the sensor, which
        is no drift.  A simulated arm is bounded as it was built.
        """
        from scipy.special import chdtri

        gap = np.linalg.norm(self.z - self.body.predict(self.q), axis=1)[self.kept]
        radius = float(chdtri(self.z.shape[1], 0.05))  # squared, of 95 % in units of a deviation
        told = np.sqrt(self._told**2 + radius * self.log.shared**2)
        if self.model.body is None:  # a corner's rows share the errors of a few nodes
            told *= _SHARED_ERRORS
        more = max(self.tested.noise**2 - self.tested.usual**2, 0.0)
        noisy = np.sqrt(told**2 + radius * more)
        return float(np.median(gap / told)), float(np.median(gap / noisy))

    @cached_property
    def unexpected(self) -> bool:
        """Whether no test fires, yet half of the rows are further off than the model told.

        Groups are tested against all that may have crept (:func:`calib.change.members.drift`),
        which on a path or in a corner follows nearly any residual, and waves that are finer than
        the rows look like noise.  The bound is narrower: half of the rows beyond it are no chance.
        """
        if self.reference.new or self.tested.score > 1.0:
            return False
        far, surely = self.beyond
        return surely > 1.0 or (far > 1.0 and changed(self.explanations))

    @cached_property
    def explanations(self) -> tuple[Explanation, ...]:
        """Members with their evidence, best first; of a log that shows no change, that of none."""
        return self._explained(calm=False) if self._suspect else self._calm

    @cached_property
    def _calm(self) -> tuple[Explanation, ...]:
        """Explanations by no change."""
        return self._explained(calm=True)

    @property
    def _waves(self) -> float:
        """Evidence of waves, which look like noise to the tests, over what chance stays below.

        What is less likely than the usual by 1 / p has a chance below p where nothing changed
        (Markov's inequality).  Maps alone have errors that look like waves.
        """
        if self.model.body is None:
            return 0.0
        return unusual(self._calm) / -math.log(FALSE_ALARM)

    def _explained(self, calm: bool) -> tuple[Explanation, ...]:
        return explain(self.reference, self.log, self._weighted[1], self.cause, calm)

    @cached_property
    def score(self) -> float:
        """How far the log is from an arm and a sensor as they were: above 1 they changed."""
        score = max(self.tested.score, 2.0 if self.reference.new else 0.0)
        if score <= 1.0:
            score = max(score, self._waves)
        if self._suspect and not self.explained:
            return max(score, 1.0 + self.misfit)
        return max(score, self.beyond[0] if self.unexpected else 0.0)

    @cached_property
    def _suspect(self) -> bool:
        """Whether a test fires, or rows are so far from the model that noise alone is no answer."""
        fired = self.tested.score > 1.0 or self._waves > 1.0
        return self.reference.new or fired or self.beyond[0] > 1.0

    @cached_property
    def changed(self) -> bool:
        """Whether something changed, and a member explains the log better than no change.

        Evidence alone took what few rows had not told of an unchanged arm for waves of its joints:
        wherever nothing was measured they did harm.
        """
        return self.reference.new or (self.score > 1.0 and changed(self.explanations))

    @property
    def likely(self) -> list[tuple[float, Explanation]]:
        """The members that count, with their weights."""
        return likely(self.explanations)

    @cached_property
    def misfit(self) -> float:
        """Typical distance of the rows from the best member, over the spread of positions."""
        left = np.linalg.norm(self.explanations[0].residual, axis=1)
        spread = np.linalg.norm(self.x - np.median(self.x, axis=0), axis=1)
        return float(np.median(left) / max(float(np.median(spread)), 1e-300))

    @property
    def explained(self) -> bool:
        """Whether any member comes near the rows: to a part of their spread, or as near as told.

        A sparse model may be wrong by a tenth of the few millimetres that rows of one place span.
        """
        if self.misfit < UNEXPLAINED:
            return True
        left = float(np.median(np.linalg.norm(self.explanations[0].residual, axis=1)))
        told = float(np.median(self._told))
        # rows that lag or whose joints are exchanged come near too, but for those at each jump
        return left < told < np.inf and self.outliers <= _FEW * len(self.q)

    def why_not(self) -> str:
        """One line on a log that no member explains."""
        told = (
            f"nothing explains the log: its positions are {100 * self.misfit:.0f} % of their "
            "spread away from any change of the arm or the sensor"
        )
        return f"{told}; {self._late or _CHECK}"

    def outlier_notes(self) -> list[str]:
        """What is said of rows that contradict all others."""
        if not self.outliers:
            return []
        rows = "1 row contradicts" if self.outliers == 1 else f"{self.outliers} rows contradict"
        many = self.outliers > _FEW * len(self.q)
        late = f"; {self._late}" if many and self.explained and self._late else ""
        return [f"{rows} all others: left out{late}"]

    @cached_property
    def _late(self) -> str:
        """What is said of positions that follow the joints by some rows, "" where they do not."""
        lag = lag_of(self.reference, self.q, self.x - self.moved_offset)
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
    rows = comparable(model, log)
    q = model.motor.scale.from_unit(rows.u)
    body = seen_body(model) if model.body is None else model.body
    predicted = body.predict(q)
    offset = model.predictor.value(rows.u) - predicted
    if not (np.abs(predicted) + np.abs(offset) < _SQUARED).all():  # as in a forged file
        raise ModelError("the model predicts no finite positions for this log: train it again")
    return Comparison(model, rows, q, rows.x, offset, body, cause, log.unit, log.shared)
