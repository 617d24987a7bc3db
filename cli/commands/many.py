"""The commands that train many models: `calib sweep` and `calib reproduce`."""

from __future__ import annotations

import glob
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

from typer import Argument, Option

from calib.common.choices import MAPS, RULES, ReadoutWord
from calib.common.wording import for_people

from .. import options as opt
from .. import parsing
from ..options import Text, flag, option
from ..output import Outcome, TextTable, fields, note, number, progress_bar, say
from ..parsing import TABLES, BadOption, check_file, several
from ..samples import Logged, Selection, check_sources, measured_samples

if TYPE_CHECKING:
    from calib.paper.setting import Setting
    from calib.paper.tables import Result

Subject = Literal["table1", "table2", "figures", "adaptation", "all"]
_SHOWN = ("forward_mean", "forward_max", "inverse_mean", "inverse_max")
_LONG = ("schedules", "adaptation_curves")  # for the CSV files only
_TERMS = (
    "SOM: self-organizing map of even density; VDSOM: of varying density, behind a colon the gain "
    "of each sample (eq. 8); sigma: radius of the neighbourhood [nodes]; +-: standard deviation "
    "over the seeds"
)


def _grid(usage: str, text: str, read: parsing.Reader[Any]) -> Any:
    return option(f"{usage},..", text, several(read))


@dataclass(frozen=True, kw_only=True)
class Grid:
    """What is tried, as typed."""

    size: Annotated[Any, _grid("--size N|NxN|NxNxN", opt.SIZE, parsing.size)] = None
    map: Annotated[Any, _grid("--map NAME", opt.MAP, parsing.one_of(MAPS))] = None
    rule: Annotated[Any, _grid("--rule batch|online", "Rules.", parsing.one_of(RULES))] = None
    epochs: Annotated[Any, _grid("--epochs N", opt.EPOCHS, parsing.count)] = None
    sigma: Annotated[Any, _grid("--sigma START:END", opt.SIGMA, parsing.sigma)] = None
    samples: Annotated[Any, _grid("--samples -n N", opt.BABBLED, parsing.count)] = None
    noise: Annotated[Any, _grid("--noise S", opt.NOISE, parsing.not_negative)] = None


def sweep(
    robots: Annotated[list[str] | None, Argument(metavar="ROBOT...", help="URDFs, names.")] = None,
    *,
    data: Annotated[list[str] | None, option("--data LOG", "Logs or patterns; repeatable.")] = None,
    output: Annotated[Text, option("--output -o FILE", "CSV or Parquet (- stdout).")] = None,
    grid: Grid,
    seeds: Annotated[int, Option(metavar="K", min=1, max=1000, help="Seeds 0 to K - 1.")] = 1,
    jobs: Annotated[int | None, Option(metavar="N", min=1, max=1000, help="Runs at once.")] = None,
    readout: Annotated[ReadoutWord, Option(help="Of the printed table.")] = "local",
    selection: Selection,
    logged: Logged,
) -> Outcome:
    """Train with every combination of options on all cores, and compare the errors.

    A training that fails is reported in one line and gives exit code 1; the others continue.
    """
    from calib.samples.tables import write_table
    from calib.sweeps import sweep as run

    tried = {name: list(values) for name, values in vars(grid).items() if values is not None}
    simulated = {name: tried.get(name) for name in ("samples", "noise")}
    check_sources(robots or (), bool(data), simulated, vars(logged))
    if data and len(robots or ()) > 1:
        raise BadOption(f"--data with {len(robots or ())} robots: expected one ROBOT or none")
    check_file(output, TABLES, stream=True)
    robot = robots[0] if robots else None
    # a file may be called log[1].csv: what matches nothing is a name
    logs = [path for text in data or () for path in sorted(glob.glob(text)) or [text]]  # noqa: PTH207
    sources: dict[str, Any] = {  # logs are read here: a worker cannot say what was assumed of one
        path: measured_samples(robot, selection, path, logged) for path in logs
    } or {name: selection.load(name) for name in robots or ()}
    with progress_bar() as progress:
        found = run(sources, tried, seeds=seeds, jobs=jobs, progress=progress)
    for row in found.rows:
        say(row.notes)
    for row in found.failed:
        note(f"error: {row.source}, {dict(row.options)}, seed {row.seed}: {row.error}")
    columns, failed = found.columns(), len(found.failed)
    if output is not None:
        write_table(output, columns)
    header = ["source", *tried, "seed", "forward", "max", "inverse", "max", "unit", "seconds"]
    cells = []
    for k, row in enumerate(found.rows):
        factor, unit = for_people(row.unit or "m")
        errors = [number(columns[f"{readout}_{kind}"][k] * factor) for kind in _SHOWN]
        options = [str(columns[name][k]) for name in ("source", *tried, "seed")]
        cells.append([*options, *errors, unit, number(row.seconds)])
    title = f"{readout} readout: mean and largest error of the tip"
    told = f"{f'{output}: ' if output else ''}{len(found.rows)} trainings, {failed} failed"
    document = {
        "output": output,
        "trainings": len(found.rows),
        "failed": failed,
        "units": {"errors": "unit of the row", "seconds": "s"},
        "rows": [fields(r, "source options seed unit errors seconds error") for r in found.rows],
    }
    table = TextTable(header, cells, title, left=2 + len(tried))
    return Outcome(document, [table, told], code=1 if failed else 0)


def reproduce(
    what: Annotated[
        Subject, Argument(metavar="|".join(get_args(Subject)), help="What to repeat.")
    ] = "all",
    *,
    output: Annotated[str, option("--output -o DIR", "Folder of tables, figures.")] = "reproduced",
    quick: Annotated[bool, flag("--quick", "Small lattices and few samples.")] = False,
    robot: Annotated[Text, option("--robot ROBOT", "Another arm, two revolute joints.")] = None,
    joints: opt.JointNames = None,
    seed: opt.Seed = 0,
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


def _text(header: Sequence[str], rows: Sequence[Sequence[Any]], title: str) -> TextTable:
    cells = [[c if isinstance(c, str) else "" if c is None else number(c) for c in r] for r in rows]
    words = [isinstance(c, str) for c in rows[0]]
    return TextTable(header, cells, title, [*words, False].index(False), foot=_TERMS)
