"""Comparison: a log beside a model, as `check`, `adapt` and their words for it see it.

One comparison holds the rows that count, the belief that they are compared with, the frame that
they were measured in, and how well each hypothesis explains them.  What several uses need is found
once, when it is first asked for.  Maps alone, without a body, are compared with their bound.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np

from ..body.belief import Body
from ..body.covariance import autocorrelation_time
from ..common.arrays import Array, Mask
from ..errors import ModelError
from ..model.model import Model
from ..samples.alignment import rows_behind
from ..samples.samples import Samples
from .comparable import Comparable, comparable
from .equations import Log, shared_columns, weighted
from .explain import Explanation, changed, explain
from .frame import Reference, carried_offset, kept_reference, reference_of
from .hypotheses import as_built
from .score import GroupTest, Tested, group_tests
from .settings import BEYOND, FALSE_ALARM, FEW, FEW_WRONG, OUTLIER, UNEXPLAINED
from .sockets import as_positions

BOUND = "bound"
"""Name of the test whether the model's own bound holds."""

_PROBES = 120  # joints all over the learned range at which predictions are compared
_WIDE = 0.5  # least spread of rows in any direction, over that of the learned range
_CELLS = 5  # along each joint, for the share of the range that a log measured
_SHARED_ERRORS = 2.0  # times a bound of 95 %: five standard deviations, so no chance at all
_LASTING = 10  # rows over which noise may last
_SQUARED = 1e100  # positions beyond overflow where they are squared


