"""The command `calib adapt`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Option

from calib.common.choices import METHODS, MethodWord
from calib.common.wording import for_people

from .. import options as opt
from ..camera import photo_of_log
from ..output import NO, Outcome, TextTable, as_typed, fields, number, progress_bar, say
from ..parsing import check_file
from ..samples import Compared, log_for
from ..units import units_of

if TYPE_CHECKING:
    pass


def adapt(
    model: opt.ModelFile,
    data: opt.NewLog,
    output: Annotated[
        str | None,
        Option("--output", "-o", metavar="MODEL", help="Default MODEL.adapted.calib."),
    ] = None,
    method: Annotated[
        MethodWord,
        opt.word(
            "--method",
            METHODS,
            "few-shot: the body, from a few rows; online: the paper's rule.",
        ),
    ] = "few-shot",
    cause: opt.WhatChanged = None,
    free: opt.Free = "all",
    columns: opt.Columns = None,
    unit: opt.Unit = None,
    time_offset: opt.TimeOffset = None,
    degrees: opt.LogDegrees = None,
    as_json: opt.Json = False,
    verbose: opt.Verbose = False,
    quiet: opt.Quiet = False,
) -> Outcome:
    """Re-calibrate a model from a few new samples. Exit code 3 if it does not improve."""
    reading = Compared(
        columns=columns, unit=unit, time_offset=time_offset, degrees=degrees
    )
    import calib

    check_file(output, ())
    loaded = calib.load(model)
    stem = Path(model).name.removesuffix(".calib").removesuffix(".adapted")
    path = output or str(Path(model).with_name(f"{stem}.adapted.calib"))
    check_file(path, ())  # before the work whose result would be lost
    log = log_for(loaded, data, reading)
    with progress_bar() as progress:
        found = calib.adapt(
            loaded, log, method=method, cause=cause, free=free, progress=progress
        )
    say(found.notes)
    written = (
        found.model is not loaded
    )  # a better one, or the old one with a wider bound
    if written:
        photo_of_log(found.model, log, data).save(path)
    about = found.model.about
    document = {
        "model": path if written else None,
        **fields(
            found,
            "improved samples outliers left_out correction kept coverage everywhere",
        ),
        **fields(found, "before after"),
        "method": method,
        "changed": [change.to_json() for change in found.changed],
        "notes": [as_typed(text) for text in found.notes],
        "unit": about.unit,
        "units": units_of(about),
    }
    factor, name = for_people(about.unit)
    before, after = (
        number(factor * each["mean"]) for each in (found.before, found.after)
    )
    left = f", {found.outliers} left out" if found.outliers else ""
    rests = (
        f"on rows that it did not learn from; {found.samples} samples of {data}{left}"
    )
    # a note told of what is unknown
    changed = [
        f"changed: {each.words}" for each in found.changed if each.cause != "unknown"
    ]
    if found.improved:
        lines = [
            f"{path}: {before} {name} before, {after} {name} after, {rests}",
            *changed,
        ]
    else:
        told = f"{path} predicts as {model} does, with a wider bound"
        if not written:
            told = f"{model} stays as it is, nothing was written"
        lines = [f"no improvement: {told}"]
        lines.append(f"{before} {name} as it is, {after} {name} adapted, {rests}")
    share = f"the log measured {100 * found.coverage:.0f} % of the learned range"
    limit = (
        f"coverage: {share}; rows from the rest"
        if found.coverage < 0.99
        else "noise; more rows"
    )
    lines.append(f"limited by {limit} help most")
    rows = [
        [when, *(number(factor * error[key]) for key in ("mean", "p99", "max"))]
        for when, error in (("before", found.before), ("after", found.after))
    ]
    title = f"distance to held-out rows [{name}], corrected: {found.correction}"
    more: list[str | TextTable] = [TextTable(["", "mean", "p99", "max"], rows, title)]
    if found.kept:
        more.append(f"left as it was: {', '.join(found.kept)}")
    return Outcome(document, lines, more, code=0 if found.improved else NO)
