"""Evidence: the tests, the bound and the explanations of a log, weighed together.

Orientations then show how the tool is turned.
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
from ..body.settings import FREE, STUDENT
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

TOOL = "tool"  # the group of where it is


@dataclass(frozen=True)
class EvidenceSettings:
    """When a log is explained."""

    # share of the positions' spread: a log that is further off from every hypothesis is explained
    # by none
    unexplained: float = 0.1
    # score of a mirror, another sense or unit, or a change within the log: no matter of chance
    discrete: float = 2.0
    # sizes of a change that no cause names, over what the rows are missed by
    unnamed: tuple[float, ...] = (1.0, 2.0, 4.0)
    # most rows used to find how the tool is turned
    tool_rows: int = 600


EVIDENCE = EvidenceSettings()


@dataclass(frozen=True)
class ToolTurn:
    """How the tool of a log is turned, relative to a belief."""

    # statistic over its threshold; 0 where nothing can be compared
    score: float = 0.0
    # (3,) [rad], in the tool's own axes
    turn: Array = field(default_factory=lambda: np.zeros(3))
    covariance: Array = field(default_factory=lambda: np.zeros((3, 3)))

    @property
    def cause(self) -> Cause:
        """A tool that is turned about its own tip."""
        angle = float(np.linalg.norm(self.turn))
        variance = self.turn @ self.covariance @ self.turn
        half = Z95 * float(np.sqrt(variance)) / angle
        size = quantity(angle, "rad", half)
        words = f"the tool is turned by {size} (its orientation, not its place)"
        cause = Cause("tool", "tool.rotation", words, angle, unit="rad")
        return cause.within(half)

    def of(self, body: Body) -> Body:
        """A belief with the tool turned."""
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

    deviation : (d,), standard deviations of the parameters, which may turn the tool, too; the
        sensor may be turned then: positions show that less well
    """
    from scipy.special import chdtri

    old = rows.body
    rows = rows.some(EVIDENCE.tool_rows)
    if rows.log.orientation is None or not knows_orientation(old):
        return ToolTurn()
    tool = structure.groups["tool.rotation"]
    sd = np.zeros(len(beta))
    if deviation is not None:
        sd = deviation.copy()
        sd[structure.groups["view.rotation"]] = FREE
    sd[tool] = FREE
    fit = _fit_to_poses(rows, rows.log.orientation, structure, Prior(beta, sd))
    before, after = exponential(np.stack([beta[tool], fit.beta[tool]]))
    turn = logarithm(before.T @ after)
    place = np.searchsorted(fit.active, tool)
    covariance = fit.covariance[np.ix_(place, place)]
    # the model knows its own tool as well as it does
    place = np.searchsorted(old.active, tool)
    prior = old.kappa**2 * old.covariance[np.ix_(place, place)]
    square = float(turn @ np.linalg.solve(covariance + prior, turn))
    by_chance = square / float(chdtri(3, FALSE_ALARM))
    # what the chain leaves over differs between regions of the workspace by about its scatter
    scatter = np.sqrt(3) * fit.noise[-1]
    by_scatter = float(np.linalg.norm(turn) / scatter)
    score = min(by_chance, by_scatter)
    return ToolTurn(score, turn, covariance)


def _fit_to_poses(
    rows: LogRows, orientation: Array, structure: Structure, prior: Prior
) -> Fit:
    """The parameters by the rows' orientations alone, without their positions."""
    turns = logarithm(matrix_of(orientation))
    poses = np.hstack([rows.x, turns])
    floor = np.repeat([FREE**2 * structure.extent, 1e-9], 3)
    measured = [Rows(rows.q, poses, floor=floor)]
    poser = structure.with_sensor(view="pose")
    fit = Fit(poser, measured, prior.mean, prior, nu=STUDENT)
    return fit.maximise()


