"""Findings: what is wrong with a log, or looks so, in words with a remedy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array
from ..common.wording import by_name
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
