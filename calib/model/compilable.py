"""Compilable: a model whose single queries compiled C answers, where there is a compiler."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ..common.arrays import Array
from ..errors import OptionError, QueryError
from ..kernel.compiled import Flag
from . import answers
from .compiled_queries import (
    CompiledQuery,
    CompiledReading,
    kernel_for,
    kernel_of,
)
from .parts import ModelParts
from .prediction import Prediction

_UNSURE = "the bound on the position may be too wide here: ask without strict"
_NOWHERE = "nothing reaches the position"
_UNREACHED = "no joints were found from `near` on within a bounded search"


@dataclass(frozen=True, eq=False, repr=False)
class Compilable(ModelParts):
    """A model's parts, and the kernel that was compiled of them."""

    strict: ClassVar[bool] = False  # see `warm_up`; no field, as `kernel`

    def warm_up(self, *, strict: bool = False) -> str:
        """Make queries fast: compile the model's own C, where a C compiler is found.

        Returns a sentence on what answers queries from now on: compiled C, or
        the batch in NumPy, and why.  Answers are the same.  Nothing but large batches is compiled
        without this, and nothing with the environment variable ``CALIB_NO_CC=1``.

        strict : for control loops: a single query that the compiled C cannot answer is NaN within
            a millisecond, and `unanswered` has the reason, instead of a search by NumPy.  Raises
            OptionError where nothing can be compiled.
        """
        kernel, sentence = kernel_of(self)
        if strict and kernel is None:
            raise OptionError(f"strict=True: {sentence}", parameter="strict")
        object.__setattr__(self, "kernel", kernel)
        object.__setattr__(self, "strict", strict)
        if kernel is None:  # what NumPy makes once
            answers.solve(self, self.sensory.weights[:1], None)
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
        """Unpickle; a strict model warms up again, others when asked to."""
        for name, value in state.items():
            object.__setattr__(self, name, value)
        if self.strict:
            self.warm_up(strict=True)

    def _single(
        self,
        query: CompiledQuery,
        *values: ArrayLike,
        unsure: Collection[int] = (Flag.NONE,),
        why: str = _UNREACHED,
    ) -> Array | None:
        """What the compiled C answers to one row; None where the batch has to.

        unsure : flags of what is no answer
        """
        kernel = self.kernel
        if kernel is None:
            return None
        answer = kernel.ask(query.name, *values)
        if answer is None:
            return None
        value, flag = answer
        if self.strict and flag == Flag.UNREACHABLE:
            return kernel.refusal(value, _NOWHERE)
        is_refused = self.strict and flag == Flag.NONE and np.isnan(value).all()
        if flag not in unsure and not is_refused:
            return value
        if not self.strict:
            return None
        if len(values) == 1:
            why = self.beyond_range(np.asarray(values[0], float)) or why
        else:  # the first is `near`
            try:
                answers.near_in_box(self, values[0], 1)
            except QueryError as error:
                why = str(error)
        return kernel.refusal(value, why)

    def _refusal(self, why: str) -> Array:
        """Joints (dof,) of a strict model that refuses a question, and the reason."""
        assert self.kernel is not None  # noqa: S101 - strict models have one
        return self.kernel.refusal(self.about.lower, why)

    def _at(
        self,
        query: CompiledReading,
        q: ArrayLike,
        approach: ArrayLike | None = None,
    ) -> Array:
        """A quantity at joint values (n, dof) or (dof,), by the fastest way."""
        directed = approach is not None
        unsure = () if self.answers_whole_range else (Flag.NONE,)
        if not directed:
            quick = self._single(query, q, unsure=unsure, why=_UNSURE)
            if quick is not None:
                return quick
        motion, single = answers.motion_of(self, q, approach)
        kernel = None if directed else kernel_for(self, query, len(motion))
        rows = None
        if kernel is not None:
            rows, flags = kernel.rows(query.name, motion.q)
            if not self.answers_whole_range and not flags.all():
                rows = None  # where a row was refused NumPy may know better
        if rows is None:
            rows = query.of(Prediction(self, motion))
        return rows[0] if single else rows
