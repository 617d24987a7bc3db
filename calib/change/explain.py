"""Explaining: which members account for a log, each with its evidence.

Every member starts at the log's own frame and moves by a few damped Gauss-Newton steps in the
eigenvectors of `Spectrum`; its evidence is Laplace's, with the likelihood raised to the power
1 / temper: rows that resemble their neighbours count for less than their number.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..body.bound import autocorrelation_time
from ..body.structure import Array
from .members import CREEP, NOTHING, Member, drift, freedom, members_of
from .reference import Reference
from .rows import EXPLAINED_ROWS, Log
from .whitening import Spectrum, scaled, spectrum

MARGIN = 5.0
"""Nats by which a change must be better than none.  A body that was only simulated has never seen
how far an arm is from it: any size of what its members leave over is as likely."""

OWN = ((1.0, CREEP), (4.0, CREEP), (16.0, CREEP), (1.0, 4.0))
"""What a log may show beyond every member, of unknown size, chosen by evidence: times the usual
size of the smooth residual, and the joints' waves over their prior.  With the least alone, waves
of 2 mrad along a line were taken for lengths and a lens."""

_USUAL = 2  # of these sizes are those of an arm that has not changed
_STEPS = 12


@dataclass(frozen=True)
class Explanation:
    """One member, as far as a log goes.

    Attributes
    ----------
    member : Member
    factor : float
        Times the usual size of the log's own residual.
    waves : float
        Sd of the joints' curves by which this arm may differ, over their prior's.
    origin : (d,) array
        Parameters that it starts from.
    beta : (d,) array
        Parameters of the greatest evidence.
    deviation : (d,) array
        Posterior standard deviations of those that were free, zero elsewhere.
    sd : (d,) array
        Standard deviations by which they were free to change.
    evidence : float
        Logarithm of the tempered evidence [nats].
    noise : float
        Noise of the log, in the sizes of `whitening.scaled`.
    temper : float
        Rows that count for one.
    residual : (n, m) array [unit]
        Measured less predicted outputs of the rows that were compared.
    margin : float [nats]
        By which it must be better than no change.
    """

    member: Member
    factor: float
    waves: float
    origin: Array
    beta: Array
    deviation: Array
    sd: Array
    evidence: float
    noise: float
    temper: float
    residual: Array
    margin: float

    @property
    def unchanged(self) -> bool:
        """Whether it says that the arm and its sensor are as they were."""
        return self.member == NOTHING and (self.factor, self.waves) in OWN[:_USUAL]


def explain(
    reference: Reference, log: Log, robust: Array, cause: str | None = None
) -> tuple[Explanation, ...]:
    """All members with their evidence, best first.

    Parameters
    ----------
    reference : Reference
        The old belief in the frame of the log.
    log : Log
        Its rows; `z` less what maps add to the body.
    robust : (d,) array
        Parameters of a robust fit of the richest member, where that one starts.
    cause : {"sensor", "joints"}, optional
        What is known about the change.
    """
    search = _Search(reference, log.some(EXPLAINED_ROWS), robust, cause)
    return tuple(sorted(search.run(), key=lambda e: -e.evidence))


class _Search:
    """The members of one log; what they share is computed once."""

    def __init__(self, reference: Reference, log: Log, robust: Array, cause: str | None) -> None:
        body = reference.body
        self.reference, self.q, self.z, self.cause = reference, log.q, log.z, cause
        self.weight, self.shared, self.robust = log.weight, log.shared, robust
        self.members = members_of(body.structure, cause)
        self.structure = reference.structure
        self.scaled = scaled(reference.body)
        self.simulated = body.simulated
        self.temper = max(body.kappa, 1.0) ** 2

    def run(self) -> list[Explanation]:
        body, reference = self.reference.body, self.reference
        richest = self.members[-1]
        weight, beta = self.weight, self.robust
        found: list[Explanation] = []
        starts: dict[Member, Array] = {}
        for own in OWN:
            found_space = spectrum(
                body,
                reference.beta,
                self.q,
                weight,
                drift(body, own[1]),
                own[0],
                reference.forgotten,
                self.shared,
            )
            if own == OWN[0]:
                first = self._fit(richest, found_space, own, beta)
                rest = found_space.rest(found_space.turn(first.residual), first.noise)
                self.temper = max(self.temper, autocorrelation_time(rest))
            for member in self.members:
                if reference.new and not member.framed:
                    continue
                start = starts.get(member)
                made = self._fit(member, found_space, own, start)
                starts[member] = made.beta
                found.append(made)
        return found

    def _fit(
        self, member: Member, space: Spectrum, own: tuple[float, float], start: Array | None
    ) -> Explanation:
        """Damped Gauss-Newton steps of one member, its noise by likelihood."""
        structure, z = self.structure, self.z
        sd = freedom(self.reference.body, member, self.cause)
        free = np.flatnonzero(sd > 0)
        # without a free frame the sensor is where it was
        held = member.framed or self.reference.new
        origin = self.reference.beta if held else self.reference.body.beta
        beta = origin.copy()
        if start is not None:
            beta[free] = start[free]

        def turned(at: Array) -> Array:
            return space.turn(structure.residual(z, structure.predict(self.q, at)))

        y = turned(beta)
        noise = space.noise(y, self.scaled.floor)
        for _ in range(_STEPS if len(free) else 0):
            _, x = structure.linearise(self.q, beta, free)
            j = space.turn_columns(x) * sd[free]
            precision = 1.0 / ((space.values + noise**2) * self.temper)
            a = (j * precision[:, None]).T @ j
            a[np.diag_indices(len(free))] += 1.0
            away = (beta - origin)[free] / sd[free]
            step = np.linalg.solve(a, j.T @ (precision * y) - away)
            before = float(precision @ y**2 + away @ away)
            share = 1.0
            for _ in range(6):
                full = np.zeros(len(beta))
                full[free] = share * step * sd[free]
                moved = structure.retract(beta, full)
                with np.errstate(all="ignore"):
                    y_new = turned(moved)
                away = (moved - origin)[free] / sd[free]
                after = float(precision @ y_new**2 + away @ away)
                if after <= before * (1 + 1e-9):
                    break
                share *= 0.3
            else:
                break
            beta, y = moved, y_new
            noise = space.noise(y, self.scaled.floor)
            if before - after < 1e-2:
                break
        determinant = 0.0
        deviation = np.zeros(len(beta))
        if len(free):
            _, x = structure.linearise(self.q, beta, free)
            j = space.turn_columns(x) * sd[free]
            a = (j / ((space.values + noise**2) * self.temper)[:, None]).T @ j
            a[np.diag_indices(len(free))] += 1.0
            determinant = float(np.linalg.slogdet(a)[1])
            deviation[free] = sd[free] * np.sqrt(np.diag(np.linalg.inv(a)))
        away = (beta - origin)[free] / sd[free]
        total = space.values + noise**2
        fit = -0.5 * float(np.log(total).sum() + (y**2 / total).sum()) / self.temper
        evidence = fit - 0.5 * float(away @ away) - 0.5 * determinant
        residual = structure.residual(z, structure.predict(self.q, beta))
        free_of_charge = member == NOTHING and (own in OWN[:_USUAL] or self.simulated)
        return Explanation(
            member, *own, origin, beta, deviation, sd, evidence, noise, self.temper, residual,
            0.0 if free_of_charge else MARGIN,
        )  # fmt: skip


def changed(found: tuple[Explanation, ...]) -> bool:
    """Whether something else than nothing explains the log, by the margin."""
    best = max(found, key=lambda e: e.evidence - e.margin)
    nothing = [e.evidence for e in found if e.unchanged]
    return not nothing or best.evidence > max(nothing) + MARGIN


def likely(found: tuple[Explanation, ...], most: int = 6) -> list[tuple[float, Explanation]]:
    """The members that count, with their posterior weights."""
    some = [e for e in found if e.evidence > found[0].evidence - 5.0][:most]
    weight = np.exp(np.array([e.evidence for e in some]) - some[0].evidence)
    return list(zip((weight / weight.sum()).tolist(), some, strict=True))
