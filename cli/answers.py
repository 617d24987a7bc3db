"""Answers to queries: for people, as documents, or as a table; it needs NumPy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

import calib
from calib.common.wording import for_people
from calib.samples.tables import Batch, read_batch, write_table

from .asking import Asking
from .output import NO, Outcome, TextTable, fixed, note, say
from .parsing import TABLES, BadOption, check_file
from .samples import refuse
from .units import JointFormat, PositionFormat, units_of

BOUNDS = ("expected_error", "model_error")
UP_TO_SCALE = "expected_error_up_to_scale"
"""Key and column of a bound in a camera's base frame that leaves out the arm's size."""
TURN = ("qx", "qy", "qz", "qw")
_LENGTHS = (
    "x",
    "y",
    "z",
    "distance",
    *BOUNDS,
    UP_TO_SCALE,
)  # have the unit of the positions
_TOLD = 10  # so many rows are named at most


class Query:
    """A model that is asked, and how its joints and positions are typed and printed."""

    def __init__(
        self,
        path: str,
        asking: Asking,
        frame: str = "sensor",
        typed: Sequence[float] = (),
    ) -> None:
        if asking.input_ is not None and typed:
            raise BadOption(
                f"--input {asking.input_!r} and {len(typed)} values: expected one"
            )
        if asking.input_ is None:
            of_many = {"output": asking.output, "columns": asking.columns}
            refuse(of_many, "is for many queries: expected --input FILE too")
        check_file(asking.output, TABLES, stream=True)
        self.model = calib.load(path)
        self.frame = frame
        self.asking = asking
        about = self.model.about
        base = frame == "base"
        self.joints = JointFormat(about, asking.degrees)
        self.positions = PositionFormat(about, frame, asking.unit)
        self.axes = ("x", "y", "z") if base else self.model.axes
        # what the numbers of an answer mean, for JSON
        self.meaning: dict[str, Any] = {"frame": frame} if base else {}
        self.meaning["unit"] = self.positions.unit
        self.meaning["bound_of"] = "true position" if base else about.bound_of
        self.meaning["units"] = units_of(about) | {"positions": self.positions.unit}
        # of a simulation, and in the base frame, both bounds are the same: one is printed
        self.bounds = BOUNDS if about.source == "log" and not base else BOUNDS[:1]

    def document(self, q: Sequence[float], **quantities: Any) -> dict[str, Any]:
        """Return one answer, of joints (dof,) [rad or m] and whatever is told of them."""
        return {"joints": dict(zip(self.joints.names, q, strict=True)), **quantities}

    def table(
        self,
        answers: Sequence[Mapping[str, Any]],
        quantities: Sequence[str],
        title: str = "",
    ) -> TextTable:
        """Return answers, one line each, an angle in deg, all else in the positions' unit."""
        length = (self.positions.factor, self.positions.shown)
        by = {
            name: for_people("rad") if name == "turned" else length
            for name in quantities
        }
        header = [*self.joints.header, *(f"{axis} [{length[1]}]" for axis in self.axes)]
        header += [
            f"{name.replace('_', ' ')} [{shown}]" for name, (_, shown) in by.items()
        ]
        rows = [
            [
                *self.joints.cells(list(answer["joints"].values())),
                *(fixed(value * length[0], 4) for value in answer["position"]),
                *(fixed(answer[name] * size, 4) for name, (size, _) in by.items()),
            ]
            for answer in answers
        ]
        return TextTable(header, rows, title, left=0)

    def read(
        self, names: Sequence[str], more: Sequence[Sequence[str]] = ()
    ) -> tuple[Batch, Any]:
        """Read queries, positions in the model's unit, and which rows (n,) are numbers."""
        if self.asking.input_ is None:
            raise BadOption("--input FILE is missing: expected a table of queries")
        batch = read_batch(self.asking.input_, names, more, self.asking.columns or {})
        lengths = [
            name in _LENGTHS and name not in self.joints.names for name in batch.names
        ]
        values = batch.values / np.where(lengths, self.positions.typed, 1.0)
        return replace(batch, values=values), np.isfinite(values).all(axis=1)

    def answer(
        self,
        batch: Batch,
        columns: Mapping[str, Any] | None,
        failures: Mapping[str, tuple[Any, str]],
        *,
        n: int | None = None,
        key: str = "answers",
        lines: Sequence[str] = (),
        **facts: Any,
    ) -> Outcome:
        """Write a table of answers, None for no table, and say which rows fail.

        `failures` have the numbers of rows and why they fail, by the key of a document.
        """
        n = len(batch.values) if n is None else n
        say_rows(
            batch.invalid, len(batch.values), "not all values are numbers, no answer"
        )
        for numbers, why in failures.values():
            say_rows(list(numbers), n, why)
        failed = {name: list(numbers) for name, (numbers, _) in failures.items()}
        code = 1 if batch.invalid else NO if any(failed.values()) else 0
        output = self.asking.output
        by = self.positions.typed
        to_file = output not in (None, "-")
        document: dict[str, Any] = {
            "output": (columns and output) if to_file else None,
            "rows": n,
        }
        document |= {"invalid": batch.invalid, **failed, **facts, **self.meaning}
        if columns is None:
            return Outcome(document, lines, code=code)
        written = {
            name: np.asarray(column, float) * by
            if by != 1.0 and name in _LENGTHS
            else column
            for name, column in columns.items()
        }
        if to_file:
            write_table(str(output), written)
            return Outcome(document, lines, code=code)
        factors = dict(zip(self.joints.names, self.joints.typed, strict=True))
        document[key] = {
            k: v / factors[k] if k in factors else v for k, v in columns.items()
        }
        return Outcome(document, lines, result=(), columns=written, code=code)


def beside(
    batch: Batch, valid: NDArray[np.bool_], added: Mapping[str, Any]
) -> dict[str, Any]:
    """Columns of a table of queries with answers of rows that are `valid` (n,), else NaN or 0."""
    say(batch.notes(list(added)))
    answers: dict[str, NDArray[Any]] = {}
    for name, column in added.items():
        truths = name == "reachable"
        answers[name] = np.full(
            len(valid), 0 if truths else np.nan, int if truths else float
        )
        answers[name][valid] = column
    return batch.answered(answers)


def say_rows(numbers: Sequence[int], of: int, what: str) -> None:
    """Say what is the matter with some rows, the first of which are named, if there are any."""
    if numbers:
        shown = ", ".join(map(str, numbers[:_TOLD]))
        more = f" and {len(numbers) - _TOLD} more" if len(numbers) > _TOLD else ""
        note(f"row{'s' if len(numbers) > 1 else ''} {shown}{more} of {of}: {what}")


def up_to_scale(model: calib.Model, q: ArrayLike) -> dict[str, Any]:
    """The bound (n,) in the base frame of a camera [m], but for the arm's size; else nothing."""
    from calib.model.space import Space

    space = Space.of(model)
    return {UP_TO_SCALE: space.bound(q, size=False)} if space.camera else {}


def say_size(bounds: Mapping[str, Any]) -> None:
    """Say what of a bound in the base frame of a camera is the arm's size."""
    if np.isfinite(bound := bounds.get(UP_TO_SCALE, np.nan)):
        note(
            "one camera cannot tell the size of the arm: but for it, the expected error is "
            f"{1e3 * bound:.2g} mm"
        )
