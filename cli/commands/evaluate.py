"""Print the errors of a model, on fresh samples or on a log; exit code 3 if its bound fails."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Annotated, Literal

import calib
from calib.common.wording import with_unit
from calib.use import assessment

from .. import options as opt
from ..logs import ANY_SENSOR, FOR_LOGS, LogFormat, log_of, with_facts
from ..output import Outcome, progress, say
from ..parsing import BadOption, refuse
from ..summary import error_table, summary

if TYPE_CHECKING:
    from calib.use.iso9283 import Iso9283


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
        Literal["kept", "free"],
        opt.option("--frame", "free: the sensor's frame is found anew."),
    ] = "kept",
    sensor: opt.OfSensor = ANY_SENSOR,
    iso: Annotated[
        bool,
        opt.option("--iso9283", "Accuracy and repeatability of poses, too."),
    ] = False,
) -> Outcome:
    from ..query import model_in

    loaded = model_in(model, sensor)
    log_format = LogFormat(columns, unit, time_offset, degrees)
    log = log_of(loaded, data, log_format, sensor)
    if log is None:
        anew = None if frame == "kept" else frame
        of_logs = {"distance": distance, "plane": plane, "frame": anew}
        refuse(of_logs, FOR_LOGS)
    else:
        log = with_facts(log, distance, plane)
        loaded = loaded.by(log.sensor)
    started = time.perf_counter()
    result = calib.evaluate(loaded, log, frame=frame, progress=progress)
    say(result.notes)
    seconds = {"total": time.perf_counter() - started}
    document = summary(loaded, model, result.errors, seconds)
    document |= {
        "evaluated": {
            "source": result.source,
            "rows": result.rows,
            "left_out": result.left_out,
        },
        "left_out": result.left_out,
        "learned": result.learned,
        "bound_holds": result.bound_holds,
    }
    warnings = assessment.bound_warnings(loaded.about)
    if log is not None:
        warnings = []
        if result.bound_holds is False:  # or there are too few rows
            line = assessment.bound_fails_for_log(
                loaded.about, result.within["covered"]
            )
            warnings.append(f"{line}; calib check says what changed")
    limit = []
    # what limited a simulation does not limit a log
    is_known = log is None or loaded.about.source == "log"
    if is_known and not warnings:
        limit = [assessment.limiting_factor(loaded, result.errors)]
    if result.touch:
        document["touch"] = result.touch
        lines = [f"{model}: {_scatter(result)}", *limit]
        return Outcome(document, lines, warnings=warnings)
    others = [] if log is not None else loaded.sensors[1:]
    lines = [
        f"{model}: {_of_sensor(loaded)}{assessment.accuracy(loaded, result)}",
        *(assessment.accuracy_as_made(loaded.by(name)) for name in others),
        *limit,
    ]
    if iso:
        standard = _standard(loaded, log)
        document["iso9283"] = standard.to_json()
        lines.append(_standard_line(standard))
    title = f"errors on {result.rows} {result.source}"
    table = error_table(loaded, result.errors, title)
    return Outcome(document, lines, [table], warnings=warnings)


def _of_sensor(model: calib.Model) -> str:
    """Return the beginning of a line that names the sensor, if it has a name."""
    return f"{model.about.sensor}: " if model.about.sensor else ""


def _standard(model: calib.Model, log: calib.Samples | None) -> Iso9283:
    """Test the poses of a log by the standard, and report where it falls short."""
    from calib.use.iso9283 import iso9283

    if log is None:
        raise BadOption(
            "--iso9283 is of a log with repeated poses: expected --data LOG too"
        )
    standard = iso9283(model, log)
    say(standard.notes)
    return standard


def _standard_line(standard: Iso9283) -> str:
    unit = standard.unit
    line = f"ISO 9283: RP {with_unit(standard.repeatability, unit)}, AP "
    if standard.delivered is not None:
        line += f"{with_unit(standard.delivered, unit)} as delivered, "
    line += f"{with_unit(standard.corrected, unit)} as corrected"
    return f"{line} (worst of {len(standard.poses)} poses)"


def _scatter(result: calib.Evaluation) -> str:
    scatter = result.touch["scatter"]
    mean = with_unit(scatter["mean"], "m")
    most = with_unit(scatter["p95"], "m")
    line = (
        f"tips scatter about their sockets by {mean}, 95 % within {most}, in {result.rows} "
        f"touches, {result.left_out} left out"
    )
    distances = result.touch["distances"]
    if not distances:
        return line
    off = [abs(gap["predicted"] - gap["stated"]) for gap in distances]
    return f"{line}; distances are off by {with_unit(sum(off) / len(off), 'm')}"
