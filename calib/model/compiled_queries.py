"""Compiled queries: those that compiled C answers, and when a model's C is compiled."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array
from ..errors import CalibError, OptionError
from ..kernel.compiled import Library, compile_source
from .parts import ModelParts
from .prediction import Prediction

COMPILE_TIME = 7e5  # [us], processor time of the compiler

ROWS_TO_COMPARE = 20
"""Joint values at which compiled C has to agree with NumPy, to a share of the extent."""
ALIKE = 1e-8


@dataclass(frozen=True)
class CompiledQuery:
    """A question that compiled C answers row by row."""

    name: str  # of the kernel's function, see `Library`
    # processor time of a row by NumPy, for each squared joint [us], see benchmarks/inverse.py
    cost: float


@dataclass(frozen=True)
class CompiledReading(CompiledQuery):
    """A quantity at joint values."""

    of: Callable[[Prediction], Array]  # its values in NumPy


FORWARD = CompiledReading("forward", 0.03, lambda prediction: prediction.value)
JACOBIAN = CompiledReading(
    "jacobian", 0.03, lambda prediction: prediction.slope
)
READING_BOUND = CompiledReading(
    "bounds", 0.8, lambda prediction: prediction.reading_bound
)
POSITION_BOUND = CompiledReading(
    "model_bounds", 0.8, lambda prediction: prediction.position_bound
)
POSE = CompiledReading("pose", 0.03, lambda prediction: prediction.pose)

INVERSE = CompiledQuery("inverse", 1.7)  # of a batch until the starts are tried
INVERSE_ALL = CompiledQuery("inverse_all", 1.7)
POSES = CompiledQuery("poses", 40.0)
POSES_ALL = CompiledQuery("poses_all", 100.0)


def kernel_of(model: ModelParts) -> tuple[Library | None, str]:
    """A model's compiled kernel, or None, and a sentence on what queries are answered by."""
    from .c_header import Header

    try:
        header = Header.of(model)
        dof = len(header.limit)
        compiled = compile_source(header.text()[0], dof, header.arm.outputs)
        _check_answers(model, compiled)
    except CalibError as error:
        return None, f"queries are answered by the batch in NumPy: {error}"
    return compiled, "queries are answered by compiled C"


def _check_answers(model: ModelParts, kernel: Library) -> None:
    """Refuse C that knows less than NumPy, such as a body's parameter that only one of them has."""
    step = max(model.motor.size // ROWS_TO_COMPARE, 1)
    q = model.motor.weights[::step]
    x, valid = kernel.rows("forward", q)
    expected = model.predictor.value(model.motor.scale.to_unit(q))
    away = np.abs(x - expected)[valid == 1]
    if (away > ALIKE * model.sensory.scale.span).any():
        raise OptionError("the compiled C does not agree with NumPy")


def kernel_for(
    model: ModelParts, query: CompiledQuery, rows: int
) -> Library | None:
    """The compiled C for rows of a query, made where that pays; None where NumPy answers.

    If it cannot be made, one warning gives the reason.
    """
    cost = rows * len(model.about.lower) ** 2 * query.cost
    compiles = model.body is not None and "uncompiled" not in model.cache
    if model.kernel is None and compiles and cost >= COMPILE_TIME:
        kernel, reason = kernel_of(model)
        object.__setattr__(model, "kernel", kernel)
        if kernel is None:
            model.cache["uncompiled"] = reason
            warnings.warn(
                f"{reason}; large batches take longer",
                RuntimeWarning,
                stacklevel=4,
            )
    kernel = model.kernel
    return kernel if kernel is not None and kernel.has(query.name) else None
