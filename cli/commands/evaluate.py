"""The command `calib evaluate`: print the errors of a model, on fresh samples or on a log."""

from __future__ import annotations

import time

from .. import options as opt
from ..advice import advice
from ..measurements import Reading, log_of
from ..output import Outcome, fields, say
from ..summary import accuracy, answers_back, error_table, summary


def evaluate(
    model: opt.ModelFile,
    *,
    data: opt.Data = None,
    columns: opt.Columns = None,
    unit: opt.Unit = None,
    degrees: opt.LogDegrees = None,
) -> Outcome:
    """Print the errors of a model, on fresh samples or on a log."""
    import calib

    loaded = calib.load(model)
    log = log_of(loaded, data, Reading(columns, unit, degrees))
    started = time.perf_counter()
    result = calib.evaluate(loaded, log)
    say(result.notes)
    seconds = {"total": time.perf_counter() - started}
    document = summary(loaded, model, result.errors, seconds)
    document["evaluated"] = fields(result, "source rows left_out")
    rows = f"{result.rows} {result.source}"
    lines = [
        f"{model}: {accuracy(loaded, result.errors, result.within, rows, result.left_out)}",
        answers_back(loaded, result.errors),
        *advice(loaded, result.errors),
    ]
    title = f"errors on {rows}"
    return Outcome(document, lines, [error_table(loaded, result.errors, title)])
