"""Evidence: the tests, the bound and the explanations of a log, weighed together.

Orientations show how the tool is turned, where the log has them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ..arm.rotations import exponential, logarithm, matrix_of
from ..body.belief import Body, knows_orientation
from ..body.covariance import Z95
from ..body.fit import Fit
from ..body.parameters import Prior
from ..body.rows import Rows
from ..body.settings import FLAT_SD, STUDENT
from ..body.structure import Structure
from ..common.arrays import Array
from ..common.rows import median_length
from ..common.wording import quantity
from ..model.alignment import Alignment
from ..samples.diagnosis import rows_behind
from .causes import Cause, indices_of, is_sensors
from .explain import MARGIN, explain
from .explanation import Explanation
from .frame import Reference
from .noise import FALSE_ALARM, Play
from .rows import LogRows
from .significance import BoundTest, GroupTests
from .steps import Step
from .system import Nuisance, System

TOOL = "tool"  # group of the tool's position


@dataclass(frozen=True)
class EvidenceSettings:
    """When a log is explained."""

    # share of the positions' spread: no hypothesis explains a log that is further off from all
    unexplained: float = 0.1
    # score of a discrete change, or of one within the log
    discrete: float = 2.0
    # sizes of a change that no cause names, over the residuals
    unnamed_sizes: tuple[float, ...] = (1.0, 2.0, 4.0)
    # most rows used to find how the tool is turned
    tool_rows: int = 600


EVIDENCE = EvidenceSettings()


@dataclass(frozen=True)
class ToolTurn:
    """How the tool of a log is turned, relative to a belief."""

    # statistic over its threshold; 0 where there are no orientations
    score: float = 0.0
    # (3,) [rad], in the tool's own axes
    turn: Array = field(default_factory=lambda: np.zeros(3))
    covariance: Array = field(default_factory=lambda: np.zeros((3, 3)))

    @property
    def cause(self) -> Cause:
        """The turn of the tool about its own tip as a cause."""
        angle = float(np.linalg.norm(self.turn))
        variance = self.turn @ self.covariance @ self.turn
        half = Z95 * float(np.sqrt(variance)) / angle
        size = quantity(angle, "rad", half)
        words = f"the tool is turned by {size} (its orientation, not its place)"
        cause = Cause("tool", "tool.rotation", words, angle, unit="rad")
        return cause.within(half)

    def of(self, body: Body) -> Body:
        """The belief with the tool turned."""
        structure = body.structure
        tool = structure.groups["tool.rotation"]
        root = body.root.copy()
        root[np.isin(body.active, tool)] = 0.0
        beta = structure.after_step(body.beta, tool, self.turn)
        turned = replace(body, beta=beta, root=root)
        return turned.with_covariance(tool, self.covariance / body.kappa**2)


def tool_turn(
    rows: LogRows,
    structure: Structure,
    beta: Array,
    deviation: Array | None = None,
) -> ToolTurn:
    """Compare orientations with those that parameters (d,) predict.

    deviation : (d,), standard deviations of the parameters; where they are given, the sensor may be
        turned, too, since positions show that less well
    """
    from scipy.special import chdtri

    old = rows.body
    rows = rows.at_most(EVIDENCE.tool_rows)
    if rows.log.orientation is None or not knows_orientation(old):
        return ToolTurn()
    tool = structure.groups["tool.rotation"]
    sd = np.zeros(len(beta))
    if deviation is not None:
        sd = deviation.copy()
        sd[structure.groups["view.rotation"]] = FLAT_SD
    sd[tool] = FLAT_SD
    fit = _fit_to_poses(rows, rows.log.orientation, structure, Prior(beta, sd))
    before, after = exponential(np.stack([beta[tool], fit.beta[tool]]))
    turn = logarithm(before.T @ after)
    indices = np.searchsorted(fit.active, tool)
    covariance = fit.covariance[np.ix_(indices, indices)]
    # how well the model knows its own tool
    indices = np.searchsorted(old.active, tool)
    prior = old.kappa**2 * old.covariance[np.ix_(indices, indices)]
    square = float(turn @ np.linalg.solve(covariance + prior, turn))
    by_chance = square / float(chdtri(3, FALSE_ALARM))
    # the chain's own errors differ between regions of the workspace by about their scatter
    scatter = np.sqrt(3) * fit.noise[-1]
    by_scatter = float(np.linalg.norm(turn) / scatter)
    score = min(by_chance, by_scatter)
    return ToolTurn(score, turn, covariance)


def _fit_to_poses(
    rows: LogRows, orientation: Array, structure: Structure, prior: Prior
) -> Fit:
    """Fit the parameters to the rows' orientations alone, without their positions."""
    turns = logarithm(matrix_of(orientation))
    poses = np.hstack([rows.x, turns])
    floor = np.repeat([FLAT_SD**2 * structure.extent, 1e-9], 3)
    measured = [Rows(rows.q, poses, floor=floor)]
    poser = structure.with_sensor(view="pose")
    fit = Fit(poser, measured, prior.mean, prior, nu=STUDENT)
    return fit.maximise()


