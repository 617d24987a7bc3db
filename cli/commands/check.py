"""The command `calib check`."""

from __future__ import annotations

from typing import Annotated

import typer

from .. import options as o
from ..measurements import log_for
from ..output import Notes, Table, number, show, show_json, tell
from ..units import for_people

NO = 3


def check(
    model: o.ModelArgument,
    data: Annotated[
        str,
        typer.Option(
            "--data",
            metavar="LOG",
            help="New samples: CSV or Parquet with the joints' columns and x, y.",
        ),
    ],
    columns: o.ColumnsOption = None,
    unit: o.UnitOption = None,
    degrees: o.DegreesOption = False,
    as_json: o.JsonOption = False,
) -> None:
    """Is the model still calibrated? Compare it with new samples; exit code 3 if not."""
    import calib

    loaded = calib.load(model)
    notes = Notes()
    log = log_for(loaded, data, columns, degrees, unit, notes)
    drift = loaded.check(log)
    notes.say(drift.notes)
    if as_json:
        show_json({"model": model, **drift.to_json(), "unit": loaded.about.unit})
    else:
        factor, name = for_people(loaded.about.unit)
        rows = []
        for signal, what in (
            ("motor", "motor map, zeta"),
            ("sensory", "sensory map, zeta"),
            ("reverse", "reverse distortion"),
            ("links", "links' residual"),
        ):
            found = drift.distortion[signal]
            size, of = (factor, name) if signal == "links" else (1e6, "1e-6")
            rows.append(
                [
                    what,
                    of,
                    number(size * found.value),
                    number(size * found.threshold),
                    "fired" if found.score > 1.0 else "",
                ]
            )
        title = f"{model}: {drift.samples} samples of {data}"
        show(Table(["signal", "unit", "found", "threshold", ""], rows, title, left=2))
        for text in drift.explanations:
            tell(text)
        verdict = "DRIFTED: calib adapt re-calibrates it" if drift.drifted else "still calibrated"
        tell(f"{verdict} (score {number(drift.score)}, threshold 1)")
    if drift.drifted:
        raise typer.Exit(NO)
