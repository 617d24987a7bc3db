"""The command `calib evaluate`: print the errors of a model, on fresh samples or on a log."""

from __future__ import annotations

import time

from ..measurements import Reading, log_of
from ..options import takes
from ..output import Notes, fields, show, show_json
from ..summary import error_table, summary


@takes()
def evaluate(
    *,
    model: str,
    data: str | None = None,
    reading: Reading,
    as_json: bool = False,
) -> None:
    """Print the errors of a model, on fresh samples or on a log."""
    import calib

    loaded = calib.load(model)
    log = log_of(loaded, data, reading, Notes())
    started = time.perf_counter()
    result = calib.evaluate(loaded, log)
    seconds = {"total": time.perf_counter() - started}
    notes = Notes()
    notes.say(result.notes)
    if result.left_out:
        notes.say([f"{result.left_out} rows are left out: wrong, or outside of what was learned"])
    if as_json:
        document = summary(loaded, model, result.errors, seconds)
        show_json({**document, "evaluated": fields(result, "source rows left_out")})
        return
    title = f"{model}: errors on {result.rows} rows ({result.source})"
    show(error_table(loaded, result.errors, title))
