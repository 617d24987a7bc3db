"""The command `calib evaluate`."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Annotated, Literal, get_args

from typer import Option

from .. import options as opt
from ..output import Outcome, fields, say, sized
from ..parsing import BadOption
from ..samples import Compared, Sockets, log_of
from ..summary import (
    accuracy,
    advice,
    answers_back,
    does_not_hold,
    error_table,
    summary,
)

if TYPE_CHECKING:
    from calib import Evaluation, Model, Samples
    from calib.use.iso9283 import Iso9283


FrameWord = Literal["kept", "free"]
FRAMES = get_args(FrameWord)


def evaluate(
    model: opt.ModelFile,
    data: opt.Data = None,
    columns: opt.Columns = None,
    unit: opt.Unit = None,
    time_offset: opt.TimeOffset = None,
    degrees: opt.LogDegrees = None,
    distance: opt.Distances = None,
    plane: opt.Planes = None,
    frame: Annotated[
        FrameWord,
        opt.word("--frame", FRAMES, "free: the sensor's frame is found anew."),
    ] = "kept",
    iso: Annotated[
        bool, Option("--iso9283", help="Accuracy and repeatability of poses, too.")
    ] = False,
    as_json: opt.Json = False,
    verbose: opt.Verbose = False,
    quiet: opt.Quiet = False,
) -> Outcome:
    """Print the errors of a model, on fresh samples or on a log."""
    reading = Compared(
        columns=columns, unit=unit, time_offset=time_offset, degrees=degrees
    )
    sockets = Sockets(distance=distance, plane=plane)
    import calib

    loaded = calib.load(model)
    log = log_of(loaded, data, reading)
    log = None if log is None else sockets.of(log)
    started = time.perf_counter()
    result = calib.evaluate(loaded, log, frame=frame)
    say(result.notes)
    seconds = {"total": time.perf_counter() - started}
    document = summary(loaded, model, result.errors, seconds)
    document["evaluated"] = fields(result, "source rows left_out")
    document["left_out"] = result.left_out
    document["learned"] = result.learned
    document["bound_holds"] = result.bound_holds
    standard = _iso9283(loaded, log) if iso else None
    if standard is not None:
        document["iso9283"] = standard.to_json()
        say(standard.notes)
    missed = [] if log is None else does_not_hold(result.within, result.rows)
    limit = missed or advice(loaded, result.errors)
    if result.touch:
        document["touch"] = result.touch
        return Outcome(document, [f"{model}: {_scatter(result)}", *limit])
    tested = f"{result.rows} {result.source}"
    lines = [
        f"{model}: {accuracy(loaded, result.errors, result.within, tested, result.left_out)}",
        answers_back(loaded, result.errors),
        *limit,
    ]
    if standard is not None:
        lines.append(_standard_line(standard))
    return Outcome(
        document, lines, [error_table(loaded, result.errors, f"errors on {tested}")]
    )


def _iso9283(model: Model, log: Samples | None) -> Iso9283:
    """Return the figures of ISO 9283 of a log that went to poses again."""
    from calib.use.iso9283 import iso9283

    if log is None:
        raise BadOption(
            "--iso9283 is of a log with repeated poses: expected --data LOG too"
        )
    return iso9283(model, log)


def _standard_line(standard: Iso9283) -> str:
    unit = standard.unit
    line = f"ISO 9283: RP {sized(standard.repeatability, unit)}, AP "
    if standard.delivered is not None:
        line += f"{sized(standard.delivered, unit)} as delivered, "
    line += f"{sized(standard.corrected, unit)} as corrected"
    return f"{line} (worst of {len(standard.poses)} poses)"


def _scatter(result: Evaluation) -> str:
    size = {name: sized(value, "m") for name, value in result.touch["scatter"].items()}
    line = (
        f"tips scatter about their sockets by {size['mean']}, 95 % within {size['p95']}"
    )
    line += f", in {result.rows} touches, {result.left_out} left out"
    off = [abs(gap["predicted"] - gap["stated"]) for gap in result.touch["distances"]]
    return line + (
        f"; distances are off by {sized(sum(off) / len(off), 'm')}" if off else ""
    )
