"""An explanation: a set of causes that accounts for a log, and the climb to where it fits best."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from ..body.normal import Factor
from ..body.parameters import Indices
from ..body.settings import NATS
from ..body.structure import Structure
from ..common.arrays import Array
from .causes import FRAME
from .frame import Reference
from .settings import CALM_WAVES, CREEP_WAVES

# Share of each parameter's information that is added where a step does not gain, and of it after a
# step that does
DAMPING = 1e-4
BOLDER = 1.0 / 8.0


@dataclass(frozen=True, eq=False)
class Place:
    """Changes of parameters over their standard deviations, and the posterior there."""

    normals: Array  # (k,)
    beta: Array  # (d,), parameters that have changed so
    fit: float  # log posterior [nats]
    gradient: Array  # (k,), of the log posterior
    precision: Array  # (k, k), Gauss and Newton's


P = TypeVar("P", bound=Place)


def climb(
    place_at: Callable[[Array], P | None],
    start: Array,
    *,
    most: int,
    enough: float,
) -> P:
    """The place of the greatest posterior, by damped steps (Levenberg 1944, Marquardt 1963).

    (precision + damping diag(precision)) step = gradient

    place_at : the place at normals (k,), None where no prediction is a number
    start : (k,)
    most : steps
    enough : nats that a step must gain
    """
    best = place_at(start) or place_at(np.zeros_like(start))
    if best is None:
        raise np.linalg.LinAlgError("no prediction is a number")
    damping = 0.0
    for _ in range(most):
        damped = best.precision.copy()
        damped[np.diag_indices(len(damped))] *= 1.0 + damping
        step = Factor(damped).solve(best.gradient)
        if 0.5 * float(best.gradient @ step) < enough:
            break
        place = place_at(best.normals + step)
        if place is not None and place.fit > best.fit:
            gain = place.fit - best.fit
            best = place
            damping *= BOLDER
            if gain < enough:
                break
        else:
            damping = max(damping / BOLDER, DAMPING)
    return best


@dataclass(frozen=True, eq=False)
class Explanation:
    """A set of causes that accounts for a log, fitted to it."""

    causes: tuple[str, ...]
    wave_size: float  # of `WAVE_SIZES`, that the joints may have
    reference: Reference
    indices: Indices  # parameters that are free
    beta: Array  # (d,), parameters of the greatest evidence
    sd: Array  # (d,), standard deviations by which they were free to change
    evidence: float  # logarithm of the tempered evidence [nats]
    correlation_time: float  # of the rows
    # (d,), posterior standard deviations of those that are free, zero elsewhere
    deviation: Array
    noise: float  # noise of the log, in `Reference.sizes`
    # (n, m) [unit], measured less predicted outputs of the rows compared
    residual: Array

    @property
    def groups(self) -> tuple[str, ...]:
        """Groups of the parameters that are free."""
        return groups_at(self.reference.structure, self.indices)

    @property
    def is_no_change(self) -> bool:
        """Whether it says that the arm and its sensor are as they were."""
        return self.wave_size <= CALM_WAVES and not len(self.indices)

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
        has_waves = self.wave_size > CREEP_WAVES
        shape = "waves of the joints" if has_waves else "a smooth residual"
        return ", ".join(names) or shape


def groups_at(structure: Structure, indices: Indices) -> tuple[str, ...]:
    """Groups of parameters, in their order."""
    names = [structure.labels[k].group for k in indices.tolist()]
    return tuple(dict.fromkeys(names))


def with_least_waves(explanations: Sequence[Explanation]) -> Explanation:
    """The best, with the least waves that the evidence hardly tells from its own."""
    best = explanations[0]
    least = best.evidence - NATS
    alike = [
        some
        for some in explanations
        if some.causes == best.causes and some.evidence > least
    ]
    return min(alike, key=lambda some: some.wave_size)
