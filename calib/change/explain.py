"""Explaining: which members account for a log, each with its evidence.

Every member starts at the log's own frame and moves by a few damped Gauss-Newton steps in the
eigenvectors of `Spectrum`; its evidence is Laplace's, with the likelihood raised to the power
1 / temper: rows that resemble their neighbours count for less than their number.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..body.covariance import autocorrelation_time
from ..body.normal import Factor
from ..body.parameters import Indices
from ..common.arrays import Array
from .members import ANYWHERE, CREEP, NOTHING, Member, anywhere, drift, freedom, members_of
from .reference import Reference
from .rows import EXPLAINED_ROWS, Log, Spectrum, spectrum

_MARGIN = 5.0
"""Nats by which a change must be better than none.  A body that was only simulated has never seen
how far an arm is from it: any size of what its members leave over is as likely."""

_OWN = ((1.0, CREEP), (4.0, CREEP), (1.0, 0.7), (16.0, CREEP), (1.0, 4.0))
"""What a log may show beyond every member, of unknown size: times the usual size of the smooth
residual, and the joints' waves over their prior.  With the least alone, waves of 2 mrad along a
line were taken for lengths and a lens.  Each is as likely before: a prior uniform in the logarithm
of a size (Jeffreys). A half-Cauchy one made narrower bounds, and rows on a line did more harm."""

_USUAL = 3
"""Of these sizes so many are those of an arm that has not changed.  Waves of .25 mrad are what a
model of 400 rows has not learned of a real UR10: taken for a change of the arm, they doubled its
error where nothing was measured."""

_STEPS = 12
_NOTHING_LEFT = 1e-2  # twice the nats by which a step must better the fit
_COUNTS, _AVERAGED = 5.0, 6  # members so many nats behind the best are averaged, so many at most
_HOPELESS = 10.0  # nats behind the best with which no member counts any more
_FAR = 30.0  # the same before its noise is settled


@dataclass(frozen=True)
class Explanation:
    """One member, as far as a log goes."""

    member: Member
    factor: float  # times the usual size of the log's own residual
    waves: float  # sd of the joints' curves by which this arm may differ, over their prior's
    origin: Array  # (d,), parameters that it starts from
    beta: Array  # (d,), parameters of the greatest evidence
    # (d,), of the best one: posterior standard deviations of those that were free, zero elsewhere
    deviation: Array
    sd: Array  # (d,), standard deviations by which they were free to change
    evidence: float  # logarithm of the tempered evidence [nats]
    fit: float  # the same without what its freedom costs, which no narrower member exceeds [nats]
    noise: float  # noise of the log, in `Reference.sizes`
    temper: float  # rows that count for one
    residual: Array  # (n, m) [unit], measured less predicted outputs of the rows that were compared
    margin: float  # [nats], by which it must be better than no change

    @property
    def unchanged(self) -> bool:
        """Whether it says that the arm and its sensor are as they were."""
        return self.member == NOTHING and (self.factor, self.waves) in _OWN[:_USUAL]


def explain(
    reference: Reference, log: Log, cause: str | None = None, calm: bool = False
) -> tuple[Explanation, ...]:
    """All members with their evidence, best first.

    reference : the old belief in the frame of the log
    log : its rows; `z` less what maps add to the body
    cause : {"sensor", "joints"}, what is known about the change
    calm : whether nothing changed: only the sizes of the log's own residual are then compared
    """
    search = _Search(reference, log.some(EXPLAINED_ROWS), cause, calm)
    return tuple(sorted(search.run(), key=lambda e: -e.evidence))


@dataclass(frozen=True)
class _Point:
    """Where a member's rows are linearised: what every size of the log's own residual shares."""

    beta: Array  # (d,)
    residual: Array  # (n, m) [unit], measured less predicted outputs at `beta`
    x: Array  # (n, m, k), derivatives by the free parameters, in their standard deviations


class _Search:
    """The members of one log; what they share is computed once."""

    def __init__(self, reference: Reference, log: Log, cause: str | None, calm: bool) -> None:
        self.reference, self.log, self.cause = reference, log, cause
        self.structure = reference.structure
        members = (NOTHING,) if calm else members_of(reference.structure, cause)
        self.richest = members[-1]
        self.members = [m for m in members if m.framed or calm or not reference.new]
        self.temper = max(reference.body.kappa, 1.0) ** 2
        self.points: dict[Member, _Point] = {}
        self.best = -np.inf

    def run(self) -> list[Explanation]:
        """Each size of the log's own residual with all members that can still matter."""
        found: list[Explanation] = []
        leader: tuple[Explanation, Factor] | None = None
        reference = self.reference
        for own in _OWN:
            space = spectrum(reference, self.log, drift(reference.body, own[1]), own[0])
            if own == _OWN[0]:
                first, _ = self._fit(self.richest, space, own)
                rest = space.rest(space.turn(first.residual), first.noise)
                self.temper = max(self.temper, autocorrelation_time(rest))
                self._start(space, first.noise)
            # The richest member first: none that frees less fits better, whatever its prior.
            rich = self._fit(self.richest, space, own)
            hopeless = rich[0].fit < self.best - _HOPELESS
            for member in self.members:
                narrower = set(member.groups) <= set(self.richest.groups)
                if hopeless and narrower and member != NOTHING:
                    continue
                made, known = rich if member == self.richest else self._fit(member, space, own)
                found.append(made)
                if made.evidence > self.best:
                    self.best, leader = made.evidence, (made, known)
        if leader is not None and leader[0].member != NOTHING:
            best, known = leader  # of this one alone: an inverse is a third of the work of a fit
            free = np.flatnonzero(best.sd > 0)
            held = np.isin(free, anywhere(self.structure, reference.forgotten))
            best.deviation[free] = best.sd[free] * np.sqrt(_variances(known, held))
        return found

    def _free(self, member: Member) -> tuple[Array, Indices, Array]:
        """Sd (d,) of what is freed, its indices, and the parameters (d,) it starts from."""
        sd = freedom(self.reference.body, member, self.cause)
        # without a free frame the sensor is where it was
        held = member.framed or self.reference.new
        return sd, np.flatnonzero(sd > 0), self.reference.beta if held else self.reference.body.beta

    def _residual(self, beta: Array) -> Array:
        with np.errstate(all="ignore"):
            return self.structure.residual(self.log.z, self.structure.predict(self.log.q, beta))

    def _linearised(self, beta: Array, free: Indices, sd: Array) -> _Point:
        predicted, x = self.structure.linearise(self.log.q, beta, free)
        return _Point(beta, self.structure.residual(self.log.z, predicted), x * sd[free])

    def _start(self, space: Spectrum, noise: float) -> None:
        """Where each member starts: at its optimum in the linearisation of the richest one."""
        rich = self.points[self.richest]
        sd, every, _ = self._free(self.richest)
        j, y = space.turn_columns(rich.x), space.turn(rich.residual)
        weighted = j / ((space.values + noise**2) * self.temper)[:, None]
        gram, pull = weighted.T @ j, weighted.T @ y
        for member in self.members:
            own, free, origin = self._free(member)
            if not np.isin(free, every).all() or member == self.richest:
                continue
            place = np.searchsorted(every, free)
            ratio = own[free] / sd[free]
            away = (rich.beta - origin)[every] / sd[every]
            a = gram[np.ix_(place, place)] * ratio[:, None] * ratio
            a[np.diag_indices(len(free))] += 1.0
            full = np.zeros(len(sd))
            full[free] = np.linalg.solve(a, (pull + gram @ away)[place] * ratio) * own[free]
            tries = [origin, self.structure.retract(origin, full)]
            size = [float(np.nansum(space.turn(self._residual(b)) ** 2)) for b in tries]
            self.points[member] = self._linearised(tries[int(np.argmin(size))], free, own)

    def _fit(
        self, member: Member, space: Spectrum, own: tuple[float, float]
    ) -> tuple[Explanation, Factor]:
        """Damped Gauss-Newton steps of one member, its noise by likelihood; its information."""
        sd, free, origin = self._free(member)
        point = self.points.get(member)
        if point is None:
            start = self.log.robust if member == self.richest else origin
            point = self._linearised(np.where(sd > 0, start, origin), free, sd)
        beta, residual = point.beta, point.residual
        y, j = space.turn(residual), space.turn_columns(point.x)
        noise = space.noise(y)
        tried = own != _OWN[0] and member != self.richest
        for _ in range(_STEPS if len(free) else 0):
            precision = 1.0 / ((space.values + noise**2) * self.temper)
            factor = _information(j, precision)
            away = (beta - origin)[free] / sd[free]
            pull = j.T @ (precision * y) - away
            step = factor.solve(pull)
            gain = float(pull @ step)
            if gain < _NOTHING_LEFT:
                break
            before = float(precision @ y**2 + away @ away)
            size = np.log(space.values + noise**2).sum() / self.temper + factor.log_determinant()
            if tried and -0.5 * (size + before - gain) < self.best - _FAR:
                break
            tried = member != self.richest
            share = 1.0
            for _ in range(6):
                full = np.zeros(len(beta))
                full[free] = share * step * sd[free]
                moved = self.structure.retract(beta, full)
                residual_new = self._residual(moved)
                y_new = space.turn(residual_new)
                away = (moved - origin)[free] / sd[free]
                after = float(precision @ y_new**2 + away @ away)
                if after <= before * (1 + 1e-9):
                    break
                share *= 0.3
            else:
                break
            beta, residual, y = moved, residual_new, y_new
            noise = space.noise(y)
            if before - after < _NOTHING_LEFT:
                break
            point = self._linearised(beta, free, sd)
            j = space.turn_columns(point.x)
        self.points[member] = _Point(beta, residual, point.x)
        total = space.values + noise**2
        factor = _information(j, 1.0 / (total * self.temper))
        away = (beta - origin)[free] / sd[free]
        likelihood = -0.5 * float(np.log(total).sum() + (y**2 / total).sum()) / self.temper
        fit = likelihood - 0.5 * float(away @ away)
        evidence = fit - 0.5 * factor.log_determinant()
        simulated = self.reference.body.simulated
        free_of_charge = member == NOTHING and (own in _OWN[:_USUAL] or simulated)
        made = Explanation(
            member, *own, origin, beta, np.zeros(len(beta)), sd, evidence, fit, noise, self.temper,
            residual, 0.0 if free_of_charge else _MARGIN,
        )  # fmt: skip
        return made, factor


