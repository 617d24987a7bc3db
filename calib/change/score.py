"""Tests: which freed group of parameters explains more of a log than chance does; and the bound.

The noise is that of a fit in which every group may have changed: it is unknown, and it may be that
of one joint's encoder.  So what a group explains has the chance of an F test.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from ..body.belief import Body
from ..body.covariance import autocorrelation_time
from ..body.parameters import Indices
from ..common.arrays import Array, Mask
from .equations import Equations, Log, Noisy, own_columns
from .frame import Reference
from .hypotheses import FRAME, TESTED, freedom, indices_of
from .rows import LogRows
from .settings import (
    BEYOND,
    CREPT,
    FALSE_ALARM,
    JOINT_NOISES,
    LARGE,
    NOISIER,
    TEST_ROWS,
)

_FINER = (0.5, 0.7, 1.0, 1.4, 2.0)  # times the noise of an encoder, once one is found
_POWER = 0.9  # share of logs in which the smallest change that is told would be found
_LARGEST = 1e8  # statistic beyond which no size of a change is computed
_LASTING = 10  # rows over which noise may last

DRIFT = "drift"
"""Name of the hypotheses that a smooth residual or waves are larger than the model told."""


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
    noisy: Noisy | None = None  # a joint whose encoder is noisy, its noise [rad or m]
    noisier: bool = (
        False  # whether the scatter is larger than usual, and that is no chance
    )

    @property
    def score(self) -> float:
        """Largest score of a group."""
        return max((g.score for g in self.groups), default=0.0)

    def bent_link(self, joint_names: Sequence[str]) -> str | None:
        """The placement that the tests name first: a link was bent or exchanged.

        The first joint's origin is the sensor's frame.
        """
        first = [group.name for group in fired(self.groups)[:1]]
        links = [f"placement:{name}" for name in joint_names[1:]]
        return first[0] if first and first[0] in links else None

    @property
    def too_few(self) -> bool:
        """Whether the rows could not show a large change of any group."""
        sizes = [g.smallest for g in self.groups if g.smallest > 0.0]
        return min(sizes, default=np.inf) > LARGE * max(self.noise, self.usual)

    @property
    def smallest(self) -> float:
        """Displacement [unit] that any single cause would have shown."""
        return max(
            (g.smallest for g in self.groups if g.smallest > 0.0), default=np.inf
        )


@dataclass(frozen=True)
class BoundTest:
    """The rows that are beyond the model's own 95 % bound."""

    beyond: float  # share of them
    test: GroupTest  # the chance of so many by noise

    def words(self, *, noisier: bool) -> str:
        """The share in words; `noisier` if noise may be all there is to it."""
        cause = "a noisier sensor or encoder, " if noisier else ""
        return (
            f"{100 * self.beyond:.0f} % of the rows are further from the prediction than its "
            f"bound, where 5 % should be: {cause}the bound does not hold"
        )


def fired(groups: Iterable[GroupTest]) -> tuple[GroupTest, ...]:
    """Groups above their threshold, the most telling first."""
    above = (g for g in groups if g.score > 1.0 and g.name != DRIFT)
    return tuple(sorted(above, key=lambda g: (-g.score, 3.0 * g.freedom - g.statistic)))


def groups_of(body: Body) -> dict[str, Indices]:
    """Groups that are tested: the sensor's view, and each joint's own parameters."""
    structure = body.structure
    frame = indices_of(structure, FRAME)
    found = {"sensor": frame}
    for name, *groups in (
        ("sensor scale", "view.scale"),
        ("sensor tilt", "view.tilt", "view.shear", "view.scale"),
        ("lens", "lens"),
    ):
        if len(indices_of(structure, groups[:1])):
            own = indices_of(structure, groups)[: 1 if name == "lens" else None]
            found[name] = np.concatenate([own, frame])
    joints: dict[str, list[int]] = {}
    for group in TESTED:
        for index in indices_of(structure, (group,)).tolist():
            # a payload bends all joints at once
            joint = (
                None
                if group in ("elastic", "payload")
                else structure.labels[index].joint
            )
            joints.setdefault(f"{group}:{joint}" if joint else group, []).append(index)
    for name, some in joints.items():
        found[name] = np.array(some, dtype=np.intp)
        found[f"{name} and sensor"] = np.concatenate([found[name], frame])
    found["geometry"] = indices_of(
        structure, ("offset", "length", "gain", "elastic", *FRAME)
    )
    return {name: ix for name, ix in found.items() if len(ix)}


