"""Answers to queries: printed for people, as a JSON document, or written as a table.

A table of queries is answered row by row in its own columns; it needs NumPy.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from calib.common.wording import for_people
from calib.samples.tables import Batch, write_table

from .output import NO, Notes, TextTable, fixed, note, show, show_json
from .units import JointFormat, meaning

if TYPE_CHECKING:
    from calib import Model

BOUNDS = ("expected_error", "model_error")
UP_TO_SCALE = "expected_error_up_to_scale"
"""Key and column of a bound in a camera's base frame that leaves out the arm's size."""

_TOLD = 10  # so many rows are named at most

_Answer = dict[str, Any]
"""Joints [rad or m] by name, "position" and further quantities, in SI or the sensor's unit."""


def answers(joints: JointFormat, q: Any, **quantities: Any) -> list[_Answer]:
    """Return a document for each answer, of joints (n, dof) and quantities of n rows each."""
    rows = zip(q, *quantities.values(), strict=True)
    return [
        {"joints": dict(zip(joints.names, of, strict=True))}
        | dict(zip(quantities, row, strict=True))
        for of, *row in rows
    ]


def show_answers(
    joints: JointFormat,
    found: Sequence[_Answer],
    unit: str,
    axes: Sequence[str],
    quantities: Sequence[str],
    title: str = "",
) -> None:
    """Print answers, one line each; an angle is in deg, all else in the unit of the positions."""
    # bounds and distances have the unit of the positions, but for the angle of a pose
    by = {name: for_people("rad" if name == "turned" else unit) for name in quantities}
    factor, printed = for_people(unit)
    header = [*joints.header, *(f"{axis} [{printed}]" for axis in axes)]
    header += [f"{name.replace('_', ' ')} [{shown}]" for name, (_, shown) in by.items()]
    rows = [
        [
            *joints.cells(list(answer["joints"].values())),
            *(fixed(value * factor, 4) for value in answer["position"]),
            *(fixed(float(answer[name]) * size, 4) for name, (size, _) in by.items()),
        ]
        for answer in found
    ]
    show(TextTable(header, rows, title, left=0))


def bounds_shown(model: Model, frame: str) -> tuple[str, ...]:
    """Bounds that are printed: of a simulation, and in the base frame, both are the same."""
    return BOUNDS if model.about.source == "log" and frame == "sensor" else BOUNDS[:1]


def write_answers(
    columns: Mapping[str, Any] | None,
    output: str | None,
    as_json: bool,
    joints: JointFormat,
    key: str = "answers",
    **told: Any,
) -> None:
    """Write a table of answers, None for no table, and print what is told with it as a document.

    output : the file; `-` is standard output. Without one they go there too, or, in SI units by a
        key, into the document.
    """
    if columns is not None and (output is not None or not as_json):
        write_table("-" if output is None else output, columns)
    if as_json:
        inside = {key: joints.in_si(columns)} if columns is not None and output is None else {}
        show_json({"output": columns and output, **told, **inside})


def write_batch(
    model: Model,
    joints: JointFormat,
    batch: Batch,
    added: Mapping[str, NDArray[Any]],
    refused: Sequence[int],
    why: str,
    streams: tuple[str | None, bool],
    frame: str = "sensor",
    n: int | None = None,
) -> int:
    """Write the answers to a batch, say which rows have none, and return the exit code.

    added : columns of the answers, as typed
    refused, why : numbers of the rows that have no answer, and the reason
    streams : the table of answers and whether a JSON document is wanted, as typed
    n : how many queries there were, where a query may have several rows of answers
    """
    invalid, n = batch.invalid, len(batch.values) if n is None else n
    told = {"rows": n, "invalid": invalid, "out_of_reach": refused, **meaning(model.about, frame)}
    write_answers(batch.answered(added), *streams, joints, **told)
    Notes().say(batch.notes(list(added)))
    say_rows(invalid, n, "not all values are numbers, no answer")
    say_rows(refused, n, why)
    return 1 if invalid else NO if refused else 0


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
