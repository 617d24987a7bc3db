"""System: a log beside a belief, linear in all that may have changed.

    y = X d + e,    e ~ N(0, K + noise^2)

K is what the belief does not know of an unchanged arm: its posterior, a creep, a smooth residual
of this log, what all rows share.  Tests and evidences are sub-blocks of the normal equations.
"""

from __future__ import annotations

import math
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..body.covariance import root_of
from ..body.fit import Fit
from ..body.information import lengths_of, matern
from ..body.parameters import Indices, Prior
from ..body.rows import Rows
from ..body.settings import STUDENT
from ..common.arrays import Array, Mask
from ..common.rows import spread_rows
from .causes import changeable, creep, freedom
from .frame import Reference, offset_after
from .rows import LogRows
from .settings import OUTLIER, PSEUDO


@dataclass(frozen=True)
class SystemSettings:
    """How large the system of a log is."""

    # of a system: its power grows with them, its work too
    rows: int = 300
    # of the log's own residual; more did not change a verdict on A and C
    nodes: int = 40
    # sizes of the noise that are compared, from where on, and that of an exact model
    noises: int = 64
    least: float = 1e-2
    exact: float = 1e-3
    # variance of an axis, of that of the noise, which no test tells
    nothing: float = 1e-10
    # 12 took exact rows of a longer link for outliers
    robust_steps: int = 60
    # of the fit that finds outliers: enough for every parameter
    robust_rows: int = 400


SYSTEM = SystemSettings()


NoisyJoint = tuple[int, float]
"""A joint whose encoder is noisy, and how much."""


@dataclass(frozen=True)
class Log:
    """Rows of a log that do not contradict all others."""

    # (n, dof), (n, m), joints [rad or m] and outputs, without what maps add to the body [unit]
    q: Array
    z: Array
    # [unit], standard deviation that all rows share, such as that of a board that was found again
    shared: float = 0.0

    def some(self, most: int) -> Log:
        """Return at most so many rows, evenly spread."""
        rows = spread_rows(len(self.q), most)
        return replace(self, q=self.q[rows], z=self.z[rows])


def sound_rows(reference: Reference, q: Array, z: Array) -> Mask:
    """Return which rows (n, dof), (n, m) are near a robust fit of all that may have changed."""
    structure = reference.structure
    body = reference.body
    start = reference.beta
    size = reference.sizes
    sd = freedom(body, changeable(structure))
    prior = Prior(start, np.hypot(sd, creep(body)))
    rows = spread_rows(len(q), SYSTEM.robust_rows)
    measured = [Rows(q[rows], z[rows], floor=size)]
    fit = Fit(structure, measured, start, prior, nu=STUDENT)
    fit.maximise(steps=SYSTEM.robust_steps)
    predicted = structure.predict(q, fit.beta)
    residual = structure.residual(z, predicted) / size
    square = (residual**2).sum(axis=1)
    outputs = residual.shape[1]
    median = float(np.median(square[rows]))
    noise = max(median / (outputs - 2 / 3), 1.0)
    return np.asarray(square <= OUTLIER**2 * outputs * noise)


def sound_data(rows: LogRows, reference: Reference) -> tuple[LogRows, Log]:
    """Return the rows that do not contradict all others, and what a body has to say of them."""
    added = rows.map_offset
    if reference.new:
        body = reference.body
        added = offset_after(rows.body, body, reference.beta, rows.q, added)
    z = rows.x - added
    sound = sound_rows(reference, rows.q, z)
    rows = rows.sound(sound)
    # that of the model's own log and of this one
    shared = math.sqrt(2.0) * rows.shared
    return rows, Log(rows.q, z[sound], shared)


