"""Batches: rows of queries through a model's compiled C, which is made where that pays."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..common.arrays import Array, Index
from ..kernel.compiled import NOTHING, Compiled
from .parts import Parts

Kind = Literal["forward", "bounds", "inverse", "poses", "branches"]


@dataclass(frozen=True)
class Worth:
    """Rows of a query from which its C is compiled, as NumPy takes longer for them (some .7 s).

    Measured by ``benchmarks/inverse.py`` with six joints.
    """

    forward: int = 400_000
    bounds: int = 20_000
    inverse: int = 2_000
    poses: int = 200
    branches: int = 20


WORTH = Worth()


def kernel_for(model: Parts, kind: Kind, rows: int) -> Compiled | None:
    """The compiled C that answers rows of a query; None where NumPy does.

    It is compiled once where there are enough rows; why it cannot be is said once, as a warning.
    """
    if model.kernel is not None or rows < getattr(WORTH, kind):
        return model.kernel
    if "uncompiled" in model.remembered or model.body is None:
        return None
    from .header import compiled_of

    kernel, reason = compiled_of(model)
    if kernel is None:
        model.remembered["uncompiled"] = reason
        warnings.warn(f"{reason}; large batches take longer", RuntimeWarning, stacklevel=4)
    object.__setattr__(model, "kernel", kernel)
    return kernel


def forward_rows(model: Parts, q: Array) -> Array | None:
    """Positions (n, m) at joints (n, dof); None where NumPy has to answer."""
    kernel = kernel_for(model, "forward", len(q))
    if kernel is None:
        return None
    x, valid = kernel.forward(q)
    return x if _settled(model, valid) else None


def bound_rows(model: Parts, q: Array, which: str) -> Array | None:
    """95 % bounds (n,) at joints (n, dof), `bounds` or `model_bounds`; None for NumPy."""
    kernel = kernel_for(model, "bounds", len(q))
    if kernel is None:
        return None
    bound, valid = kernel.bounds(q, which)
    return bound if _settled(model, valid) else None


def _settled(model: Parts, valid: Array) -> bool:
    """Whether NumPy has nothing to add: where rows were refused it may know better."""
    return model.everywhere or bool(valid.all())


def all_rows(model: Parts, x: Array) -> list[Array] | None:
    """Joints (k, dof) of every branch of positions (n, m), the middle one first; None for NumPy.

    Families of redundant joints are NumPy's.
    """
    kernel = None if model.solver.redundant else kernel_for(model, "inverse", len(x))
    if kernel is None:
        return None
    q, count = kernel.inverse_all(x)
    scale = model.motor.scale
    away = np.linalg.norm(scale.difference(scale.to_unit(q), np.full(q.shape, 0.5)), axis=2)
    away[np.arange(q.shape[1]) >= count[:, None]] = np.inf
    order = np.argsort(away, axis=1, kind="stable")
    q = np.take_along_axis(q, order[:, :, None], axis=1)
    return [rows[:k] for rows, k in zip(q, count.tolist(), strict=True)]


def inverse_rows(model: Parts, x: Array, near: Array, *, nearest: bool) -> tuple[Array, Index]:
    """Joints (n, dof) for positions (n, m) near others (n, dof), and rows (k,) left to NumPy."""
    kernel = kernel_for(model, "inverse", len(x))
    if kernel is None:
        return np.full_like(near, np.nan), np.arange(len(x))
    q, sure = kernel.inverse(x, near)
    if nearest:
        return q, np.flatnonzero((sure == 0) | (sure == NOTHING))
    return q, np.flatnonzero(sure == 0)
