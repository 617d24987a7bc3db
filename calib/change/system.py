"""System: a log beside a belief, linear in all that may have changed.

    y = X d + e,    e ~ N(0, K + noise^2)

K is what the belief does not know of an unchanged arm: its posterior, a creep, a smooth residual
of this log, what all rows share.  Tests and evidences are sub-blocks of the normal equations.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..body.covariance import root_of
from ..body.fit import Fit
from ..body.information import lengths_of, matern
from ..body.parameters import Indices, Prior
from ..body.rows import Rows
from ..body.settings import SIMULATED_FLOOR, STUDENT
from ..common.arrays import Array, Mask
from ..common.rows import thinned
from ..stream.monitor import affine_columns
from .causes import changeable, creep, freedom
from .frame import Reference
from .settings import OUTLIER, PSEUDO, Level


@dataclass(frozen=True)
class SystemSettings:
    """How large the system of a log is."""

    # of a system: its power grows with them, its work too
    rows: int = 300
    # of the log's own residual; more did not change a verdict on A and C
    nodes: int = 40
    # sizes of the noise that are compared
    noises: int = 64
    # where many sets are compared: they share the noise nearly
    coarser: int = 3
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
        rows = thinned(len(self.q), most)
        return replace(self, q=self.q[rows], z=self.z[rows])


def sound_rows(
    reference: Reference, q: Array, z: Array, cause: str | None
) -> Mask:
    """Return which rows (n, dof), (n, m) are near a robust fit of all that may have changed."""
    rows = thinned(len(q), SYSTEM.robust_rows)
    size = reference.sizes
    sd = freedom(reference.body, changeable(reference.structure), cause)
    prior = Prior(reference.beta, np.hypot(sd, creep(reference.body)))
    measured = [Rows(q[rows], z[rows], floor=size)]
    fit = Fit(reference.structure, measured, reference.beta, prior, nu=STUDENT)
    fit.maximise(steps=SYSTEM.robust_steps)
    predicted = reference.structure.predict(q, fit.beta)
    squares = (reference.structure.residual(z, predicted) / size) ** 2
    outputs = squares.shape[1]
    square = squares.sum(axis=1)
    noise = max(float(np.median(square[rows])) / (outputs - 2 / 3), 1.0)
    return np.asarray(square <= OUTLIER**2 * outputs * noise)


class Unknown:
    """What no change tells of a log: principal axes (N, r) and variances (r,) in noises.

    crept : times the usual creep of the parameters
    freed : (d,), standard deviation by which parameters may have changed
    noisy : a joint whose encoder is noisy, and its noise over that of the sensor [rad or m / size]
    """

    def __init__(
        self,
        reference: Reference,
        log: Log,
        level: Level,
        *,
        crept: float = 1.0,
        freed: Array | None = None,
        noisy: NoisyJoint | None = None,
    ) -> None:
        structure = reference.structure
        sizes = reference.sizes
        self.white = np.tile(np.diag(1.0 / sizes), (len(log.q), 1, 1))
        self.log_determinant = 0.0
        if noisy is not None:
            self._shield(
                structure.slope(log.q, reference.beta)[..., noisy[0]],
                noisy[1],
                sizes,
            )
        active, root = prior_columns(reference, level.waves, crept, freed)
        predicted, x = structure.linearise(log.q, reference.beta, active)
        smooth = own_columns(
            reference, log, level.residual * reference.body.kappa
        )
        parts = [smooth, x @ root, shared_columns(reference, log, predicted)]
        columns = self.whiten(np.concatenate(parts, axis=2))
        self.axes, self.values = principal_axes(columns)
        extents = np.asarray(structure.extents)
        self.floor = float(np.min(SIMULATED_FLOOR * extents / sizes))
        self.usual = max(
            float(np.min(reference.body.noise / sizes)), self.floor
        )

    def _shield(self, slope: Array, ratio: float, sizes: Array) -> None:
        """Whiten noise of a joint, too: I + ratio^2 g g' of a row has one eigenvalue beside 1."""
        g = slope / sizes
        square = (g**2).sum(axis=1)
        value = 1.0 + ratio**2 * square
        g = g / np.sqrt(np.maximum(square, 1e-300))[:, None]
        less = (1.0 - 1.0 / np.sqrt(value))[:, None, None]
        self.white = self.white - less * g[:, :, None] * (
            g[:, None] @ self.white
        )
        self.log_determinant = float(np.log(value).sum())

    def whiten(self, x: Array) -> Array:
        """Return residuals (n, m) or columns (n, m, k) [unit], by rows, in the noise's size."""
        flat = self.white @ x.reshape(*x.shape[:2], -1)
        flat = flat.reshape(flat.shape[0] * flat.shape[1], -1)
        return np.asarray(flat[:, 0] if x.ndim == 2 else flat)

    def likelihood(self, y: Array, noise: Array | float) -> Array:
        """Log likelihood (s,) [nats] of whitened residuals (N,) under sizes (s,) of the noise."""
        square = np.atleast_1d(noise) ** 2
        turned = self.axes.T @ y
        share = self.values / (square[:, None] + self.values)
        size = len(y) * np.log(square) + np.log1p(
            self.values / square[:, None]
        ).sum(axis=1)
        rest = (float(y @ y) - share @ turned**2) / square
        return np.asarray(-0.5 * (size + rest + self.log_determinant))

    def information(
        self, y: Array, x: Array, noise: float
    ) -> tuple[Array, Array]:
        """Return what rows tell of columns (N, k), whatever else is unknown.

        Returns the information (k, k) and its moments (k,).
        """
        turned = self.axes.T @ x
        less = turned.T * (self.values / (noise**2 + self.values))
        power = (x.T @ x - less @ turned) / noise**2
        return power, (x.T @ y - less @ (self.axes.T @ y)) / noise**2

    def noises(
        self, y: Array, least: float | None = None
    ) -> tuple[Array, Array]:
        """Return sizes (s,) of the noise, and the log likelihood (s,) of residuals (N,).

        They are `least` at least; where that is not given the old noise counts for some rows.
        """
        high = 2.0 * max(float(np.sqrt(np.mean(y**2))), least or 1.0)
        sizes = np.geomspace(
            least or max(self.floor, 1e-2), high, SYSTEM.noises
        )
        likelihood = self.likelihood(y, sizes)
        if least is None:
            likelihood -= PSEUDO * (np.log(sizes) + 0.5 / sizes**2)
        return sizes, likelihood

    def most_likely_noise(self, y: Array, least: float | None = None) -> float:
        """Size of the noise of the greatest likelihood."""
        sizes, likelihood = self.noises(y, least)
        return float(sizes[int(np.argmax(likelihood))])

    def rest(self, x: Array, noise: float) -> Array:
        """Return what the unknown does not follow of residuals or columns, by rows, in noises."""
        share = self.values / (noise**2 + self.values)
        rest = x - self.axes @ ((self.axes.T @ x).T * share).T
        shape = (len(self.white), -1, *x.shape[1:])
        return np.asarray(rest.reshape(shape) / noise)


