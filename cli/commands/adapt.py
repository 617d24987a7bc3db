"""The command `calib adapt`: re-calibrate a model from a few new samples."""

from __future__ import annotations

from pathlib import Path

import typer

from calib.common.choices import METHODS
from calib.common.wording import for_people

from ..measurements import Reading, log_for
from ..options import NEW_LOG, takes
from ..output import NO, Notes, TextTable, fields, note, number, progress_bar, show, show_json, tell
from ..photo import photo_of_log
from ..translation import as_typed
from ..units import units_of
from ..usage import check_file, choice, option


@takes(
    output=option("--output -o MODEL", "The new file (default MODEL.adapted.calib)."),
    method=choice(
        "--method",
        METHODS,
        "few-shot updates the body from a few rows; online applies the paper's rule to "
        "thousands of rows.",
    ),
    **NEW_LOG,
)
def adapt(
    *,
    model: str,
    data: str,
    output: str | None = None,
    method: str = "few-shot",
    cause: str | None = None,
    reading: Reading,
    as_json: bool = False,
) -> None:
    """Re-calibrate a model from a few new samples. Exit code 3 if it does not improve."""
    import calib

    if output is not None:
        check_file(output)
    loaded = calib.load(model)
    path = output or adapted_name(model)
    check_file(path)  # before the work whose result would be lost
    notes = Notes()
    log = log_for(loaded, data, reading, notes)
    with progress_bar(loaded.about.unit) as progress:
        found = calib.adapt(loaded, log, method=method, cause=cause, progress=progress)
    notes.say(found.notes)
    if found.improved:
        adapted = photo_of_log(found.model, log, data, notes)
        adapted.save(path)
    if as_json:
        show_json(
            {
                "model": path if found.improved else None,
                **fields(found, "improved samples outliers correction kept coverage everywhere"),
                **fields(found, "before after"),
                "method": method,
                "changed": [change.to_json() for change in found.changed],
                "notes": [as_typed(text) for text in found.notes],
                "unit": found.model.about.unit,
                "units": units_of(found.model.about),
            }
        )
    else:
        factor, name = for_people(found.model.about.unit)
        rows = [
            [when, *(number(factor * error[key]) for key in ("mean", "p99", "max"))]
            for when, error in (("before", found.before), ("after", found.after))
        ]
        title = f"distance to held-out rows [{name}], corrected: {found.correction}"
        show(TextTable(["", "mean", "p99", "max"], rows, title))
        for change in found.changed:
            if change.cause == "unknown":  # a note told it
                continue
            tell(f"changed: {as_typed(change.words)}")
        if found.kept:
            tell(f"left as it was: {', '.join(found.kept)}")
        tell(f"the log measured {100 * found.coverage:.0f} % of the learned range")
    if not found.improved:
        note(f"no improvement: {model} was left unchanged and nothing was written")
        raise typer.Exit(NO)
    if not as_json:
        tell(f"{path}: adapted with {found.samples} samples")


def adapted_name(model: str) -> str:
    """Return the file beside a model that its adaptation is written to.

    Examples
    --------
    >>> adapted_name("m.calib"), adapted_name("m.adapted.calib")
    ('m.adapted.calib', 'm.adapted.calib')
    """
    path = Path(model)
    stem = path.name.removesuffix(".calib").removesuffix(".adapted")
    return str(path.with_name(f"{stem}.adapted.calib"))
