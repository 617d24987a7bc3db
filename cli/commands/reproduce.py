"""The command `calib reproduce`: repeat the paper's tables, figures and adaptation."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

from typer import Argument, Option

from .. import options as opt
from ..options import Text, option
from ..output import Outcome, TextTable, number, progress_bar

if TYPE_CHECKING:
    from calib.paper.setting import Setting
    from calib.paper.tables import Result

Subject = Literal["table1", "table2", "figures", "adaptation", "all"]


def reproduce(
    what: Annotated[
        Subject, Argument(metavar="|".join(get_args(Subject)), help="What to repeat.")
    ] = "all",
    *,
    output: Annotated[str, option("--output -o DIR", "Folder of tables, figures.")] = "reproduced",
    quick: Annotated[bool, Option("--quick", help="Small lattices and few samples.")] = False,
    robot: Annotated[Text, option("--robot ROBOT", "Another arm, two revolute joints.")] = None,
    joints: opt.JointNames = None,
    seed: opt.Seed = 0,
) -> Outcome:
    """Repeat the paper's tables, figures and adaptation, with its numbers beside ours."""
    from calib.paper.setting import ROBOT, Setting

    folder = Path(output)
    folder.mkdir(parents=True, exist_ok=True)
    started = time.perf_counter()
    document: dict[str, Any] = {}
    tables: list[TextTable] = []
    with progress_bar("") as bar:

        def report(share: float, stage: str) -> None:
            if bar is not None:
                bar(share, stage, float("nan"))

        arm = robot or ROBOT
        setting = Setting.of(seed, quick=quick, report=report, robot=arm, named=joints)
        # the figures bring the adaptation along
        every = [name for name in get_args(Subject) if name not in ("adaptation", "all")]
        for name in every if what == "all" else [what]:
            key, result = _run(name, setting, folder)
            document[key] = result.data
            tables += _written(result, folder)
    document["units"] = {"joints": "rad", "positions": "m", "seconds": "s"}
    document["seconds"] = time.perf_counter() - started
    document["files"] = sorted(str(path) for path in folder.iterdir())
    line = f"{output}: {len(document['files'])} files, {document['seconds']:.0f} s"
    return Outcome(document, [*tables, line], result=[line])


def _run(name: str, setting: Setting, folder: Path) -> tuple[str, Result]:
    from calib.paper import figures, tables
    from calib.paper.adaptation import adaptation

    if name.startswith("table"):
        return name, {"table1": tables.table1, "table2": tables.table2}[name](setting)
    if name == "figures":
        figures.lattice_figure(setting, folder / "lattices.png")
    result, episodes = adaptation(setting)
    figures.changed_figure(episodes, folder / "changed.png")
    figures.curves_figure(episodes, folder / "adaptation.png")
    return "adaptation", result


_LONG = ("schedules", "adaptation_curves")  # for the CSV files only


def _written(result: Result, folder: Path) -> list[TextTable]:
    from calib.common.atomic import atomic_write

    shown = []
    for table in result.tables:
        atomic_write(folder / f"{table.name}.csv", table.csv().encode())
        if table.name not in _LONG:
            rows = [
                ["" if c is None else c if isinstance(c, str) else number(c) for c in row]
                for row in table.rows
            ]
            words = [isinstance(c, str) for c in table.rows[0]]
            left = words.index(False) if False in words else len(words)
            shown.append(TextTable(table.header, rows, table.title, left, foot=_TERMS))
    return shown


_TERMS = (
    "SOM: self-organizing map of even density; VDSOM: of varying density, behind a colon the gain "
    "of each sample (eq. 8); sigma: radius of the neighbourhood [nodes]; +-: standard deviation "
    "over the seeds"
)
