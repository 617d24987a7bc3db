"""Batches: rows of queries through a model's compiled C, which is made where that pays."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..common.arrays import Array
from ..kernel.compiled import Library
from .header import kernel_of
from .parts import Parts

Kind = Literal[
    "forward",
    "bounds",
    "model_bounds",
    "jacobian",
    "inverse",
    "poses",
    "branches",
]


@dataclass(frozen=True)
class NumpyCost:
    """Processor time of a row by NumPy, for each squared joint [us]; ``benchmarks/inverse.py``."""

    forward: float = 0.03
    jacobian: float = 0.03
    bounds: float = 0.8
    model_bounds: float = 0.8
    inverse: float = 1.7
    poses: float = 40.0
    branches: float = 100.0
    compiler: float = 7e5  # [us], to compile a model


COST = NumpyCost()
# positions at once: their branches fit into the processor's cache
CHUNK = 20_000


def prepare(model: Parts, kind: Kind, rows: int) -> Library | None:
    """The compiled C for rows of a query, made where that pays; None where NumPy answers.

    Why it cannot be made is said once, as a warning.
    """
    cost = rows * len(model.about.lower) ** 2 * getattr(COST, kind)
    if model.kernel is not None or cost < COST.compiler:
        return model.kernel
    if "uncompiled" in model.cache or model.body is None:
        return None
    kernel, reason = kernel_of(model)
    if kernel is None:
        model.cache["uncompiled"] = reason
        warnings.warn(
            f"{reason}; large batches take longer", RuntimeWarning, stacklevel=4
        )
    object.__setattr__(model, "kernel", kernel)
    return kernel


def rows_at(model: Parts, kind: Kind, q: Array) -> Array | None:
    """What is asked for at joints (n, dof), see `Library.rows`; None where NumPy has to answer.

    Where a row was refused NumPy may know better.
    """
    kernel = prepare(model, kind, len(q))
    if kernel is None:
        return None
    answers, valid = kernel.rows(kind, q)
    return answers if model.everywhere or valid.all() else None


def all_rows(model: Parts, x: Array) -> list[Array] | None:
    """Joints (k, dof) of every branch of positions (n, m), the middle one first; None for NumPy.

    Families of redundant joints are NumPy's.
    """
    kernel = (
        None if model.solver.redundant else prepare(model, "inverse", len(x))
    )
    if kernel is None:
        return None
    ways: list[Array] = []
    for first in range(0, len(x), CHUNK):
        ways += _branches_of(model, kernel, x[first : first + CHUNK])
    return ways


def _branches_of(model: Parts, kernel: Library, x: Array) -> list[Array]:
    """All joint values (k, dof) of each target (n, m), the nearest to the ranges' middle first."""
    q, count = kernel.rows(
        "inverse_all", np.zeros((len(x), len(model.about.lower))), x
    )
    several = np.flatnonzero(count > 1)
    ways = q[several]
    # C leaves what is behind the last way as it was
    ways[np.arange(q.shape[1]) >= count[several, None]] = np.nan
    scale = model.motor.scale
    u = scale.to_unit(ways)
    away = np.linalg.norm(scale.difference(u, np.full(u.shape, 0.5)), axis=2)
    order = np.argsort(away, axis=1, kind="stable")  # NaN last
    q[several] = np.take_along_axis(ways, order[:, :, None], axis=1)
    return [rows[:k] for rows, k in zip(q, count.tolist(), strict=True)]
