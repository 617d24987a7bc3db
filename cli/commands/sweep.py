"""The command `calib sweep`."""

from __future__ import annotations

import glob
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from calib.common.choices import MAPS, READOUTS, RULES

from .. import options as o
from .. import parsing
from ..comparison import document, failures, summary, tables
from ..output import Notes, note, progress_bar, show, show_json, tell
from ..parsing import Values, several
from ..samples import Selection, check_sources, measured
from ..usage import BadOption, argument, choice, one_document, option

if TYPE_CHECKING:
    from calib import Samples
    from calib.arm.arm import Arm

BACKENDS = ("loky", "threading", "dask", "ray")
_MOST_SEEDS = 1000


def sweep(
    robots: Annotated[
        list[str] | None,
        argument(
            "ROBOT...", "URDF files or bundled robots (calib robots). Not needed with --data."
        ),
    ] = None,
    data: Annotated[
        list[str] | None,
        option(
            "--data LOG",
            "A measured log, or several by a quoted pattern such as 'logs/*.csv'; repeatable.",
        ),
    ] = None,
    output: Annotated[
        str | None,
        option(
            "--output -o FILE",
            "A row for each training, as CSV, or Parquet by its name (- for standard output).",
        ),
    ] = None,
    size: Annotated[
        Values | None, option("--size N,NxN,..", "Nodes of both maps.", several(parsing.size))
    ] = None,
    map_: Annotated[
        Values | None,
        option(
            "--map A,B,..",
            f"Kinds of map, of {', '.join(MAPS)}.",
            several(parsing.kind_of_map(MAPS)),
        ),
    ] = None,
    rule: Annotated[
        Values | None,
        option(
            "--rule A,B", f"Training rules, of {', '.join(RULES)}.", several(parsing.one_of(RULES))
        ),
    ] = None,
    epochs: Annotated[
        Values | None,
        option(
            "--epochs N,N,..",
            "Passes over the samples; the full lattice alone is trained then.",
            several(parsing.whole(1)),
        ),
    ] = None,
    sigma: Annotated[
        Values | None,
        option(
            "--sigma START:END,..",
            "Neighbourhood radii at the start and the end [nodes]; the full lattice alone "
            "is trained then.",
            several(parsing.sigma),
        ),
    ] = None,
    samples: Annotated[
        Values | None,
        option(
            "--samples -n N,N,..",
            "How many samples to babble (default 20000).",
            several(parsing.whole(1)),
        ),
    ] = None,
    noise: Annotated[
        Values | None,
        option(
            "--noise S,S,..",
            "Standard deviations of the simulated sensor along each axis [m] (default 0).",
            several(parsing.at_least_zero("m")),
        ),
    ] = None,
    seeds: Annotated[
        int,
        option(
            "--seeds K",
            "Train each combination this many times, with the seeds 0, 1, 2 and so on.",
            parsing.whole(1, _MOST_SEEDS),
        ),
    ] = 1,
    jobs: Annotated[
        int | None,
        option(
            "--jobs N",
            "How many trainings at the same time (default all cores).",
            parsing.whole(1, 10_000),
        ),
    ] = None,
    backend: Annotated[
        str,
        choice(
            "--backend",
            BACKENDS,
            "Run the trainings in processes or threads of this machine, or on a Dask or Ray "
            "cluster.",
        ),
    ] = "loky",
    readout: Annotated[
        Values | None,
        option(
            "--readout A,B,..",
            "Readouts to print a table for (default all); files and JSON hold them all.",
            several(parsing.one_of(READOUTS)),
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

    one_document(output, as_json)
    simulated = {"--samples": samples, "--noise": noise}
    of_logs = {"--columns": columns, "--unit": unit, "--prismatic": prismatic}
    check_sources(robots or (), bool(data), simulated, of_logs)
    _check_lists(robots or (), data or ())
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


def _check_lists(robots: Sequence[str], data: Sequence[str]) -> None:
    """Refuse lists of robots and logs that do not go together."""
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
        several_meant = glob.has_magic(text) and not Path(text).exists()
        matches = sorted(glob.glob(text, recursive=True)) if several_meant else [text]  # noqa: PTH207
        if not matches:
            raise BadOption(f"--data {text!r}: expected logs, but no file matches")
        found.update(dict.fromkeys(matches))
    return list(found)