class RichNoise:
    """The noise of one shape that is most likely where every group may have changed."""

    def __init__(
        self,
        reference: Reference,
        log: Log,
        residual: Array,
        noisy: Noisy | None = None,
    ) -> None:
        # the unit weights of a payload would leave few rows no freedom
        groups = [
            g
            for g in reference.structure.groups
            if not g.startswith(("curve", "payload"))
        ]
        sd = freedom(reference.body, tuple(groups), found=reference.forgotten)
        self.equations = e = Equations(
            reference, log, crept=CREPT, noisy=noisy, freed=sd
        )
        y = e.whiten(residual)
        self.size = e.most_likely_noise(y, e.usual)  # in `Reference.sizes`
        # of it and of the usual one [nats]
        self.likelihood, self.usual = e.likelihood(
            y, np.array([self.size, e.usual])
        ).tolist()
        # rows that err together count once
        self.temper = autocorrelation_time(e.rest(y, self.size))
        # directions of the rows that tell the noise
        told = e.values / (self.size**2 + e.values)
        self.left = (len(y) - float((1.0 - (1.0 - told) ** 2).sum())) / self.temper
        self.shape = noisy


def group_tests(reference: Reference, log: Log, probes: Array) -> Tested:
    """Test every group against the belief as the model knows it.

    probes : (p, dof), joints all over the learned range
    """
    from scipy.special import chdtrc, chndtrinc, fdtrc, fdtri

    log = log.some(TEST_ROWS)
    structure = reference.structure
    groups = groups_of(reference.body)
    beta = reference.beta
    every = np.unique(np.concatenate(list(groups.values())))
    predicted, x = structure.linearise(log.q, beta, every)
    residual = structure.residual(log.z, predicted)
    moves = structure.linearise(probes, beta, every)[1][:, : structure.blocks[0]]
    moves = np.sqrt((moves**2).sum(axis=1).mean(axis=0))
    noise = RichNoise(reference, log, residual)
    noisier = False
    if noise.size > NOISIER * noise.equations.usual and not len(reference.forgotten):
        slope = structure.slope(log.q, beta) / reference.sizes[:, None]
        lengths = np.sqrt((slope**2).sum(axis=1).mean(axis=0))
        joints = np.flatnonzero(lengths > 0.0).tolist()
        # so that at the tip both are alike
        shapes = [(k, times / lengths[k]) for k, times in product(joints, JOINT_NOISES)]
        tried = [
            noise,
            *(RichNoise(reference, log, residual, shape) for shape in shapes),
        ]
        best = max(tried, key=lambda n: n.likelihood)
        gains = 2.0 * (best.likelihood - np.array([noise.usual, noise.likelihood]))
        chance = chdtrc([2, 1], np.maximum(gains / noise.temper, 0.0)) * (
            1 + len(joints)
        )
        noisier = bool(chance[0] < FALSE_ALARM)
        if best.shape is not None and chance[1] < FALSE_ALARM:
            k, ratio = best.shape
            finer = [
                RichNoise(reference, log, residual, (k, ratio * times))
                for times in _FINER
            ]
            noise = max(finer, key=lambda n: n.likelihood)
    e = Equations(reference, log, crept=CREPT, noisy=noise.shape)
    y = e.whiten(residual)
    x = e.whiten(x)
    power, pull = e.information(y, x, noise.size)
    found = []
    count = len(groups) + 2
    for name, indices in groups.items():
        place = np.searchsorted(every, indices)
        if name.startswith(
            "elastic"
        ):  # of a joint about a vertical axis no load is felt
            place = place[np.argsort(-moves[place], kind="stable")]
        told = power[place[0], place[0]]
        if not told > 0.0:  # a tracker has no lens
            continue
        size = np.sqrt(np.maximum(power[place, place], 1e-300))
        values, vectors = np.linalg.eigh(
            power[np.ix_(place, place)] / size[:, None] / size
        )
        clear = values > 1e-9 * values[-1]
        values = values[clear]
        vectors = vectors[:, clear] / size[:, None]
        turned = vectors.T @ pull[place]
        k = len(values)
        statistic = float((turned**2 / values).sum()) / noise.temper
        p = min(1.0, count * float(fdtrc(k, noise.left, statistic / k)))
        deviation = np.sqrt((vectors**2 / values).sum(axis=1) * noise.temper)
        least = k * float(fdtri(k, noise.left, 1.0 - FALSE_ALARM / count))
        # with hardly a row left for the noise no change is large enough
        enough = least < _LARGEST
        needed = chndtrinc(least, k, 1.0 - _POWER) * noise.temper if enough else np.inf
        change = every[place], vectors @ (turned / values), deviation
        smallest = float(np.sqrt(needed / told) * moves[place[0]])
        found.append(GroupTest(name, p, statistic, k, change, smallest))
    # The variance of a smooth residual, or of waves of the joints (chance by Satterthwaite 1946).
    # Waves that are finer than the rows look like a noisy encoder.
    waved = reference.body.rows and noise.shape is None
    curves = indices_of(structure, ("curve",)) if waved else every[:0]
    waves = (
        structure.linearise(log.q, beta, curves)[1]
        * structure.prior(("curve",)).sd[curves]
    )
    for columns in (own_columns(reference, log, 1.0), waves):
        power, pull = e.information(y, e.whiten(columns), noise.size)
        mean = float(np.trace(power))
        square = float((power**2).sum())
        if mean > 0.0:
            spread = mean**2 / square
            ratio = float(pull @ pull) / mean / noise.temper
            p = min(1.0, count * float(fdtrc(spread, noise.left, ratio)))
            found.append(GroupTest(DRIFT, p, spread * ratio, round(spread)))
    noisy = None
    now = noise.size * float(reference.sizes[0])
    if noise.shape is not None:
        noisy = noise.shape[0], noise.shape[1] * noise.size
    return Tested(tuple(found), now, float(reference.body.noise[0]), noisy, noisier)


