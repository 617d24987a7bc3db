"""Repeat the paper's tables, figures and adaptation, with its numbers beside ours."""

from __future__ import annotations

import textwrap
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from typer import Argument

from calib.common.wording import error_size

from .. import options as opt
from ..output import Outcome, TextTable, progress

if TYPE_CHECKING:
    from calib.paper.setting import Setting
    from calib.paper.tables import Result, Table

Subject = Literal["table1", "table2", "figures", "adaptation", "all"]

_LONG = ("schedules", "adaptation_curves")  # for the CSV files only
_TERMS = (
    "SOM: self-organizing map of even density; VDSOM: of varying density, behind a colon the gain "
    "of each sample (eq. 8); sigma: radius of the neighbourhood [nodes]; +-: standard deviation "
    "over the seeds"
)


def reproduce(
    what: Annotated[Subject, Argument(help="What to repeat.")] = "all",
    output: Annotated[
        str, opt.value("--output -o DIR", "Folder of tables, figures.")
    ] = "reproduced",
    quick: Annotated[
        bool, opt.option("--quick", "Small lattices and few samples.")
    ] = False,
    seed: opt.Seed = 0,
) -> Outcome:
    from calib.common.atomic import atomic_write
    from calib.paper.setting import Setting

    folder = Path(output)
    folder.mkdir(parents=True, exist_ok=True)
    started = time.perf_counter()
    setting = Setting.of(seed, quick=quick, report=progress)
    document: dict[str, object] = {}
    tables: list[TextTable] = []
    # the figures bring the adaptation along
    for name in ("table1", "table2", "figures") if what == "all" else (what,):
        key, result = _result(name, setting, folder)
        document[key] = result.data
        for table in result.tables:
            atomic_write(folder / f"{table.name}.csv", table.csv().encode())
            if table.name not in _LONG:
                tables.append(_text(table))
    seconds = time.perf_counter() - started
    files = sorted(str(path) for path in folder.iterdir())
    document["units"] = {"joints": "rad", "positions": "m", "seconds": "s"}
    document["seconds"] = seconds
    document["files"] = files
    line = f"{output}: {len(files)} files, {seconds:.0f} s"
    return Outcome(document, [line, *tables, *textwrap.wrap(_TERMS, 100)])


def _result(name: str, setting: Setting, folder: Path) -> tuple[str, Result]:
    from calib.paper import figures, tables
    from calib.paper.adaptation import adaptation

    if name == "table1":
        return name, tables.table1(setting)
    if name == "table2":
        return name, tables.table2(setting)
    if name == "figures":
        figures.lattice_figure(setting, folder / "lattices.png")
    result, episodes = adaptation(setting)
    figures.change_figure(episodes, folder / "changed.png")
    figures.curves_figure(episodes, folder / "adaptation.png")
    return "adaptation", result


def _text(table: Table) -> TextTable:
    rows = [[_cell(value) for value in row] for row in table.rows]
    words = sum(isinstance(value, str) for value in table.rows[0])
    # small lattices have no numbers of the paper to compare with
    filled = [
        k for k in range(len(table.header)) if any(row[k] for row in rows)
    ]
    header = [table.header[k] for k in filled]
    rows = [[row[k] for k in filled] for row in rows]
    return TextTable(header, rows, table.title, words)


def _cell(value: str | float | None) -> str:
    if isinstance(value, str):
        return value
    return "" if value is None else error_size(value)
