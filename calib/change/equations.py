"""Equations: a log beside a belief, as one linear Gaussian problem.

What a belief does not know of the residuals are columns of independent standard normals: its
posterior, a creep of all parameters, a residual of this log alone, what all rows share.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..body.covariance import root_of
from ..body.fit import Fit
from ..body.information import lengths_of, matern
from ..body.parameters import Indices, Prior
from ..body.rows import Rows
from ..body.settings import SIMULATED_FLOOR, STUDENT
from ..common.arrays import Array, Mask
from ..common.rows import thinned
from .frame import Reference
from .hypotheses import creep, freedom, hypotheses_of
from .settings import CREEP, OUTLIER, PSEUDO

_SETTLED = 60  # steps of the fit that finds outliers: 12 took exact rows of a longer link for some
_ROBUST_ROWS = 400  # of that fit: enough for every parameter
_NODES = 40  # of the log's own residual; more did not change a verdict on A and C
_NOISES = 64  # sizes of the noise that are compared
_NOTHING = 1e-10  # variance of an axis, of that of the noise, which no test tells

Noisy = tuple[int, float]
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
        """At most so many rows, evenly spread."""
        rows = thinned(len(self.q), most)
        return Log(self.q[rows], self.z[rows], self.shared)


def sound_rows(reference: Reference, q: Array, z: Array, cause: str | None) -> Mask:
    """Which rows (n, dof), (n, m) are near a robust fit in which all may have changed."""
    body = reference.body
    structure = reference.structure
    sd = np.hypot(
        freedom(body, hypotheses_of(structure, cause)[-1], cause), creep(body)
    )
    rows = thinned(len(q), _ROBUST_ROWS)
    size = reference.sizes
    prior = Prior(reference.beta, sd)
    told = [Rows(q[rows], z[rows], floor=size)]
    fit = Fit(structure, told, reference.beta, prior, nu=STUDENT)
    fit.maximise(steps=_SETTLED)
    r = structure.residual(z, structure.predict(q, fit.beta)) / size
    m = r.shape[1]
    e2 = (r**2).sum(axis=1)
    noise = max(float(np.median(e2[rows])) / (m - 2 / 3), 1.0)
    return np.asarray(e2 <= OUTLIER**2 * m * noise)


class Equations:
    """The residuals of a log, whitened: their principal axes under what is not known.

    factor : times the usual size of the log's own residual
    waves : sd of the joints' curves by which the arm may differ, over their prior's
    crept : times the usual creep of the parameters
    freed : (d,), standard deviation by which parameters may have changed
    noisy : a joint whose encoder is noisy, and its noise over that of the sensor [rad or m / size]
    """

    def __init__(
        self,
        reference: Reference,
        log: Log,
        *,
        factor: float = 1.0,
        waves: float = CREEP,
        crept: float = 1.0,
        freed: Array | None = None,
        noisy: Noisy | None = None,
    ) -> None:
        body = reference.body
        structure = reference.structure
        sizes = reference.sizes
        self.reference = reference
        self.log = log
        self.white = np.tile(np.diag(1.0 / sizes), (len(log.q), 1, 1))
        self.log_determinant = 0.0
        if (
            noisy is not None
        ):  # I + ratio^2 g g' of each row has one eigenvalue that is not 1
            g = structure.slope(log.q, reference.beta)[..., noisy[0]] / sizes
            length = (g**2).sum(axis=1)
            value = 1.0 + noisy[1] ** 2 * length
            g = g / np.sqrt(np.maximum(length, 1e-300))[:, None]
            less = (1.0 - 1.0 / np.sqrt(value))[:, None, None]
            self.white = self.white - less * g[:, :, None] * (g[:, None] @ self.white)
            self.log_determinant = float(np.log(value).sum())
        active, known = prior_columns(reference, waves, crept, freed)
        seen, x = structure.linearise(log.q, reference.beta, active)
        own = own_columns(reference, log, factor * body.kappa)
        parts = [own, x @ known, shared_columns(reference, log, seen)]
        self.axes, self.values = principal_axes(
            self.whiten(np.concatenate(parts, axis=2))
        )
        self.floor = float(
            np.min(SIMULATED_FLOOR * np.asarray(structure.extents) / sizes)
        )
        self.usual = max(float(np.min(body.noise / sizes)), self.floor)

    def whiten(self, x: Array) -> Array:
        """Residuals (n, m) or columns (n, m, k) [unit], by rows in units of the noise's size."""
        flat = self.white @ x.reshape(*x.shape[:2], -1)
        flat = flat.reshape(flat.shape[0] * flat.shape[1], -1)
        return np.asarray(flat[:, 0] if x.ndim == 2 else flat)

    def likelihood(self, y: Array, noise: Array | float) -> Array:
        """Log likelihood (s,) [nats] of whitened residuals (N,) under sizes (s,) of the noise."""
        square = np.atleast_1d(noise) ** 2
        turned = self.axes.T @ y
        share = self.values / (
            square[:, None] + self.values
        )  # of an axis that is no noise
        size = len(y) * np.log(square) + np.log1p(self.values / square[:, None]).sum(
            axis=1
        )
        rest = (float(y @ y) - share @ turned**2) / square
        return np.asarray(-0.5 * (size + rest + self.log_determinant))

    def information(self, y: Array, x: Array, noise: float) -> tuple[Array, Array]:
        """What rows tell of columns (N, k) whatever else is unknown: (k, k), and moments (k,)."""
        turned = self.axes.T @ x
        less = turned.T * (self.values / (noise**2 + self.values))
        power = (x.T @ x - less @ turned) / noise**2
        return power, (x.T @ y - less @ (self.axes.T @ y)) / noise**2

    def most_likely_noise(self, y: Array, least: float | None = None) -> float:
        """Size of the noise of the greatest likelihood.

        It is `least` at least; where that is not given the old noise counts for some rows.
        """
        high = 2.0 * max(float(np.sqrt(np.mean(y**2))), least or 1.0)
        grid = np.geomspace(least or max(self.floor, 1e-2), high, _NOISES)
        value = self.likelihood(y, grid)
        if least is None:
            value -= PSEUDO * (np.log(grid) + 0.5 / grid**2)
        return float(grid[int(np.argmax(value))])

    def rest(self, y: Array, noise: float) -> Array:
        """What the unknown does not follow of the residuals, (n, m) in noises."""
        share = self.values / (noise**2 + self.values)
        rest = y - self.axes @ (share * (self.axes.T @ y))
        return np.asarray(rest.reshape(len(self.white), -1) / noise)


