"""Re-calibrate a model from a few new samples. Exit code 3 if it does not improve.

A file is written then only where the bound has to be wider.
"""

from pathlib import Path
from typing import Annotated

import calib
from calib.common.choices import MethodWord
from calib.common.wording import with_unit

from .. import options as opt
from ..logs import ANY_SENSOR, LogFormat, log_for
from ..output import EXIT_ACT, Line, Outcome, as_typed, fields, progress, say
from ..parsing import check_file
from ..pictures import photo_of_log
from ..units import units_of

FACTS = (
    "improved",
    "samples",
    "outliers",
    "left_out",
    "correction",
    "kept",
    "coverage",
    "everywhere",
    "before",
    "after",
)


def adapt(
    model: opt.ModelFile,
    data: opt.NewLog,
    output: Annotated[
        str | None,
        opt.value("--output -o MODEL", "Default MODEL.adapted.calib."),
    ] = None,
    method: Annotated[
        MethodWord,
        opt.option(
            "--method",
            "few-shot: the body, from a few rows; online: the paper's rule.",
        ),
    ] = "few-shot",
    cause: opt.WhatChanged = None,
    free: opt.Free = "all",
    columns: opt.Columns = None,
    unit: opt.Unit = None,
    time_offset: opt.TimeOffset = None,
    degrees: opt.LogDegrees = None,
    sensor: opt.OfSensor = ANY_SENSOR,
) -> Outcome:
    loaded = calib.load(model)
    stem = Path(model).name.removesuffix(".calib").removesuffix(".adapted")
    path = output or str(Path(model).with_name(f"{stem}.adapted.calib"))
    check_file(path, (".calib",))  # before the work whose result would be lost
    log_format = LogFormat(columns, unit, time_offset, degrees)
    log = log_for(loaded, data, log_format, sensor)
    result = calib.adapt(
        loaded, log, method=method, cause=cause, free=free, progress=progress
    )
    say(result.notes)
    # a better one, or the old one with a wider bound
    written = result.model is not loaded
    if written:
        photo_of_log(result.model, log, data).save(path)
    about = result.model.by(log.sensor).about
    document = {
        "model": path if written else None,
        **fields(result, *FACTS),
        "method": method,
        "changed": [change.to_json() for change in result.changed],
        "notes": [as_typed(text) for text in result.notes],
        "unit": about.unit,
        "units": units_of(about),
    }
    rows = f"on rows that it did not learn from; {result.samples} samples of {data}"
    if result.outliers:
        rows += f", {result.outliers} left out"
    if result.improved:
        lines = _improvement(result, path, rows, about.unit)
    else:
        state = f"{model} stays as it is, nothing was written"
        if written:
            state = f"{path} predicts as {model} does, with a wider bound"
        before, after = _errors(result, about.unit)
        lines = [
            f"no clear improvement: {state}",
            f"{before} as it is, {after} adapted, {rows}",
        ]
    more: list[Line] = [f"corrected: {result.correction}"]
    if result.kept:
        more.append(f"left as it was: {', '.join(result.kept)}")
    return Outcome(
        document, lines, more, code=0 if result.improved else EXIT_ACT
    )


def _improvement(
    result: calib.Adaptation, path: str, rows: str, unit: str
) -> list[str]:
    """Report how much better the new model is, what changed, and what limits it."""
    before, after = _errors(result, unit)
    lines = [f"{path}: {before} before, {after} after, {rows}"]
    for change in result.changed:
        if change.cause != "unknown":  # which a note has reported
            lines.append(f"changed: {change.words}")
    limit = "limited by noise; more rows help most"
    if result.coverage < 0.9:  # rows at random miss some of it, too
        limit = (
            f"limited by coverage: the log measured {100 * result.coverage:.0f} % of the learned "
            "range; rows from the rest help most"
        )
    return [*lines, limit]


def _errors(result: calib.Adaptation, unit: str) -> tuple[str, str]:
    """Mean errors before and after, in words."""
    before = with_unit(result.before["mean"], unit)
    return before, with_unit(result.after["mean"], unit)
