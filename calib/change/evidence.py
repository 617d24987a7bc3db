"""Evidence: the tests, the bound and the explanations of a log, weighed together.

`bound_test` counts the rows beyond the model's bound; `Evidence.score` says whether something
changed, `Evidence.is_attributed` whether a change of the arm or the sensor explains it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..body.belief import Body
from ..body.covariance import autocorrelation_time
from ..common.arrays import Array, Mask
from ..common.rows import median_length
from ..samples.diagnosis import rows_behind
from .explain import explain
from .explanation import Explanation
from .frame import Reference
from .observations import Observations
from .rows import LogRows
from .settings import BEYOND, FALSE_ALARM, MARGIN
from .significance import GroupTest, GroupTests
from .system import System
from .tool import ToolTurn, tool_turn

TOOL = "tool"  # the group of where it is


@dataclass(frozen=True)
class EvidenceSettings:
    """When a log is explained."""

    # rows over which noise may last
    lasting: int = 10
    # share of the positions' spread: a log that is further off from every hypothesis is explained
    # by none
    unexplained: float = 0.1
    # share of rows that may contradict all others where the rest is as near as told
    few_wrong: float = 0.05


EVIDENCE = EvidenceSettings()


@dataclass(frozen=True)
class BoundTest:
    """The rows that are beyond the model's own 95 % bound."""

    beyond: float  # share of them
    usual: float  # median of the bounds [unit]
    test: GroupTest  # the chance of so many by noise

    @property
    def holds(self) -> bool:
        """Whether they are about as many as usual."""
        return self.beyond <= BEYOND and self.test.score <= 1.0

    def words(self, *, noisier: bool) -> str:
        """The share in words; `noisier` if noise may be all there is to it."""
        cause = "a noisier sensor or encoder, " if noisier else ""
        return (
            f"{100 * self.beyond:.0f} % of the rows are further from the prediction than its "
            f"bound, where 5 % should be: {cause}the bound does not hold"
        )


def bound_test(
    rows: LogRows, limit: Array, shared: Array | float, tests: GroupTests
) -> BoundTest:
    """Count the rows beyond the 95 % bound, beside what a noisier sensor or encoder would do.

    rows : n of them that do not contradict all others
    limit : (n,), the bound of each row [unit]
    shared : (n,), variance of what all rows share [unit^2]
    """
    from scipy.special import chdtri

    residual = rows.x - rows.predicted
    square = (residual**2).sum(axis=1)
    usual = float(np.median(limit))
    # squared, of 95 % of a Gaussian, in deviations
    radius = float(chdtri(residual.shape[1], 0.05))
    noise = _noise_of_sensor(square, residual.shape[1], tests)
    # rows of like joints that err alike are no noisier sensor
    if noise > 0.0 and variance_of_places(rows, residual) * radius > usual**2:
        noise = 0.0
    variance = noise + _noise_of_joint(rows, tests)
    by_more_noise = square > limit**2 + radius * (shared + variance)
    beyond = float(np.mean(square > limit**2 + radius * shared))
    return BoundTest(beyond, usual, GroupTest("bound", _chance(by_more_noise)))


def _chance(beyond: Mask) -> float:
    """Chance (binomial) of so many rows (n,) beyond a bound that as many as usual may exceed.

    Rows that err together count once.
    """
    from scipy.special import bdtrc

    if not beyond.any():
        return 1.0
    time = autocorrelation_time(beyond[:, None].astype(float))
    count = int(beyond.sum() / time)
    independent = math.ceil(len(beyond) / time)
    return float(bdtrc(count - 1, independent, BEYOND)) if count else 1.0


def _noise_of_sensor(square: Array, outputs: int, tests: GroupTests) -> float:
    """Variance of an axis [unit^2] beyond the usual one, of squared distances (n,)."""
    from scipy.special import chdtri

    # half of the rows of a noisier sensor are nearer than its median
    median = float(np.median(square)) / float(chdtri(outputs, 0.5))
    return max(max(tests.noise**2, median) - tests.usual**2, 0.0)


def _noise_of_joint(rows: LogRows, tests: GroupTests) -> Array:
    """Variance (n,) [unit^2] of the rows by a joint whose encoder is noisy."""
    if tests.noisy is None:
        return np.zeros(len(rows))
    joint, sd = tests.noisy
    body = rows.body
    slope = body.structure.slope(rows.q, body.beta)
    moves = slope[..., joint] ** 2
    variance: Array = sd**2 * moves.sum(axis=1)
    return variance


def variance_of_places(rows: LogRows, residual: Array) -> float:
    """Variance of an axis by which rows of like joints err alike, 0 where that may be chance."""
    from scipy.spatial import cKDTree
    from scipy.special import ndtri

    # of so many rows at least one is no neighbour in time: noise may last over some rows
    lasting = EVIDENCE.lasting
    count = min(2 * lasting + 2, len(rows))
    _, neighbours = cKDTree(rows.u).query(rows.u, count)
    near = np.asarray(neighbours)
    index = np.arange(len(rows))
    later = np.abs(near - index[:, None]) > lasting
    row = np.flatnonzero(later.any(axis=1))
    if not len(row):
        return 0.0
    other = near[row, later[row].argmax(axis=1)]
    pairs = np.sort(np.stack([row, other], axis=1), axis=1)
    first, second = np.unique(pairs, axis=0).T
    product = (residual[first] * residual[second]).sum(axis=1)
    # whatever its size, noise makes either sign as likely
    sure = product.sum() > -ndtri(FALSE_ALARM) * np.linalg.norm(product)
    return float(product.mean()) / residual.shape[1] if sure else 0.0


