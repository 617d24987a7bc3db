"""The command `calib sweep`."""

from __future__ import annotations

import glob
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from calib.common.choices import MAPS, READOUTS, RULES, ReadoutWord
from calib.common.wording import for_people

from .. import options as opt
from .. import parsing
from ..output import Outcome, TextTable, fields, note, number, progress_bar, say
from ..parsing import TABLES, BadOption, check_file, several, whole
from ..samples import Logged, Selection, check_sources, measured_samples

if TYPE_CHECKING:
    pass


_SHOWN = ("forward_mean", "forward_max", "inverse_mean", "inverse_max")


# values to try, with commas between them
Sizes = Annotated[
    Sequence[int | tuple[int, ...]] | None,
    Option(
        "--size",
        metavar="N|NxN|NxNxN,..",
        parser=several(parsing.lattice_sides),
        help=opt.SIZE,
    ),
]
Maps = Annotated[
    Sequence[str] | None,
    Option(
        "--map", metavar="NAME,..", parser=several(parsing.one_of(MAPS)), help=opt.MAP
    ),
]
Rules = Annotated[
    Sequence[str] | None,
    Option(
        "--rule",
        metavar="batch|online,..",
        parser=several(parsing.one_of(RULES)),
        help="Rules.",
    ),
]
Epochs = Annotated[
    Sequence[int] | None,
    Option("--epochs", metavar="N,..", parser=several(parsing.count), help=opt.EPOCHS),
]
Schedules = Annotated[
    Sequence[parsing.RadiusSchedule] | None,
    Option(
        "--sigma", metavar="START:END,..", parser=several(parsing.sigma), help=opt.SIGMA
    ),
]
Numbers = Annotated[
    Sequence[int] | None,
    Option(
        "--samples",
        "-n",
        metavar="N,..",
        parser=several(parsing.count),
        help=opt.SAMPLES,
    ),
]
Noises = Annotated[
    Sequence[float] | None,
    Option(
        "--noise", metavar="S,..", parser=several(parsing.not_negative), help=opt.NOISE
    ),
]


def sweep(
    robots: Annotated[
        list[str] | None, Argument(metavar="ROBOT...", help="URDFs, names.")
    ] = None,
    data: Annotated[
        list[str] | None,
        Option("--data", metavar="LOG", help="Logs or patterns; repeatable."),
    ] = None,
    output: Annotated[
        str | None,
        Option("--output", "-o", metavar="FILE", help="CSV or Parquet (- stdout)."),
    ] = None,
    size: Sizes = None,
    map: Maps = None,  # noqa: A002
    rule: Rules = None,
    epochs: Epochs = None,
    sigma: Schedules = None,
    samples: Numbers = None,
    noise: Noises = None,
    seeds: Annotated[
        int,
        Option("--seeds", metavar="K", parser=whole(1, 1000), help="Seeds 0 to K - 1."),
    ] = 1,
    jobs: Annotated[
        int | None,
        Option("--jobs", metavar="N", parser=whole(1, 1000), help="Runs at once."),
    ] = None,
    readout: Annotated[
        ReadoutWord,
        opt.word(
            "--readout",
            READOUTS,
            "Of the printed table.",
        ),
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
    as_json: opt.Json = False,
    verbose: opt.Verbose = False,
    quiet: opt.Quiet = False,
) -> Outcome:
    """Train with every combination of options on all cores, and compare the errors.

    A training that fails is reported in one line and gives exit code 1; the others continue.
    """
    selection = Selection(
        joints=joints, tip=tip, planar=planar, lock=lock, ranges=ranges, degrees=degrees
    )
    logged = Logged(
        columns=columns, unit=unit, time_offset=time_offset, prismatic=prismatic
    )
    from calib.samples.tables import write_table
    from calib.sweeps import sweep as run

    grid = {
        "size": size,
        "map": map,
        "rule": rule,
        "epochs": epochs,
        "sigma": sigma,
        "samples": samples,
        "noise": noise,
    }
    tried = {name: list(values) for name, values in grid.items() if values is not None}
    simulated = {name: tried.get(name) for name in ("samples", "noise")}
    check_sources(robots or (), bool(data), simulated, vars(logged))
    if data and len(robots or ()) > 1:
        raise BadOption(
            f"--data with {len(robots or ())} robots: expected one ROBOT or none"
        )
    check_file(output, TABLES, stream=True)
    robot = robots[0] if robots else None
    # a file may be called log[1].csv: what matches nothing is a name
    logs = [path for text in data or () for path in sorted(glob.glob(text)) or [text]]  # noqa: PTH207
    sources: dict[str, Any] = (
        {  # logs are read here: a worker cannot say what was assumed of one
            path: measured_samples(robot, selection, path, logged) for path in logs
        }
        or {name: selection.load(name) for name in robots or ()}
    )
    with progress_bar() as progress:
        runs = run(sources, tried, seeds=seeds, jobs=jobs, progress=progress)
    for row in runs.rows:
        say(row.notes)
    for row in runs.failed:
        note(f"error: {row.source}, {dict(row.options)}, seed {row.seed}: {row.error}")
    table_of_runs = runs.columns()
    failed = len(runs.failed)
    if output is not None:
        write_table(output, table_of_runs)
    header = [
        "source",
        *tried,
        "seed",
        "forward",
        "max",
        "inverse",
        "max",
        "unit",
        "seconds",
    ]
    cells = []
    for k, row in enumerate(runs.rows):
        factor, shown = for_people(row.unit or "m")
        errors = [
            number(table_of_runs[f"{readout}_{kind}"][k] * factor) for kind in _SHOWN
        ]
        options = [str(table_of_runs[name][k]) for name in ("source", *tried, "seed")]
        cells.append([*options, *errors, shown, number(row.seconds)])
    title = f"{readout} readout: mean and largest error of the tip"
    summary = (
        f"{f'{output}: ' if output else ''}{len(runs.rows)} trainings, {failed} failed"
    )
    document = {
        "output": output,
        "trainings": len(runs.rows),
        "failed": failed,
        "units": {"errors": "unit of the row", "seconds": "s"},
        "rows": [
            fields(r, "source options seed unit errors seconds error")
            for r in runs.rows
        ],
    }
    table = TextTable(header, cells, title, left=2 + len(tried))
    return Outcome(document, [table, summary], code=1 if failed else 0)
