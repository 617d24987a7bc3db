"""The command `calib sweep`: train with every combination of options, on all cores."""

from __future__ import annotations

import glob
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from calib.common.choices import READOUTS, RULES, Backend

from .. import options as opt
from .. import parsing
from ..comparison import count_line, document, failures, sweep_tables
from ..files import TABLES, check_output
from ..options import option
from ..output import Outcome, note, progress_bar, say
from ..parsing import BadOption, several
from ..samples import Logged, Selection, check_sources, measured_samples

if TYPE_CHECKING:
    from calib import Samples
    from calib.arm.arm import Arm


def _grid(usage: str, text: str, read: parsing.Reader[Any]) -> Any:
    """Declare an option of several values to try, with commas between them."""
    return option(f"{usage},..", text, several(read))


def sweep(
    robots: Annotated[
        list[str] | None, Argument(metavar="ROBOT...", help="URDF files or bundled robots.")
    ] = None,
    *,
    data: Annotated[
        list[str] | None, option("--data LOG", "A log or a quoted pattern; repeatable.")
    ] = None,
    output: Annotated[
        str | None, option("--output -o FILE", "A row a training: CSV or Parquet (- stdout).")
    ] = None,
    size: Annotated[Any, _grid("--size N|NxN|NxNxN", opt.SIZE, parsing.size)] = None,
    map: Annotated[Any, _grid("--map KIND", opt.MAP, parsing.kind_of_map)] = None,  # noqa: A002
    rule: Annotated[Any, _grid("--rule batch|online", "Rules.", parsing.one_of(RULES))] = None,
    epochs: Annotated[Any, _grid("--epochs N", opt.EPOCHS, parsing.count)] = None,
    sigma: Annotated[Any, _grid("--sigma START:END", opt.SIGMA, parsing.sigma)] = None,
    samples: Annotated[Any, _grid("--samples -n N", opt.SAMPLES, parsing.count)] = None,
    noise: Annotated[Any, _grid("--noise S", opt.NOISE, parsing.not_negative)] = None,
    seeds: Annotated[
        int, Option(metavar="K", min=1, max=1000, help="Trainings of each, with seeds 0 to K - 1.")
    ] = 1,
    jobs: Annotated[
        int | None,
        Option(metavar="N", min=1, max=10_000, help="Trainings at a time (default all cores)."),
    ] = None,
    backend: Annotated[
        Backend, Option(help="Processes or threads of this machine, or a Dask or Ray cluster.")
    ] = "loky",
    readout: Annotated[
        Any, _grid("--readout A", "Readouts to print (default best).", parsing.one_of(READOUTS))
    ] = None,
    joints: opt.Joints = None,
    tip: opt.Tip = None,
    planar: opt.Planar = False,
    lock: opt.Lock = None,
    ranges: opt.Ranges = None,
    degrees: opt.Degrees = False,
    columns: opt.Columns = None,
    unit: opt.Unit = None,
    prismatic: opt.Prismatic = None,
) -> Outcome:
    """Train with every combination of options on all cores, and compare the errors.

    A training that fails is reported in one line and gives exit code 1; the others continue.
    """
    from calib.samples.tables import write_table
    from calib.sweeps.sweep import sweep as run

    typed = {"size": size, "map": map, "rule": rule, "epochs": epochs, "sigma": sigma}
    typed |= {"samples": samples, "noise": noise}
    tried = {name: list(values) for name, values in typed.items() if values is not None}
    # one unit for all: errors of logs in mm and m would stand in one column
    logged, selection = (
        Logged(columns, unit, prismatic),
        Selection(joints, tip, planar, lock, ranges, degrees),
    )
    simulated = {name: tried.get(name) for name in ("samples", "noise")}
    check_sources(robots or (), bool(data), simulated, vars(logged))
    _check_lists(robots or (), data or ())
    check_output(output, TABLES, stream=True)
    sources: dict[str, Callable[[], Arm | Samples]] = {
        name: partial(_arm, name, selection) for name in robots or ()
    }
    unit = unit or "m"
    if data is not None:
        robot, logged = robots[0] if robots else None, Logged(columns, unit, prismatic)
        read = partial(measured_samples, robot, selection, logged=logged)
        sources = {path: partial(read, path) for path in _logs(data)}
    with progress_bar(unit) as progress:
        found = run(sources, tried, seeds=seeds, jobs=jobs, backend=backend, progress=progress)
    say(found.notes)
    for row in found.rows:
        say(row.notes)
    for line in failures(found):
        note(line)
    if output is not None:
        write_table(output, found.columns())
    tables = sweep_tables(found, readout or READOUTS)
    first = len(tables) if readout else 1
    return Outcome(
        document(found, output),
        [] if output == "-" else [*tables[:first], count_line(found, output)],
        [] if output == "-" else tables[first:],
        code=1 if found.failed else 0,
    )


def _arm(robot: str, selection: Selection) -> Arm:
    arm = selection.load(robot)
    say(arm.notes)
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
