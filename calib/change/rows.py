"""Rows of a log: how much each counts, and what a belief does not know of them.

The covariance of the rows' residuals holds the old posterior, a creep of all parameters, and
a residual of this log alone: a Gaussian process over the joints whose size is that of the
body's own held-out errors.  Its eigenvectors are found once; then the evidence of every member
costs a few small products.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..body.likeness import lengths_of, matern
from ..common.arrays import Array
from ..common.rows import thinned
from .members import drift, freedom, members_of
from .reference import Reference

_FLOOR = 1e-6  # least noise, of the extents
_PSEUDO = 4.0  # observations that the old noise counts for
_GRID = 60
_STUDENT = 6.0
_STEPS = 12
_ROBUST_ROWS = 400  # of the robust fit that finds outliers: enough for every parameter
_OUTLIER = 5.0  # noises from which a row contradicts all others

EXPLAINED_ROWS = 200
"""Rows that members are compared on: the cube of outputs times rows for each size of residual."""

TESTED_ROWS = 300
"""Rows of the group tests: one such decomposition, and the power grows with them."""

RESIDUAL_ROWS = 400
"""Rows of the log's own residual: their cube for each held-out block."""

UPDATED_ROWS = 600
"""Rows that an update takes: linear in them."""


@dataclass(frozen=True)
class Log:
    """Rows of a log and how much each counts."""

    # (n, dof), (n, m), joints [rad or m] and outputs, without what maps add to the body [unit]
    q: Array
    z: Array
    weight: Array  # (n,), Student weights about a fit of the richest member
    kept: NDArray[np.bool_]  # (n,), rows that do not contradict all others
    robust: Array  # (d,), parameters of that fit
    # [unit], standard deviation that all rows share, such as that of a board that was found again
    shared: float = 0.0

    def some(self, most: int) -> Log:
        """At most so many rows, evenly spread."""
        return self.of(thinned(len(self.q), most))

    def of(self, rows: NDArray[np.intp]) -> Log:
        """Some rows."""
        weight, kept = self.weight[rows], self.kept[rows]
        return replace(self, q=self.q[rows], z=self.z[rows], weight=weight, kept=kept)


def weighted(
    reference: Reference, q: Array, z: Array, cause: str | None = None, shared: float = 0.0
) -> Log:
    """A log with robust weights.

    reference : the old belief in the frame of the log
    q, z : (n, dof), (n, m), all rows
    cause : {"sensor", "joints"}, what is known about the change
    shared : [unit], standard deviation that all rows share
    """
    body, structure = reference.body, reference.structure
    richest = members_of(structure, cause)[-1]
    sd = np.hypot(freedom(body, richest, cause), drift(body))
    free = np.flatnonzero(sd > 0)
    beta = reference.beta.copy()
    moved = np.zeros(len(free))
    size = reference.sizes
    rows = thinned(len(q), _ROBUST_ROWS)
    noise = 1.0
    for _ in range(_STEPS):
        predicted, x = structure.linearise(q[rows], beta, free)
        r = structure.residual(z[rows], predicted) / size
        weight, noise = _student(r)
        root = np.sqrt(weight) / noise
        j = (x / size[:, None] * sd[free] * root[:, None, None]).reshape(-1, len(free))
        a = j.T @ j
        a[np.diag_indices(len(free))] += 1.0
        step = np.linalg.solve(a, j.T @ (r * root[:, None]).ravel() - moved)
        step *= min(1.0, 10.0 / max(float(np.abs(step).max()), 1e-12))
        full = np.zeros(len(beta))
        full[free] = step * sd[free]
        beta, moved = structure.retract(beta, full), moved + step
        if float(np.abs(step).max()) < 1e-3:
            break
    r = structure.residual(z, structure.predict(q, beta)) / size
    weight, noise = _student(r)
    kept = np.sqrt((r**2).sum(axis=1)) <= _OUTLIER * np.sqrt(r.shape[1]) * noise
    return Log(q, z, weight, kept, beta, shared)


