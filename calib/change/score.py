"""Tests: which freed group of parameters explains more of a log than chance does; and the bound.

The size of the noise is unknown, and it may be that of one joint's encoder; each is what makes the
log most likely, with the group freed and without.  The gain has a chance where nothing changed,
that of an F test, so that a noise of few rows is not taken for known.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..body.belief import Body
from ..body.covariance import autocorrelation_time
from ..body.parameters import Indices
from ..common.arrays import Array
from .equations import Equations, Log
from .frame import Reference
from .hypotheses import FRAME, TESTED, indices_of
from .settings import (
    BEYOND,
    CREPT,
    DRIFTS,
    FALSE_ALARM,
    FEW,
    FEW_ROWS,
    JOINT_NOISES,
    LEFT,
    NOISIER,
    OUTLIER,
    OWN,
    POWER,
)

_ROWS = 300  # their power grows with the rows, their work with the rows too

_FINER = (0.5, 0.7, 1.0, 1.4, 2.0)  # times the noise of an encoder, once one is found
_STEP = 0.2  # of the logarithm of a noise; a likelihood changes by .02 nats
_SAME = "same"
_LASTING = 10  # rows over which noise may last

DRIFT = "drift"
"""Name of the hypothesis that a smooth residual is larger than the model told."""


@dataclass(frozen=True)
class GroupTest:
    """One group of parameters, freed alone."""

    name: str  # ``"sensor"``, ``"sensor scale"``, ``"length:elbow"``, ``"geometry"``, ``"drift"``
    p_value: float  # chance of such rows where nothing changed, after Bonferroni
    statistic: float = 0.0  # twice the gain in log likelihood
    freedom: int = 1  # directions that the rows tell apart
    # (p,), its parameters, how each changed, and the standard deviation of that
    change: tuple[Indices, Array, Array] | None = None
    # [unit], root mean square displacement, over the learned range, of the smallest change of the
    # first parameter that these rows would show nine times in ten
    smallest: float = 0.0

    @property
    def score(self) -> float:
        """Logarithm of the p-value over that of `FALSE_ALARM`: above 1 it fired."""
        return abs(math.log(max(self.p_value, 1e-300)) / math.log(FALSE_ALARM))


@dataclass(frozen=True)
class Tested:
    """All groups of one log."""

    groups: tuple[GroupTest, ...]
    noise: float  # [unit], standard deviation per axis of what no group explains
    usual: float  # [unit], what the belief expected
    noisy: tuple[int, float] | None = None  # a joint whose encoder is noisy, its noise [rad or m]

    @property
    def score(self) -> float:
        """Largest statistic over its threshold."""
        return max((g.score for g in self.groups), default=0.0)

    @property
    def smallest(self) -> float:
        """Displacement [unit] that any single cause would have shown."""
        return max((g.smallest for g in self.groups if g.smallest > 0.0), default=np.inf)


def fired(groups: Iterable[GroupTest]) -> tuple[GroupTest, ...]:
    """Groups above their threshold, the most telling first."""
    above = (g for g in groups if g.score > 1.0 and g.name != DRIFT)
    # a larger group explains more by chance alone
    return tuple(sorted(above, key=lambda g: 3.0 * g.freedom - g.statistic))


def groups_of(body: Body) -> dict[str, Indices]:
    """Groups that are tested: the sensor's view, and each joint's own parameters."""
    structure = body.structure
    frame = indices_of(structure, FRAME)
    found = {"sensor": frame}
    for name, groups in (
        ("sensor scale", ("view.scale",)),
        ("sensor tilt", ("view.tilt", "view.shear", "view.scale")),
        ("lens", ("lens",)),
    ):
        if len(indices_of(structure, groups[:1])):
            own = indices_of(structure, groups)[: 1 if name == "lens" else None]
            found[name] = np.concatenate([own, frame])
    joints: dict[str, list[int]] = {}
    for group in TESTED:
        for index in indices_of(structure, (group,)).tolist():
            joint = structure.labels[index].joint
            joints.setdefault(f"{group}:{joint}" if joint else group, []).append(index)
    joints["elastic"] = indices_of(structure, ("elastic",)).tolist()  # a payload bends all at once
    for name, some in joints.items():
        if some:
            found[name] = np.array(some, dtype=np.intp)
            found[f"{name} and sensor"] = np.concatenate([found[name], frame])
    found["geometry"] = indices_of(structure, ("offset", "length", "gain", "elastic", *FRAME))
    return {name: ix for name, ix in found.items() if len(ix)}


class _Groups(NamedTuple):
    """The groups of which a sensor can see something."""

    every: Indices  # (p,), all parameters of the groups
    columns: dict[str, Indices]  # of each group, where its parameters stand in `every`
    moves: Array  # (p,) [unit], root mean square displacement by one of each parameter
    x: Array  # (n, m, p), derivative by them at the rows
    residual: Array  # (n, m), of the rows

    @staticmethod
    def of(reference: Reference, log: Log, probes: Array) -> _Groups:
        structure, groups = reference.structure, groups_of(reference.body)
        every = np.unique(np.concatenate(list(groups.values())))
        predicted, x = structure.linearise(log.q, reference.beta, every)
        _, moves = structure.linearise(probes, reference.beta, every)
        moves = np.sqrt((moves[:, : structure.blocks[0]] ** 2).sum(axis=1).mean(axis=0))
        columns = {}
        for name, indices in groups.items():
            place = np.searchsorted(every, indices)
            if name.startswith("elastic"):  # of a joint about a vertical axis no load is felt
                place = place[np.argsort(-moves[place], kind="stable")]
            if x[..., place[0]].any():  # a tracker has no lens
                columns[name] = place
        return _Groups(every, columns, moves, x, structure.residual(log.z, predicted))


class _Tests:
    """How likely [nats] each group makes the log, for one shape of the noise."""

    def __init__(
        self, reference: Reference, log: Log, groups: _Groups,
        noisy: tuple[int, float] | None = None,
    ) -> None:  # fmt: skip
        self.noisy, self.groups = noisy, groups
        self.equations = e = Equations(reference, log, crept=CREPT, noisy=noisy)
        self.y, self.x = e.whiten(groups.residual), e.whiten(groups.x)
        # from the usual one to that where nothing changed, in `Reference.sizes`
        most = e.most_likely_noise(self.y, e.usual)
        self.sizes = np.geomspace(e.usual, most, 2 + int(math.log(most / e.usual) / _STEP))
        self.told = [e.information(self.y, self.x, size) for size in self.sizes.tolist()]
        told = e.values / (self.sizes[:, None] ** 2 + e.values)
        self.left = len(self.y) - (1.0 - (1.0 - told) ** 2).sum(axis=1)
        # a larger smooth residual, or waves of a joint's curve, as of no smooth residual
        others = [e.larger(factor) for factor in DRIFTS]
        if noisy is None and reference.body.rows:
            others.append(Equations(reference, log, waves=OWN[2][1] / CREPT, crept=CREPT))
        same = e.likelihood(self.y, self.sizes)
        drift = np.max([other.likelihood(self.y, self.sizes) for other in others], axis=0)
        self.fits = {_SAME: _Fit.of(same, 0), DRIFT: _Fit.of(drift, 1)}
        for name, ix in groups.columns.items():
            found = [self.turned(ix, at) for at in range(len(self.sizes))]
            square = np.array([float((turned**2 / values).sum()) for values, _, turned in found])
            self.fits[name] = _Fit.of(same + 0.5 * square, len(found[0][0]))

    def turned(self, ix: Indices, at: int) -> tuple[Array, Array, Array]:
        """Directions that the rows tell apart of a group: values, vectors (p, k), and moments."""
        power, pull = self.told[at]
        size = np.sqrt(np.maximum(power[ix, ix], 1e-300))
        values, vectors = np.linalg.eigh(power[np.ix_(ix, ix)] / size[:, None] / size)
        clear = values > 1e-9 * values[-1]
        vectors = vectors[:, clear] / size[:, None]
        return values[clear], vectors, vectors.T @ pull[ix]

    @property
    def best(self) -> tuple[float, int]:
        """Likelihood [nats] of the best hypothesis and where its noise stands in `sizes`.

        By Akaike's criterion with its term of few rows (Hurvich 1989).
        """
        tried = []
        for value, at, k in self.fits.values():
            less = k * (1 + (k + 1) / max(float(self.left[at]) - k - 1, 0.1))
            tried.append((value - less, at))
        return max(tried)

    @property
    def noise(self) -> float:
        """Most likely noise of the best hypothesis, in `Reference.sizes`."""
        return float(self.sizes[self.best[1]])


class _Fit(NamedTuple):
    """One hypothesis under its most likely noise."""

    value: float  # log likelihood [nats]
    at: int  # where the noise stands in the sizes
    freedom: int  # directions that the rows tell apart

    @staticmethod
    def of(values: Array, freedom: int) -> _Fit:
        """Of likelihoods (s,) under all sizes."""
        return _Fit(float(values.max()), int(values.argmax()), freedom)


def _judged(tests: Sequence[_Tests]) -> list[GroupTest]:
    """Each group's test, where every hypothesis has the most likely shape of the noise."""
    from scipy.special import chndtrinc, fdtrc, fdtri

    same, likely = max(tests, key=lambda t: t.fits[_SAME]), max(tests, key=lambda t: t.best)
    usual, noise = same.fits[_SAME].value, float(same.sizes[same.fits[_SAME].at])
    # rows that err together count once
    temper = autocorrelation_time(same.equations.rest(same.y, noise, same.x))
    power = likely.told[likely.best[1]][0]
    count, found, names = len(same.y) / temper, [], [n for n in same.fits if n != _SAME]
    for name in names:
        best = max(tests, key=lambda t: t.fits[name])
        value, at, freedom = best.fits[name]
        left = float(best.left[at]) / temper - freedom
        if not freedom or left < LEFT:
            continue
        statistic = max(2.0 * (value - usual), 0.0) / temper
        # a gain of a log likelihood, as the F of a regression with as many rows
        f = left / freedom * np.expm1(min(statistic / count, 500.0))
        p = min(1.0, float(fdtrc(freedom, left, f)) * len(names))
        if name == DRIFT:
            found.append(GroupTest(name, p, statistic))
            continue
        place = best.groups.columns[name]
        values, vectors, turned = best.turned(place, at)
        deviation = np.sqrt((vectors**2 / values).sum(axis=1) * temper)
        change = best.groups.every[place], vectors @ (turned / values), deviation
        most = freedom / left * float(fdtri(freedom, left, 1.0 - FALSE_ALARM / len(names)))
        needed = chndtrinc(count * np.log1p(most), freedom, 1.0 - POWER) * temper
        told = max(float(power[place[0], place[0]]), 1e-300)
        smallest = float(np.sqrt(needed / told) * best.groups.moves[place[0]])
        found.append(GroupTest(name, p, statistic, freedom, change, smallest))
    return found


