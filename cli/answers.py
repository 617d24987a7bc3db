"""Answers: joints and positions of a query, as JSON and as one table from the same documents."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from calib.common.wording import for_people

from .output import TextTable, fixed, show
from .units import JointFormat

_Answer = dict[str, Any]
"""Joints [rad or m] by name, "position" and further quantities, in SI or the sensor's unit."""


def answers(joints: JointFormat, q: Any, **quantities: Any) -> list[_Answer]:
    """Return a document for each answer, of joints (n, dof) and quantities of n rows each."""
    rows = zip(q, *quantities.values(), strict=True)
    return [
        {
            "joints": dict(zip(joints.names, of, strict=True)),
            **dict(zip(quantities, row, strict=True)),
        }
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
    factor, printed = for_people(unit)
    header = [*joints.header, *(f"{axis} [{printed}]" for axis in axes)]
    units = [for_people("rad") if name == "turned" else (factor, printed) for name in quantities]
    header += [
        f"{name.replace('_', ' ')} [{shown}]"
        for name, (_, shown) in zip(quantities, units, strict=True)
    ]
    rows = []
    for answer in found:
        row = [joints.cell(k, value) for k, value in enumerate(answer["joints"].values())]
        row += [fixed(value * factor, 4) for value in answer["position"]]
        row += [
            fixed(float(answer[name]) * by, 4)
            for name, (by, _) in zip(quantities, units, strict=True)
        ]
        rows.append(row)
    show(TextTable(header, rows, title, left=0))
