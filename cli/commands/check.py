"""The command `calib check`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from calib.common.wording import for_people

from .. import options as opt
from .. import parsing
from ..camera import log_of_pictures
from ..output import NO, Outcome, TextTable, number, say
from ..samples import Compared, log_for
from ..units import units_of

if TYPE_CHECKING:
    from calib import Model, Samples, Verdict


_MOST = 8


SIGNALS = {
    "motor": "motor map, zeta",
    "sensory": "sensory map, zeta",
    "reverse": "reverse distortion",
    "links": "distance to the prediction",
}


def check(
    model: opt.ModelFile,
    data: opt.NewLog,
    cause: opt.WhatChanged = None,
    tolerance: Annotated[
        float | None,
        Option(
            "--tolerance",
            metavar="S",
            parser=parsing.number,
            help="Exit 3 if unseen [m].",
        ),
    ] = None,
    columns: opt.Columns = None,
    unit: opt.Unit = None,
    time_offset: opt.TimeOffset = None,
    degrees: opt.LogDegrees = None,
    joints_file: opt.JointsFile = None,
    camera: opt.DatasetCamera = None,
    as_json: opt.Json = False,
    verbose: opt.Verbose = False,
    quiet: opt.Quiet = False,
) -> Outcome:
    """Compare a model with new samples: is it still calibrated? Exit code 3 if not.

    A log with a column `episode` is judged series by series, too. The data of a model of pictures
    may be pictures or a LeRobotDataset.
    """
    reading = Compared(
        columns=columns, unit=unit, time_offset=time_offset, degrees=degrees
    )
    import calib

    loaded = calib.load(model)
    with log_of_pictures(loaded, data, joints_file, camera, reading.degrees) as path:
        log = log_for(loaded, path, reading)
    series = [] if log.episode is None else log.episode.astype(int).tolist()
    episodes = [_episode(loaded, log, series, k, cause) for k in sorted({*series})]
    drift = calib.check(loaded, log, cause=cause, tolerance=tolerance)
    say(drift.notes)
    rescaled = any(
        cause.cause == "scale" and cause.interval is None for cause in drift.causes
    )
    unit_seen = drift.unit
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
    elif drift.changed is None:
        lines = [
            "TOO FEW ROWS TO SAY: they could not show a change of ten times the noise"
        ]
        lines += ["what to do: measure more poses, spread over the joints' ranges"]
    elif drift.drifted is None:
        lines = [
            "TOO COARSE: these rows could not have shown a change of the tolerated size"
        ]
        lines += ["what to do: give more rows, or rows of less noise", limit]
    else:
        head = "still calibrated"
        if not drift.bound_holds:
            share = f"{100 * drift.covered:.0f} %"
            head = f"THE BOUND DOES NOT HOLD: {share} of the rows are within it, 95 % should be"
        lines = [head, *drift.explanations, limit]
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


def _details(drift: Verdict, factor: float, name: str) -> list[str | TextTable]:
    tests = [
        [
            g.name,
            number(g.p_value),
            number(factor * g.smallest),
            "fired" * (g.score > 1.0),
        ]
        for g in sorted(
            (*drift.tests.groups, drift.bound.test), key=lambda g: -g.score
        )[:_MOST]
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
    zeta = (
        "zeta: mean squared distance of rows to winning nodes, in the unit box (eq. 9)"
    )
    header = ["what may have changed", "chance", f"smallest [{name}]", ""]
    return [
        TextTable(header, tests, foot=found),
        TextTable(
            ["on the maps", "unit", "found", "usual"], signals, left=2, foot=zeta
        ),
    ]
