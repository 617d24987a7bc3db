"""The command `calib reproduce`."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .. import options as o
from .. import parsing
from ..output import Table, note, number, show, show_json
from ..parsing import BadOption
from ..progress import progress_bar
from ..units import kinds_of_joints, ranges_in_si

if TYPE_CHECKING:
    from calib.paper.setting import Setting
    from calib.paper.tables import Result

Formats = tuple[str, ...]
FORMATS = ("png", "svg", "pdf")
SUBJECTS = (
    "table1",
    "table2",
    "figures",
    "adaptation",
    "networks",
    "experiments",
    "ablation",
    "all",
)

SubjectArgument = Annotated[
    str,
    typer.Argument(
        parser=parsing.one_of("WHAT", SUBJECTS), metavar="|".join(SUBJECTS), help="What to repeat."
    ),
]


def reproduce(
    what: SubjectArgument = "all",
    output: Annotated[
        str, typer.Option("--output", "-o", metavar="DIR", help="Folder of the CSV files, figures.")
    ] = "reproduced",
    quick: Annotated[
        bool, typer.Option("--quick", help="Use small lattices and few samples, for a quick trial.")
    ] = False,
    data: Annotated[
        str | None,
        typer.Option("--data", metavar="DIR", help="Folder of real logs, for the ablation."),
    ] = None,
    robot: Annotated[
        str | None,
        typer.Option("--robot", metavar="ROBOT", help="Another arm with two revolute joints."),
    ] = None,
    ranges: o.RangeOption = None,
    lengths: Annotated[
        list[str] | None,
        typer.Option(
            "--length", metavar="JOINT=M", help="Length of the link that a joint moves; repeatable."
        ),
    ] = None,
    formats: Annotated[
        list[str] | None,
        typer.Option(
            "--format",
            parser=parsing.one_of("FORMAT", FORMATS),
            metavar="|".join(FORMATS),
            help="File type of the figures; repeatable (default png).",
        ),
    ] = None,
    degrees: o.DegreesOption = False,
    seed: o.SeedOption = 0,
    as_json: o.JsonOption = False,
) -> None:
    """Repeat the paper's tables, figures and experiments, with its numbers beside ours."""
    from calib.paper.setting import ROBOT, Setting

    folder = Path(output)
    folder.mkdir(parents=True, exist_ok=True)
    started = time.perf_counter()
    document: dict[str, Any] = {}
    with progress_bar("") as bar:

        def report(share: float, stage: str) -> None:
            if bar is not None:
                bar(share, stage, float("nan"))

        arm = robot or ROBOT
        typed = ranges_in_si(ranges or (), kinds_of_joints(arm), degrees) if ranges else None
        setting = Setting.of(
            seed,
            quick=quick,
            report=report,
            robot=arm,
            ranges=typed,
            lengths=_lengths(lengths or ()),
        )
        setting = replace(setting, data=None if data is None else Path(data))
        drawn = tuple(dict.fromkeys(formats or ("png",)))
        for name in _ALL if what == "all" else (what,):
            for key, result in _RUNS[name](setting, folder, drawn):
                document[key] = result.data
                _keep(result, folder, shown=not as_json)
    document["units"] = {"joints": "rad", "positions": "m", "seconds": "s"}
    document["seconds"] = time.perf_counter() - started
    document["files"] = sorted(str(path) for path in folder.iterdir())
    if as_json:
        show_json(document)
    else:
        note(f"{output}: {len(document['files'])} files, {document['seconds']:.0f} s")


def _lengths(typed: Sequence[str]) -> dict[str, float]:
    """Lengths of links by their joints."""
    found = {}
    for text in typed:
        joint, equals, value = text.partition("=")
        try:
            length = float(value)
        except ValueError:
            length = -1.0
        if not (joint and equals and 0.0 < length < _LONGEST):
            raise BadOption(f"--length {text!r}: expected JOINT=METRES such as elbow=0.3")
        found[joint] = length
    return found


def _table1(setting: Setting, _folder: Path, _: Formats) -> list[tuple[str, Result]]:
    from calib.paper.tables import table1

    return [("table1", table1(setting))]


def _table2(setting: Setting, _folder: Path, _: Formats) -> list[tuple[str, Result]]:
    from calib.paper.tables import table2

    return [("table2", table2(setting))]


def _networks(setting: Setting, _folder: Path, _: Formats) -> list[tuple[str, Result]]:
    from calib.paper.experiments import networks

    return [("networks", networks(setting))]


def _experiments(setting: Setting, _folder: Path, _: Formats) -> list[tuple[str, Result]]:
    from calib.paper import experiments as e

    runs = (e.resampling, e.perturbation, e.directions)
    return [(run.__name__, run(setting)) for run in runs]


def _ablation(setting: Setting, _folder: Path, _formats: Formats) -> list[tuple[str, Result]]:
    from calib.paper.ablation import ablation

    return [("ablation", ablation(setting))]


def _figures(setting: Setting, folder: Path, formats: Formats) -> list[tuple[str, Result]]:
    from calib.paper.figures import lattice_figure

    lattice_figure(setting, folder / "lattices.png", formats)
    return _adaptation(setting, folder, formats)


def _adaptation(setting: Setting, folder: Path, formats: Formats) -> list[tuple[str, Result]]:
    from calib.paper.adaptation import adaptation
    from calib.paper.figures import changed_figure, curves_figure

    result, episodes = adaptation(setting)
    changed_figure(episodes, folder / "changed.png", formats)
    curves_figure(episodes, folder / "adaptation.png", formats)
    return [("adaptation", result)]


_RUNS: dict[str, Callable[[Setting, Path, Formats], list[tuple[str, Result]]]] = {
    "table1": _table1,
    "table2": _table2,
    "figures": _figures,
    "adaptation": _adaptation,
    "networks": _networks,
    "experiments": _experiments,
    "ablation": _ablation,
}
_LONGEST = 1e3  # of a link [m]
_ALL = (
    "table1",
    "table2",
    "figures",
    "networks",
    "experiments",
    "ablation",
)  # figures: adaptation too
_LONG = ("schedules", "adaptation_curves", "ablation")  # for the CSV files only


def _keep(result: Result, folder: Path, *, shown: bool) -> None:
    """Write the tables as CSV and print them."""
    from calib.common.atomic import atomic_write

    for table in result.tables:
        atomic_write(folder / f"{table.name}.csv", table.csv().encode())
        if shown and table.name not in _LONG:
            rows = [[_cell(c) for c in row] for row in table.rows]
            left = next(
                (k for k, c in enumerate(table.rows[0]) if not isinstance(c, str)), len(rows[0])
            )
            show(Table(table.header, rows, table.title, left))
            print()


def _cell(value: str | float | None) -> str:
    if value is None:
        return ""
    return value if isinstance(value, str) else number(value)