@dataclass(frozen=True, eq=False)
class Evidence:
    """The evidence of a log about a belief.

    The properties build on one another in their order; those from `best` on need explanations.
    """

    # rows of the log that do not contradict the others, predicted by body and maps
    rows: LogRows
    # {"sensor", "joints", "offsets"} or None, what is known about the change
    cause: str | None
    prior: Body  # the belief that a changed arm starts from
    reference: Reference  # the prior in the frame of the log
    # the rows as a body alone is compared with them: without the maps' offset, and with the joints
    # at their true values under `play`
    observations: LogRows
    tests: GroupTests
    bound: BoundTest
    unnamed_log_evidence: float  # of a smooth change that no cause names [nats]
    play: Play | None = None  # of a joint, beyond what the model knows
    explanations: tuple[Explanation, ...] = ()  # the best first
    step: Step | None = None  # a change within the log

    @property
    def unit(self) -> str:
        """Unit of the positions; "sensor" where their scale shows that it is not the model's."""
        unit = self.rows.unit
        same = self.reference.scale == 1.0 or unit != self.rows.model.about.unit
        return unit if same else "sensor"

    @property
    def test_score(self) -> float:
        """Largest score of the tests for a change, above 1 if something changed."""
        if self.reference.has_discrete_cause:
            return max(self.tests.score, EVIDENCE.discrete)
        return self.tests.score

    @property
    def fired(self) -> bool:
        """Whether a test fired, so that causes are searched."""
        return self.test_score > 1.0 or not self.bound.holds

    @property
    def best(self) -> Explanation:
        """The explanation of the greatest evidence."""
        return self.explanations[0]

    @property
    def change(self) -> Array:
        """Change (d,) of the parameters by the best explanation."""
        return self.best.beta - self.prior.beta

    @cached_property
    def misfit(self) -> float:
        """Median distance of the rows from the best explanation, over that from their middle."""
        spread = median_length(self.rows.x - np.median(self.rows.x, axis=0))
        return median_length(self.best.residual) / max(spread, 1e-300)

    @cached_property
    def is_explained(self) -> bool:
        """Whether the best explanation is near the rows, measured by their spread or the bound.

        The bound counts only where few rows are strays: of rows that lag, or whose joints are
        exchanged, those at each jump are left out as strays.
        """
        if self.misfit < EVIDENCE.unexplained:
            return True
        distance = median_length(self.best.residual)
        return self.rows.has_few_strays and distance < self.bound.usual < np.inf

    @cached_property
    def is_one_place(self) -> bool:
        """Whether the tip hardly moves compared with the noise of the rows' mean."""
        predicted = self.rows.predicted
        spread = median_length(predicted - np.median(predicted, axis=0))
        noise = median_length(self.best.residual) / math.sqrt(len(predicted))
        return spread < noise

    @cached_property
    def is_better(self) -> bool:
        """Whether a change explains the rows clearly better than no change does.

        log p(y | best change) - log p(y | no change) > MARGIN, and the change is not clearly worse
        than one without a name.
        """
        if not self.is_explained or self.is_one_place:
            return False
        if self.reference.has_discrete_cause:
            return True
        best = self.best.log_evidence
        no_change = [
            e.log_evidence for e in self.explanations if e.is_no_change
        ]
        gain = best - max(no_change, default=-np.inf)
        return gain > MARGIN and best > self.unnamed_log_evidence - MARGIN

    @cached_property
    def score(self) -> float:
        """Score of the whole evidence; above 1 the arm or its sensor changed.

        A log that nothing explains has a score of at least 1 + misfit.  One that contradicts the
        bound has at least 1 + the share of the rows beyond it: where errors repeat, or where a
        change explains the rows better than none.
        """
        score = self.test_score
        if self.fired and not self.is_explained:
            score = max(score, 1.0 + self.misfit)
        is_contradicted = self.bound.is_contradicted and self.play is None
        if self.is_better and not self.bound.holds:
            is_contradicted |= self.tests.noisy_joint is None
        if is_contradicted:
            score = max(score, 1.0 + self.bound.beyond)
        if self.step is not None:
            score = max(score, EVIDENCE.discrete)
        return score

    @property
    def is_attributed(self) -> bool:
        """Whether one change explains the rows clearly better than none, all along the log."""
        return self.is_better and self.score > 1.0 and self.step is None

    @cached_property
    def tool(self) -> ToolTurn:
        """How the tool is turned, given the explanation of the positions if there is one."""
        structure = self.reference.structure
        if self.is_attributed:
            best = self.best
            return tool_turn(self.rows, structure, best.beta, best.deviation)
        return tool_turn(self.rows, structure, self.rows.body.beta)

    def why_not(self) -> str:
        """Why nothing explains the log, in one line."""
        reference = self.reference
        q = self.rows.q
        predicted = reference.structure.predict(q, reference.beta)
        lag = rows_behind(q, predicted, self.observations.x)
        check = "check that joints and positions of a row belong together and are of this arm"
        if lag:
            check = f"positions follow the joints by {lag} rows: align the clocks of both"
        return (
            f"nothing explains the log: its positions are {100 * self.misfit:.0f} % of their "
            f"spread away from any change of the arm or the sensor; {check}"
        )


