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
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import Any, TextIO

import typer

from calib.common.wording import for_people, one_line, printable

NO = 3  # exit code of a result that a script should act on; each command says which
_WIDTH = 100  # of lines of words and of tables
_TINY = 1e-6  # what is below a nanometre or a millionth of a degree is rounding

_QUOTED = re.compile(r"`([A-Za-z_]\w*)(?:=([^`]*))?`")
_WORDS = "adapt calib check expected_error homing_offset model_error names point time"
"""What stands in backquotes without being a parameter that an option sets."""
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
    pairs = re.sub(r"\(([^()]*)\)", lambda pair: pair[1].replace(", ", ":"), value)
    typed = re.sub(r"[][{}'\"]", "", pairs).replace(": ", "=").replace(", ", ",")
    # an option for each entry of a mapping
    several = value.startswith("{") and name != "columns"
    return " ".join(
        f"{option} {part}" for part in (typed.split(",") if several else [typed])
    )


@dataclass(frozen=True)
class TextTable:
    """A table for people."""

    header: Sequence[str]  # names of the columns
    rows: Sequence[Sequence[str]]  # cells, already as text
    title: str = ""  # what it shows
    left: int = 1  # how many columns, from the left, hold words rather than numbers
    foot: str = ""  # what its terms mean, in one line below it

    def lines(self) -> list[str]:
        """Return the table as plain text, its columns aligned; too wide a line for each cell."""
        # names from a file may hold control characters
        header = [printable(cell) for cell in self.header]
        cells = [[printable(cell) for cell in row] for row in self.rows]
        lines = _aligned([header, *cells], self.left)
        if max(map(len, lines)) > _WIDTH:
            pairs = [[*pair] for row in cells for pair in zip(header, row, strict=True)]
            lines = _aligned(pairs, 2)
        title = [printable(self.title)] if self.title else []
        return [*title, *lines, *textwrap.wrap(printable(self.foot), _WIDTH)]


def _aligned(cells: Sequence[Sequence[str]], words: int) -> list[str]:
    """Return rows of cells as lines; the first columns hold words, which begin at the left."""
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    lines = []
    for row in cells:
        padded = [
            cell.ljust(width) if k < words else cell.rjust(width)
            for k, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        lines.append("  ".join(padded).rstrip())
    return lines


_Line = str | TextTable


@dataclass(frozen=True)
class Outcome:
    """What a command found."""

    document: Any  # what --json prints
    lines: Sequence[_Line] = ()  # what people read, the verdict first
    more: Sequence[_Line] = ()  # what --verbose adds
    result: Sequence[_Line] | None = (
        None  # what --quiet prints, the first line if not given
    )
    columns: Mapping[str, Any] | None = None  # what goes to standard output as CSV
    code: int = 0  # exit code

    def show(self, *, as_json: bool, verbose: bool, streamed: bool) -> None:
        """Print what was found; lines go to standard error where a table was `streamed`."""
        if as_json:
            print_json(self.document)
            return
        shown = [*self.lines, *(self.more if verbose else ())]
        if SPEECH.quiet:
            shown = list(self.lines[:1] if self.result is None else self.result)
        if self.columns is not None:
            from calib.samples.tables import write_table

            write_table("-", self.columns)
        if self.columns is not None or streamed:
            for line in shown:
                if isinstance(line, str) and not SPEECH.quiet:
                    note(line)
            return
        for line in shown:
            print(
                one_line(as_typed(line))
                if isinstance(line, str)
                else "\n".join(line.lines())
            )


@dataclass
class Speech:
    """What the command at hand says on standard error."""

    quiet: bool = False  # nothing but errors and what a batch leaves unanswered
    notes: set[str] = field(default_factory=set)  # that were said already


SPEECH = Speech()


def start_speaking(quiet: bool) -> None:
    """Begin a command, whose notes are said unless it is quiet."""
    SPEECH.quiet = quiet
    SPEECH.notes.clear()


def say(notes: Iterable[str]) -> None:
    """Say notes on standard error, each once, unless the result alone is wanted."""
    for text in notes:
        if text not in SPEECH.notes and not SPEECH.quiet:
            SPEECH.notes.add(text)
            note(f"note: {text}")


def note(text: str) -> None:
    """Say something on standard error, in one line."""
    try:
        print(one_line(" ".join(as_typed(text).split())), file=sys.stderr, flush=True)
    except (
        OSError
    ):  # a full disk: nobody is told, but the exit code stays the command's
        silence(sys.stderr)


def silence(stream: TextIO) -> None:
    """Point a stream at nothing, so that no later flush, Python's last one too, fails."""
    with suppress(OSError, ValueError):  # no real stream, as in tests
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def print_json(document: Any) -> None:
    """Print one JSON document; numbers that are not finite become null."""
    # a program wants one document on one line
    indent = 2 if sys.stdout.isatty() else None
    print(json.dumps(plain(document), indent=indent))


def fields(holder: object, names: str) -> dict[str, Any]:
    """Return what stands in a document under the same names as in what was found."""
    return {name: getattr(holder, name) for name in names.split()}


def plain(value: Any) -> Any:
    """Return plain data: no arrays, of which Polars and NumPy need not be imported, no NaN."""

    def listed(value: Any) -> Any:
        if isinstance(value, Mapping):
            return dict(value)
        return next(
            (getattr(value, n)() for n in ("tolist", "to_list") if hasattr(value, n)),
            None,
        )

    return json.loads(json.dumps(value, default=listed), parse_constant=lambda _: None)


def number(value: float | None) -> str:
    """Return the size of an error with four significant digits, or a dash for none."""
    if value is None or not math.isfinite(value):
        return "-"
    size = abs(value)
    if size < _TINY:
        return "<1e-6" if size else "0"
    # decimals that four digits need: 1.234, 12.34, 0.0001234
    return f"{value:.{max(0, 3 - math.floor(math.log10(size)))}f}"


def sized(value: float, unit: str) -> str:
    """Return a length or an angle with the unit that people read, mm or degrees."""
    factor, shown = for_people(unit)
    return f"{number(factor * value)} {shown}"


def fixed(value: float, decimals: int) -> str:
    """Return a number with so many decimals, never minus zero, or a dash for none."""
    return (
        f"{round(value, decimals) + 0.0:.{decimals}f}" if math.isfinite(value) else "-"
    )


@contextmanager
def progress_bar() -> Iterator[Callable[..., None]]:
    """Show how far a training is, on standard error: called with the share that is done."""
    hidden = SPEECH.quiet or not sys.stderr.isatty()
    with typer.progressbar(length=100, file=sys.stderr, hidden=hidden) as bar:
        yield lambda share, *_: bar.update(round(100 * share) - bar.pos)
