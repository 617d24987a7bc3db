"""The command `calib recognise`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from typer import Argument

from calib.common.wording import for_people

from .. import options as opt
from ..output import NO, Outcome, TextTable, number
from ..samples import Compared, log_for

if TYPE_CHECKING:
    pass


def recognise(
    models: Annotated[
        list[str], Argument(metavar="MODEL..", help="One a state of the arm.")
    ],
    data: opt.NewLog,
    columns: opt.Columns = None,
    unit: opt.Unit = None,
    time_offset: opt.TimeOffset = None,
    degrees: opt.LogDegrees = None,
    as_json: opt.Json = False,
    verbose: opt.Verbose = False,
    quiet: opt.Quiet = False,
) -> Outcome:
    """Tell which of some models the arm is in. Exit code 3 if it is in none."""
    reading = Compared(
        columns=columns, unit=unit, time_offset=time_offset, degrees=degrees
    )
    import calib

    loaded = [calib.load(path) for path in models]
    log = log_for(loaded[0], data, reading)
    found = calib.recognise(loaded, log)
    name = None if found.index is None else models[found.index]
    fits = [{"model": models[fit.index], **fit.to_json()} for fit in found.fits]
    factor, shown = for_people(loaded[0].about.unit)
    rows = [
        [models[f.index], number(f.score), number(factor * f.distance), "fits" * f.fits]
        for f in found.fits
    ]
    header = ["model", "score", f"median distance [{shown}]", ""]
    table = TextTable(header, rows, f"{found.samples} samples of {data}")
    return Outcome(
        {"model": name, "samples": found.samples, "fits": fits},
        [f"{name} fits" if name else "none of the models fits", table],
        code=0 if name else NO,
    )
