"""Lag: whether a log's positions follow its joints by some rows."""

from __future__ import annotations

import numpy as np

from ..common.arrays import Array
from ..common.rows import thinned
from .reference import Reference, rigid_misfit

MOST = 30
"""Rows by which positions are moved against the joints, either way."""

_BETTER = 0.5
_MOST_ROWS = 0.8  # of the rows, which have to come nearer; the others may be wrong detections
_SMOOTH = 0.3  # steps of the joints over their spread, above which rows are no path


def lag_of(reference: Reference, q: Array, z: Array) -> int:
    """Rows by which positions follow the joints; 0 where no shift halves the misfit.

    reference : the old belief in the frame of the log
    q, z : (n, dof), (n, m), rows in the order in which they were measured
    """
    n = len(q)
    most = min(MOST, n // 4)
    if float(np.median(np.abs(np.diff(q, axis=0)))) > _SMOOTH * float(np.median(np.ptp(q, axis=0))):
        return 0
    places = reference.structure.blocks[0]
    found = {}
    for shift in range(-most, most + 1):
        # positive: the position of a row belongs to joints of some rows before
        a, b = (q[: n - shift], z[shift:]) if shift >= 0 else (q[-shift:], z[: n + shift])
        rows = thinned(len(a), 60)
        predicted = reference.structure.predict(a[rows], reference.beta)
        p, seen = predicted[:, :places], b[rows, :places]
        left = seen - p @ rigid_misfit(p, seen, scaled=False)[2].T
        left -= np.median(left, axis=0)
        # the median alone forgives what happens at the jumps between places
        found[shift] = float(np.quantile(np.linalg.norm(left, axis=1), _MOST_ROWS))
    best = min(found, key=lambda k: (found[k], abs(k)))
    return best if found[best] < _BETTER * found[0] else 0