@dataclass(frozen=True, eq=False)
class Comparison:
    """A log beside a model."""

    model: Model
    rows: Comparable
    predicted: Array  # (n, m) [unit], positions that the model predicts
    cause: str | None  # {"sensor", "joints"} or None, what the user knows about the change
    unit: str  # unit of the log's positions
    shared: float = 0.0  # [unit], standard deviation that all of them share

    @property
    def u(self) -> Array:
        """Joints (n, dof) in the unit box."""
        return self.rows.u

    @property
    def q(self) -> Array:
        """Joints (n, dof) [rad or m]."""
        return self.rows.q

    @property
    def x(self) -> Array:
        """Positions (n, m) [unit]."""
        return self.rows.x

    @property
    def body(self) -> Body:
        """The belief of the model, where it has one."""
        assert self.model.body is not None  # noqa: S101 - maps alone are compared with their bound
        return self.model.body

    @cached_property
    def offset(self) -> Array:
        """What maps add to the body at the rows, (n, m) [unit]."""
        return self.predicted - self.body.predict(self.q)

    @property
    def missed(self) -> Array:
        """Distance of the rows from their prediction, (n,) [unit]."""
        return np.asarray(np.linalg.norm(self.x - self.predicted, axis=1))

    @property
    def unit_seen(self) -> str:
        """Unit of the positions; "sensor" where their scale shows that it is not the model's."""
        same = self.model.body is None or self.reference.scale == 1.0
        told = self.unit != self.model.about.unit or same
        return self.unit if told else "sensor"

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
        """Rows with robust weights."""
        # the model's own log shares as much
        shared = float(np.sqrt(2.0)) * self.shared
        return weighted(self.reference, self.q, self.x - self.moved_offset, self.cause, shared)

    @cached_property
    def moved_offset(self) -> Array:
        """What maps add to the body, in the frame of the log, (n, m)."""
        to = self.reference
        if not to.new:
            return self.offset
        return carried_offset(self.body, to.body, to.beta, self.q, self.offset)

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
        return self.rows.wrong + int(np.count_nonzero(~self.kept))

    @property
    def left_out(self) -> int:
        """Rows of the log that are wrong, or outside of what the model has learned."""
        return self.rows.left_out + int(np.count_nonzero(~self.kept))

    @cached_property
    def spans(self) -> bool:
        """Whether the rows vary in every direction of the joints, as over the learned range.

        Held-out rows of a line or a corner say nothing of a prediction elsewhere.
        """
        spread = np.cov(self.model.motor.scale.to_unit(self.q).T)
        # along each axis the variance of uniform rows is 1 / 12
        return bool(np.linalg.eigvalsh(np.atleast_2d(spread))[0] > _WIDE**2 / 12.0)

    @property
    def coverage(self) -> float:
        """Share of the learned range, in cells of a fifth of each joint's range, that rows visit.

        Six joints have 15,625 cells, which no log visits: of more than three joints it is the mean
        over all pairs of joints.
        """
        u = np.clip(self.model.motor.scale.to_unit(self.q), 0.0, 1.0 - 1e-12)
        cells, dof = (u * _CELLS).astype(int), u.shape[1]
        some = combinations(range(dof), 2) if dof > 3 else [tuple(range(dof))]
        shares = [len(np.unique(cells[:, ix], axis=0)) / _CELLS ** len(ix) for ix in some]
        return float(np.mean(shares))

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
    def groups(self) -> tuple[GroupTest, ...]:
        """All tests, that of the model's bound the last."""
        return (*self.tested.groups, self.bound_test)

    @cached_property
    def _told(self) -> Array:
        """95 % bound [unit] on each row, as the model tells it; infinite where it does not."""
        told = np.nan_to_num(self.model.expected_error(self.q), nan=np.inf)
        if self.model.body is None:  # a corner's rows share the errors of a few nodes
            return np.asarray(_SHARED_ERRORS * told)
        return np.maximum(told, self.belief.bound(self.q))

    @property
    def beyond(self) -> float:
        """Share of the rows beyond what the model told."""
        told = self._told**2 + self._radius * self._common
        return float(np.mean((self.missed**2 > told)[self.kept]))

    @cached_property
    def _common(self) -> Array:
        """Variance (n,) of an axis by what all rows share: model's frame and the log's own."""
        if not self.shared or self.model.body is None:
            return np.full(len(self.x), self.shared**2)
        columns = shared_columns(self.reference, self.log, self.log.z)
        return np.asarray((columns**2).sum(axis=(1, 2)) / columns.shape[1])

    @property
    def _radius(self) -> float:
        """Squared radius of 95 % of a Gaussian, in units of a deviation."""
        from scipy.special import chdtri

        return float(chdtri(self.x.shape[1], 0.05))

    @cached_property
    def bound_test(self) -> GroupTest:
        """How surely too many rows lie beyond what the model told, in logarithms of chances.

        Even if all of the log's own scatter is noise of the sensor or of one encoder, which is no
        drift; but what rows of like joints share is no noise.
        """
        from scipy.special import bdtrc, chdtri

        kept, radius = self.kept, self._radius
        gap = self.missed[kept]
        more = max(self.tested.noise**2 - self.tested.usual**2, 0.0)
        if len(gap) < FEW:  # half of the rows of a noisier sensor are nearer than its median
            half = float(np.median(gap)) ** 2 / float(chdtri(self.x.shape[1], 0.5))
            more = max(more, half - self.tested.usual**2)
        if more and self._shared_by_neighbours:
            more = 0.0
        told = self._told[kept] ** 2 + radius * (self._common[kept] + more)
        if self.tested.noisy is not None:
            joint, sd = self.tested.noisy
            slope = self.body.structure.slope(self.q[kept], self.body.beta)[..., joint]
            told = told + radius * sd**2 * (slope**2).sum(axis=1)
        over = gap**2 > told
        # rows that err together count once
        alike = autocorrelation_time(over[:, None].astype(float)) if over.any() else 1.0
        count, n = int(over.sum() / alike), int(np.ceil(len(over) / alike))
        p = max(float(bdtrc(count - 1, n, BEYOND)) if count else 1.0, 1e-300)
        none = np.zeros(0, dtype=np.intp)
        return GroupTest(BOUND, -2 * math.log(p), -2 * math.log(FALSE_ALARM), p, none)

    @cached_property
    def _shared_by_neighbours(self) -> bool:
        """Whether rows of like joints err alike, by more than the model told: that is no noise.

        A ripple of 2 mm, too short for the smooth residual of a log, passed for noise.  Pairs lie
        apart in time, so that noise that lasts over some rows is not taken for it.
        """
        from scipy.spatial import cKDTree
        from scipy.special import ndtri

        kept = np.flatnonzero(self.kept)
        u, residual = self.u[kept], (self.x - self.predicted)[kept]
        # of so many rows at least one is no neighbour in time
        near = np.asarray(cKDTree(u).query(u, min(2 * _LASTING + 2, len(u)))[1])
        later = np.abs(kept[near] - kept[:, None]) > _LASTING
        row = np.flatnonzero(later.any(axis=1))
        if not len(row):
            return False
        pairs = np.stack([row, near[row, later[row].argmax(axis=1)]], axis=1)
        first, second = np.unique(np.sort(pairs, axis=1), axis=0).T
        product = (residual[first] * residual[second]).sum(axis=1)
        # whatever its size, noise makes either sign as likely
        sure = product.sum() > -ndtri(FALSE_ALARM) * np.linalg.norm(product)
        variance = float(product.mean()) / residual.shape[1]  # per axis
        told = float(np.median(self._told[kept])) ** 2
        return bool(sure and self._radius * variance > told)

    @property
    def unexpected(self) -> bool:
        """Whether no group explains that more rows are beyond the bound than it can mean."""
        new = self.model.body is not None and self.reference.new
        return not new and self.tested.score <= 1.0 < self.bound_test.score

    @cached_property
    def explanations(self) -> tuple[Explanation, ...]:
        """Members with their evidence, best first; of a log that shows no change, that of none."""
        if not self._suspect:
            return self._calm
        return explain(self.reference, self.log, self.cause)

    @cached_property
    def _calm(self) -> tuple[Explanation, ...]:
        """Explanations by no change."""
        return explain(self.reference, self.log, self.cause, calm=True)

    @cached_property
    def score(self) -> float:
        """How far the log is from an arm and a sensor as they were: above 1 they changed."""
        score = max(self.tested.score, self.bound_test.score)
        if self.model.body is None:
            return score
        score = max(score, 2.0 if self.reference.new else 0.0)
        if self._suspect and not self.explained:
            return max(score, 1.0 + self.misfit)
        return score

    @cached_property
    def _suspect(self) -> bool:
        """Whether a test fires, or half of the rows are further off than the model told."""
        fired = max(self.tested.score, self.bound_test.score) > 1.0
        return self.reference.new or fired or self.beyond > 0.5

    @cached_property
    def changed(self) -> bool:
        """Whether something changed, and a hypothesis explains the log better than no change.

        Evidence alone took what few rows had not told of an unchanged arm for waves of its joints:
        wherever nothing was measured they did harm.
        """
        if self.model.body is None:
            return self.score > 1.0
        return self.reference.new or (self.score > 1.0 and changed(self.explanations))

    @cached_property
    def spread(self) -> float:
        """Typical distance of positions from their middle [unit]."""
        return float(np.median(np.linalg.norm(self.x - np.median(self.x, axis=0), axis=1)))

    @cached_property
    def _left(self) -> float:
        """Typical distance of the rows from the best explanation [unit]."""
        return float(np.median(np.linalg.norm(self.explanations[0].residual, axis=1)))

    @property
    def misfit(self) -> float:
        """Typical distance of the rows from the best explanation, over the spread of positions."""
        return self._left / max(self.spread, 1e-300)

    @property
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
            return list(self.rows.notes)
        rows = "1 row contradicts" if wrong == 1 else f"{wrong} rows contradict"
        many = self.outliers > FEW_WRONG * len(self.q)
        late = f"; {self._late}" if many and self.explained and self._late else ""
        return [*self.rows.notes, f"{rows} all others: left out{late}"]

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
    rows = rows._replace(notes=(*told, *rows.notes))
    predicted = model.predictor.value(rows.u)
    alone = predicted if model.body is None else model.body.predict(rows.q)
    if not (np.abs([predicted, alone]) < _SQUARED).all():  # as in a forged file
        raise ModelError("the model predicts no finite positions for this log: train it again")
    return Comparison(model, rows, predicted, cause, log.unit, log.shared)
