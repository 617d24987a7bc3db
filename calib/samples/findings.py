"""Findings: what is wrong with a log, or looks so, and other readings of its joint values."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array
from ..common.wording import by_name, listing
from ..errors import LogError


@dataclass(frozen=True)
class Finding:
    """Something that is wrong with a log, or looks so."""

    # still, unit, turns, degrees, exchanged, reversed, mirrored
    kind: str
    words: str
    hint: str = ""  # the remedy, with Python's names of options
    parameter: str | None = None
    value: object = None
    # whether it can be nothing else; otherwise it may be intended
    mistake: bool = True


def refuse_mistakes(findings: Sequence[Finding], label: str = "") -> list[str]:
    """Refuse a log for the first finding that is a mistake; return the others as notes.

    label : what the log is called, "" where that is known
    Raises LogError.
    """
    notes = []
    for finding in findings:
        words = f"{label}: {finding.words}" if label else finding.words
        hint = finding.hint
        if finding.mistake:
            raise LogError(
                words,
                hint=hint or None,
                parameter=finding.parameter,
                value=finding.value,
            )
        notes.append(f"{words}; {hint}" if hint else words)
    return notes


def still_columns(q: Array, x: Array, names: Sequence[str]) -> list[Finding]:
    """Findings of columns that never move.

    In space a coordinate may be still: a sensor may see the points of a plane.
    """
    findings = []
    if len(q) < 2:
        words = "one usable row; learning needs two or more"
        findings.append(Finding("still", words))
    columns = by_name(names, q.T)
    if x.shape[1] == 2:
        columns |= by_name("xy", x.T)
    for name, column in columns.items():
        if not np.ptp(column):
            words = f"{name} is {column[0]:g} in every row; what does not move cannot be learned"
            hint = "leave it out of `joints`" if name in names else ""
            findings.append(Finding("still", words, hint, "joints", name))
    return findings


Interpretation = tuple[Array, Finding]
"""Other joint values (n, dof), and what they would mean."""

ONLY_IF = "the log fits the robot only if "
"""Start of the words of each."""


def interpretations(
    q: Array, names: Sequence[str], revolute: Sequence[bool], *, any_order: bool
) -> tuple[Iterator[Interpretation], ...]:
    """Interpretations of joint values (n, dof): their unit, their order, one sign, two signs.

    any_order : whether columns are tried in all orders, not only with two exchanged
    """
    return (
        units(q, revolute),
        _orders(q, names, any_order),
        _signs(q, names, 1),
        _signs(q, names, 2),
    )


def units(q: Array, revolute: Sequence[bool]) -> Iterator[Interpretation]:
    """The angles of joint values (n, dof) in degrees, then in radians."""
    for unit, convert, hint in (
        ("degrees", np.deg2rad, "give `degrees=True`"),
        ("radians", np.rad2deg, "leave out `degrees`"),
    ):
        words = f"{ONLY_IF}the joint values are {unit}"
        finding = Finding("degrees", words, hint, "degrees", unit == "radians")
        yield np.where(revolute, convert(q), q), finding


def _orders(
    q: Array, names: Sequence[str], any_order: bool
) -> Iterator[Interpretation]:
    """Columns of joint values (n, dof) exchanged, two of them or in any order."""
    for order in itertools.permutations(range(len(names))):
        column_of = {names[k]: names[j] for k, j in enumerate(order) if k != j}
        if len(column_of) == 2 or (column_of and any_order):
            holds = listing(
                f"{column} holds {name}" for name, column in column_of.items()
            )
            words = f"{ONLY_IF}columns are exchanged ({holds})"
            hint = f"give `columns={column_of}`, or correct the header"
            value = list(column_of)
            finding = Finding("exchanged", words, hint, "columns", value)
            yield q[:, list(order)], finding


def _signs(
    q: Array, names: Sequence[str], count: int
) -> Iterator[Interpretation]:
    """The signs of `count` columns of joint values (n, dof) changed."""
    if count >= len(names):  # all of them changed are a mirror
        return
    hint = "its encoder or servo is reversed: change the sign of its column"
    for joints in itertools.combinations(range(len(names)), count):
        changed = q.copy()
        changed[:, joints] *= -1.0
        reversed_names = [names[k] for k in joints]
        joined = " and ".join(reversed_names)
        words = f"{ONLY_IF}{joined} counts the other way"
        yield (
            changed,
            Finding("reversed", words, hint, "joints", reversed_names),
        )
