"""Score tests: which freed group of parameters explains more of a log than chance does.

One set of normal equations.  A log of an arm that has not changed is normal: its covariance is
that of the model's posterior, of a residual of this log alone, and of noise.  The size of the
noise is unknown, and it may be that of one joint's encoder; each is what makes the log most
likely, with the group freed and without.  Twice the gain in log likelihood is the statistic; its
threshold is that of an F test, so that a noise of few rows is not taken for known.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
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
    JOINT_NOISES,
    LEFT,
    NOISIER,
    POWER,
    TESTED_ROWS,
    WAVES,
)

DRIFT = "drift"
"""Name of the hypothesis that a smooth residual is larger than the model told."""


@dataclass(frozen=True)
class GroupTest:
    """One group of parameters, freed alone."""

    name: str  # ``"sensor"``, ``"sensor scale"``, ``"length:elbow"``, ``"geometry"``, ``"drift"``
    # twice the gain in log likelihood, and what chance stays below but in `FALSE_ALARM` of the logs
    statistic: float
    threshold: float
    p_value: float  # chance of such a statistic where nothing changed, after Bonferroni
    indices: Indices  # (p,), its parameters; the first is the one that the group is about
    freedom: int = 1  # directions that the rows tell apart
    # (p,), change of each parameter and its standard deviation
    estimate: Array = field(default_factory=lambda: np.zeros(0))
    deviation: Array = field(default_factory=lambda: np.zeros(0))
    # [unit], root mean square displacement, over the learned range, of the smallest change of the
    # first parameter that these rows would show nine times in ten
    smallest: float = 0.0

    @property
    def score(self) -> float:
        """Statistic over threshold: above 1 where the p-value is below the false-alarm rate."""
        return self.statistic / self.threshold


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

    def joined(*names: str) -> Indices:
        return indices_of(structure, names)

    frame = joined(*FRAME)
    found = {"sensor": frame}
    for name, own in (
        ("sensor scale", joined("view.scale")),
        ("sensor tilt", joined("view.tilt", "view.shear", "view.scale")),
        ("lens", joined("lens")[:1]),
    ):
        if name != "sensor tilt" or len(joined("view.tilt")):
            found[name] = np.concatenate([own, frame]) if len(own) else own
    joints: dict[str, list[int]] = {}
    for group in TESTED:
        for index in joined(group):
            joint = structure.label(int(index)).joint
            joints.setdefault(f"{group}:{joint}" if joint else group, []).append(int(index))
    joints["elastic"] = joined("elastic").tolist()  # a payload bends all joints at once
    for name, some in joints.items():
        if some:
            found[name] = np.array(some, dtype=np.intp)
            found[f"{name} and sensor"] = np.concatenate([found[name], frame])
    found["geometry"] = joined("offset", "length", "gain", "elastic", *FRAME)
    return {name: ix for name, ix in found.items() if len(ix)}


class _Groups(NamedTuple):
    """What is tested of one log."""

    every: Indices  # (p,), all parameters of the groups
    columns: dict[str, Indices]  # of each group, where its parameters stand in `every`
    moves: Array  # (p,) [unit], root mean square displacement by one of each parameter
    x: Array  # (n, m, p), derivative by them at the rows


class _Profile:
    """Log likelihoods [nats] of all hypotheses over sizes of the noise, for one shape of it."""

    def __init__(
        self, equations: Equations, y: Array, groups: _Groups,
        joint: int | None = None, ratio: float = 0.0,
    ) -> None:  # fmt: skip
        self.joint, self.ratio = joint, ratio
        flat = equations.whiten(y)
        self.x = equations.whiten(groups.x)
        self.sizes = equations.noises(flat)  # in `Reference.sizes`
        self.same = equations.likelihood(flat, self.sizes)
        self.power, self.pull = equations.information(flat, self.x, self.sizes)
        told = equations.values / (self.sizes[:, None] ** 2 + equations.values)
        square = 1.0 - (1.0 - told) ** 2
        self.freedom = len(flat) - square.sum(axis=1)  # of the noise
        # a larger smooth residual, or waves of a joint's curve, as of no smooth residual
        reference, log = equations.reference, equations.log
        others = [equations.larger(factor) for factor in DRIFTS]
        if joint is None and reference.body.rows:
            others.append(Equations(reference, log, waves=WAVES / CREPT, crept=CREPT))
        self.drift = np.max([e.likelihood(flat, self.sizes) for e in others], axis=0)
        self.gain: dict[str, Array] = {}
        self.directions: dict[str, int] = {}
        for name, ix in groups.columns.items():
            self.gain[name], self.directions[name] = _explained(self.power, self.pull, ix)


def _explained(power: Array, pull: Array, ix: Indices) -> tuple[Array, int]:
    """Quadratic form (s,) of a group's moment, and the directions that the rows tell apart."""
    a, v = power[:, ix[:, None], ix], pull[:, ix]
    size = np.sqrt(np.maximum(np.einsum("sii->si", a), 0.0))
    size = np.where(size > 0.0, size, 1.0)
    values, vectors = np.linalg.eigh(a / size[:, :, None] / size[:, None])
    turned = np.einsum("sij,si->sj", vectors, v / size)
    clear = values > 1e-9 * values[:, -1:]
    square = np.where(clear, turned**2 / np.where(clear, values, 1.0), 0.0).sum(axis=1)
    return np.asarray(square), int(clear[0].sum())


