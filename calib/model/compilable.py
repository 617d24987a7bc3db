"""Models whose queries compiled C answers, where there is a compiler: single ones, and rows."""

from __future__ import annotations

import warnings
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ..common.arrays import Array
from ..errors import CalibError, OptionError
from ..kernel.compiled import NOTHING, Library, compile_source
from .answers import solve
from .header import Header
from .parts import Parts

COST = {
    "forward": 0.03,
    "jacobian": 0.03,
    "bounds": 0.8,
    "model_bounds": 0.8,
    "inverse": 1.7,
    "poses": 40.0,
    "branches": 100.0,
    "compiler": 7e5,
}
"""Processor time of a row by NumPy, for each squared joint, and of the compiler [us].

See ``benchmarks/inverse.py``."""

CHUNK = 20_000
"""Positions at once, whose branches fit into the processor's cache."""

ROWS_TO_COMPARE = 20
"""Joint values at which compiled C has to say what NumPy says, to a share of the extent."""
ALIKE = 1e-8


_UNSURE = "the bound on the position may be too wide here: ask without strict"
_NOWHERE = "nothing reaches the position"
_UNREACHED = "no joints were found from `near` on within a bounded search"


@dataclass(frozen=True, eq=False, repr=False)
class Compilable(Parts):
    """The parts of a model, and what was compiled of them."""

    strict: ClassVar[bool] = False  # as of `warm_up`

    def warm_up(self, *, strict: bool = False) -> str:
        """Make queries fast: compile the model's own C, where a C compiler is found.

        Returns a sentence that says what queries are answered by from now on: by compiled C, or by
        the batch in NumPy, and why.  Answers are the same.  Nothing but large batches is compiled
        without this, and nothing with the environment variable ``CALIB_NO_CC=1``.

        strict : for control loops: a single query that the compiled C cannot answer is NaN within
            a millisecond, and `unanswered` says why, instead of a search by NumPy.  Raises
            OptionError where nothing can be compiled.
        """
        kernel, sentence = kernel_of(self)
        if strict and kernel is None:
            raise OptionError(f"strict=True: {sentence}", parameter="strict")
        object.__setattr__(self, "kernel", kernel)
        object.__setattr__(self, "strict", strict)
        if kernel is None:  # what NumPy makes once
            solve(self, self.sensory.weights[:1], None)
        return sentence

    @property
    def warm(self) -> bool:
        """Whether compiled C answers; a model that was pickled has to warm up again."""
        return self.kernel is not None

    @property
    def unanswered(self) -> str | None:
        """Why this thread's last single query of a strict model was NaN, None if it was not."""
        return None if self.kernel is None else self.kernel.reason

    def __setstate__(self, state: Mapping[str, object]) -> None:
        """Unpickle; a strict model warms up again, others have to be told to."""
        for name, value in state.items():
            object.__setattr__(self, name, value)
        if self.strict:
            self.warm_up(strict=True)

    def _single(
        self,
        kind: str,
        *values: ArrayLike,
        unsure: Collection[int] = (0,),
        why: str = _UNREACHED,
    ) -> Array | None:
        """What the compiled C answers to one row; None where the batch has to.

        unsure : flags of answers that are none
        """
        if self.kernel is None:
            return None
        answer = self.kernel.ask(kind, *values)
        if answer is None:
            return None
        value, sure = answer
        if self.strict and sure == NOTHING:
            return self.kernel.refusal(value, _NOWHERE)
        if sure not in unsure:
            return value
        return self.kernel.refusal(value, why) if self.strict else None

    def _single_at(self, kind: str, q: ArrayLike) -> Array | None:
        """What the compiled C answers at joint values; None where the batch has to."""
        unsure = () if self.everywhere else (0,)
        return self._single(kind, q, unsure=unsure, why=_UNSURE)

    def _rows_at(self, kind: str, q: Array) -> Array | None:
        """What the compiled C answers at joints (n, dof); None where NumPy has to.

        Where a row was refused NumPy may know better.
        """
        kernel = prepare(self, kind, len(q))
        if kernel is None:
            return None
        answers, valid = kernel.rows(kind, q)
        return answers if self.everywhere or valid.all() else None


def kernel_of(model: Parts) -> tuple[Library | None, str]:
    """A model's compiled kernel, or None, and a sentence on what queries are answered by."""
    try:
        header = Header.of(model)
        dof = len(header.limit)
        compiled = compile_source(header.text()[0], dof, header.arm.outputs)
        _check_answers(model, compiled)
    except CalibError as error:
        return None, f"queries are answered by the batch in NumPy: {error}"
    return compiled, "queries are answered by compiled C"


def _check_answers(model: Parts, kernel: Library) -> None:
    """Refuse C that knows less than NumPy, such as a body's parameter that only one of them has."""
    step = max(model.motor.size // ROWS_TO_COMPARE, 1)
    q = model.motor.weights[::step]
    x, valid = kernel.rows("forward", q)
    expected = model.predictor.value(model.motor.scale.to_unit(q))
    away = np.abs(x - expected)[valid == 1]
    if (away > ALIKE * model.sensory.scale.span).any():
        raise OptionError("the compiled C does not say the same")


def prepare(model: Parts, kind: str, rows: int) -> Library | None:
    """The compiled C for rows of a query, made where that pays; None where NumPy answers.

    Why it cannot be made is said once, as a warning.
    """
    cost = rows * len(model.about.lower) ** 2 * COST[kind]
    if model.kernel is not None or cost < COST["compiler"]:
        return model.kernel
    if "uncompiled" in model.cache or model.body is None:
        return None
    kernel, reason = kernel_of(model)
    if kernel is None:
        model.cache["uncompiled"] = reason
        warnings.warn(
            f"{reason}; large batches take longer", RuntimeWarning, stacklevel=5
        )
    object.__setattr__(model, "kernel", kernel)
    return kernel


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
