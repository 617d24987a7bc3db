"""The command `calib sweep`: train with every combination of options, on all cores."""

from __future__ import annotations

import glob
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from calib.common.choices import READOUTS

from .. import parsing
from ..options import takes
from ..output import (
    Notes,
    TextTable,
    explained,
    fields,
    note,
    number,
    progress_bar,
    show,
    show_json,
    tell,
)
from ..samples import Grid, Logged, Selection, check_sources, measured_samples
from ..usage import BadOption, argument, choice, one_document, option

if TYPE_CHECKING:
    from calib import Samples, Sweep
    from calib.arm.arm import Arm


@takes(
    robots=argument("ROBOT...", "URDF files or bundled robots. Not needed with --data."),
    data=option("--data LOG", "A log, or several by a quoted pattern such as 'logs/*.csv'."),
    output=option("--output -o FILE", "A row for each training, CSV or Parquet (- for stdout)."),
    seeds=option("--seeds K", "Train each with the seeds 0, 1, 2 ...", parsing.integer(1, 1000)),
    jobs=option("--jobs N", "How many at a time (default all cores).", parsing.integer(1, 1000)),
    readout=choice("--readout", READOUTS, "Readout of the table; files and JSON hold them all."),
)
def sweep(
    *,
    robots: list[str] | None = None,
    data: list[str] | None = None,
    output: str | None = None,
    grid: Grid,
    seeds: int = 1,
    jobs: int | None = None,
    readout: str = "local",
    selection: Selection,
    logged: Logged,
    as_json: bool = False,
) -> None:
    """Train with every combination of options on all cores, and compare the errors.

    A training that fails is reported in one line and gives exit code 1; the others continue.
    """
    from calib.common.atomic import check_writable
    from calib.samples.tables import write_table
    from calib.sweeps import sweep as run

    one_document(output, as_json)
    tried = {name: list(values) for name, values in vars(grid).items() if values is not None}
    simulated = {name: tried.get(name) for name in ("samples", "noise")}
    check_sources(robots or (), bool(data), simulated, vars(logged))
    if data and len(robots or ()) > 1:
        raise BadOption(f"--data with {len(robots or ())} robots: expected one ROBOT or none")
    if output not in (None, "-"):
        check_writable(str(output))
    notes = Notes()
    sources: dict[str, Callable[[], Arm | Samples]] = {
        name: partial(selection.load, name) for name in robots or ()
    }
    if data is not None:
        shared: dict[str, Any] = {"logged": logged, "seed": 0, "notes": notes}
        robot = robots[0] if robots else None
        sources = {
            path: partial(measured_samples, robot, selection, path, **shared)
            for path in _logs(data)
        }
    with progress_bar(logged.unit or "m") as progress:
        # logs are read here: a worker cannot say what was assumed of one
        ready: dict[str, Any] = {name: source() for name, source in sources.items()}
        found = run(ready, tried, seeds=seeds, jobs=jobs, progress=progress)
    notes.say(found.notes)
    for row in found.rows:
        notes.say(row.notes)
    for row in found.failed:
        note(f"error: {row.source}, {dict(row.options)}, seed {row.seed}: {row.error}")
    if output is not None:
        write_table(output, found.columns())
    told = f"{len(found)} trainings, {len(found.failed)} failed"
    if as_json:
        rows = [fields(row, "source options seed unit errors seconds error") for row in found.rows]
        failed = len(found.failed)
        show_json({"output": output, "trainings": len(found), "failed": failed, "rows": rows})
    elif output != "-":
        show(_table(found, readout))
        tell(f"{output}: {told}" if output else told)
    if found.failed:
        raise typer.Exit(1)


def _logs(typed: list[str]) -> list[str]:
    """The logs that are meant, each once; a name with wildcards stands for several."""
    found: dict[str, None] = {}
    for text in typed:
        # a file may be called log[1].csv: what is there is no pattern
        several = glob.has_magic(text) and not Path(text).exists()
        matches = sorted(glob.glob(text, recursive=True)) if several else [text]  # noqa: PTH207
        if not matches or text == "-":
            raise BadOption(f"--data {text!r}: expected files, but none matches")
        found.update(dict.fromkeys(matches))
    return list(found)


def _table(found: Sweep, readout: str) -> TextTable:
    """A row for each training, errors of the tip in the unit of its positions."""
    from calib.common.wording import for_people
    from calib.sweeps import written

    names = list(dict.fromkeys(name for row in found.rows for name in row.options))
    rows = []
    for row in found.rows:
        factor, unit = for_people(row.unit or "m")
        errors = [
            number(factor * row.distance(readout, way, key))
            for way in ("forward", "inverse")
            for key in ("mean", "max")
        ]
        options = [str(written(row.options.get(name))) for name in names]
        rows.append([row.source, *options, str(row.seed), *errors, unit, number(row.seconds)])
    header = ["source", *names, "seed", "forward", "max", "inverse", "max", "unit", "seconds"]
    title = f"{readout} readout: mean and largest error of the tip"
    return explained(TextTable(header, rows, title, left=2 + len(names)))
