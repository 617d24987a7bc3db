"""Output: results on standard output, everything else on standard error.

Tables are for people, in mm and degrees. JSON is for programs, in SI units.
"""

from __future__ import annotations

import json
import math
import os
import re
import shutil
import sys
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, TextIO

from calib.common.choices import READOUTS
from calib.common.wording import one_line, printable

from .translation import as_typed

# what is below a nanometre or a millionth of a degree is rounding
_LEAST, _TINY = 1e-6, "<1e-6"
NO = 3  # exit code of a result that a script should act on; each command says which
_WIDTH = 78  # of a terminal, for lines of words
_HUGE = 1e12  # written out it would be wider than its column


@dataclass(frozen=True)
class TextTable:
    """A table for people."""

    header: Sequence[str]  # names of the columns
    rows: Sequence[Sequence[str]]  # cells, already as text
    title: str = ""  # what it shows
    left: int = 1  # how many columns, from the left, hold words rather than numbers
    foot: str = ""  # what its terms mean, in one line below it

    def lines(self) -> list[str]:
        """Return the table as plain text, its columns aligned."""
        # names from a file may hold control characters
        cells = [[printable(cell) for cell in row] for row in (self.header, *self.rows)]
        widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
        lines = [printable(self.title)] if self.title else []
        for row in cells:
            padded = [
                cell.ljust(width) if k < self.left else cell.rjust(width)
                for k, (cell, width) in enumerate(zip(row, widths, strict=True))
            ]
            lines.append("  ".join(padded).rstrip())
        return lines

    def records(self) -> list[str]:
        """Return the table for a narrow terminal: a line for each cell, a blank line for a row."""
        lines = [self.title] if self.title else []
        for row in self.rows:
            pairs = zip(self.header, row, strict=True)
            lines += [*(f"{name}: {cell}".strip(": ") for name, cell in pairs), ""]
        return list(map(printable, lines[:-1]))


_MEANINGS = (
    (
        set(READOUTS),
        "local: body and local models; body: the body alone; linear, activity, winner: the maps "
        "and their Hebbian links alone",
    ),
    (
        {"threshold"},
        "found: test statistic of a change of these parameters, above its threshold it fired; "
        "smallest: the smallest change that these rows could have shown",
    ),
    ({"zeta"}, "zeta: mean squared distance of rows to winning nodes, in the unit box (eq. 9)"),
    ({"som"}, "SOM: self-organizing map of even density"),
    (
        {"vdsom"},
        "VDSOM: the same with varying density; behind a colon, another gain (eq. 8), "
        "residual: where the body is wrong",
    ),
    ({"dsom"}, "DSOM: steps grow with the distance to the winner"),
    ({"gng"}, "GNG: growing neural gas, a map without a lattice"),
    ({"gas"}, "gas: neural gas, nodes without a lattice that follow samples by rank"),
    ({"sigma"}, "sigma: radius of the neighbourhood [nodes]"),
    ({"links"}, "links: Hebbian links between nodes of the two maps (eq. 5)"),
    ({"+-"}, "+-: standard deviation over the seeds"),
)


def explained(table: TextTable) -> TextTable:
    """Return the table with what its terms mean below it; each row's first cells count too."""
    # only words that stand in this table: a list of all terms would be longer than most tables
    cells = [cell for row in table.rows for cell in row[: table.left]]
    text = " ".join([table.title, *table.header, *cells]).lower()
    words = set(re.findall(r"[a-z]+|\+-", text))
    return replace(table, foot="; ".join(told for terms, told in _MEANINGS if words & terms))


def show(table: TextTable) -> None:
    """Print a table; on a terminal that is too narrow for it a line for each cell."""
    # not with Rich: it would be imported, which takes longer than most queries
    lines = table.lines()
    if sys.stdout.isatty() and max(map(len, lines)) > shutil.get_terminal_size().columns:
        lines = table.records()
    print("\n".join([*lines, *textwrap.wrap(table.foot, _WIDTH)]))


