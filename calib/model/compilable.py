"""Models whose single queries compiled C answers, where there is a compiler."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import ClassVar

from numpy.typing import ArrayLike

from ..common.arrays import Array
from ..errors import OptionError
from ..kernel.compiled import NOTHING
from .answers import solve
from .header import kernel_of
from .parts import Parts

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
