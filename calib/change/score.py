"""Score tests: which freed group of parameters explains more of a log than chance does.

One set of normal equations.  A log of an arm that has not changed is normal: its covariance is
that of the model's posterior, of a residual of this log alone, and of noise.  The size of the
noise is unknown, and it may be that of one joint's encoder; each is what makes the log most
likely, with the group freed and without.  Twice the gain in log likelihood is the statistic; its
threshold is that of an F test, so that a noise of few rows is not taken for known.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..body.belief import Body
from ..body.covariance import autocorrelation_time
from ..body.likeness import lengths_of, matern
from ..body.parameters import Indices
from ..common.arrays import Array
from ..common.rows import thinned
from .members import FRAME, TESTED, drift
from .reference import Reference
from .rows import Log
from .settings import (
    CREPT,
    DRIFTS,
    FALSE_ALARM,
    FEW_ROWS,
    JOINT_NOISES,
    LEAST_NOISE,
    LEAST_OWN,
    LEFT,
    NOISES,
    NOISIER,
    POWER,
    TESTED_NODES,
    TESTED_ROWS,
    WAVES,
)

DRIFT = "drift"
"""Name of the hypothesis that a smooth residual is larger than the model told."""


@dataclass(frozen=True)
class GroupTest:
    """One group of parameters, freed alone."""

    name: str  # ``"sensor"``, ``"sensor scale"``, ``"length:elbow"``, ``"geometry"``, ``"drift"``
    indices: Indices  # (p,), its parameters; the first is the one that the group is about
    # twice the gain in log likelihood, and what chance stays below in 999 of 1,000 logs
    statistic: float
    threshold: float
    p_value: float  # chance of such a statistic where nothing changed, after Bonferroni
    freedom: int  # directions that the rows tell apart
    # (p,), change of each parameter and its standard deviation
    estimate: Array
    deviation: Array
    # [unit], root mean square displacement, over the learned range, of the smallest change of the
    # first parameter that these rows would show nine times in ten
    smallest: float

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
    noisy: tuple[int, float] | None  # a joint whose encoder is noisy, and its noise [rad or m]

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
    known = structure.groups

    def joined(*names: str) -> Indices:
        return np.concatenate([known[n] for n in names if n in known]).astype(np.intp)

    frame = joined(*FRAME)
    found = {"sensor": frame}
    if "view.scale" in known:
        found["sensor scale"] = np.concatenate([known["view.scale"], frame])
    if "view.tilt" in known:
        found["sensor tilt"] = joined("view.tilt", "view.shear", "view.scale", *FRAME)
    if "lens" in known and len(known["lens"]):
        found["lens"] = np.concatenate([known["lens"][:1], frame])
    own: dict[str, list[int]] = {}
    for group in TESTED:
        for index in known.get(group, ()):
            joint = structure.label(int(index)).joint
            own.setdefault(f"{group}:{joint}" if joint else group, []).append(int(index))
    if len(known.get("elastic", ())):  # a payload bends all joints at once
        own["elastic"] = known["elastic"].tolist()
    for name, indices in own.items():
        found[name] = np.array(indices, dtype=np.intp)
        found[f"{name} and sensor"] = np.concatenate([found[name], frame])
    found["geometry"] = joined("offset", "length", "gain", "elastic", *FRAME)
    return {k: np.asarray(ix, dtype=np.intp) for k, ix in found.items() if len(ix)}


class _Profile(NamedTuple):
    """Log likelihoods over sizes of the noise, for one shape of it."""

    joint: int | None  # whose encoder is noisy
    ratio: float  # of that noise [rad or m] to the sensor's [size]
    sizes: Array  # (s,), noise in `Reference.sizes`
    same: Array  # (s,) [nats], nothing changed
    drift: Array  # (s,) [nats], the best size of a larger smooth residual
    gain: dict[str, Array]  # (s,), of each group: its quadratic form
    directions: dict[str, int]  # directions of each group that the rows tell apart
    power: Array  # (s, p, p) and (s, p): information on the tested parameters and its moment
    pull: Array
    freedom: Array  # (s,), of the noise


class _Normal:
    """The normal equations of one log: columns of what is unknown, of what is tested, rows."""

    def __init__(self, reference: Reference, log: Log, every: Indices) -> None:
        body, structure = reference.body, reference.structure
        self.body, self.log, self.size = body, log, reference.sizes
        places = slice(structure.blocks[0])
        (n, m), active = log.z.shape, body.active
        both = np.union1d(active, every)
        predicted, x = structure.linearise(log.q, reference.beta, both)
        x = x / self.size[:, None]
        self.y = structure.residual(log.z, predicted) / self.size
        self.tested = x[..., np.searchsorted(both, every)]
        root = np.where(np.isin(active, reference.forgotten)[:, None], 0.0, body.root)
        known = x[..., np.searchsorted(both, active)].reshape(n * m, -1) @ root
        own = np.maximum(body.tau, LEAST_OWN * np.asarray(structure.extents)) / self.size
        nodes = log.q[thinned(n, TESTED_NODES)]
        lengths = lengths_of(body, log.q)
        alike = matern(nodes, nodes, lengths)
        alike[np.diag_indices(len(nodes))] += 1e-6
        smooth = np.linalg.solve(np.linalg.cholesky(alike), matern(nodes, log.q, lengths)).T
        smooth = np.einsum("nk,ij,j->nikj", smooth, np.eye(m), own).reshape(n, m, -1)
        curves = np.flatnonzero(drift(body, WAVES) > drift(body)) if body.rows else every[:0]
        moved = structure.linearise(log.q, reference.beta, curves)[1] / self.size[:, None]
        self.waves = moved * drift(body, WAVES)[curves]
        crept = CREPT * drift(body)
        crept = x[..., crept[both] > 0] * crept[both][crept[both] > 0]
        known = np.concatenate([body.kappa * known.reshape(n, m, -1), crept], axis=2)
        parts = [known, body.kappa * smooth]
        if log.shared:  # a frame that is shifted and bent as a plane is, as the board was found
            bent = np.concatenate([np.ones((n, 1)), predicted[:, places] / structure.extents[0]], 1)
            part = np.einsum("nk,ij,j->nikj", bent, np.eye(m), log.shared / self.size)
            parts.append(part.reshape(n, m, -1))
        self.unknown = np.concatenate(parts, axis=2)
        self.smooth = np.arange(parts[0].shape[2], parts[0].shape[2] + parts[1].shape[2])
        self.slope = structure.slope(log.q, reference.beta) / self.size[:, None]
        floor = np.maximum(body.noise, LEAST_NOISE * np.asarray(structure.extents)) / self.size
        self.usual = float(floor[0])

    def whitened(self, joint: int | None, ratio: float) -> tuple[Array, Array, Array, float]:
        """Unknown and tested columns, residuals and log determinant, under a shape of the noise."""
        root = np.sqrt(self.log.weight)[:, None]
        parts = [self.unknown, self.tested, self.y[..., None]]
        log_determinant = -2.0 * self.y.shape[1] * float(np.log(root).sum())
        if joint is not None:  # I + ratio^2 g g' of each row has one eigenvalue that is not 1
            g = self.slope[..., joint]
            length = (g**2).sum(axis=1)
            value = 1.0 + ratio**2 * length
            g = g / np.sqrt(np.maximum(length, 1e-300))[:, None]
            less = (1.0 - 1.0 / np.sqrt(value))[:, None]
            parts = [
                p - (less * g)[..., None] * np.einsum("nm,nmk->nk", g, p)[:, None] for p in parts
            ]
            log_determinant += float(np.log(value).sum())
        count = self.y.size
        b, j, y = ((p * root[..., None]).reshape(count, -1) for p in parts)
        return b, j, y[:, 0], log_determinant

    def profile(self, groups: dict[str, Indices], joint: int | None, ratio: float) -> _Profile:
        """Log likelihoods of all hypotheses over sizes of the noise; `groups` are columns."""
        b, j, y, determinant = self.whitened(joint, ratio)
        most = max(2.0 * float(np.sqrt(np.mean(y**2))), 2.0 * self.usual)
        sizes = np.geomspace(self.usual, most, NOISES)
        square, yy = sizes**2, float(y @ y)
        gram, moment, across = b.T @ b, b.T @ y, b.T @ j

        def likelihood(values: Array, turned: Array) -> Array:
            total = square[:, None] + values
            size = len(y) * np.log(square) + np.log(total / square[:, None]).sum(axis=1)
            left = (yy - (turned**2 / total).sum(axis=1)) / square
            return np.asarray(-0.5 * (size + left + determinant))

        values, vectors = np.linalg.eigh(gram)
        values, turned = np.maximum(values, 0.0), vectors.T @ moment
        same = likelihood(values, turned)
        larger = []
        for factor in DRIFTS:
            scale = np.ones(len(gram))
            scale[self.smooth] = factor
            v, w = np.linalg.eigh(gram * scale[:, None] * scale)
            larger.append(likelihood(np.maximum(v, 0.0), w.T @ (scale * moment)))
        if joint is None and self.waves.shape[2]:  # of a joint's curve, as of no smooth residual
            root = np.sqrt(self.log.weight)[:, None, None]
            more = np.concatenate([b, (self.waves * root).reshape(len(y), -1)], axis=1)
            v, w = np.linalg.eigh(more.T @ more)
            larger.append(likelihood(np.maximum(v, 0.0), w.T @ (more.T @ y)))
        c = vectors.T @ across
        inner, lead = j.T @ j, j.T @ y
        power, pull = np.empty((len(sizes), *inner.shape)), np.empty((len(sizes), len(lead)))
        for k, total in enumerate(square[:, None] + values):
            power[k] = (inner - (c / total[:, None]).T @ c) / square[k]
            pull[k] = (lead - c.T @ (turned / total)) / square[k]
        explained = {name: _explained(power, pull, ix) for name, ix in groups.items()}
        gain = {name: square for name, (square, _) in explained.items()}
        count = {name: told for name, (_, told) in explained.items()}
        told = 1.0 - (square[:, None] / (square[:, None] + values)) ** 2
        return _Profile(
            joint, ratio, sizes, same, np.max(larger, axis=0), gain, count, power, pull,
            len(y) - told.sum(axis=1),
        )  # fmt: skip

    def rest(self, size: float) -> Array:
        """What neither unknown nor tested columns follow of the residuals, (n, m) in noises."""
        b, j, y, _ = self.whitened(None, 0.0)
        length = np.linalg.norm(j, axis=0)
        a = np.concatenate([b, j * (1e3 * size / np.where(length > 0, length, 1.0))], axis=1)
        a = a[:, np.abs(a).any(axis=0)]
        inner = a.T @ a
        inner[np.diag_indices(len(inner))] += size**2
        return np.asarray((y - a @ np.linalg.solve(inner, a.T @ y)).reshape(self.y.shape) / size)


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
    groups = groups_of(body)
    every = np.unique(np.concatenate(list(groups.values())))
    normal = _Normal(reference, log, every)
    _, moves = structure.linearise(probes, reference.beta, every)
    moves = np.sqrt((moves[:, : structure.blocks[0]] ** 2).sum(axis=1).mean(axis=0))
    columns = {}
    for name, indices in groups.items():
        if name.startswith("elastic"):  # of a joint about a vertical axis no load is felt
            indices = indices[np.argsort(-moves[np.searchsorted(every, indices)], kind="stable")]
        place = np.searchsorted(every, indices)
        if normal.tested[..., place[0]].any():  # what a sensor can see: a tracker has no lens
            columns[name] = place
    profiles = [normal.profile(columns, None, 0.0)]
    found, noise = _judged(profiles, normal, columns, every, moves)
    noisy = None
    more = noise > NOISIER * normal.usual or any(g.name == DRIFT and g.score > 1.0 for g in found)
    if more and not len(reference.forgotten):
        for joint in range(structure.dof):
            for ratio in _ratios(normal, joint):
                profiles.append(normal.profile(columns, joint, ratio))
        noisy = _noisy_joint(profiles)
        if noisy is not None:
            found, noise = _judged(profiles, normal, columns, every, moves)
    unit = float(reference.sizes[0])
    # what the weights leave out, as the median tells it
    rest = np.linalg.norm(noise * normal.rest(noise), axis=1) / np.sqrt(log.weight)
    free = rest.size * normal.y.shape[1] / max(rest.size * normal.y.shape[1] - len(every), 1.0)
    told = float(np.median(rest)) / (1.177 if normal.y.shape[1] == 2 else 1.54)
    told = max(told * float(np.sqrt(min(free, 2.0))), normal.usual) if not noisy else noise
    return Tested(tuple(found), told * unit, float(body.noise[0]), noisy)


def _ratios(normal: _Normal, joint: int) -> Iterator[float]:
    """Sizes of one encoder's noise over the sensor's, so that at the tip both are alike."""
    length = float(np.sqrt((normal.slope[..., joint] ** 2).sum(axis=1).mean()))
    if length > 0.0:
        yield from (ratio / length for ratio in JOINT_NOISES)


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
    profiles: list[_Profile],
    normal: _Normal,
    columns: dict[str, Indices],
    every: Indices,
    moves: Array,
) -> tuple[list[GroupTest], float]:
    """Each group's statistic and threshold, and the noise in sizes."""
    from scipy.special import chndtrinc, fdtrc, fdtri

    level = FALSE_ALARM / (len(columns) + 1)
    calm = max(profiles, key=lambda p: float(p.same.max()))
    least = float(calm.same.max())
    noise = _most_likely(profiles)
    at = int(np.argmax(calm.same))
    # rows that err together count once
    temper = autocorrelation_time(normal.rest(float(calm.sizes[at])))
    count = normal.y.size / temper

    def judged(freedom: int, gain: float, left: float) -> tuple[float, float, float]:
        left = left / temper - freedom
        statistic = max(2.0 * gain, 0.0) / temper
        if left < LEFT:
            return statistic, np.inf, 1.0
        # a gain of a log likelihood, as the F of a regression with as many rows
        most = freedom / left * float(fdtri(freedom, left, 1.0 - level))
        f = left / freedom * np.expm1(min(statistic / count, 500.0))
        return statistic, count * float(np.log1p(most)), float(fdtrc(freedom, left, f))

    found = []
    for name, place in columns.items():
        best = max(profiles, key=lambda p: float((p.same + 0.5 * p.gain[name]).max()))
        k = int(np.argmax(best.same + 0.5 * best.gain[name]))
        likelihood = float(best.same[k] + 0.5 * best.gain[name][k])
        power, pull = best.power[k][np.ix_(place, place)], best.pull[k][place]
        freedom = best.directions[name]
        if not freedom:
            continue
        size = np.sqrt(np.maximum(np.diag(power), 1e-300))
        inverse = np.linalg.pinv(power / size[:, None] / size, rcond=1e-9, hermitian=True)
        statistic, threshold, p = judged(freedom, likelihood - least, float(best.freedom[k]))
        if not np.isfinite(threshold):
            continue
        needed = float(chndtrinc(threshold, freedom, 1.0 - POWER)) * temper
        told = np.sqrt(max(noise.profile.power[noise.at][place[0], place[0]], 1e-300))
        smallest = np.sqrt(needed) / told * moves[place[0]]
        estimate, deviation = inverse @ (pull / size) / size, np.sqrt(np.diag(inverse)) / size
        p_value = min(1.0, p * (len(columns) + 1))
        found.append(
            GroupTest(
                name, every[place], statistic, threshold, p_value, freedom, estimate,
                deviation * np.sqrt(temper), float(smallest),
            )
        )  # fmt: skip
    best = max(profiles, key=lambda p: float(p.drift.max()))
    k = int(np.argmax(best.drift))
    statistic, threshold, p = judged(1, float(best.drift[k]) - least, float(best.freedom[k]))
    p_value = min(1.0, p * (len(columns) + 1))
    none = np.zeros(0)
    found.append(
        GroupTest(DRIFT, none.astype(np.intp), statistic, threshold, p_value, 1, none, none, 0.0)
    )
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
