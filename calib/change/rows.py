"""Rows of a log with their weights: what every comparison with a belief starts from."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from ..common.rows import thinned
from .members import drift, freedom, members_of
from .reference import Reference

_STUDENT = 6.0
_STEPS = 12
_ROBUST_ROWS = 400  # of the robust fit that finds outliers: enough for every parameter
EXPLAINED_ROWS = 200
"""Rows that members are compared on: the cube of outputs times rows for each size of residual."""

TESTED_ROWS = 300
"""Rows of the group tests: one such decomposition, and the power grows with them."""

RESIDUAL_ROWS = 400
"""Rows of the log's own residual: their cube for each held-out block."""

UPDATED_ROWS = 600
"""Rows that an update takes: linear in them."""

_OUTLIER = 5.0  # noises from which a row contradicts all others


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
        rows = thinned(len(self.q), most)
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
