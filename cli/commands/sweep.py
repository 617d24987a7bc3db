"""The command `calib sweep`: train with every combination of options, on all cores."""

from __future__ import annotations

import glob
from typing import Annotated, Any

from typer import Argument, Option

from calib.common.choices import MAPS, RULES, ReadoutWord
from calib.common.wording import for_people

from .. import options as opt
from .. import parsing
from ..options import Text, option
from ..output import Outcome, TextTable, fields, note, number, progress_bar, say
from ..parsing import TABLES, BadOption, check_file, several
from ..samples import Logged, Selection, check_sources, measured_samples

_SHOWN = ("forward_mean", "forward_max", "inverse_mean", "inverse_max")


def _grid(usage: str, text: str, read: parsing.Reader[Any]) -> Any:
    return option(f"{usage},..", text, several(read))


def sweep(
    robots: Annotated[list[str] | None, Argument(metavar="ROBOT...", help="URDFs, names.")] = None,
    *,
    data: Annotated[list[str] | None, option("--data LOG", "Logs or patterns; repeatable.")] = None,
    output: Annotated[Text, option("--output -o FILE", "CSV or Parquet (- stdout).")] = None,
    size: Annotated[Any, _grid("--size N|NxN|NxNxN", opt.SIZE, parsing.size)] = None,
    map: Annotated[Any, _grid("--map NAME", opt.MAP, parsing.one_of(MAPS))] = None,  # noqa: A002
    rule: Annotated[Any, _grid("--rule batch|online", "Rules.", parsing.one_of(RULES))] = None,
    epochs: Annotated[Any, _grid("--epochs N", opt.EPOCHS, parsing.count)] = None,
    sigma: Annotated[Any, _grid("--sigma START:END", opt.SIGMA, parsing.sigma)] = None,
    samples: Annotated[Any, _grid("--samples -n N", opt.BABBLED, parsing.count)] = None,
    noise: Annotated[Any, _grid("--noise S", opt.NOISE, parsing.not_negative)] = None,
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

    typed = {"size": size, "map": map, "rule": rule, "epochs": epochs, "sigma": sigma}
    typed |= {"samples": samples, "noise": noise}
    tried = {name: list(values) for name, values in typed.items() if values is not None}
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
    with progress_bar(logged.unit or "m") as progress:
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
        errors = [columns[f"{readout}_{kind}"][k] * factor for kind in _SHOWN]
        options = [str(columns[name][k]) for name in ("source", *tried, "seed")]
        cells.append([*options, *(number(e) for e in errors), unit, number(row.seconds)])
    title = f"{readout} readout: mean and largest error of the tip"
    told = f"{f'{output}: ' if output else ''}{len(found.rows)} trainings, {failed} failed"
    lines: list[str | TextTable] = [TextTable(header, cells, title, left=2 + len(tried)), told]
    document = {
        "output": output,
        "trainings": len(found.rows),
        "failed": failed,
        "units": {"errors": "unit of the row", "seconds": "s"},
        "rows": [fields(r, "source options seed unit errors seconds error") for r in found.rows],
    }
    return Outcome(document, lines, code=1 if failed else 0)
