"""The command `calib reproduce`."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

from typer import Argument, Option

from .. import options as opt
from .. import parsing
from ..output import Outcome, TextTable, number, progress_bar

if TYPE_CHECKING:
    from calib.paper.setting import Setting
    from calib.paper.tables import Result


Subject = Literal["table1", "table2", "figures", "adaptation", "all"]
SUBJECTS = get_args(Subject)


_LONG = ("schedules", "adaptation_curves")  # for the CSV files only


_TERMS = (
    "SOM: self-organizing map of even density; VDSOM: of varying density, behind a colon the gain "
    "of each sample (eq. 8); sigma: radius of the neighbourhood [nodes]; +-: standard deviation "
    "over the seeds"
)


def reproduce(
    what: Annotated[
        Subject,
        Argument(
            metavar="|".join(SUBJECTS),
            parser=parsing.one_of(SUBJECTS),
            help="What to repeat.",
        ),
    ] = "all",
    output: Annotated[
        str, Option("--output", "-o", metavar="DIR", help="Folder of tables, figures.")
    ] = "reproduced",
    quick: Annotated[
        bool, Option("--quick", help="Small lattices and few samples.")
    ] = False,
    robot: Annotated[
        str | None,
        Option("--robot", metavar="ROBOT", help="Another arm, two revolute joints."),
    ] = None,
    joints: opt.JointNames = None,
    seed: opt.Seed = 0,
    as_json: opt.Json = False,
    verbose: opt.Verbose = False,
    quiet: opt.Quiet = False,
) -> Outcome:
    """Repeat the paper's tables, figures and adaptation, with its numbers beside ours."""
    from calib.common.atomic import atomic_write
    from calib.paper.setting import ROBOT, Setting

    folder = Path(output)
    folder.mkdir(parents=True, exist_ok=True)
    started = time.perf_counter()
    document: dict[str, Any] = {}
    shown: list[TextTable] = []
    with progress_bar() as report:
        arm = robot or ROBOT
        setting = Setting.of(seed, quick=quick, report=report, robot=arm, named=joints)
        # the figures bring the adaptation along
        for name in ("table1", "table2", "figures") if what == "all" else (what,):
            key, result = _run(name, setting, folder)
            document[key] = result.data
            for table in result.tables:
                atomic_write(folder / f"{table.name}.csv", table.csv().encode())
                if table.name not in _LONG:
                    shown.append(_text(table.header, table.rows, table.title))
    document["units"] = {"joints": "rad", "positions": "m", "seconds": "s"}
    document["seconds"] = time.perf_counter() - started
    document["files"] = sorted(str(path) for path in folder.iterdir())
    line = f"{output}: {len(document['files'])} files, {document['seconds']:.0f} s"
    return Outcome(document, [line, *shown])


def _run(name: str, setting: Setting, folder: Path) -> tuple[str, Result]:
    from calib.paper import figures, tables
    from calib.paper.adaptation import adaptation

    if name.startswith("table"):
        return name, getattr(tables, name)(setting)
    if name == "figures":
        figures.lattice_figure(setting, folder / "lattices.png")
    result, episodes = adaptation(setting)
    figures.changed_figure(episodes, folder / "changed.png")
    figures.curves_figure(episodes, folder / "adaptation.png")
    return "adaptation", result


def _text(
    header: Sequence[str], rows: Sequence[Sequence[Any]], title: str
) -> TextTable:
    cells = [
        [c if isinstance(c, str) else "" if c is None else number(c) for c in r]
        for r in rows
    ]
    words = [isinstance(c, str) for c in rows[0]]
    return TextTable(header, cells, title, [*words, False].index(False), foot=_TERMS)
