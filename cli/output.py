"""Output: results on standard output, everything else on standard error.

A command returns an `Outcome`, which is rendered once: as text for people, in mm and degrees, or
as one JSON document for programs, in SI units.
"""

from __future__ import annotations

import json
import math
import os
import re
import sys
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, is_dataclass
from typing import TYPE_CHECKING, TextIO

from calib.common.wording import one_line, printable

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

EXIT_ACT = (
    3  # where a script should act on the result; each command's help says when
)
_WIDTH = 100  # of lines of words and of tables

JsonDocument = Mapping[str, object] | Sequence[object]

_QUOTED = re.compile(r"`([A-Za-z_]\w*)(?:=([^`]*))?`")
_WORDS = "adapt calib check expected_error homing_offset model_error names point sensor time"
"""Words in backquotes that are no parameter which an option sets."""
_RENAMED = {
    "changes": "--change",
    "log": "--data",
    "measured": "--data",
    "n": "--samples",
    "ranges": "--range",
    "robot": "ROBOT",
    "samples": "--data",
    "start": "--from",
}
"""Options of another name than the parameters that they set."""


def as_typed(text: str) -> str:
    """Return a message of the library, parameters in backquotes, in what people type.

    Examples
    --------
    >>> as_typed("give `degrees=True`, or `ranges={'elbow': (LOW, HIGH)}`")
    'give --degrees, or --range elbow=LOW:HIGH'
    >>> as_typed("leave it out of `joints`, or give `joints=['a', 'b']`")
    'leave it out of --joints, or give --joints a,b'
    """
    return _QUOTED.sub(_option, text)


def option_of(parameter: str) -> str:
    """Return the option that sets a parameter."""
    return _RENAMED.get(parameter, f"--{parameter.replace('_', '-')}")


def _option(match: re.Match[str]) -> str:
    name = match[1]
    value = match[2]
    if name in _WORDS.split():
        return match[0]
    option = option_of(name)
    if value in (None, "True"):
        return option
    # Python's (LOW, HIGH), {'elbow': 1} and ['a', 'b'] are LOW:HIGH, elbow=1 and a,b
    ranges = re.sub(
        r"\(([^()]*)\)", lambda pair: pair[1].replace(", ", ":"), value
    )
    plain_text = re.sub(r"[][{}'\"]", "", ranges)
    typed = plain_text.replace(": ", "=").replace(", ", ",")
    if value.startswith("{") and name != "columns":
        # an option for each entry of a mapping
        return " ".join(f"{option} {part}" for part in typed.split(","))
    return f"{option} {typed}"


@dataclass(frozen=True)
class TextTable:
    """A table for people."""

    header: Sequence[str]  # names of the columns
    rows: Sequence[Sequence[str]]  # cells, already as text
    title: str = ""  # what it shows
    # how many columns, from the left, hold words rather than numbers
    left: int = 1
    foot: str = ""  # what its terms mean, in one line below it

    def __str__(self) -> str:
        """Return the table as aligned text.

        Of too wide a one the first column's words head their rows; where that is too wide still,
        each cell has a line.
        """
        # names from a file may hold control characters
        header = [printable(cell) for cell in self.header]
        rows = [[printable(cell) for cell in row] for row in self.rows]
        lines = _align([header, *rows], self.left)
        if self.left > 1 and max(map(len, lines)) > _WIDTH:
            lines = _grouped(header, rows, self.left)
        if max(map(len, lines)) > _WIDTH:
            cells: list[Sequence[str]] = []
            for row in rows:
                # an empty line between rows
                cells += [("", ""), *zip(header, row, strict=True)]
            lines = _align(cells[1:], 2)
        title = [printable(self.title)] if self.title else []
        foot = textwrap.wrap(printable(self.foot), _WIDTH)
        return "\n".join([*title, *lines, *foot])


def _align(rows: Sequence[Sequence[str]], words: int) -> list[str]:
    """Return rows of cells as lines; the first columns hold words, which begin at the left."""
    columns = []
    for k, cells in enumerate(zip(*rows, strict=True)):
        width = max(map(len, cells))
        align = str.ljust if k < words else str.rjust
        columns.append([align(cell, width) for cell in cells])
    return ["  ".join(cells).rstrip() for cells in zip(*columns, strict=True)]


def _grouped(
    header: Sequence[str], rows: Sequence[Sequence[str]], words: int
) -> list[str]:
    """Return rows of cells as lines below the words of their first column."""
    header_line, *lines = _align(
        [row[1:] for row in (header, *rows)], words - 1
    )
    grouped = [f"  {header_line}"]
    heading = None
    for row, line in zip(rows, lines, strict=True):
        if row[0] != heading:
            heading = row[0]
            grouped.append(heading)
        grouped.append(f"  {line}")
    return grouped