def group_tests(reference: Reference, log: Log, probes: Array) -> Tested:
    """Test every group.

    reference : the belief as the model knows it, in the frame of the log where that is new
    log : rows; `z` less what maps add to the body
    probes : (p, dof), joints all over the learned range
    """
    log = log.some(TESTED_ROWS)
    if len(log.q) < FEW_ROWS:  # weights of few rows favour what their fit could follow
        log = replace(log, weight=np.where(log.kept, 1.0, log.weight))
    body, structure = reference.body, reference.structure
    groups, y = _tested(reference, log, probes)
    equations = Equations(reference, log, crept=CREPT)
    profiles = [_Profile(equations, y, groups)]
    flat = equations.whiten(y)
    found, noise = _judged(profiles, equations, groups, flat)
    noisy = None
    more = noise > NOISIER * equations.usual or any(g.name == DRIFT and g.score > 1 for g in found)
    if more and not len(reference.forgotten):
        slope = structure.slope(log.q, reference.beta) / reference.sizes[:, None]
        lengths = np.sqrt((slope**2).sum(axis=1).mean(axis=0))
        for joint in np.flatnonzero(lengths > 0.0).tolist():
            for times in JOINT_NOISES:  # so that at the tip both are alike
                ratio = times / float(lengths[joint])
                other = Equations(reference, log, crept=CREPT, noisy=(joint, ratio))
                profiles.append(_Profile(other, y, groups, joint, ratio))
        noisy = _noisy_joint(profiles)
        if noisy is not None:
            found, noise = _judged(profiles, equations, groups, flat)
    # what the weights leave out, as the median tells it
    rest = equations.rest(flat, profiles[0].x, noise)
    rest = np.linalg.norm(noise * rest, axis=1) / np.sqrt(log.weight)
    free = y.size / max(y.size - len(groups.every), 1.0)
    told = float(np.median(rest)) / (1.177 if y.shape[1] == 2 else 1.54)
    told = max(told * float(np.sqrt(min(free, 2.0))), equations.usual) if not noisy else noise
    return Tested(tuple(found), told * float(reference.sizes[0]), float(body.noise[0]), noisy)


def _tested(reference: Reference, log: Log, probes: Array) -> tuple[_Groups, Array]:
    """The groups of which a sensor can see something, and the residuals (n, m)."""
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
    return _Groups(every, columns, moves, x), structure.residual(log.z, predicted)


def _noisy_joint(profiles: Sequence[_Profile]) -> tuple[int, float] | None:
    """The joint whose encoder's noise makes the log clearly more likely, whatever changed."""
    from scipy.special import chdtrc

    best, calm = _most_likely(profiles), _most_likely(profiles[:1])
    if best.profile.joint is None:
        return None
    joints = len({p.joint for p in profiles}) - 1
    if float(chdtrc(1, max(2.0 * (best.value - calm.value), 0.0))) * joints > FALSE_ALARM:
        return None
    return best.profile.joint, best.profile.ratio * float(best.profile.sizes[best.at])