def show_facts(facts: Mapping[str, str]) -> None:
    """Print names and values, one pair on each line."""
    shown = {printable(name): printable(as_typed(value)) for name, value in facts.items()}
    width = max(map(len, shown), default=0)
    for name, value in shown.items():
        print(f"{name:<{width}}  {value}")


def show_json(document: Any) -> None:
    """Print one JSON document; numbers that are not finite become null."""
    # a person reads it on a terminal; a program wants one document on one line
    indent = 2 if sys.stdout.isatty() else None
    print(json.dumps(plain(document), indent=indent, allow_nan=False))


def fields(holder: object, names: str) -> dict[str, Any]:
    """Return what stands in a document under the same names as in what was found."""
    return {name: getattr(holder, name) for name in names.split()}


def plain(value: Any) -> Any:
    """Return a value as JSON can hold it: no arrays, no NaN, no infinity."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    # arrays and scalars of NumPy, columns of Polars, which need not be imported for this
    for name in ("tolist", "to_list"):
        if hasattr(value, name):
            return plain(getattr(value, name)())
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def note(text: str) -> None:
    """Say something on standard error, in one line."""
    try:
        print(one_line(" ".join(as_typed(text).split())), file=sys.stderr, flush=True)
    except BrokenPipeError:
        raise
    except OSError:  # a full disk: nobody is told, but the exit code stays the command's
        silence(sys.stderr)


def silence(stream: TextIO) -> None:
    """Point a stream at nothing, so that no later flush, Python's last one too, fails."""
    try:
        handle = os.open(os.devnull, os.O_WRONLY)
        os.dup2(handle, stream.fileno())
        os.close(handle)
    except (OSError, ValueError):  # no real stream, as in tests
        pass


def tell(text: str) -> None:
    """Print a line of a result on standard output; names within it may be a stranger's."""
    print(one_line(text))


def conclude(path: str, line: str, more: Iterable[str], document: Any) -> None:
    """Say what was written to a path, by one document if there is one.

    Lines go to standard error where the table itself went to standard output.
    """
    if document is not None:
        show_json(document)
        return
    say, line = (note, line) if path == "-" else (tell, f"{path}: {line}")
    for each in (line, *more):
        say(each)


class Notes:
    """Notes that were printed, so that none is printed twice."""

    def __init__(self) -> None:
        self._said: set[str] = set()

    def say(self, notes: Iterable[str]) -> None:
        """Say those notes that were not said yet."""
        for text in notes:
            if text not in self._said:
                self._said.add(text)
                note(f"note: {text}")


def number(value: float | None) -> str:
    """Return the size of an error with four significant digits, or a dash for none."""
    if value is None or not math.isfinite(value):
        return "-"
    # decimals that four digits need: 1.234, 12.34, 0.0001234
    size = abs(value)
    if 0.0 < size < _LEAST:
        return _TINY
    if size >= 1e7:
        return f"{value:.3e}"
    decimals = 3 - math.floor(math.log10(size)) if size else 0
    return f"{value:.{max(0, decimals)}f}"


def fixed(value: float, decimals: int) -> str:
    """Return a number with so many decimals, never minus zero, or a dash for none."""
    if not math.isfinite(value):
        return "-"
    if abs(value) >= _HUGE:
        return f"{value:.3e}"
    return f"{round(value, decimals) + 0.0:.{decimals}f}"


_Report = Callable[[float, str, float], None]


@contextmanager
def progress_bar(unit: str) -> Iterator[_Report | None]:
    """Show how far a training is, on standard error.

    Yields what takes the share of the work that is done, the stage and its error [unit]; None
    where standard error is no terminal.
    """
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeRemainingColumn(compact=True),
        TextColumn("{task.fields[error]}"),
        console=Console(stderr=True),
        transient=True,
    )
    with bar:
        task = bar.add_task("babbling", total=1.0, error="")

        def report(share: float, stage: str, error: float) -> None:
            shown = f"error {error:.3g} {unit}" if math.isfinite(error) else ""
            bar.update(task, completed=share, description=stage, error=shown)

        yield report