Line = str | TextTable


@dataclass(frozen=True)
class Outcome:
    """The result of a command."""

    document: JsonDocument  # what --json prints
    lines: Sequence[Line] = ()  # what people read, the verdict first
    more: Sequence[Line] = ()  # what --verbose adds
    # lines before all others; with any the exit code is `EXIT_ACT`
    warnings: Sequence[str] = ()
    # what --quiet prints, the first line if not given
    result: Sequence[Line] | None = None
    # what goes to standard output as CSV
    columns: Mapping[str, ArrayLike] | None = None
    code: int = 0  # exit code

    def show(self, *, streamed: bool) -> None:
        """Print the result; lines go to standard error where a table was `streamed`."""
        end_progress()
        if PRINT_MODE.as_json:
            print_json(self.document)
            return
        lines: Sequence[Line] = [*self.warnings, *self.lines]
        if PRINT_MODE.quiet:
            lines = lines[:1] if self.result is None else self.result
        elif PRINT_MODE.verbose:
            lines = [*lines, *self.more]
        if self.columns is not None:
            from calib.samples.tables import write_table

            write_table("-", self.columns)
            streamed = True
        for line in lines:
            text = one_line(as_typed(line)) if isinstance(line, str) else line
            if not streamed:
                print(text)
            elif not PRINT_MODE.quiet:
                note(str(line).removeprefix("-: "))


@dataclass
class PrintMode:
    """How the current command prints, and its notes on standard error."""

    as_json: bool = False  # one document on standard output
    verbose: bool = False  # what the answer rests on, too
    quiet: bool = False  # nothing but errors and what a batch leaves unanswered
    notes: set[str] = field(default_factory=set)  # that were printed already
    in_progress: bool = False  # whether a share of the work is shown

    def start(self, as_json: bool, verbose: bool, quiet: bool) -> None:
        """Begin a command, which has printed nothing yet."""
        self.as_json = as_json
        self.verbose = verbose
        self.quiet = quiet
        self.notes.clear()


PRINT_MODE = PrintMode()


def progress(share: float, *_: object) -> None:
    """Show the share of the work that is done, on a terminal."""
    if sys.stderr.isatty() and not PRINT_MODE.quiet:
        print(f"\r{share:4.0%} ", end="", file=sys.stderr, flush=True)
        PRINT_MODE.in_progress = True


def end_progress() -> None:
    """Take the share of the work away."""
    if PRINT_MODE.in_progress:
        print("\r     \r", end="", file=sys.stderr)
        PRINT_MODE.in_progress = False


def say(notes: Iterable[str]) -> None:
    """Print notes on standard error, each once, unless the result alone is wanted."""
    for text in notes:
        if text not in PRINT_MODE.notes and not PRINT_MODE.quiet:
            PRINT_MODE.notes.add(text)
            note(f"note: {text}")


def note(text: str) -> None:
    """Print a line on standard error."""
    end_progress()
    try:
        print(
            one_line(" ".join(as_typed(text).split())),
            file=sys.stderr,
            flush=True,
        )
    except OSError:  # a full disk: the exit code stays the command's
        silence(sys.stderr)


def silence(stream: TextIO) -> None:
    """Point a stream at nothing, so that no later flush, Python's last one too, fails."""
    with suppress(OSError, ValueError):  # no real stream, as in tests
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def print_json(document: JsonDocument) -> None:
    """Print one JSON document; numbers that are not finite become null."""
    # a program wants one document on one line
    print(
        json.dumps(plain(document), indent=2 if sys.stdout.isatty() else None)
    )


def plain(value: object) -> object:
    """Return plain data: no dataclasses, no arrays of Polars or NumPy, no NaN."""
    text = json.dumps(value, default=_as_list)
    return json.loads(text, parse_constant=lambda _: None)


def _as_list(value: object) -> object:
    if isinstance(value, Mapping):
        return dict(value)
    if is_dataclass(value):
        return vars(value)
    method = "tolist" if hasattr(value, "tolist") else "to_list"
    return getattr(value, method)()


def fields(holder: object, *names: str) -> dict[str, object]:
    """Return attributes that a document has under the same names."""
    return {name: getattr(holder, name) for name in names}


def with_decimals(value: float, decimals: int) -> str:
    """Return a number with some decimals, never minus zero, or a dash for none."""
    if not math.isfinite(value):
        return "-"
    return f"{round(value, decimals) + 0.0:.{decimals}f}"