def bound_test(
    rows: LogRows, sound: Mask, limit: Array, shared: Array | float, tests: Tested
) -> BoundTest:
    """Count the rows beyond the 95 % bound, beside what a noisier sensor or encoder would do.

    sound : (n,), rows that do not contradict all others; k of them
    limit : (n,), the bound of each row [unit]
    shared : (k,), variance of what all rows share [unit^2]
    """
    from scipy.special import bdtrc, chdtri

    index = np.flatnonzero(sound)
    away = (rows.x - rows.predicted)[index]
    bound = limit[index]
    square = (away**2).sum(axis=1)
    outputs = away.shape[1]
    radius = float(
        chdtri(outputs, 0.05)
    )  # squared, of 95 % of a Gaussian, in deviations
    # half of the rows of a noisier sensor are nearer than its median
    noise = max(tests.noise**2, float(np.median(square)) / float(chdtri(outputs, 0.5)))
    noise = max(noise - tests.usual**2, 0.0)
    if (
        noise
        and alike(index, rows.u[index], away) * radius > float(np.median(bound)) ** 2
    ):
        noise = 0.0
    variance = np.full(len(index), noise)
    if tests.noisy is not None:
        joint, sd = tests.noisy
        slope = rows.body.structure.slope(rows.q[index], rows.body.beta)[..., joint]
        variance += sd**2 * (slope**2).sum(axis=1)
    over = square > bound**2 + radius * (shared + variance)
    # rows that err together count once
    time = autocorrelation_time(over[:, None].astype(float)) if over.any() else 1.0
    count = int(over.sum() / time)
    independent = math.ceil(len(over) / time)
    p = float(bdtrc(count - 1, independent, BEYOND)) if count else 1.0
    test = GroupTest("bound", p, -2.0 * math.log(max(p, 1e-300)))
    return BoundTest(float(np.mean(square > bound**2 + radius * shared)), test)


def alike(rows: Indices, u: Array, residual: Array) -> float:
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