def _student(r: Array) -> tuple[Array, float]:
    """Weights (n,) of residuals (n, m) in sizes, and their noise, at least one size."""
    m = r.shape[1]
    e2 = (r**2).sum(axis=1)
    noise = max(float(np.median(e2)) / (m - 2 / 3), 1.0)
    return (_STUDENT + m) / (_STUDENT + e2 / noise), float(np.sqrt(noise))


@dataclass(frozen=True)
class Spectrum:
    """Covariance of the residuals of some rows, without the noise."""

    values: Array  # (N,), eigenvalues, in squared sizes
    vectors: Array  # (N, N)
    root: Array  # (n,), square roots of the rows' weights
    size: Array  # (m,) [unit], sizes of the outputs
    floor: float  # least noise, in those sizes

    def turn(self, residual: Array) -> Array:
        """Residuals (n, m) in the eigenvectors, (N,)."""
        return np.asarray((residual / self.size * self.root[:, None]).ravel() @ self.vectors)

    def turn_columns(self, derivative: Array) -> Array:
        """Derivatives (n, m, k) in the eigenvectors, (N, k)."""
        flat = derivative / self.size[:, None] * self.root[:, None, None]
        flat = flat.reshape(len(self.vectors), derivative.shape[2])
        return np.asarray(self.vectors.T @ flat)

    def rest(self, turned: Array, noise: float) -> Array:
        """What the process does not follow of residuals (N,) in the eigenvectors, (n, m)."""
        flat = self.vectors @ (turned * noise**2 / (self.values + noise**2))
        return np.asarray(flat.reshape(len(self.root), -1))

    def noise(self, turned: Array) -> float:
        """Noise of the greatest likelihood, in sizes; the old noise counts for two rows."""
        high = 2.0 * max(float(np.sqrt(np.mean(turned**2))), 1.0)
        grid = np.geomspace(max(self.floor, 1e-2), high, _GRID)
        total = self.values[:, None] + grid**2
        cost = np.log(total).sum(axis=0) + (turned[:, None] ** 2 / total).sum(axis=0)
        cost += _PSEUDO * (np.log(grid**2) + 1.0 / grid**2)
        return float(grid[int(np.argmin(cost))])


def spectrum(reference: Reference, log: Log, creep: Array, factor: float) -> Spectrum:
    """Covariance of the rows' residuals under a belief.

    reference : the old belief in the frame of the log, where it is linearised
    log : the rows
    creep : (d,), standard deviation by which parameters may have crept
    factor : times the usual size of the log's own residual
    """
    body, size, root = reference.body, reference.sizes, np.sqrt(log.weight)
    active = np.union1d(body.active, np.flatnonzero(creep))
    seen, x = body.structure.linearise(log.q, reference.beta, active)
    n, m, k = x.shape
    flat = (x / size[:, None] * root[:, None, None]).reshape(n * m, k)
    # y = X (b - b0) + own residual + noise: the covariance of the first two, X P X' + K
    known = np.diag(creep[active] ** 2)
    place = np.searchsorted(active, body.active)
    known[np.ix_(place, place)] += body.covariance * body.kappa**2
    kept = ~np.isin(active, reference.forgotten)
    flat = flat[:, kept]
    total = flat @ known[np.ix_(kept, kept)] @ flat.T
    alike = matern(log.q, log.q, lengths_of(body, log.q)) * root[:, None] * root
    own = (factor * reference.own_sd / size) ** 2
    total += np.kron(alike, np.diag(own))
    extents = np.asarray(body.structure.extents, dtype=float)
    if log.shared:  # a frame that is shifted, turned, tilted: as smooth as the workspace is wide
        places = seen[:, :m] / (2.0 * extents)
        alike = matern(places, places, np.ones(m)) * root[:, None] * root
        total += np.kron(alike, np.diag((log.shared / size) ** 2))
    values, vectors = np.linalg.eigh(total)
    floor = float(np.min(_FLOOR * extents / size))
    return Spectrum(np.maximum(values, 0.0), vectors, root, size, floor)