def unnamed_log_evidence(system: System) -> float:
    """Log evidence of a smooth change that no cause names, of its most likely size [nats].

    Infinitely small where the sensor's frame was fitted to the log: that change has a name.
    """
    if system.reference.is_fitted:
        return -np.inf
    rms = np.sqrt((system.y**2).mean()) * system.reference.expected_noise
    likelihoods = []
    for size in EVIDENCE.unnamed_sizes:
        nuisance = Nuisance(system, residual_sd=size * rms)
        statistics = nuisance.statistics(system.y)
        _, likelihood = statistics.noises()
        likelihoods.append(float(likelihood.max()))
    return max(likelihoods) / system.observations.correlation_time


def with_orientations(
    evidence: Evidence, systems: Sequence[System]
) -> Evidence:
    """The evidence, its best explanation one that the orientations support, if there is one.

    Positions alone may take a turned camera for a joint's offset, which would turn the tool, too.
    An offset of the last joint turns the tool but hardly moves it: positions alone may not show it.
    """
    if evidence.score <= 1.0 or evidence.tool.score <= 1.0:
        return evidence
    if not evidence.is_attributed:
        explanations = _by_orientations(evidence)
        return replace(evidence, explanations=explanations)
    cause = evidence.cause
    if cause not in (None, "joints") or TOOL in evidence.best.groups:
        return evidence
    explanations = explain(systems, cause, calm=False, certain_groups=(TOOL,))
    return replace(evidence, explanations=explanations)


def _by_orientations(evidence: Evidence) -> tuple[Explanation, ...]:
    """The explanations, with the best change that also explains the tool's turn moved first."""
    structure = evidence.reference.structure
    changes = [e for e in evidence.explanations if e.causes]
    least = evidence.best.log_evidence - MARGIN
    for change in changes:
        tool = tool_turn(
            evidence.rows, structure, change.beta, change.deviation
        )
        if change.log_evidence > least and tool.score <= 1.0:
            others = [other for other in changes if other is not change]
            return (change, *others)
    return evidence.explanations


def frame_between(evidence: Evidence, beta: Array) -> Alignment:
    """The sensor's new frame at parameters (d,), as an affine map of the old one.

    The lens stays as it was: one that is bent by a corner's rows may fold over elsewhere.
    """
    structure = evidence.reference.structure
    probes = evidence.rows.probes
    mixed = evidence.prior.beta.copy()
    of_frame = filter(is_sensors, set(structure.groups) - {"lens"})
    sensors = indices_of(structure, of_frame)
    mixed[sensors] = beta[sensors]
    before = evidence.rows.body.predict(probes)
    after = structure.predict(probes, mixed)
    position = structure.position
    return Alignment.between(before[:, position], after[:, position])
