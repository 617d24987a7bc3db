"""The commands of an arm that changed: `calib check`, `calib adapt` and `calib recognise`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from calib.common.choices import MethodWord
from calib.common.wording import for_people

from .. import options as opt
from ..camera import log_of_pictures, photo_of_log
from ..options import Text, option
from ..output import NO, Outcome, TextTable, as_typed, fields, number, progress_bar, say
from ..parsing import check_file
from ..samples import Compared, log_for
from ..units import units_of

if TYPE_CHECKING:
    from calib import Drift, Model, Samples

_MOST = 8
"""Groups that are printed."""

SIGNALS = {
    "motor": "motor map, zeta",
    "sensory": "sensory map, zeta",
    "reverse": "reverse distortion",
    "links": "distance to the prediction",
}


def check(
    model: opt.ModelFile,
    *,
    data: opt.NewLog,
    cause: opt.WhatChanged = None,
    tolerance: Annotated[float | None, option("--tolerance S", "Exit 3 if unseen [m].")] = None,
    reading: Compared,
    joints_file: opt.JointsFile = None,
    camera: opt.DatasetCamera = None,
) -> Outcome:
    """Compare a model with new samples: is it still calibrated? Exit code 3 if not.

    A log with a column `episode` is judged series by series, too. The data of a model of pictures
    may be pictures or a LeRobotDataset.
    """
    import calib

    loaded = calib.load(model)
    with log_of_pictures(loaded, data, joints_file, camera, reading.degrees) as path:
        log = log_for(loaded, path, reading)
    series = [] if log.episode is None else log.episode.astype(int).tolist()
    episodes = [_episode(loaded, log, series, k, cause) for k in sorted({*series})]
    drift = calib.check(loaded, log, cause=cause, tolerance=tolerance)
    say(drift.notes)
    rescaled = any(cause.cause == "scale" and cause.interval is None for cause in drift.causes)
    unit_seen = "sensor" if rescaled else loaded.about.unit
    document = {
        "model": model,
        **drift.to_json(),
        "episodes": episodes,
        "unit": unit_seen,
        "units": {**units_of(loaded.about), "positions": unit_seen},
    }
    remedy = f"calib adapt {model} --data {data} re-calibrates it"
    if not drift.adapts:
        remedy = "calib adapt finds nothing that mends it: check the log and the arm"
    elif rescaled:
        remedy = "check the log's unit before calib adapt, which learns the new scale"
    factor, name = for_people(unit_seen)
    limit = (
        f"limited by noise: these {drift.samples} rows show changes from "
        f"{number(factor * drift.smallest)} {name} on; more rows show smaller ones"
    )
    bumped = [each for each in episodes if each["drifted"]]
    if drift.drifted:
        first, *others = drift.explanations or ("its cause is unknown",)
        lines = [f"DRIFTED: {first}", *others, f"what to do: {remedy}", limit]
    elif bumped:
        lines = [f"DRIFTED in {len(bumped)} of {len(episodes)} episodes", limit]
        document["drifted"] = True
    elif drift.drifted is None:
        lines = ["TOO COARSE: these rows could not have shown a change of the tolerated size"]
        lines += ["what to do: give more rows, or rows of less noise", limit]
    else:
        lines = ["still calibrated", *drift.explanations, limit]
    for each in bumped:
        told = (*each["explanations"], "its cause is unknown")[0]
        lines.append(f"episode {each['episode']}: DRIFTED: {told}")
    code = NO if bumped or drift.drifted is not False else 0
    return Outcome(document, lines, _details(drift, factor, name), code=code)


def _episode(
    model: Model, log: Samples, series: list[int], number_: int, cause: str | None
) -> dict[str, Any]:
    """The verdict on one series; None where it has too few rows."""
    import calib
    from calib.errors import LogError

    rows = [k for k, each in enumerate(series) if each == number_]
    told: dict[str, Any] = {"episode": number_, "samples": len(rows), "drifted": None}
    try:
        drift = calib.check(model, log.take(rows), cause=cause)
    except LogError as error:
        return {**told, "score": None, "explanations": [str(error)]}
    found = {"drifted": drift.drifted, "score": drift.score}
    return {**told, **found, "explanations": list(drift.explanations)}


def _details(drift: Drift, factor: float, name: str) -> list[str | TextTable]:
    tests = [
        [g.name, number(g.p_value), number(factor * g.smallest), "fired" * (g.score > 1.0)]
        for g in sorted(drift.groups, key=lambda g: -g.score)[:_MOST]
    ]
    signals = [
        [SIGNALS[key], unit, number(size * found.value), number(size * found.threshold)]
        for key, found in drift.distortion.items()
        # zeta is a squared share of the unit box: millionths are readable
        for size, unit in [(factor, name) if key == "links" else (1e6, "1e-6")]
    ]
    found = (
        "chance: of such rows where nothing changed; below 0.001 the test fired; "
        "smallest: the smallest change that these rows could have shown"
    )
    zeta = "zeta: mean squared distance of rows to winning nodes, in the unit box (eq. 9)"
    header = ["what may have changed", "chance", f"smallest [{name}]", ""]
    return [
        TextTable(header, tests, foot=found),
        TextTable(["on the maps", "unit", "found", "usual"], signals, left=2, foot=zeta),
    ]


def adapt(
    model: opt.ModelFile,
    *,
    data: opt.NewLog,
    output: Annotated[Text, option("--output -o MODEL", "Default MODEL.adapted.calib.")] = None,
    method: Annotated[
        MethodWord, Option(help="few-shot: the body, from a few rows; online: the paper's rule.")
    ] = "few-shot",
    cause: opt.WhatChanged = None,
    reading: Compared,
) -> Outcome:
    """Re-calibrate a model from a few new samples. Exit code 3 if it does not improve."""
    import calib

    check_file(output, ())
    loaded = calib.load(model)
    stem = Path(model).name.removesuffix(".calib").removesuffix(".adapted")
    path = output or str(Path(model).with_name(f"{stem}.adapted.calib"))
    check_file(path, ())  # before the work whose result would be lost
    log = log_for(loaded, data, reading)
    with progress_bar() as progress:
        found = calib.adapt(loaded, log, method=method, cause=cause, progress=progress)
    say(found.notes)
    written = found.model is not loaded  # a better one, or the old one with a wider bound
    if written:
        photo_of_log(found.model, log, data).save(path)
    about = found.model.about
    document = {
        "model": path if written else None,
        **fields(found, "improved samples outliers left_out correction kept coverage everywhere"),
        **fields(found, "before after"),
        "method": method,
        "changed": [change.to_json() for change in found.changed],
        "notes": [as_typed(text) for text in found.notes],
        "unit": about.unit,
        "units": units_of(about),
    }
    factor, name = for_people(about.unit)
    before, after = (number(factor * each["mean"]) for each in (found.before, found.after))
    left = f", {found.outliers} left out" if found.outliers else ""
    rests = f"on rows that it did not learn from; {found.samples} samples of {data}{left}"
    # a note told of what is unknown
    changed = [f"changed: {each.words}" for each in found.changed if each.cause != "unknown"]
    if found.improved:
        lines = [f"{path}: {before} {name} before, {after} {name} after, {rests}", *changed]
    else:
        told = f"{path} predicts as {model} does, with a wider bound"
        if not written:
            told = f"{model} stays as it is, nothing was written"
        lines = [f"no improvement: {told}"]
        lines.append(f"{before} {name} as it is, {after} {name} adapted, {rests}")
    share = f"the log measured {100 * found.coverage:.0f} % of the learned range"
    limit = (
        f"coverage: {share}; rows from the rest" if found.coverage < 0.99 else "noise; more rows"
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


def recognise(
    models: Annotated[list[str], Argument(metavar="MODEL..", help="One a state of the arm.")],
    *,
    data: opt.NewLog,
    reading: Compared,
) -> Outcome:
    """Tell which of some models the arm is in. Exit code 3 if it is in none."""
    import calib

    loaded = [calib.load(path) for path in models]
    log = log_for(loaded[0], data, reading)
    found = calib.recognise(loaded, log)
    name = None if found.index is None else models[found.index]
    fits = [{"model": models[fit.index], **fit.to_json()} for fit in found.fits]
    factor, shown = for_people(loaded[0].about.unit)
    rows = [
        [models[f.index], number(f.score), number(factor * f.distance), "fits" * f.fits]
        for f in found.fits
    ]
    header = ["model", "score", f"median distance [{shown}]", ""]
    table = TextTable(header, rows, f"{found.samples} samples of {data}")
    return Outcome(
        {"model": name, "samples": found.samples, "fits": fits},
        [f"{name} fits" if name else "none of the models fits", table],
        code=0 if name else NO,
    )
