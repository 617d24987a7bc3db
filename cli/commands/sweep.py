"""The command `calib sweep`: train with every combination of options, on all cores."""

from __future__ import annotations

import glob
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from calib.common.choices import BACKENDS, READOUTS

from .. import parsing
from ..comparison import count_line, document, failures, sweep_tables
from ..options import takes
from ..output import Notes, note, progress_bar, show, show_json, tell
from ..parsing import several
from ..samples import Grid, Logged, Selection, check_sources, measured_samples
from ..usage import BadOption, argument, choice, one_document, option

if TYPE_CHECKING:
    from calib import Samples
    from calib.arm.arm import Arm

_MOST_SEEDS = 1000


@takes(
    robots=argument(
        "ROBOT...", "URDF files or bundled robots (calib robots). Not needed with --data."
    ),
    data=option(
        "--data LOG",
        "A measured log, or several by a quoted pattern such as 'logs/*.csv'; repeatable.",
    ),
    output=option(
        "--output -o FILE",
        "A row for each training, as CSV, or Parquet by its name (- for standard output).",
    ),
    seeds=option(
        "--seeds K",
        "Train each combination this many times, with the seeds 0, 1, 2 and so on.",
        parsing.integer(1, _MOST_SEEDS),
    ),
    jobs=option(
        "--jobs N",
        "How many trainings at the same time (default all cores).",
        parsing.integer(1, 10_000),
    ),
    backend=choice(
        "--backend",
        BACKENDS,
        "Run the trainings in processes or threads of this machine, or on a Dask or Ray cluster.",
    ),
    readout=option(
        "--readout A,B,..",
        "Readouts to print a table for (default all); files and JSON hold them all.",
        several(parsing.one_of(READOUTS)),
    ),
)
def sweep(
    *,
    robots: list[str] | None = None,
    data: list[str] | None = None,
    output: str | None = None,
    grid: Grid,
    seeds: int = 1,
    jobs: int | None = None,
    backend: str = "loky",
    readout: tuple[Any, ...] | None = None,
    selection: Selection,
    logged: Logged,
    as_json: bool = False,
) -> None:
    """Train with every combination of options on all cores, and compare the errors.

    A training that fails is reported in one line and gives exit code 1; the others continue.
    """
    from calib.common.atomic import check_writable
    from calib.samples.tables import write_table
    from calib.sweeps.sweep import sweep as run

    one_document(output, as_json)
    tried = {name: list(values) for name, values in vars(grid).items() if values is not None}
    simulated = {name: tried.get(name) for name in ("samples", "noise")}
    check_sources(robots or (), bool(data), simulated, vars(logged))
    _check_lists(robots or (), data or ())
    if output not in (None, "-"):
        check_writable(str(output))
    notes, unit = Notes(), logged.unit or "m"
    sources: dict[str, Callable[[], Arm | Samples]] = {
        name: partial(_arm, name, selection, notes) for name in robots or ()
    }
    if data is not None:
        robot = robots[0] if robots else None
        # one unit for all: errors of logs in mm and m would stand in one column
        shared: dict[str, Any] = {"logged": replace(logged, unit=unit), "seed": 0, "notes": notes}
        read = partial(measured_samples, robot, selection, **shared)
        sources = {path: partial(read, path) for path in _logs(data)}
    with progress_bar(unit) as progress:
        found = run(sources, tried, seeds=seeds, jobs=jobs, backend=backend, progress=progress)
    notes.say(found.notes)
    for row in found.rows:
        notes.say(row.notes)
    for line in failures(found):
        note(line)
    if output is not None:
        write_table(output, found.columns())
    if as_json:
        show_json(document(found, output))
    elif output != "-":
        for table in sweep_tables(found, readout or READOUTS):
            show(table)
        tell(count_line(found, output))
    if found.failed:
        raise typer.Exit(1)


def _arm(robot: str, selection: Selection, notes: Notes) -> Arm:
    arm = selection.load(robot)
    notes.say(arm.notes)
    return arm


def _check_lists(robots: Sequence[str], data: Sequence[str]) -> None:
    if data and len(robots) > 1:
        raise BadOption(
            f"--data with {len(robots)} robots: expected one ROBOT or none; repeat --data for "
            "each log, or quote a pattern such as 'logs/*.csv'"
        )
    if "-" in data:
        raise BadOption("--data '-': expected files, standard input holds one log")
    for name in robots:
        if robots.count(name) > 1:
            raise BadOption(f"ROBOT {name!r} is given twice: expected each once")


def _logs(typed: Sequence[str]) -> list[str]:
    """Return the logs that are meant, each once; a name with wildcards stands for several."""
    found: dict[str, None] = {}
    for text in typed:
        # a file may be called log[1].csv: what is there is no pattern
        several_meant = glob.has_magic(text) and not Path(text).exists()
        matches = sorted(glob.glob(text, recursive=True)) if several_meant else [text]  # noqa: PTH207
        if not matches:
            raise BadOption(f"--data {text!r}: expected logs, but no file matches")
        found.update(dict.fromkeys(matches))
    return list(found)
