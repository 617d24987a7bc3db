"""A planar arm of two joints, beliefs over it, and logs that are compared with them."""

from __future__ import annotations

from functools import cache

import numpy as np

from calib.body.fitting import fit_body
from calib.change.explain import explain
from calib.change.reference import reference_of
from calib.change.rows import weighted

LOWER, UPPER = np.radians([0.0, 15.0]), np.radians([90.0, 150.0])
L1, L2 = 0.30, 0.25


def tip(q, first=L1, second=L2):
    a, b = q[:, 0], q[:, 0] + q[:, 1]
    return np.stack(
        [first * np.cos(a) + second * np.cos(b), first * np.sin(a) + second * np.sin(b)], axis=1
    )


def joints(n, seed=0):
    return np.random.default_rng(seed).uniform(LOWER, UPPER, (n, 2))


def noise(n, seed=0, size=1e-3):
    return size * np.random.default_rng(1000 + seed).standard_normal((n, 2))


def moved(q, offset):
    """The joints with another offset of the elbow."""
    return q + np.array([0.0, offset])


@cache
def body():
    """What 4,000 rows at 1 mm say of the arm."""
    q = joints(4000)
    names = ("shoulder", "elbow")
    made = fit_body(q, tip(q) + noise(4000), joint_names=names, revolute=(True, True))
    return made.body


@cache
def exact_body():
    q = joints(800)
    names = ("shoulder", "elbow")
    made = fit_body(q, tip(q), joint_names=names, revolute=(True, True), simulated=True)
    return made.body


def compared(belief, q, z, cause=None):
    reference = reference_of(belief, q, z)
    log = weighted(reference, q, z, cause)
    return reference, log, explain(reference, log, cause), log.kept
