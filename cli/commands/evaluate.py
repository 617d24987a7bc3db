"""The command `calib evaluate`: print the errors of a model, on fresh samples or on a log."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Annotated, Literal

from .. import options as opt
from ..measurements import Reading, log_of
from ..output import Outcome, TextTable, fields, say
from ..samples import Sockets
from ..summary import accuracy, advice, answers_back, does_not_hold, error_table, summary

if TYPE_CHECKING:
    from calib import Evaluation


def evaluate(
    model: opt.ModelFile,
    *,
    data: opt.Data = None,
    reading: Reading,
    sockets: Sockets,
    frame: Annotated[
        Literal["kept", "free"],
        opt.flag("--frame", "free: of the log, the sensor's frame is found anew."),
    ] = "kept",
) -> Outcome:
    """Print the errors of a model, on fresh samples or on a log."""
    import calib

    loaded = calib.load(model)
    log = log_of(loaded, data, reading)
    if log is not None:
        log = sockets.of(log)
    started = time.perf_counter()
    result = calib.evaluate(loaded, log, frame=frame)
    say(result.notes)
    seconds = {"total": time.perf_counter() - started}
    document = summary(loaded, model, result.errors, seconds)
    document["evaluated"] = fields(result, "source rows left_out")
    document["left_out"] = result.left_out
    missed = [] if log is None else does_not_hold(result.within, result.rows)
    limit = missed or advice(loaded, result.errors)
    if result.touch:
        document["touch"] = result.touch
        rows = [
            [each["setup"], each["point"], str(each["rows"]), f"{1e3 * each['scatter']:.3f}"]
            for each in result.touch["points"]
        ]
        table = TextTable(["setup", "point", "rows", "scatter [mm]"], rows, "by socket", 2)
        return Outcome(document, [_scatter(model, result), *limit], [table])
    tested = f"{result.rows} {result.source}"
    lines = [
        f"{model}: {accuracy(loaded, result.errors, result.within, tested, result.left_out)}",
        answers_back(loaded, result.errors),
        *limit,
    ]
    title = f"errors on {tested}"
    return Outcome(document, lines, [error_table(loaded, result.errors, title)])


def _scatter(model: str, result: Evaluation) -> str:
    size = {name: 1e3 * value for name, value in result.touch["scatter"].items()}
    line = (
        f"{model}: tips scatter about their sockets by {size['mean']:.3g} mm (95 % within "
        f"{size['p95']:.3g}, largest {size['max']:.3g}) in {result.rows} touches"
    )
    if result.left_out:
        line += f", {result.left_out} left out (in no socket of theirs, or out of range)"
    off = [abs(each["predicted"] - each["stated"]) for each in result.touch["distances"]]
    return line + (f"; distances are off by {1e3 * sum(off) / len(off):.2g} mm" if off else "")
