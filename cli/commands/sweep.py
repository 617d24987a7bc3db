"""The command `calib sweep`."""

from __future__ import annotations

import glob
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from calib.common.choices import MAPS, READOUTS, RULES

from .. import options as o
from .. import parsing
from ..comparison import document, failures, summary, tables
from ..output import Notes, note, show, show_json, tell
from ..parsing import BadOption, Values, several
from ..progress import progress_bar
from ..samples import Selection, measured

if TYPE_CHECKING:
    from calib import Samples
    from calib.arm.arm import Arm

BACKENDS = ("loky", "threading", "dask", "ray")
_MOST_SEEDS = 1000


def sweep(
    robots: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="ROBOT...",
            help="URDF files or bundled robots (calib robots). Optional with --data.",
        ),
    ] = None,
    data: Annotated[
        list[str] | None,
        typer.Option(
            "--data",
            metavar="LOG",
            help="A measured log, or several by a quoted pattern such as 'logs/*.csv'; repeatable.",
        ),
    ] = None,
    output: Annotated[
        str | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="A row for each training, as CSV, or Parquet by its name (- for standard output).",
        ),
    ] = None,
    size: Annotated[
        Values | None,
        typer.Option(
            "--size",
            parser=several("--size", parsing.size("--size")),
            metavar="N,NxN,..",
            help="Nodes of both maps.",
        ),
    ] = None,
    map_: Annotated[
        Values | None,
        typer.Option(
            "--map",
            parser=several("--map", parsing.kind_of_map(MAPS)),
            metavar="A,B,..",
            help=f"Kinds of map, of {', '.join(MAPS)}.",
        ),
    ] = None,
    rule: Annotated[
        Values | None,
        typer.Option(
            "--rule",
            parser=several("--rule", parsing.one_of("--rule", RULES)),
            metavar="A,B",
            help=f"Training rules, of {', '.join(RULES)}.",
        ),
    ] = None,
    epochs: Annotated[
        Values | None,
        typer.Option(
            "--epochs",
            parser=several("--epochs", parsing.whole("--epochs", 1)),
            metavar="N,N,..",
            help="Passes over the samples; the full lattice alone is trained then.",
        ),
    ] = None,
    sigma: Annotated[
        Values | None,
        typer.Option(
            "--sigma",
            parser=several("--sigma", parsing.sigma),
            metavar="START:END,..",
            help="Neighbourhood radii at the start and the end [nodes]; the full lattice alone "
            "is trained then.",
        ),
    ] = None,
    samples: Annotated[
        Values | None,
        typer.Option(
            "--samples",
            "-n",
            parser=several("--samples", parsing.whole("--samples", 1)),
            metavar="N,N,..",
            help="How many samples to babble (default 20000).",
        ),
    ] = None,
    noise: Annotated[
        Values | None,
        typer.Option(
            "--noise",
            parser=several("--noise", parsing.at_least_zero("--noise", "m")),
            metavar="S,S,..",
            help="Standard deviations of the simulated sensor along each axis [m] (default 0).",
        ),
    ] = None,
    seeds: Annotated[
        int,
        typer.Option(
            "--seeds",
            parser=parsing.whole("--seeds", 1, _MOST_SEEDS),
            metavar="K",
            help="Train each combination this many times, with the seeds 0, 1, 2 and so on.",
        ),
    ] = 1,
    jobs: Annotated[
        int | None,
        typer.Option(
            "--jobs",
            parser=parsing.whole("--jobs", 1, 10_000),
            metavar="N",
            help="How many trainings at the same time (default all cores).",
        ),
    ] = None,
    backend: Annotated[
        str,
        typer.Option(
            "--backend",
            parser=parsing.one_of("--backend", BACKENDS),
            metavar="|".join(BACKENDS),
            help="Run the trainings in processes or threads of this machine, or on a Dask or Ray "
            "cluster.",
        ),
    ] = "loky",
    readout: Annotated[
        Values | None,
        typer.Option(
            "--readout",
            parser=several("--readout", parsing.one_of("--readout", READOUTS)),
            metavar="A,B,..",
            help="Readouts to print a table for (default all); files and JSON hold them all.",
        ),
    ] = None,
    joints: o.JointsOption = None,
    tip: o.TipOption = None,
    lock: o.LockOption = None,
    ranges: o.RangeOption = None,
    columns: o.ColumnsOption = None,
    unit: o.UnitOption = None,
    prismatic: o.PrismaticOption = None,
    degrees: o.DegreesOption = False,
    as_json: o.JsonOption = False,
) -> None:
    """Train with every combination of options on all cores, and compare the errors.

    A training that fails is reported in one line and gives exit code 1; the others continue.
    """
    from calib.common.atomic import check_writable
    from calib.samples.tables import write_table
    from calib.sweeps.sweep import sweep as run

    if as_json and output == "-":
        raise BadOption("--json and --output '-' both want standard output: expected one of them")
    simulated = {"--samples": samples, "--noise": noise}
    of_logs = {"--columns": columns, "--unit": unit, "--prismatic": prismatic}
    _check_sources(robots or (), data, simulated, of_logs)
    if output not in (None, "-"):
        check_writable(str(output))
    notes = Notes()

    def selection(robot: str | None) -> Selection:
        return Selection(robot, joints, tip, lock or (), ranges or (), degrees)

    sources: dict[str, Callable[[], Arm | Samples]] = {}
    if data is None:
        sources = {name: partial(_arm, selection(name), notes) for name in robots or ()}
    else:
        robot = robots[0] if robots else None
        for path in _logs(data):
            sources[path] = partial(
                measured,
                selection(robot),
                path,
                columns=columns,
                unit=unit or "m",
                prismatic=prismatic or (),
                seed=0,
                notes=notes,
            )
    typed: dict[str, Sequence[Any] | None] = {
        "size": size and [each.plain() for each in size],
        "map": map_,
        "rule": rule,
        "epochs": epochs,
        "sigma": sigma,
        "samples": samples,
        "noise": noise,
    }
    grid = {name: list(values) for name, values in typed.items() if values is not None}
    with progress_bar(unit or "m") as progress:
        found = run(sources, grid, seeds=seeds, jobs=jobs, backend=backend, progress=progress)
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
        for table in tables(found, readout or READOUTS):
            show(table)
        tell(summary(found, output))
    if found.failed:
        raise typer.Exit(1)