def principal_axes(columns: Array) -> tuple[Array, Array]:
    """Axes (N, r) and variances (r,) of `columns` (N, k) times independent standard normals.

    The smaller of the two products is taken apart.
    """
    rows, unknown = columns.shape
    if rows <= unknown:
        values, axes = np.linalg.eigh(columns @ columns.T)
        return axes, np.maximum(values, 0.0)
    values, turns = np.linalg.eigh(columns.T @ columns)
    some = values > _NOTHING
    return columns @ turns[:, some] / np.sqrt(values[some]), values[some]


def own_columns(reference: Reference, log: Log, factor: float) -> Array:
    """A smooth residual of one log (a Gaussian process): (n, m, p m) by its values at p rows."""
    lengths = lengths_of(reference.body, log.q)
    nodes = log.q[thinned(len(log.q), _NODES)]
    alike = matern(nodes, nodes, lengths)
    alike[np.diag_indices(len(alike))] += 1e-6
    features = np.linalg.solve(np.linalg.cholesky(alike), matern(nodes, log.q, lengths))
    sd = np.diag(factor * reference.own_sd)
    return np.asarray(np.einsum("kn,ij->nikj", features, sd).reshape(*log.z.shape, -1))


def prior_columns(
    reference: Reference, waves: float, crept: float = 1.0, freed: Array | None = None
) -> tuple[Indices, Array]:
    """What is not known of the arm's parameters: which (k,), by standard normals (k, r).

    waves, crept, freed : as of `Equations`
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


def shared_columns(reference: Reference, log: Log, seen: Array) -> Array:
    """Outputs (n, m, r) by what all rows share: a frame that is shifted, turned and bent."""
    if not log.shared:
        return np.zeros((*log.z.shape, 0))
    structure = reference.structure
    places = seen[:, : structure.blocks[0]]
    return log.shared * affine_columns(places / structure.extents[0], log.z.shape[1])


def shared_variance(reference: Reference, log: Log) -> Array:
    """Variance (n,) of an axis [unit^2] of what all rows share: two frames, bent and shifted."""
    columns = shared_columns(reference, log, log.z)
    return np.asarray((columns**2).sum(axis=(1, 2)) / log.z.shape[1])


def affine_columns(x: Array, outputs: int | None = None) -> Array:
    """Displacements (n, m, (1 + p) m) of positions (n, p) by an affine map of their frame."""
    n = len(x)
    m = outputs or x.shape[1]
    bent = np.concatenate([np.ones((n, 1)), x], axis=1)
    return np.asarray(np.einsum("nk,ij->nikj", bent, np.eye(m)).reshape(n, m, -1))