def group_tests(reference: Reference, log: Log, probes: Array) -> Tested:
    """Test every group against the belief as the model knows it.

    probes : (p, dof), joints all over the learned range
    """
    from scipy.special import chdtrc

    log = log.some(_ROWS)
    if len(log.q) < FEW_ROWS:  # weights of few rows favour what their fit could follow
        log = replace(log, weight=np.where(log.kept, 1.0, log.weight))
    groups = _Groups.of(reference, log, probes)
    calm = _Tests(reference, log, groups)
    found, usual, m = _judged([calm]), calm.equations.usual, groups.residual.shape[1]
    at = calm.best[1] if any(g.score > 1.0 for g in found) else calm.fits[_SAME].at
    noise, noisy = float(calm.sizes[at]), None
    more = noise > NOISIER * usual or any(g.name == DRIFT and g.score > 1 for g in found)
    if more and not len(reference.forgotten):
        slope = reference.structure.slope(log.q, reference.beta) / reference.sizes[:, None]
        lengths = np.sqrt((slope**2).sum(axis=1).mean(axis=0))
        joints = np.flatnonzero(lengths > 0.0).tolist()
        # so that at the tip both are alike
        shapes = [(k, times / lengths[k]) for k in joints for times in JOINT_NOISES]
        best = max((_Tests(reference, log, groups, s) for s in shapes), key=lambda t: t.best)
        # the joint whose encoder's noise makes the log clearly more likely, whatever changed
        gain = max(2.0 * (best.best[0] - calm.best[0]), 0.0)
        if best.noisy and float(chdtrc(1, gain)) * len(joints) < FALSE_ALARM:
            # Robust weights took errors along one direction for outliers: 3 mrad of noise passed
            # for 2, its mean for an offset.
            rest = best.equations.whiten(groups.residual).reshape(-1, m) / best.noise
            near = (rest**2).sum(axis=1) <= OUTLIER**2 * m * log.weight
            log = replace(log, weight=np.where(log.kept | near, 1.0, log.weight))
            joint, ratio = best.noisy
            finer = [(joint, ratio * times) for times in _FINER]
            tests = [_Tests(reference, log, groups, s) for s in (None, *finer)]
            best = max(tests[1:], key=lambda t: t.best)
            found, noise = _judged(tests), best.noise
            noisy = joint, float((best.noisy or finer[0])[1] * noise)
    if noisy is None:  # what the weights leave out, as the median tells it
        rest = noise * calm.equations.rest(calm.y, noise, calm.x)
        away = np.linalg.norm(rest, axis=1) / np.sqrt(log.weight)
        told = float(np.median(away)) / (1.177 if m == 2 else 1.54)
        free = groups.residual.size / max(groups.residual.size - len(groups.every), 1.0)
        noise = max(told * float(np.sqrt(min(free, 2.0))), usual)
    size = float(reference.sizes[0])
    return Tested(tuple(found), noise * size, float(reference.body.noise[0]), noisy)