def _arm(selection: Selection, notes: Notes) -> Arm:
    arm = selection.load()
    notes.say(arm.notes)
    return arm


def _check_sources(
    robots: Sequence[str],
    data: Sequence[str] | None,
    simulated: Mapping[str, object],
    of_logs: Mapping[str, object],
) -> None:
    """Refuse options that would be without effect."""
    if not robots and not data:
        raise BadOption("no source to learn from: expected ROBOT, --data LOG, or both")
    if data and len(robots) > 1:
        raise BadOption(
            f"--data with {len(robots)} robots: expected one ROBOT or none; repeat --data for "
            "each log, or quote a pattern such as 'logs/*.csv'"
        )
    if data and "-" in data:
        raise BadOption("--data '-': expected files, standard input holds one log")
    for name in robots:
        if robots.count(name) > 1:
            raise BadOption(f"ROBOT {name!r} is given twice: expected each once")
    for options, wrong, remedy in (
        (simulated, bool(data), "applies to simulated babbling, which --data replaces"),
        (of_logs, not data, "applies to a log: expected --data LOG too"),
    ):
        for name, value in options.items():
            if wrong and value is not None:
                raise BadOption(f"{name} {remedy}")
    if robots and of_logs["--prismatic"] is not None:
        raise BadOption("--prismatic applies to a log without ROBOT; ROBOT defines its joints")


def _logs(typed: Sequence[str]) -> list[str]:
    """Return the logs that are meant, each once; a name with wildcards stands for several."""
    found: dict[str, None] = {}
    for text in typed:
        several_meant = glob.has_magic(text) and not Path(text).exists()
        matches = sorted(glob.glob(text, recursive=True)) if several_meant else [text]  # noqa: PTH207
        if not matches:
            raise BadOption(f"--data {text!r}: expected logs, but no file matches")
        found.update(dict.fromkeys(matches))
    return list(found)