def _information(j: Array, precision: Array) -> Factor:
    """Information of rows (N, k) and of a prior of one."""
    a = (j * precision[:, None]).T @ j
    a[np.diag_indices(len(a))] += 1.0
    return Factor(a)


def _variances(information: Factor, held: NDArray[np.bool_]) -> Array:
    """Diagonal (k,) of the covariance, less the prior of what was `held` to a fit of these rows.

    By the matrix inversion lemma: ``C + C_h (1 / w - C_hh)^-1 C_h'``, w the weight taken away.
    """
    if not held.any():
        return information.variances()
    c = information.inverse()
    lost = -c[np.ix_(held, held)]
    lost[np.diag_indices(len(lost))] += 1.0 / (1.0 - ANYWHERE**-2)
    return np.asarray(np.diag(c) + (c[:, held] * np.linalg.solve(lost, c[held]).T).sum(axis=1))


def changed(found: tuple[Explanation, ...]) -> bool:
    """Whether something else than nothing explains the log, by the margin."""
    best = max(found, key=lambda e: e.evidence - e.margin)
    nothing = [e.evidence for e in found if e.unchanged]
    return not nothing or best.evidence > max(nothing) + _MARGIN


def unusual(found: tuple[Explanation, ...]) -> float:
    """Nats by which an arm that has not changed shows more than is usual; at least 0."""
    calm = [e for e in found if e.member == NOTHING and e.margin]
    usual = max((e.evidence for e in found if e.unchanged), default=np.inf)
    return max(0.0, max((e.evidence for e in calm), default=-np.inf) - usual)


def likely(found: Sequence[Explanation]) -> list[tuple[float, Explanation]]:
    """The members that count, best first, with their posterior weights."""
    return weighed([e for e in found if e.evidence > found[0].evidence - _COUNTS][:_AVERAGED])


def weighed(some: Sequence[Explanation]) -> list[tuple[float, Explanation]]:
    """Explanations with their posterior weights."""
    weight = np.exp(np.array([e.evidence for e in some]) - some[0].evidence)
    return list(zip((weight / weight.sum()).tolist(), some, strict=True))