class System:
    """Rows of a log, linearised at parameters `at`; changes are told from `reference`'s.

    indices : (k,), parameters that may have changed
    """

    def __init__(
        self,
        reference: Reference,
        log: Log,
        indices: Indices,
        *,
        at: Array | None = None,
        unknown: dict[Level, Unknown] | None = None,
    ) -> None:
        self.reference = reference
        self.log = log.some(SYSTEM.rows)
        self.indices = indices
        structure = reference.structure
        self.at = reference.beta if at is None else at
        predicted, self.columns = structure.linearise(
            self.log.q, self.at, indices
        )
        self.residual = structure.residual(self.log.z, predicted)
        self.residual += self.columns @ (self.at - reference.beta)[indices]
        # by level: where only the columns are linearised elsewhere they stay as they are
        self._unknown = {} if unknown is None else unknown

    def unknown(self, level: Level) -> Unknown:
        """What is not known at a level of the log's own residual."""
        if level not in self._unknown:
            self._unknown[level] = Unknown(self.reference, self.log, level)
        return self._unknown[level]

    def again(self, at: Array) -> System:
        """Return the same rows, linearised elsewhere."""
        return System(
            self.reference, self.log, self.indices, at=at, unknown=self._unknown
        )


class Information:
    """What rows tell at one level: the evidence of any freed parameters is a sub-block.

    sd : (k,), standard deviations by which the system's parameters may have changed
    """

    def __init__(self, system: System, level: Level, sd: Array) -> None:
        unknown = system.unknown(level)
        y = unknown.whiten(system.residual)
        x = unknown.whiten(system.columns) * sd
        noises, self.likelihood = (
            part[:: SYSTEM.coarser] for part in unknown.noises(y)
        )
        turned = unknown.axes.T @ x
        turned_y = unknown.axes.T @ y
        shares = unknown.values / (noises[:, None] ** 2 + unknown.values)
        less = np.stack([(turned.T * share) @ turned for share in shares])
        self.power = (x.T @ x - less) / noises[:, None, None] ** 2
        self.pull = (x.T @ y - (shares * turned_y) @ turned) / noises[
            :, None
        ] ** 2

    def evidence(self, places: Indices, temper: float) -> tuple[float, Array]:
        """Return the evidence of freeing parameters at places (p,) [nats], and their steps (p,).

        temper : rows that count for one
        """
        power = self.power[:, places][:, :, places] / temper + np.eye(
            len(places)
        )
        pull = self.pull[:, places] / temper
        root = np.linalg.cholesky(power)
        half = np.linalg.solve(root, pull[..., None])[..., 0]
        volume = np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1)
        evidence = (
            self.likelihood / temper + 0.5 * (half**2).sum(axis=1) - volume
        )
        best = int(np.argmax(evidence))
        step = np.linalg.solve(power[best], pull[best])
        return float(evidence[best]), step


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
    return columns @ turns[:, some] / np.sqrt(values[some]), values[some]


