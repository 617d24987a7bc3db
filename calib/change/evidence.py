"""Evidence: the tests, the bound and the explanations of a log, weighed together by `weigh`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..body.belief import Body
from ..common.rows import median_length
from ..samples.diagnosis import rows_behind
from .bound import BoundTest
from .explain import explain
from .explanation import Explanation
from .frame import Reference
from .observations import Observations
from .rows import LogRows
from .settings import MARGIN
from .significance import GroupTests
from .system import System
from .tool import ToolTurn, tool_turn

TOOL = "tool"  # the group of where it is


@dataclass(frozen=True)
class EvidenceSettings:
    """When a log is explained."""

    # share of the positions' spread: a log that is further off from every hypothesis is explained
    # by none
    unexplained: float = 0.1
    # share of rows that may contradict all others where the rest is as near as told
    few_wrong: float = 0.05
    # score of a mirror, another sense or another unit, which are no matter of chance
    discrete: float = 2.0


EVIDENCE = EvidenceSettings()


@dataclass(frozen=True, eq=False)
class Comparison:
    """A log beside a belief, before a cause is looked for."""

    rows: LogRows
    # {"sensor", "joints", "offsets"} or None, what is known about the change
    cause: str | None
    prior: Body  # the belief that a changed arm starts from
    reference: Reference  # the same in the frame of the log
    observations: Observations
    tests: GroupTests
    bound: BoundTest

    @property
    def unit(self) -> str:
        """Unit of the positions; "sensor" where their scale shows that it is not the model's."""
        unit = self.rows.unit
        same = self.reference.scale == 1.0 or unit != self.rows.model.about.unit
        return unit if same else "sensor"

    @property
    def test_score(self) -> float:
        """Largest score of what says that something changed, above 1 if it did."""
        score = max(self.tests.score, self.bound.test.score)
        if self.reference.has_discrete_cause:
            score = max(score, EVIDENCE.discrete)
        return score

    @property
    def fired(self) -> bool:
        """Whether causes are worth a search."""
        return self.test_score > 1.0 or self.bound.fails

    def is_within_bound(self, distance: float) -> bool:
        """Whether rows are as near as told that are typically so far off [unit].

        Rows that lag or whose joints are exchanged come near too, but for those at each jump.
        """
        count = len(self.rows) + self.rows.wrong
        few = self.rows.wrong <= EVIDENCE.few_wrong * count
        return few and distance < self.bound.usual < np.inf


@dataclass(frozen=True, eq=False)
class Evidence(Comparison):
    """What a log says of a belief."""

    explanations: tuple[Explanation, ...]  # the best first
    # typical distance of the rows from the best explanation, over that from their middle
    misfit: float
    # whether that comes near the rows: to a part of their spread, or the bound
    is_explained: bool
    score: float  # above 1 the arm or its sensor changed
    # whether it changed, and a change explains the rows clearly better than none
    is_attributed: bool
    # beside the best explanation of the positions, as far as sure
    tool: ToolTurn

    @property
    def best(self) -> Explanation:
        """The explanation of the greatest evidence."""
        return self.explanations[0]

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


def weigh(
    comparison: Comparison, explanations: tuple[Explanation, ...]
) -> Evidence:
    """Weigh the tests and the bound of a log with its explanations, the best first.

    gain = log p(y | best change) - log p(y | no change)

    A log that nothing explains has the score 1 + misfit, one that a change explains better than
    none 1 + share of the rows beyond a bound that fails.
    """
    rows = comparison.rows
    reference = comparison.reference
    bound = comparison.bound
    best = explanations[0]

    # how near does the best explanation come?
    distance = median_length(best.residual)
    spread = median_length(rows.x - np.median(rows.x, axis=0))
    misfit = distance / max(spread, 1e-300)
    is_explained = misfit < EVIDENCE.unexplained
    is_explained = is_explained or comparison.is_within_bound(distance)

    # is it better than no change?
    no_change = [e.evidence for e in explanations if e.is_no_change]
    gain = best.evidence - max(no_change, default=-np.inf)
    is_better = reference.has_discrete_cause or gain > MARGIN
    is_better = is_better and is_explained

    # did anything change?
    score = comparison.test_score
    if comparison.fired and not is_explained:
        score = max(score, 1.0 + misfit)
    if is_better and bound.fails and comparison.tests.noisy is None:
        score = max(score, 1.0 + bound.beyond)
    is_attributed = is_better and score > 1.0

    # how is the tool turned beside that?
    structure = reference.structure
    if is_attributed:
        tool = tool_turn(rows, structure, best.beta, best.deviation)
    else:
        tool = tool_turn(rows, structure, rows.body.beta)
    return Evidence(
        rows=rows,
        cause=comparison.cause,
        prior=comparison.prior,
        reference=reference,
        observations=comparison.observations,
        tests=comparison.tests,
        bound=bound,
        explanations=explanations,
        misfit=misfit,
        is_explained=is_explained,
        score=score,
        is_attributed=is_attributed,
        tool=tool,
    )


def with_orientations(
    evidence: Evidence, systems: Sequence[System], temper: float
) -> Evidence:
    """Evidence whose best explanation orientations do not contradict, as far as there is one.

    A camera that is turned moves what it sees: positions alone may call that a joint's offset,
    which the tool would have to be turned back by.  An offset of the last joint turns the tool, and
    hardly moves it: positions alone may call that no change.
    """
    if evidence.score <= 1.0 or evidence.tool.score <= 1.0:
        return evidence
    if not evidence.is_attributed:
        return weigh(evidence, _by_orientations(evidence))
    cause = evidence.cause
    if cause not in (None, "joints") or TOOL in evidence.best.groups:
        return evidence
    explanations = explain(
        systems, cause, temper=temper, calm=False, turned=(TOOL,)
    )
    return weigh(evidence, explanations)


def _by_orientations(evidence: Evidence) -> tuple[Explanation, ...]:
    """The explanations, first the best change by which the tool stands as it should."""
    structure = evidence.reference.structure
    changes = [some for some in evidence.explanations if some.causes]
    least = evidence.best.evidence - MARGIN
    for change in changes:
        tool = tool_turn(
            evidence.rows, structure, change.beta, change.deviation
        )
        if change.evidence > least and tool.score <= 1.0:
            others = [some for some in changes if some is not change]
            return (change, *others)
    return evidence.explanations
