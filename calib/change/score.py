"""Score tests: which freed group of parameters explains more of a log than chance does.

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
    CREPT,
    DRIFTS,
    FALSE_ALARM,
    FEW_ROWS,
    FINER,
    JOINT_NOISES,
    LEFT,
    NOISIER,
    OUTLIER,
    POWER,
    WAVES,
)

_ROWS = 300  # their power grows with the rows, their work with the rows too

DRIFT = "drift"
"""Name of the hypothesis that a smooth residual is larger than the model told."""

_SAME = "same"


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


class _Profile:
    """Log likelihoods [nats] of all hypotheses over sizes of the noise, for one shape of it."""

    def __init__(
        self, reference: Reference, log: Log, groups: _Groups,
        noisy: tuple[int, float] | None = None,
    ) -> None:  # fmt: skip
        self.noisy = noisy
        self.equations = e = Equations(reference, log, crept=CREPT, noisy=noisy)
        self.y, self.x = e.whiten(groups.residual), e.whiten(groups.x)
        self.sizes = e.noises(self.y)  # in `Reference.sizes`
        self.power, self.pull = e.information(self.y, self.x, self.sizes)
        told = e.values / (self.sizes[:, None] ** 2 + e.values)
        self.freedom = len(self.y) - (1.0 - (1.0 - told) ** 2).sum(axis=1)  # of the noise
        # a larger smooth residual, or waves of a joint's curve, as of no smooth residual
        others = [e.larger(factor) for factor in DRIFTS]
        if noisy is None and reference.body.rows:
            others.append(Equations(reference, log, waves=WAVES / CREPT, crept=CREPT))
        same = e.likelihood(self.y, self.sizes)
        drift = np.max([other.likelihood(self.y, self.sizes) for other in others], axis=0)
        self.value = {_SAME: same, DRIFT: drift}
        self.directions = {_SAME: 0, DRIFT: 1}
        for name, ix in groups.columns.items():
            gain, self.directions[name] = _explained(self.power, self.pull, ix)
            self.value[name] = same + 0.5 * gain


def _explained(power: Array, pull: Array, ix: Indices) -> tuple[Array, int]:
    """Quadratic form (s,) of a group's moment, and the directions that the rows tell apart."""
    a, v = power[:, ix[:, None], ix], pull[:, ix]
    size = np.sqrt(np.maximum(np.einsum("sii->si", a), 1e-300))
    values, vectors = np.linalg.eigh(a / size[:, :, None] / size[:, None])
    turned = np.einsum("sij,si->sj", vectors, v / size)
    clear = values > 1e-9 * values[:, -1:]
    square = np.where(clear, turned**2 / np.where(clear, values, 1.0), 0.0).sum(axis=1)
    return np.asarray(square), int(clear[0].sum())


class _Best(NamedTuple):
    """The most likely size of the noise: of one hypothesis, or of all by Akaike's criterion."""

    value: float
    profile: _Profile
    at: int

    @staticmethod
    def of(profiles: Sequence[_Profile], name: str | None = None) -> _Best:
        tried = []
        for p in profiles:
            for each in p.directions if name is None else (name,):
                # with its term of few rows (Hurvich 1989)
                k = 0 if name is not None else p.directions[each]
                value = p.value[each] - k * (1 + (k + 1) / np.maximum(p.freedom - k - 1, 0.1))
                tried.append(_Best(float(value.max()), p, int(value.argmax())))
        return max(tried, key=lambda each: each.value)

    @property
    def size(self) -> float:
        """That size, in `Reference.sizes`."""
        return float(self.profile.sizes[self.at])