@dataclass(frozen=True, eq=False)
class Evidence:
    """The evidence of a log about a belief.

    Its properties follow from one another in their order; those below `best` need explanations.
    """

    rows: LogRows
    # {"sensor", "joints", "offsets"} or None, what is known about the change
    cause: str | None
    prior: Body  # the belief that a changed arm starts from
    reference: Reference  # the same in the frame of the log
    observations: LogRows
    tests: GroupTests
    bound: BoundTest
    unnamed: float  # evidence of a smooth change that no cause names [nats]
    play: Play | None = None  # of a joint, which the observations are freed of
    explanations: tuple[Explanation, ...] = ()  # the best first
    # of a change within the log, its row as the file counts
    step: Step | None = None

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
        """Whether causes are worth a search."""
        return self.test_score > 1.0 or not self.bound.holds

    @property
    def best(self) -> Explanation:
        """The explanation of the greatest evidence."""
        return self.explanations[0]

    @property
    def change(self) -> Array:
        """Change (d,) of the parameters by that."""
        return self.best.beta - self.prior.beta

    @cached_property
    def misfit(self) -> float:
        """Typical distance of the rows from the best explanation, over that from their middle."""
        spread = median_length(self.rows.x - np.median(self.rows.x, axis=0))
        return median_length(self.best.residual) / max(spread, 1e-300)

    @cached_property
    def is_explained(self) -> bool:
        """Whether the best explanation is near the rows: to a part of their spread, or the bound.

        Of rows that lag, or whose joints are exchanged, those at each jump are left out as wrong.
        """
        if self.misfit < EVIDENCE.unexplained:
            return True
        distance = median_length(self.best.residual)
        return self.rows.few_wrong and distance < self.bound.usual < np.inf

    @cached_property
    def is_one_place(self) -> bool:
        """Whether the tip hardly moves compared with the noise of the rows' mean."""
        predicted = self.rows.predicted
        moved = median_length(predicted - np.median(predicted, axis=0))
        noise = median_length(self.best.residual) / math.sqrt(len(predicted))
        return moved < noise

    @cached_property
    def is_better(self) -> bool:
        """Whether a change explains the rows, clearly better than none does.

        log p(y | best change) - log p(y | no change) > MARGIN, and not clearly worse than a change
        without a name.
        """
        if not self.is_explained or self.is_one_place:
            return False
        if self.reference.has_discrete_cause:
            return True
        evidence = self.best.evidence
        no_change = [e.evidence for e in self.explanations if e.is_no_change]
        gain = evidence - max(no_change, default=-np.inf)
        return gain > MARGIN and evidence > self.unnamed - MARGIN

    @cached_property
    def score(self) -> float:
        """Above 1 the arm or its sensor changed.

        A log that nothing explains has the score 1 + misfit, one that a change explains better
        than none, or whose rows repeat what they are missed by, 1 + share of the rows beyond a
        bound that fails.
        """
        score = self.test_score
        if self.fired and not self.is_explained:
            score = max(score, 1.0 + self.misfit)
        is_contradicted = self.bound.is_contradicted and self.play is None
        if self.is_better and not self.bound.holds:
            is_contradicted |= self.tests.noisy is None
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
        """How the tool is turned given the best explanation of the positions, as far as sure."""
        structure = self.reference.structure
        if self.is_attributed:
            best = self.best
            return tool_turn(self.rows, structure, best.beta, best.deviation)
        return tool_turn(self.rows, structure, self.rows.body.beta)

    def why_not(self) -> str:
        """One line on a log that nothing explains."""
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


def evidence_of_unnamed(system: System) -> float:
    """Evidence of a smooth change that no cause names, of its most likely size [nats].

    A sensor that was put elsewhere is no such change.
    """
    if system.reference.is_fitted:
        return -np.inf
    missed = np.sqrt((system.y**2).mean()) * system.reference.sizes
    evidences = []
    for times in EVIDENCE.unnamed:
        nuisance = Nuisance(system, residual_sd=times * missed)
        statistics = nuisance.statistics(system.y)
        _, likelihood = statistics.noises()
        evidences.append(float(likelihood.max()))
    return max(evidences) / system.observations.correlation_time


def with_orientations(
    evidence: Evidence, systems: Sequence[System]
) -> Evidence:
    """Evidence whose best explanation orientations do not contradict, as far as there is one.

    A camera that is turned moves what it sees: positions alone may call that a joint's offset,
    which the tool would have to be turned back by.  An offset of the last joint turns the tool, and
    hardly moves it: positions alone may call that no change.
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
    """The explanations, first the best change that explains the tool's turn, too."""
    structure = evidence.reference.structure
    changes = [e for e in evidence.explanations if e.causes]
    least = evidence.best.evidence - MARGIN
    for change in changes:
        tool = tool_turn(
            evidence.rows, structure, change.beta, change.deviation
        )
        if change.evidence > least and tool.score <= 1.0:
            others = [other for other in changes if other is not change]
            return (change, *others)
    return evidence.explanations


def frame_between(evidence: Evidence, beta: Array) -> Alignment:
    """The sensor's new frame, of parameters (d,), as an affine map of the old one.

    Its lens is as it was: one that a corner's rows bend may fold over elsewhere.
    """
    structure = evidence.reference.structure
    probes = evidence.rows.probes
    mixed = evidence.prior.beta.copy()
    of_frame = filter(is_sensors, set(structure.groups) - {"lens"})
    sensors = indices_of(structure, of_frame)
    mixed[sensors] = beta[sensors]
    before = evidence.rows.body.predict(probes)
    after = structure.predict(probes, mixed)
    places = slice(structure.blocks[0])
    return Alignment.between(before[:, places], after[:, places])