def _judged(
    profiles: list[_Profile], equations: Equations, groups: _Groups, y: Array
) -> tuple[list[GroupTest], float]:
    """Each group's statistic and threshold, and the noise in sizes."""
    from scipy.special import chndtrinc, fdtrc, fdtri

    tests = len(groups.columns) + 1
    level = FALSE_ALARM / tests
    calm = max(profiles, key=lambda p: float(p.same.max()))
    least, at = float(calm.same.max()), int(np.argmax(calm.same))
    noise = _most_likely(profiles)
    # rows that err together count once
    temper = autocorrelation_time(equations.rest(y, profiles[0].x, float(calm.sizes[at])))
    count = len(y) / temper

    def judged(freedom: int, gain: float, left: float) -> tuple[float, float, float]:
        left = left / temper - freedom
        statistic = max(2.0 * gain, 0.0) / temper
        if left < LEFT:
            return statistic, np.inf, 1.0
        # a gain of a log likelihood, as the F of a regression with as many rows
        most = freedom / left * float(fdtri(freedom, left, 1.0 - level))
        f = left / freedom * np.expm1(min(statistic / count, 500.0))
        p = min(1.0, float(fdtrc(freedom, left, f)) * tests)
        return statistic, count * float(np.log1p(most)), p

    found = []
    for name, place in groups.columns.items():
        best = max(profiles, key=lambda p: float((p.same + 0.5 * p.gain[name]).max()))
        k = int(np.argmax(best.same + 0.5 * best.gain[name]))
        freedom = best.directions[name]
        gain = float(best.same[k] + 0.5 * best.gain[name][k]) - least
        if not freedom:
            continue
        statistic, threshold, p = judged(freedom, gain, float(best.freedom[k]))
        if not np.isfinite(threshold):
            continue
        power, pull = best.power[k][np.ix_(place, place)], best.pull[k][place]
        size = np.sqrt(np.maximum(np.diag(power), 1e-300))
        inverse = np.linalg.pinv(power / size[:, None] / size, rcond=1e-9, hermitian=True)
        estimate, deviation = inverse @ (pull / size) / size, np.sqrt(np.diag(inverse)) / size
        needed = float(chndtrinc(threshold, freedom, 1.0 - POWER)) * temper
        told = np.sqrt(max(noise.profile.power[noise.at][place[0], place[0]], 1e-300))
        smallest = float(np.sqrt(needed) / told * groups.moves[place[0]])
        found.append(
            GroupTest(
                name, statistic, threshold, p, groups.every[place], freedom, estimate,
                deviation * np.sqrt(temper), smallest,
            )
        )  # fmt: skip
    best = max(profiles, key=lambda p: float(p.drift.max()))
    k = int(np.argmax(best.drift))
    statistic, threshold, p = judged(1, float(best.drift[k]) - least, float(best.freedom[k]))
    found.append(GroupTest(DRIFT, statistic, threshold, p, np.zeros(0, dtype=np.intp)))
    size = noise.profile.sizes[noise.at] if any(g.score > 1.0 for g in found) else calm.sizes[at]
    return found, float(size)


class _Likely(NamedTuple):
    """The most likely size of the noise, whatever changed."""

    value: float
    profile: _Profile
    at: int


def _most_likely(profiles: Sequence[_Profile]) -> _Likely:
    """Of all hypotheses, by Akaike's criterion with its term of few rows (Hurvich 1989)."""
    tried = []
    for p in profiles:
        free = [
            p.same + 0.5 * gain - k * (1.0 + (k + 1.0) / np.maximum(p.freedom - k - 1.0, 0.1))
            for k, gain in zip(p.directions.values(), p.gain.values(), strict=True)
        ]
        for value in (p.same, p.drift - 1.0, *free):
            at = int(np.argmax(value))
            tried.append(_Likely(float(value[at]), p, at))
    return max(tried, key=lambda each: each.value)
