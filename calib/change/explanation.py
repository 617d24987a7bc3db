"""An explanation: a set of causes that accounts for a log, fitted to it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ..body.parameters import Indices
from ..body.settings import NATS
from ..common.arrays import Array
from .causes import FRAME
from .frame import Reference
from .settings import CREEP, OWN, Level


@dataclass(frozen=True, eq=False)
class Explanation:
    """A set of causes that accounts for a log, fitted to it."""

    causes: tuple[str, ...]
    level: Level
    reference: Reference
    indices: Indices  # parameters that are free
    beta: Array  # (d,), parameters of the greatest evidence
    sd: Array  # (d,), standard deviations by which they were free to change
    evidence: float  # logarithm of the tempered evidence [nats]
    temper: float  # rows that count for one
    # (d,), posterior standard deviations of those that are free, zero elsewhere
    deviation: Array
    noise: float  # noise of the log, in `Reference.sizes`
    # (n, m) [unit], measured less predicted outputs of the rows compared
    residual: Array

    @property
    def groups(self) -> tuple[str, ...]:
        """Groups of the parameters that are free."""
        labels = self.reference.structure.labels
        names = [labels[k].group for k in self.indices.tolist()]
        return tuple(dict.fromkeys(names))

    @property
    def is_no_change(self) -> bool:
        """Whether it says that the arm and its sensor are as they were."""
        return self.level.calm and not len(self.indices)

    @property
    def name(self) -> str:
        """Such as "frame, length", or what it is where nothing is freed."""
        names = [
            group.removeprefix("view.")
            for group in self.groups
            if group not in FRAME
        ]
        if FRAME[0] in self.groups:
            names.insert(0, "frame")
        waves = self.level.waves > CREEP
        shape = "waves of the joints" if waves else "a smooth residual"
        return ", ".join(names) or shape


def least_residual(explanations: Sequence[Explanation]) -> Explanation:
    """The best, with the least residual of the log's own that the evidence hardly tells from it."""
    best = explanations[0]
    least = best.evidence - NATS
    alike = [
        some
        for some in explanations
        if some.causes == best.causes and some.evidence > least
    ]
    return min(alike, key=lambda some: OWN.index(some.level))


def simplest(explanations: Sequence[Explanation]) -> Explanation:
    """The one that frees least, of those that the evidence hardly tells from the best."""
    least = explanations[0].evidence - NATS
    alike = [some for some in explanations if some.evidence > least]
    return min(alike, key=lambda some: (len(some.indices), -some.evidence))