def group_tests(reference: Reference, log: Log, probes: Array) -> Tested:
    """Test every group against the belief as the model knows it.

    probes : (p, dof), joints all over the learned range
    """
    from scipy.special import chdtrc

    log = log.some(_ROWS)
    if len(log.q) < FEW_ROWS:  # weights of few rows favour what their fit could follow
        log = replace(log, weight=np.where(log.kept, 1.0, log.weight))
    groups = _Groups.of(reference, log, probes)
    profiles = [calm := _Profile(reference, log, groups)]
    found, noise = _judged(profiles, groups)
    noisy, usual, m = None, calm.equations.usual, groups.residual.shape[1]
    more = noise > NOISIER * usual or any(g.name == DRIFT and g.score > 1 for g in found)
    if more and not len(reference.forgotten):
        slope = reference.structure.slope(log.q, reference.beta) / reference.sizes[:, None]
        lengths = np.sqrt((slope**2).sum(axis=1).mean(axis=0))
        joints = np.flatnonzero(lengths > 0.0).tolist()
        # so that at the tip both are alike
        tried = [(joint, times / lengths[joint]) for joint in joints for times in JOINT_NOISES]
        profiles += [_Profile(reference, log, groups, own) for own in tried]
        # the joint whose encoder's noise makes the log clearly more likely, whatever changed
        best = _Best.of(profiles)
        gain = max(2.0 * (best.value - _Best.of(profiles[:1]).value), 0.0)
        if best.profile.noisy and float(chdtrc(1, gain)) * len(joints) < FALSE_ALARM:
            # Robust weights took errors along one direction for outliers: 3 mrad of noise passed
            # for 2, its mean for an offset.
            rest = best.profile.equations.whiten(groups.residual).reshape(-1, m) / best.size
            near = (rest**2).sum(axis=1) <= OUTLIER**2 * m * log.weight
            log = replace(log, weight=np.where(log.kept | near, 1.0, log.weight))
            joint, ratio = best.profile.noisy
            finer = [(joint, ratio * times) for times in FINER]
            profiles = [_Profile(reference, log, groups, own) for own in (None, *finer)]
            best = _Best.of(profiles[1:])
            noisy = joint, (best.profile.noisy or finer[0])[1] * best.size
            found, noise = _judged(profiles, groups)
    if noisy is None:  # what the weights leave out, as the median tells it
        rest = noise * calm.equations.rest(calm.y, noise, calm.x)
        away = np.linalg.norm(rest, axis=1) / np.sqrt(log.weight)
        told = float(np.median(away)) / (1.177 if m == 2 else 1.54)
        free = groups.residual.size / max(groups.residual.size - len(groups.every), 1.0)
        noise = max(told * float(np.sqrt(min(free, 2.0))), usual)
    size = float(reference.sizes[0])
    return Tested(tuple(found), noise * size, float(reference.body.noise[0]), noisy)


def _judged(profiles: list[_Profile], groups: _Groups) -> tuple[list[GroupTest], float]:
    """Each group's test, and the noise in sizes."""
    from scipy.special import chndtrinc, fdtrc, fdtri

    names = [*groups.columns, DRIFT]
    same, likely, first = _Best.of(profiles, _SAME), _Best.of(profiles), profiles[0]
    # rows that err together count once
    temper = autocorrelation_time(first.equations.rest(first.y, same.size, first.x))
    count, found = len(first.y) / temper, []
    for name in names:
        best = _Best.of(profiles, name)
        freedom, k = best.profile.directions[name], best.at
        left = float(best.profile.freedom[k]) / temper - freedom
        if not freedom or left < LEFT:
            continue
        statistic = max(2.0 * (best.value - same.value), 0.0) / temper
        # a gain of a log likelihood, as the F of a regression with as many rows
        f = left / freedom * np.expm1(min(statistic / count, 500.0))
        p = min(1.0, float(fdtrc(freedom, left, f)) * len(names))
        if name == DRIFT:
            found.append(GroupTest(name, p, statistic))
            continue
        place = groups.columns[name]
        power, pull = best.profile.power[k][np.ix_(place, place)], best.profile.pull[k][place]
        size = np.sqrt(np.maximum(np.diag(power), 1e-300))
        inverse = np.linalg.pinv(power / size[:, None] / size, rcond=1e-9, hermitian=True)
        deviation = np.sqrt(np.diag(inverse) * temper) / size
        change = groups.every[place], inverse @ (pull / size) / size, deviation
        most = freedom / left * float(fdtri(freedom, left, 1.0 - FALSE_ALARM / len(names)))
        needed = chndtrinc(count * np.log1p(most), freedom, 1.0 - POWER) * temper
        told = max(float(likely.profile.power[likely.at][place[0], place[0]]), 1e-300)
        smallest = float(np.sqrt(needed / told) * groups.moves[place[0]])
        found.append(GroupTest(name, p, statistic, freedom, change, smallest))
    return found, (likely if any(g.score > 1.0 for g in found) else same).size
