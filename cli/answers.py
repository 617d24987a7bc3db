"""Answers to queries: for people, as documents, or as a table in the columns that were asked.

It needs NumPy.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

import calib
from calib.common.wording import for_people
from calib.samples.tables import Batch, read_batch, write_table

from .output import NO, Outcome, TextTable, fixed, note, say
from .parsing import TABLES, BadOption, check_file
from .units import JointFormat, PositionFormat, units_of

BOUNDS = ("expected_error", "model_error")
UP_TO_SCALE = "expected_error_up_to_scale"
"""Key and column of a bound in a camera's base frame that leaves out the arm's size."""
_LENGTHS = ("x", "y", "z", "distance", *BOUNDS, UP_TO_SCALE)  # have the unit of the positions
_TOLD = 10  # so many rows are named at most


class Query:
    """A model that is asked, and how its joints and positions are typed and printed."""

    def __init__(
        self,
        path: str,
        degrees: bool,
        frame: str,
        unit: str | None,
        typed: Sequence[float],
        input_: str | None,
        columns: object,
        output: str | None,
    ) -> None:
        if input_ is not None and typed:
            raise BadOption(f"--input {input_!r} and {len(typed)} values: expected one of them")
        for option, value in (("--output", output), ("--columns", columns)):
            if value is not None and input_ is None:
                raise BadOption(f"{option} is for many queries: expected --input FILE too")
        check_file(output, TABLES, stream=True)
        self.model, self.frame = calib.load(path), frame
        about = self.model.about
        self.joints = JointFormat(about, degrees)
        self.positions = PositionFormat(about, frame, unit)
        base = frame == "base"
        units = units_of(about) | {"positions": self.positions.unit}
        bound = "true position" if base else about.bound_of
        told = {"unit": self.positions.unit, "bound_of": bound, "units": units}
        # what the numbers of an answer mean, for JSON
        self.meaning: dict[str, Any] = {"frame": frame, **told} if base else told
        # of a simulation, and in the base frame, both bounds are the same: one is printed
        self.bounds = BOUNDS if about.source == "log" and not base else BOUNDS[:1]

    def documents(self, q: Any, **quantities: Any) -> list[dict[str, Any]]:
        """Return a document for each answer, of joints (n, dof) and quantities of n rows each."""
        rows = zip(q, *quantities.values(), strict=True)
        return [
            {"joints": dict(zip(self.joints.names, of, strict=True))}
            | dict(zip(quantities, row, strict=True))
            for of, *row in rows
        ]

    def table(
        self,
        found: Sequence[Mapping[str, Any]],
        axes: Sequence[str],
        quantities: Sequence[str],
        title: str = "",
    ) -> TextTable:
        """Return answers, one line each, an angle in deg, all else in the positions' unit."""
        length = (self.positions.factor, self.positions.shown)
        by = {name: for_people("rad") if name == "turned" else length for name in quantities}
        header = [*self.joints.header, *(f"{axis} [{length[1]}]" for axis in axes)]
        header += [f"{name.replace('_', ' ')} [{shown}]" for name, (_, shown) in by.items()]
        rows = [
            [
                *self.joints.cells(list(answer["joints"].values())),
                *(fixed(value * length[0], 4) for value in answer["position"]),
                *(fixed(float(answer[name]) * size, 4) for name, (size, _) in by.items()),
            ]
            for answer in found
        ]
        return TextTable(header, rows, title, left=0)

    def read(
        self,
        source: str,
        names: Sequence[str],
        columns: Mapping[str, str] | None,
        more: Sequence[Sequence[str]] = (),
    ) -> Batch:
        """Read a table of queries; its positions come in the model's unit."""
        batch = read_batch(source, names, more, columns or {})
        lengths = [name in _LENGTHS and name not in self.joints.names for name in batch.names]
        return replace(batch, values=batch.values / np.where(lengths, self.positions.typed, 1.0))

    def write(
        self,
        columns: Mapping[str, Any] | None,
        output: str | None,
        *,
        key: str = "answers",
        code: int = 0,
        lines: Sequence[str] = (),
        **told: Any,
    ) -> Outcome:
        """Write a table of answers, None for no table, and tell what goes with it."""
        to_file, by = output not in (None, "-"), self.positions.typed
        document = {"output": (columns and output) if to_file else None, **told}
        if columns is None:
            return Outcome(document, lines, code=code)
        written = {
            name: np.asarray(column, float) * by if by != 1.0 and name in _LENGTHS else column
            for name, column in columns.items()
        }
        if to_file:
            write_table(str(output), written)
            return Outcome(document, lines, code=code)
        factors = dict(zip(self.joints.names, self.joints.typed, strict=True))
        document[key] = {k: v / factors[k] if k in factors else v for k, v in columns.items()}
        return Outcome(document, lines, result=(), columns=written, code=code)

    def answer(
        self,
        batch: Batch,
        added: Mapping[str, NDArray[Any]],
        refused: Sequence[int],
        why: str,
        output: str | None,
        n: int | None = None,
    ) -> Outcome:
        """Write the answers to a batch and say which rows have none."""
        invalid, n = batch.invalid, len(batch.values) if n is None else n
        say(batch.notes(list(added)))
        say_rows(invalid, n, "not all values are numbers, no answer")
        say_rows(refused, n, why)
        code = 1 if invalid else NO if refused else 0
        told = {"rows": n, "invalid": invalid, "out_of_reach": refused, **self.meaning}
        return self.write(batch.answered(added), output, code=code, **told)


def over_all_rows(valid: NDArray[np.bool_], columns: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """Columns (n,) with values where rows are `valid` (n,); the others are NaN, or not reached."""
    found = {name: np.full(len(valid), np.nan) for name in columns}
    if "reachable" in found:
        found["reachable"] = np.zeros(len(valid), dtype=np.int64)
    for name, column in columns.items():
        found[name][valid] = column
    return found


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


def say_size(bound: float | None) -> None:
    """Say what of a bound [m] in the base frame of a camera is the arm's size."""
    if bound is not None and np.isfinite(bound):
        note(
            "one camera cannot tell the size of the arm: but for it, the expected error is "
            f"{1e3 * bound:.2g} mm"
        )