def bound_test(
    tested: Tested, rows: Indices, u: Array, residual: Array, bound: Array, shared: Array,
    slope: Array | None,
) -> tuple[float, GroupTest]:  # fmt: skip
    """Share of the rows beyond the 95 % bound, and how surely these are too many to be noise.

    rows, u : (n,) and (n, dof), their numbers in the log and their joints in the unit box
    residual, bound : (n, m) and (n,) [unit], infinite where the model tells none
    shared : (n,), variance of an axis by what all rows share
    slope : (n, m), motion of the tip by a joint whose encoder is noisy
    """
    from scipy.special import bdtrc, chdtri

    square, m = (residual**2).sum(axis=1), residual.shape[1]
    radius = float(chdtri(m, 0.05))  # squared, of 95 % of a Gaussian, in units of a deviation
    more = max(tested.noise**2 - tested.usual**2, 0.0)
    if len(rows) < FEW:  # half of the rows of a noisier sensor are nearer than its median
        more = max(more, float(np.median(square)) / float(chdtri(m, 0.5)) - tested.usual**2)
    alike = more and _alike(rows, u, residual) * radius > float(np.median(bound)) ** 2
    noise = np.full(len(rows), 0.0 if alike else more)
    if tested.noisy is not None and slope is not None:
        noise += tested.noisy[1] ** 2 * (slope**2).sum(axis=1)
    over = square > bound**2 + radius * (shared + noise)
    # rows that err together count once
    time = autocorrelation_time(over[:, None].astype(float)) if over.any() else 1.0
    count, n = int(over.sum() / time), math.ceil(len(over) / time)
    p = float(bdtrc(count - 1, n, BEYOND)) if count else 1.0
    beyond = float(np.mean(square > bound**2 + radius * shared))
    return beyond, GroupTest("bound", p, -2.0 * math.log(max(p, 1e-300)))


def _alike(rows: Indices, u: Array, residual: Array) -> float:
    """Variance of an axis by which rows of like joints err alike, 0 where that may be chance."""
    from scipy.spatial import cKDTree
    from scipy.special import ndtri

    # of so many rows at least one is no neighbour in time: noise may last over some rows
    near = np.asarray(cKDTree(u).query(u, min(2 * _LASTING + 2, len(u)))[1])
    later = np.abs(rows[near] - rows[:, None]) > _LASTING
    row = np.flatnonzero(later.any(axis=1))
    if not len(row):
        return 0.0
    pairs = np.stack([row, near[row, later[row].argmax(axis=1)]], axis=1)
    first, second = np.unique(np.sort(pairs, axis=1), axis=0).T
    product = (residual[first] * residual[second]).sum(axis=1)
    # whatever its size, noise makes either sign as likely
    sure = product.sum() > -ndtri(FALSE_ALARM) * np.linalg.norm(product)
    return float(product.mean()) / residual.shape[1] if sure else 0.0
