"""Train with every combination of options on all cores, and compare the errors.

A training that fails is reported in one line and gives exit code 1; the others continue.
"""

from __future__ import annotations

import glob
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

from typer import Argument

from calib.common.choices import MAPS, RULES, ReadoutWord
from calib.common.wording import for_people

from .. import options as opt
from .. import parsing
from ..logs import Reading, Selection, check_sources, measured
from ..output import Outcome, TextTable, fields, note, number, progress, say
from ..parsing import TABLES, BadOption, check_file, several, whole

if TYPE_CHECKING:
    from calib.sweeps import Source, Sweep

_SHOWN = ("forward_mean", "forward_max", "inverse_mean", "inverse_max")


def sweep(
    robots: Annotated[
        list[str] | None, Argument(metavar="ROBOT...", help="URDFs, names.")
    ] = None,
    data: Annotated[
        list[str] | None,
        opt.value("--data", "LOG", "Logs or patterns; repeatable."),
    ] = None,
    output: Annotated[
        str | None,
        opt.value("--output -o", "FILE", "CSV or Parquet (- stdout)."),
    ] = None,
    size: Annotated[
        Sequence[int | tuple[int, ...]] | None,
        opt.value(
            "--size", "N|NxN|NxNxN,..", opt.SIZE, several(parsing.lattice_sides)
        ),
    ] = None,
    map: Annotated[  # noqa: A002
        Sequence[str] | None,
        opt.value("--map", "NAME,..", opt.MAP, several(parsing.one_of(MAPS))),
    ] = None,
    rule: Annotated[
        Sequence[str] | None,
        opt.value(
            "--rule",
            "batch|online,..",
            "Rules.",
            several(parsing.one_of(RULES)),
        ),
    ] = None,
    epochs: Annotated[
        Sequence[int] | None,
        opt.value("--epochs", "N,..", opt.EPOCHS, several(parsing.count)),
    ] = None,
    sigma: Annotated[
        Sequence[parsing.RadiusSchedule] | None,
        opt.value("--sigma", "START:END,..", opt.SIGMA, several(parsing.sigma)),
    ] = None,
    samples: Annotated[
        Sequence[int] | None,
        opt.value("--samples -n", "N,..", opt.SAMPLES, several(parsing.count)),
    ] = None,
    noise: Annotated[
        Sequence[float] | None,
        opt.value("--noise", "S,..", opt.NOISE, several(parsing.not_negative)),
    ] = None,
    seeds: Annotated[
        int, opt.value("--seeds", "K", "Seeds 0 to K - 1.", whole(1, 1000))
    ] = 1,
    jobs: Annotated[
        int | None, opt.value("--jobs", "N", "Runs at once.", whole(1, 1000))
    ] = None,
    readout: Annotated[
        ReadoutWord, opt.option("--readout", "Of the printed table.")
    ] = "local",
    joints: opt.JointNames = None,
    tip: opt.Tip = None,
    planar: opt.Planar = False,
    lock: opt.Lock = None,
    ranges: opt.Ranges = None,
    degrees: opt.Degrees = False,
    columns: opt.Columns = None,
    unit: opt.Unit = None,
    time_offset: opt.TimeOffset = None,
    prismatic: opt.Prismatic = None,
) -> Outcome:
    from calib.samples.tables import write_table
    from calib.sweeps import sweep as run

    selection = Selection(joints, tip, planar, lock, ranges, degrees)
    reading = Reading(columns, unit, time_offset, prismatic=prismatic)
    simulated = {"samples": samples, "noise": noise}
    robots = robots or []
    check_sources(robots, bool(data), simulated, vars(reading))
    if data and len(robots) > 1:
        raise BadOption(
            f"--data with {len(robots)} robots: expected one ROBOT or none"
        )
    check_file(output, TABLES, stream=True)
    sources: dict[str, Source] = {}
    for text in data or ():  # logs are read here: a worker cannot say its notes
        # a file may be called log[1].csv: what matches nothing is a name
        for path in sorted(glob.glob(text)) or [text]:  # noqa: PTH207
            robot = robots[0] if robots else None
            sources[path] = measured(robot, selection, path, reading)
    if not data:
        sources = {name: selection.load(name) for name in robots}
    options = {
        "size": size,
        "map": map,
        "rule": rule,
        "epochs": epochs,
        "sigma": sigma,
    }
    grid = {
        name: list(values)
        for name, values in {**options, **simulated}.items()
        if values is not None
    }
    result = run(sources, grid, seeds=seeds, jobs=jobs, progress=progress)
    for trial in result.rows:
        say(trial.notes)
    for trial in result.failed:
        name = f"{trial.source}, {dict(trial.options)}, seed {trial.seed}"
        note(f"error: {name}: {trial.error}")
    if output is not None:
        write_table(output, result.columns())
    failed = len(result.failed)
    summary = f"{len(result.rows)} trainings, {failed} failed"
    if output is not None:
        summary = f"{output}: {summary}"
    document = {
        "output": output,
        "trainings": len(result.rows),
        "failed": failed,
        "units": {"errors": "unit of the row", "seconds": "s"},
        "rows": [
            fields(trial, "source options seed unit errors seconds error")
            for trial in result.rows
        ],
    }
    table = _table(result, list(grid), readout)
    return Outcome(document, [table, summary], code=1 if failed else 0)


def _table(result: Sweep, options: list[str], readout: str) -> TextTable:
    columns = result.columns()
    names = ["source", *options, "seed"]
    rows = []
    for k, trial in enumerate(result.rows):
        factor, shown = for_people(trial.unit or "m")
        values = [columns[f"{readout}_{kind}"][k] for kind in _SHOWN]
        errors = [number(value * factor) for value in values]
        words = [str(columns[name][k]) for name in names]
        rows.append([*words, *errors, shown, number(trial.seconds)])
    header = [*names, "forward", "max", "inverse", "max", "unit", "seconds"]
    title = f"{readout} readout: mean and largest error of the tip"
    return TextTable(header, rows, title, left=len(names))
