"""The command `calib recognise`: which of some models the arm is in."""

from __future__ import annotations

import typer

from calib.common.wording import for_people

from ..measurements import Reading, log_for
from ..options import takes
from ..output import NO, Notes, TextTable, number, show, show_json, tell
from ..usage import argument


@takes(models=argument("MODEL..", "Model files, one for each state of the arm."))
def recognise(
    *,
    models: list[str],
    data: str,
    reading: Reading,
    as_json: bool = False,
) -> None:
    """Tell which of some models the arm is in. Exit code 3 if it is in none."""
    import calib

    loaded = [calib.load(path) for path in models]
    notes = Notes()
    log = log_for(loaded[0], data, reading, notes)
    found = calib.recognise(loaded, log)
    name = None if found.index is None else models[found.index]
    if as_json:
        told = [{"model": models[fit.index], **fit.to_json()} for fit in found.fits]
        show_json({"model": name, "samples": found.samples, "fits": told})
    else:
        factor, unit = for_people(loaded[0].about.unit)
        rows = [
            [models[f.index], number(f.score), number(factor * f.distance), "fits" * f.fits]
            for f in found.fits
        ]
        header = ["model", "score", f"median distance [{unit}]", ""]
        tell(f"{name} fits" if name else "none of the models fits")
        show(TextTable(header, rows, f"{found.samples} samples of {data}"))
    if name is None:
        raise typer.Exit(NO)