@dataclass(frozen=True, eq=False)
class Evidence:
    """What a log says of a belief."""

    rows: LogRows
    # {"sensor", "joints", "offsets"} or None, what is known about the change
    cause: str | None
    prior: Body  # the belief that a changed arm starts from
    reference: Reference  # the same in the frame of the log
    observations: Observations
    tests: GroupTests
    bound: BoundTest
    explanations: tuple[Explanation, ...]  # the best first

    @property
    def unit(self) -> str:
        """Unit of the positions; "sensor" where their scale shows that it is not the model's."""
        unit = self.rows.unit
        same = self.reference.scale == 1.0 or unit != self.rows.model.about.unit
        return unit if same else "sensor"

    @property
    def distance(self) -> float:
        """Typical distance of the rows from the best explanation [unit]."""
        return median_length(self.explanations[0].residual)

    @property
    def misfit(self) -> float:
        """The same as a share of the typical distance of the positions from their middle."""
        away = self.rows.x - np.median(self.rows.x, axis=0)
        return self.distance / max(median_length(away), 1e-300)

    @cached_property
    def is_explained(self) -> bool:
        """Whether an explanation comes near the rows: to a part of their spread, or the bound."""
        if self.misfit < EVIDENCE.unexplained:
            return True
        # rows that lag or whose joints are exchanged come near too, but for those at each jump
        count = len(self.rows) + self.rows.wrong
        few = self.rows.wrong <= EVIDENCE.few_wrong * count
        return few and self.distance < self.bound.usual < np.inf

    @cached_property
    def is_better_than_none(self) -> bool:
        """Whether a change explains the rows, and by `MARGIN` nats better than none."""
        if not self.is_explained:
            return False
        none = [e.evidence for e in self.explanations if e.is_no_change]
        gain = self.explanations[0].evidence - MARGIN
        is_better = gain > max(none, default=-np.inf)
        return self.reference.has_discrete_cause or is_better

    @cached_property
    def score(self) -> float:
        """Above 1 the arm or its sensor changed: the largest score of what may say so."""
        bound_fails = self.bound.beyond > BEYOND
        scores = [self.tests.score, self.bound.test.score]
        if self.reference.has_discrete_cause:
            scores.append(2.0)
        if not self.is_explained and (bound_fails or max(scores) > 1.0):
            scores.append(1.0 + self.misfit)
        if (
            self.is_better_than_none
            and bound_fails
            and self.tests.noisy is None
        ):
            scores.append(1.0 + self.bound.beyond)
        return max(scores)

    @property
    def is_attributed(self) -> bool:
        """Whether something changed, and a change is clearly better than none."""
        return self.is_better_than_none and self.score > 1.0

    @cached_property
    def tool(self) -> ToolTurn:
        """How the tool is turned beside the best explanation of the positions, as far as sure."""
        if not self.is_attributed:
            return self.tool_beside(self.rows.body.beta)
        best = self.explanations[0]
        structure = self.reference.structure
        return tool_turn(self.rows, structure, best.beta, best.deviation)

    def tool_beside(self, beta: Array) -> ToolTurn:
        """How the tool is turned beside what parameters (d,) predict."""
        return tool_turn(self.rows, self.reference.structure, beta)

    def why_not(self) -> str:
        """One line on a log that nothing explains."""
        reference = self.reference
        lag = rows_behind(
            lambda q: reference.structure.predict(q, reference.beta),
            self.rows.q,
            self.observations.z,
        )
        check = "check that joints and positions of a row belong together and are of this arm"
        if lag:
            check = f"positions follow the joints by {lag} rows: align the clocks of both"
        return (
            f"nothing explains the log: its positions are {100 * self.misfit:.0f} % of their "
            f"spread away from any change of the arm or the sensor; {check}"
        )


def with_orientations(
    evidence: Evidence, systems: Sequence[System], temper: float
) -> Evidence:
    """Evidence whose best explanation orientations do not contradict, as far as there is one.

    A camera that is turned moves what it sees: positions alone may call that a joint's offset,
    which the tool would have to be turned back by.  An offset of the last joint turns the tool, and
    hardly moves it: positions alone may call that no change.
    """
    cause = evidence.cause
    if evidence.score <= 1.0 or evidence.tool.score <= 1.0:
        return evidence
    if not evidence.is_attributed:
        return _by_orientations(evidence)
    if cause not in (None, "joints"):
        return evidence
    if TOOL in evidence.explanations[0].groups:
        return evidence
    explanations = explain(
        systems, cause, temper=temper, calm=False, turned=(TOOL,)
    )
    return replace(evidence, explanations=explanations)


def _by_orientations(evidence: Evidence) -> Evidence:
    """The evidence where the best change by which the tool stands as it should is blamed."""
    structure = evidence.reference.structure
    changes = [some for some in evidence.explanations if some.causes]
    least = evidence.explanations[0].evidence - MARGIN
    for best in changes:
        tool = tool_turn(evidence.rows, structure, best.beta, best.deviation)
        if best.evidence > least and tool.score <= 1.0:
            others = [some for some in changes if some is not best]
            return replace(evidence, explanations=(best, *others))
    return evidence