def own_columns(reference: Reference, log: Log, factor: float) -> Array:
    """A smooth residual of one log (a Gaussian process): (n, m, p m) by its values at p rows."""
    lengths = lengths_of(reference.body, log.q)
    nodes = log.q[thinned(len(log.q), SYSTEM.nodes)]
    alike = matern(nodes, nodes, lengths)
    alike[np.diag_indices(len(alike))] += 1e-6
    features = np.linalg.solve(
        np.linalg.cholesky(alike), matern(nodes, log.q, lengths)
    )
    sd = np.diag(factor * reference.own_sd)
    return np.asarray(
        np.einsum("kn,ij->nikj", features, sd).reshape(*log.z.shape, -1)
    )


def prior_columns(
    reference: Reference,
    waves: float,
    crept: float = 1.0,
    freed: Array | None = None,
) -> tuple[Indices, Array]:
    """What is not known of the arm's parameters: which (k,), by standard normals (k, r).

    waves, crept, freed : as of `Level` and `Unknown`
    """
    body = reference.body
    sd = crept * creep(body, waves)
    lost = reference.forgotten
    if freed is not None:  # of a frame that is held the old knowledge stays
        sd = np.hypot(sd, freed)
        lost = np.intersect1d(lost, np.flatnonzero(freed))
    active = np.union1d(body.active, np.flatnonzero(sd)).astype(np.intp)
    kept = np.where(np.isin(body.active, lost)[:, None], 0.0, body.root)
    covariance = np.diag(sd[active] ** 2)
    place = np.searchsorted(active, body.active)
    covariance[np.ix_(place, place)] += body.kappa**2 * kept @ kept.T
    return active, root_of(covariance)


def shared_columns(reference: Reference, log: Log, predicted: Array) -> Array:
    """Outputs (n, m, r) by what all rows share: a frame that is shifted, turned and bent."""
    if not log.shared:
        return np.zeros((*log.z.shape, 0))
    structure = reference.structure
    places = predicted[:, : structure.blocks[0]]
    return log.shared * affine_columns(
        places / structure.extents[0], log.z.shape[1]
    )


def shared_variance(reference: Reference, log: Log) -> Array:
    """Variance (n,) of an axis [unit^2] of what all rows share: two frames, bent and shifted."""
    columns = shared_columns(reference, log, log.z)
    return np.asarray((columns**2).sum(axis=(1, 2)) / log.z.shape[1])
