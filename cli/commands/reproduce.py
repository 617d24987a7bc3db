"""The command `calib reproduce`: repeat the paper's tables, figures and experiments."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .. import parsing
from ..options import takes
from ..output import TextTable, explained, note, number, progress_bar, show, show_json
from ..parsing import JointRange, JointValue
from ..units import in_si, kinds_of_joints
from ..usage import argument, choice, flag, option

if TYPE_CHECKING:
    from calib.paper.setting import Setting
    from calib.paper.tables import Result

_LONGEST = 1e3  # of a link [m]
FORMATS = ("png", "svg", "pdf")
SUBJECTS = ("table1", "table2", "figures", "adaptation", "networks", "experiments")
CHOICES = (*SUBJECTS, "all")


@parsing.expects("JOINT=METRES such as elbow=0.3")
def _length(text: str) -> JointValue:
    joint, _, value = text.partition("=")
    length = parsing.finite_number(value)
    parsing.require(bool(joint) and 0.0 < length < _LONGEST)
    return joint, length


@takes(
    what=argument("|".join(CHOICES), "What to repeat.", parsing.one_of(CHOICES)),
    output=option("--output -o DIR", "Folder of the CSV files, figures."),
    quick=flag("--quick", "Use small lattices and few samples, for a quick trial."),
    robot=option("--robot ROBOT", "Another arm with two revolute joints."),
    lengths=option(
        "--length JOINT=M", "Length of the link that a joint moves; repeatable.", _length
    ),
    formats=choice("--format", FORMATS, "File type of the figures; repeatable (default png)."),
)
def reproduce(
    what: str = "all",
    output: str = "reproduced",
    quick: bool = False,
    robot: str | None = None,
    ranges: list[JointRange] | None = None,
    lengths: list[JointValue] | None = None,
    formats: list[str] | None = None,
    degrees: bool = False,
    seed: int = 0,
    as_json: bool = False,
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
        typed = in_si("--range", ranges, kinds_of_joints(arm), degrees) if ranges else None
        setting = Setting.of(
            seed, quick=quick, report=report, robot=arm, ranges=typed, lengths=dict(lengths or ())
        )
        drawn = tuple(dict.fromkeys(formats or ("png",)))
        # the figures bring the adaptation along
        names = [name for name in SUBJECTS if name != "adaptation"] if what == "all" else [what]
        for name in names:
            for key, result in _run(name, setting, folder, drawn):
                document[key] = result.data
                _keep(result, folder, shown=not as_json)
    document["units"] = {"joints": "rad", "positions": "m", "seconds": "s"}
    document["seconds"] = time.perf_counter() - started
    document["files"] = sorted(str(path) for path in folder.iterdir())
    if as_json:
        show_json(document)
    else:
        note(f"{output}: {len(document['files'])} files, {document['seconds']:.0f} s")


def _run(
    name: str, setting: Setting, folder: Path, formats: Sequence[str]
) -> Iterator[tuple[str, Result]]:
    """Redo one subject: draw its figures, and yield its results by name."""
    from calib.paper import experiments, figures, tables
    from calib.paper.adaptation import adaptation

    runs: dict[str, tuple[Callable[[Setting], Result], ...]] = {
        "table1": (tables.table1,),
        "table2": (tables.table2,),
        "networks": (experiments.networks,),
        "experiments": (
            experiments.resampling,
            experiments.perturbation,
            experiments.both_directions,
        ),
    }
    if name == "figures":
        figures.lattice_figure(setting, folder / "lattices.png", formats)
    if name in ("figures", "adaptation"):
        result, episodes = adaptation(setting)
        figures.changed_figure(episodes, folder / "changed.png", formats)
        figures.curves_figure(episodes, folder / "adaptation.png", formats)
        yield "adaptation", result
    for run in runs.get(name, ()):
        yield run.__name__, run(setting)


_LONG = ("schedules", "adaptation_curves")  # for the CSV files only


def _keep(result: Result, folder: Path, *, shown: bool) -> None:
    from calib.common.atomic import atomic_write

    for table in result.tables:
        atomic_write(folder / f"{table.name}.csv", table.csv().encode())
        if shown and table.name not in _LONG:
            rows = [[_cell(c) for c in row] for row in table.rows]
            left = next(
                (k for k, c in enumerate(table.rows[0]) if not isinstance(c, str)), len(rows[0])
            )
            show(explained(TextTable(table.header, rows, table.title, left)))
            print()


def _cell(value: str | float | None) -> str:
    if value is None:
        return ""
    return value if isinstance(value, str) else number(value)