class System:
    """Rows of a log beside a reference, in noises: N numbers, of n rows and m outputs.

    noisy : a joint whose encoder is noisy, and its noise over that of the sensor [rad or m / size]
    """

    def __init__(
        self, reference: Reference, log: Log, noisy: NoisyJoint | None = None
    ) -> None:
        structure = reference.structure
        self.reference = reference
        self.log = log.some(SYSTEM.rows)
        self.noisy = noisy
        q = self.log.q
        self.slope = structure.slope(q, reference.beta)
        self.predicted, columns = structure.linearise(q, reference.beta)
        rest = structure.residual(self.log.z, self.predicted)
        # (N, d), columns of all parameters; those of the reference stay where the system is set
        # up again elsewhere, and with them what is unknown
        self.first = self.whiten(columns)
        self.x = self.first
        self.y = self.whiten(rest)
        self._unknown: dict[float, Unknown] = {}

    @cached_property
    def _white(self) -> tuple[Array, float]:
        """Roots (n, m, m) of the precision of each row, and the logarithm of their covariance."""
        sizes = self.reference.sizes
        rows = len(self.log.q)
        white = np.tile(np.diag(1.0 / sizes), (rows, 1, 1))
        if self.noisy is None:
            return white, 0.0
        # noise of a joint, too: I + ratio^2 g g' of a row has one eigenvalue beside 1
        joint, ratio = self.noisy
        g = self.slope[..., joint] / sizes
        square = (g**2).sum(axis=1)
        length = np.sqrt(np.maximum(square, 1e-300))
        g /= length[:, None]
        value = 1.0 + ratio**2 * square
        less = 1.0 - 1.0 / np.sqrt(value)
        along = g[:, None] @ white
        white -= less[:, None, None] * g[:, :, None] * along
        return white, float(np.log(value).sum())

    @property
    def log_determinant(self) -> float:
        """That of the rows' noise, over the usual one."""
        return self._white[1]

    def whiten(self, x: Array) -> Array:
        """Return residuals (n, m) or columns (n, m, k) [unit] in noises: (N,) or (N, k)."""
        roots, _ = self._white
        n, m, *columns = x.shape
        flat: Array = roots @ x.reshape(n, m, -1)
        return flat.reshape(n * m, *columns)

    def residual(self, beta: Array, free: Indices) -> tuple[Array, Array]:
        """Residuals (n, m) [unit] at parameters (d,), and columns (N, k) of some of these."""
        structure = self.reference.structure
        with np.errstate(all="ignore"):
            predicted, columns = structure.linearise(self.log.q, beta, free)
            residual = structure.residual(self.log.z, predicted)
        return residual, self.whiten(columns)

    def again(self, at: Array) -> System:
        """Return the same rows, linearised elsewhere; changes count from the reference."""
        every = np.arange(len(at))
        change = at - self.reference.beta
        system = copy(self)
        residual, system.x = self.residual(at, every)
        system.y = self.whiten(residual) + system.x @ change
        return system

    def unknown(self, waves: float) -> Unknown:
        """What is not known of an arm whose joints may have such waves."""
        if waves not in self._unknown:
            self._unknown[waves] = Unknown(self, waves)
        return self._unknown[waves]


@dataclass(frozen=True)
class Products:
    """What tests ask of rows in noises: products of residuals y (N,) and columns x (N, k).

    So much is the same whether rows are at hand or were forgotten one by one.
    """

    count: float  # N
    square: float  # y'y
    pull: Array  # (k,), x'y
    power: Array  # (k, k), x'x
    values: Array  # (r,), variances of what is unknown
    axes_y: Array  # (r,), the residuals along its axes
    axes_x: Array  # (r, k), the columns along them
    log_determinant: float = 0.0  # of the rows' noise, over the usual one

    @staticmethod
    def of_gram(count: float, gram: Array, unknown: int) -> Products:
        """Products of the gram (r + k + 1)^2 of unknown columns (r), columns and residuals."""
        values, turns = np.linalg.eigh(gram[:unknown, :unknown])
        some = values > SYSTEM.nothing
        values = values[some]
        along = turns[:, some].T @ gram[:unknown, unknown:]
        along /= np.sqrt(values)[:, None]
        rest = gram[unknown:, unknown:]
        return Products(
            count,
            float(rest[-1, -1]),
            rest[:-1, -1],
            rest[:-1, :-1],
            values,
            along[:, -1],
            along[:, :-1],
        )

    def likelihood(self, noise: Array | float) -> Array:
        """Log likelihood (s,) [nats] of the residuals under sizes (s,) of the noise."""
        variance = np.atleast_1d(noise) ** 2
        column = variance[:, None]
        size = np.log1p(self.values / column).sum(axis=1)
        size += self.count * np.log(variance)
        share = self.values / (column + self.values)
        square = self.square - share @ self.axes_y**2
        rest = square / variance
        likelihood: Array = -0.5 * (size + rest + self.log_determinant)
        return likelihood

    def information(self, noise: float) -> tuple[Array, Array]:
        """Information (k, k) on the columns, whatever else is unknown, and its moments (k,)."""
        share = self.values / (noise**2 + self.values)
        less = self.axes_x.T * share
        power = self.power - less @ self.axes_x
        pull = self.pull - less @ self.axes_y
        return power / noise**2, pull / noise**2

    def noises(self, least: float | None = None) -> tuple[Array, Array]:
        """Sizes (s,) of the noise, and their log likelihood.

        They are `least` at least; where that is not given the old noise counts for some rows.
        """
        usual = math.sqrt(self.square / self.count)
        high = 2.0 * max(usual, least or 1.0)
        low = least or SYSTEM.least
        sizes = np.geomspace(low, high, SYSTEM.noises)
        likelihood = self.likelihood(sizes)
        if least is None:
            likelihood -= PSEUDO * (np.log(sizes) + 0.5 / sizes**2)
        return sizes, likelihood

    def most_likely_noise(self, least: float | None = None) -> float:
        """Size of the noise of the greatest likelihood."""
        sizes, likelihood = self.noises(least)
        best = np.argmax(likelihood)
        return float(sizes[best])

    def freedom(self, noise: float) -> float:
        """Directions of the rows that tell the noise, whatever else is unknown."""
        share = self.values / (noise**2 + self.values)
        lost = share * (2.0 - share)
        return self.count - float(lost.sum())


