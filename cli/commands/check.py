"""Compare a model with new samples: is it still calibrated? Exit code 3 if not.

A log with a column `episode` is judged series by series, too. The data of a model of pictures
may be pictures or a LeRobotDataset.
"""

from __future__ import annotations

from pathlib import Path
from shlex import quote
from typing import Annotated

import calib
from calib.common.wording import error_size, for_people, with_unit
from calib.use import assessment

from .. import options as opt
from ..logs import ANY_SENSOR, LogFormat, log_for
from ..output import EXIT_ACT, Outcome, TextTable, progress, say
from ..parsing import above_zero, refuse
from ..pictures import log_of_pictures
from ..units import units_of

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
        opt.value(
            "--tolerance S",
            "Exit 3 where rows cannot show such a change [m].",
            above_zero,
        ),
    ] = None,
    columns: opt.Columns = None,
    unit: opt.Unit = None,
    time_offset: opt.TimeOffset = None,
    degrees: opt.LogDegrees = None,
    joints_file: opt.JointsFile = None,
    camera: opt.DatasetCamera = None,
    sensor: opt.OfSensor = ANY_SENSOR,
) -> Outcome:
    loaded = calib.load(model)
    log_format = LogFormat(columns, unit, time_offset, degrees)
    if joints_file is None and not Path(data).is_dir():
        refuse({"camera": camera}, "is of a LeRobotDataset")
        log = log_for(loaded, data, log_format, sensor)
    else:
        of_tables = {
            "columns": columns,
            "unit": unit,
            "time_offset": time_offset,
        }
        refuse(of_tables, "is of tables, not of pictures")
        log = log_of_pictures(
            loaded, data, joints_file, camera, degrees, sensor
        )
    verdict = calib.check(
        loaded, log, cause=cause, tolerance=tolerance, progress=progress
    )
    say(verdict.notes)
    document = {
        "model": model,
        **verdict.to_json(),
        "unit": verdict.unit,
        "units": units_of(loaded.about, verdict.unit),
    }
    adapt = f"calib adapt {quote(model)} --data {quote(data)}"
    if sensor != ANY_SENSOR:
        adapt += f" --in {quote(sensor)}"
    lines = _verdict(verdict, adapt)
    for episode in verdict.drifted_episodes:
        title = f"episode {episode.episode}: DRIFTED"
        lines.append(f"{title}: {episode.main_cause}")
    code = 0 if verdict.is_calm else EXIT_ACT
    return Outcome(document, lines, [_signals(verdict)], code=code)


def _verdict(verdict: calib.Verdict, adapt: str) -> list[str]:
    """Report what the rows show, what to do, and what limits the answer."""
    limit = (
        f"limited by noise: these {verdict.samples} rows show changes from "
        f"{with_unit(verdict.smallest, verdict.unit)} on; more rows show smaller ones"
    )
    if verdict.changed:
        remedy = verdict.hint or f"{adapt} re-calibrates it"
        return [
            f"DRIFTED: {verdict.main_cause}",
            *verdict.explanations[1:],
            f"what to do: {remedy}",
            limit,
        ]
    if verdict.drifted:
        count = f"{len(verdict.drifted_episodes)} of {len(verdict.episodes)}"
        return [f"DRIFTED in {count} episodes", limit]
    if verdict.changed is None:
        return [
            "TOO FEW ROWS TO SAY: they could not show a change of ten times the noise",
            "what to do: measure more poses, spread over the joints' ranges",
        ]
    if verdict.drifted is None:
        return [
            "TOO COARSE: these rows could not have shown a change of the tolerated size",
            "what to do: give more rows, or rows of less noise",
            limit,
        ]
    headline = "still calibrated"
    if not verdict.bound_holds:
        about = verdict.rows.model.about
        headline = assessment.bound_fails_for_log(about, verdict.covered)
    return [headline, *verdict.explanations, limit]


def _signals(verdict: calib.Verdict) -> TextTable:
    """Return the distortions of the maps, which raise no alarm."""
    factor, unit = for_people(verdict.unit)
    rows = []
    for key, signal in verdict.distortion.items():
        # zeta is a squared share of the unit box: millionths are readable
        size, shown = (factor, unit) if key == "links" else (1e6, "1e-6")
        values = (
            error_size(size * signal.value),
            error_size(size * signal.threshold),
        )
        rows.append([SIGNALS[key], shown, *values])
    zeta = "zeta: mean squared distance of rows to winning nodes, in the unit box (eq. 9)"
    header = ["on the maps", "unit", "found", "usual"]
    return TextTable(header, rows, left=2, foot=zeta)
