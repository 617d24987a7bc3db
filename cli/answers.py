"""Answers to queries: for people, as documents, or as a table in the columns that were asked.

It needs NumPy.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from calib.common.wording import for_people
from calib.samples.tables import Batch, write_table

from .output import NO, Outcome, TextTable, fixed, note, say
from .units import JointFormat, PositionFormat

if TYPE_CHECKING:
    from calib import Model

BOUNDS = ("expected_error", "model_error")
UP_TO_SCALE = "expected_error_up_to_scale"
"""Key and column of a bound in a camera's base frame that leaves out the arm's size."""
LENGTHS = ("x", "y", "z", "distance", *BOUNDS, UP_TO_SCALE)
"""Columns of answers that have the unit of the positions."""

_TOLD = 10  # so many rows are named at most


def documents(joints: JointFormat, q: Any, **quantities: Any) -> list[dict[str, Any]]:
    """Return a document for each answer, of joints (n, dof) and quantities of n rows each."""
    rows = zip(q, *quantities.values(), strict=True)
    return [
        {"joints": dict(zip(joints.names, of, strict=True))}
        | dict(zip(quantities, row, strict=True))
        for of, *row in rows
    ]


def answer_table(
    joints: JointFormat,
    found: Sequence[Mapping[str, Any]],
    positions: PositionFormat,
    axes: Sequence[str],
    quantities: Sequence[str],
    title: str = "",
) -> TextTable:
    """Return answers, one line each; an angle is in deg, all else in the unit of the positions."""
    # bounds and distances have the unit of the positions, but for the angle of a pose
    lengths = (positions.factor, positions.shown)
    by = {name: for_people("rad") if name == "turned" else lengths for name in quantities}
    header = [*joints.header, *(f"{axis} [{positions.shown}]" for axis in axes)]
    header += [f"{name.replace('_', ' ')} [{shown}]" for name, (_, shown) in by.items()]
    rows = [
        [
            *joints.cells(list(answer["joints"].values())),
            *(fixed(value * positions.factor, 4) for value in answer["position"]),
            *(fixed(float(answer[name]) * size, 4) for name, (size, _) in by.items()),
        ]
        for answer in found
    ]
    return TextTable(header, rows, title, left=0)


def bounds_shown(model: Model, frame: str) -> tuple[str, ...]:
    """Bounds that are printed: of a simulation, and in the base frame, both are the same."""
    return BOUNDS if model.about.source == "log" and frame == "sensor" else BOUNDS[:1]


def table_outcome(
    columns: Mapping[str, Any] | None,
    output: str | None,
    joints: JointFormat,
    positions: PositionFormat | None = None,
    *,
    key: str = "answers",
    code: int = 0,
    lines: Sequence[str] = (),
    **told: Any,
) -> Outcome:
    """Write a table of answers, None for no table, and tell what goes with it.

    columns : joints as typed, positions and their bounds in the model's unit
    output : the file; without one, or with `-`, answers go to standard output, or in SI units by
        a key into the document
    """
    to_file = output not in (None, "-")
    document = {"output": (columns and output) if to_file else None, **told}
    if columns is None:
        return Outcome(document, lines, code=code)
    written, factor = dict(columns), positions.typed if positions else 1.0
    for name in LENGTHS if factor != 1.0 else ():
        if name in written:
            written[name] = np.asarray(written[name], dtype=float) * factor
    if to_file:
        write_table(str(output), written)
        return Outcome(document, lines, code=code)
    return Outcome(
        document | {key: joints.in_si(columns)}, lines, result=(), columns=written, code=code
    )


def read_table(
    source: str,
    names: Sequence[str],
    columns: Mapping[str, str] | None,
    positions: PositionFormat | None = None,
    more: Sequence[Sequence[str]] = (),
) -> Batch:
    """Read a table of queries; its positions come in the model's unit."""
    from dataclasses import replace

    from calib.samples.tables import read_batch

    batch = read_batch(source, names, more, columns or {})
    if positions is None or positions.typed == 1.0:
        return batch
    typed = [positions.typed if name in LENGTHS else 1.0 for name in batch.names]
    return replace(batch, values=batch.values / np.array(typed))


def batch_outcome(
    joints: JointFormat,
    positions: PositionFormat,
    batch: Batch,
    added: Mapping[str, NDArray[Any]],
    refused: Sequence[int],
    why: str,
    output: str | None,
    n: int | None = None,
    **told: Any,
) -> Outcome:
    """Write the answers to a batch and say which rows have none.

    added : columns of the answers, joints as typed
    refused, why : numbers of the rows that have no answer, and the reason
    n : how many queries there were, where a query may have several rows of answers
    """
    invalid, n = batch.invalid, len(batch.values) if n is None else n
    say(batch.notes(list(added)))
    say_rows(invalid, n, "not all values are numbers, no answer")
    say_rows(refused, n, why)
    return table_outcome(
        batch.answered(added),
        output,
        joints,
        positions,
        code=1 if invalid else NO if refused else 0,
        rows=n,
        invalid=invalid,
        out_of_reach=refused,
        **told,
    )


def over_all_rows(valid: NDArray[np.bool_], columns: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """Columns (n,) with values where rows are `valid` (n,); the others are NaN, or not reached."""
    found = {name: np.full(len(valid), np.nan) for name in columns}
    if "reachable" in found:
        found["reachable"] = np.zeros(len(valid), dtype=np.int64)
    for name, column in columns.items():
        found[name][valid] = column
    return found


def numbered(numbers: Sequence[int]) -> str:
    """Name rows by their numbers, the first few of them."""
    shown = ", ".join(map(str, numbers[:_TOLD]))
    more = f" and {len(numbers) - _TOLD} more" if len(numbers) > _TOLD else ""
    return f"row{'s' if len(numbers) > 1 else ''} {shown}{more}"


def say_rows(numbers: Sequence[int], of: int, what: str) -> None:
    """Say what is the matter with some rows, if there are any."""
    if numbers:
        note(f"{numbered(numbers)} of {of}: {what}")