class Unknown:
    """What no change tells of a log: principal axes (N, r) and variances (r,) in noises.

    waves : of `WAVES`
    crept : times the usual creep of the parameters
    freed : (d,), standard deviation by which parameters may have changed
    """

    def __init__(
        self,
        system: System,
        waves: float,
        crept: float = 1.0,
        freed: Array | None = None,
    ) -> None:
        reference = system.reference
        active, root = prior_columns(reference, waves, crept, freed)
        smooth = residual_columns(reference, system.log)
        shared = frame_columns(reference, system.log, system.predicted)
        parts = [
            system.whiten(smooth),
            system.first[:, active] @ root,
            system.whiten(shared),
        ]
        self.system = system
        self.axes, self.values = principal_axes(np.concatenate(parts, axis=1))

    def products(self, y: Array, x: Array) -> Products:
        """Products of residuals (N,) and columns (N, k)."""
        return Products(
            count=len(y),
            square=float(y @ y),
            pull=x.T @ y,
            power=x.T @ x,
            values=self.values,
            axes_y=self.axes.T @ y,
            axes_x=self.axes.T @ x,
            log_determinant=self.system.log_determinant,
        )

    def rest(self, x: Array, noise: float) -> Array:
        """Return what the unknown does not follow of residuals or columns, by rows, in noises."""
        share = self.values / (noise**2 + self.values)
        along = (self.axes.T @ x).T * share
        rest: Array = (x - self.axes @ along.T) / noise
        rows = len(self.system.log.q)
        return rest.reshape(rows, -1, *x.shape[1:])


def principal_axes(columns: Array) -> tuple[Array, Array]:
    """Axes (N, r) and variances (r,) of `columns` (N, k) times independent standard normals.

    The smaller of the two products is taken apart.
    """
    rows, unknown = columns.shape
    if rows <= unknown:
        values, axes = np.linalg.eigh(columns @ columns.T)
        return axes, np.maximum(values, 0.0)
    values, turns = np.linalg.eigh(columns.T @ columns)
    some = values > SYSTEM.nothing
    values = values[some]
    axes = columns @ turns[:, some]
    return axes / np.sqrt(values), values


def residual_columns(reference: Reference, log: Log) -> Array:
    """Outputs (n, m, p m) by a smooth residual of one log, by its values at p of its rows."""
    nodes = log.q[spread_rows(len(log.q), SYSTEM.nodes)]
    return smooth_columns(reference, log.q, nodes)


def smooth_columns(reference: Reference, q: Array, nodes: Array) -> Array:
    """A smooth residual (a Gaussian process): (n, m, p m) by its values at joints (p, dof)."""
    lengths = lengths_of(reference.body, nodes)
    alike = matern(nodes, nodes, lengths)
    alike[np.diag_indices(len(alike))] += 1e-6
    root = np.linalg.cholesky(alike)
    features = np.linalg.solve(root, matern(nodes, q, lengths))
    sd = np.diag(reference.body.kappa * reference.residual_sd)
    columns: Array = np.einsum("kn,ij->nikj", features, sd)
    return columns.reshape(len(q), len(sd), -1)


def prior_columns(
    reference: Reference,
    waves: float,
    crept: float = 1.0,
    freed: Array | None = None,
) -> tuple[Indices, Array]:
    """What is unknown of the arm's parameters: which (k,), by standard normals (k, r).

    waves : of `WAVES`
    crept, freed : as of `Unknown`
    """
    body = reference.body
    sd = crept * creep(body, waves)
    lost = reference.forgotten
    if freed is not None:  # of a frame that is held the old knowledge stays
        sd = np.hypot(sd, freed)
        lost = np.intersect1d(lost, np.flatnonzero(freed))
    active = np.union1d(body.active, np.flatnonzero(sd))
    active = active.astype(np.intp)
    covariance = np.diag(sd[active] ** 2)
    old = body.root.copy()
    old[np.isin(body.active, lost)] = 0.0
    place = np.searchsorted(active, body.active)
    covariance[np.ix_(place, place)] += body.kappa**2 * old @ old.T
    return active, root_of(covariance)


def frame_columns(reference: Reference, log: Log, predicted: Array) -> Array:
    """Outputs (n, m, r) by what all rows share: a frame that is shifted, turned and bent."""
    if not log.shared:
        return np.zeros((*log.z.shape, 0))
    structure = reference.structure
    outputs = log.z.shape[1]
    places = predicted[:, : structure.blocks[0]]
    columns = affine_columns(places / structure.extents[0], outputs)
    return log.shared * columns


def frame_variance(reference: Reference, log: Log) -> Array:
    """Variance (n,) of an axis [unit^2] of what all rows share: two frames, bent and shifted."""
    columns = frame_columns(reference, log, log.z)
    variances = (columns**2).mean(axis=1)
    variance: Array = variances.sum(axis=1)
    return variance


def affine_columns(x: Array, outputs: int) -> Array:
    """Displacements (n, m, (1 + p) m) of positions (n, p) by an affine map of their frame."""
    n = len(x)
    ones = np.ones((n, 1))
    features = np.concatenate([ones, x], axis=1)
    moves: Array = np.einsum("nk,ij->nikj", features, np.eye(outputs))
    return moves.reshape(n, outputs, -1)
