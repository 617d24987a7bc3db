"""Learn a model from simulated babbling or from a measured log.

Exit code 3, with the model written, if its own fresh or held-out rows contradict its bound.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Annotated

from typer import Argument

import calib
from calib.use import assessment

from .. import options as opt
from ..logs import (
    FOR_LOGS,
    LogFormat,
    Selection,
    babble_log,
    read_measured_log,
    with_facts,
)
from ..output import Outcome, progress, say
from ..parsing import TABLES, BadOption, check_file, refuse
from ..pictures import photo_of_log, with_photo
from ..summary import error_table, summary


def train(
    robot: Annotated[
        str | None,
        Argument(metavar="ROBOT", help="A URDF, an MJCF or a bundled robot."),
    ] = None,
    data: opt.DataOfSensors = None,
    output: Annotated[
        str | None,
        opt.value("--output -o MODEL", "Default ROBOT.calib or LOG.calib."),
    ] = None,
    force: Annotated[
        bool, opt.option("--force", "Replace a model of another robot.")
    ] = False,
    joints: opt.JointNames = None,
    tip: opt.Tip = None,
    planar: opt.Planar = False,
    lock: opt.Lock = None,
    ranges: opt.Ranges = None,
    gravity: opt.Gravity = None,
    degrees: opt.Degrees = False,
    map: opt.MapName = None,  # noqa: A002
    size: opt.MapSize = None,
    motor_size: opt.MotorSize = None,
    sensory_size: opt.SensorySize = None,
    body: opt.BodyKind = "auto",
    view: opt.SensorView = "auto",
    free: opt.Free = "all",
    rule: opt.TrainingRule = "batch",
    epochs: opt.Epochs = None,
    sigma: opt.Sigma = None,
    samples: opt.Number = None,
    noise: opt.Noise = None,
    change: opt.Changes = None,
    seed: opt.Seed = 0,
    columns: opt.Columns = None,
    unit: opt.Unit = None,
    time_offset: opt.TimeOffset = None,
    prismatic: opt.Prismatic = None,
    distance: opt.Distances = None,
    plane: opt.Planes = None,
    lens: Annotated[
        str | None,
        opt.value("--lens lens.json", "Of a camera (fitted if not given)."),
    ] = None,
    no_rows: Annotated[
        bool, opt.option("--no-rows", "Keep no rows of the log.")
    ] = False,
    photo: opt.PhotoFile = None,
    no_photo: opt.NoPhoto = False,
) -> Outcome:
    selection = Selection(joints, tip, planar, lock, ranges, degrees, gravity)
    log_format = LogFormat(columns, unit, time_offset, prismatic=prismatic)
    _check_sources(
        robot,
        data,
        of_robot={
            "tip": tip,
            "planar": planar or None,
            "lock": lock,
            "gravity": gravity,
        },
        of_logs={
            **vars(log_format),
            "distance": distance,
            "plane": plane,
            "gravity": gravity,
            "lens": lens,
            "photo": photo,
        },
        of_simulation={"samples": samples, "noise": noise, "change": change},
    )
    path = output or _default_path(robot or (data or [""])[0])
    check_file(path, (".calib",))
    if data:
        from calib.samples.tables import sources_by_sensor

        logs = []
        for sensor, source in sources_by_sensor(data).items():
            log = read_measured_log(
                robot, selection, source, log_format, lens, sensor
            )
            logs.append(with_facts(log, distance, plane))
    else:
        logs = [babble_log(robot, selection, samples, noise, change, seed)]
    log = logs[0]
    if output is None and not force:
        _check_same_origin(path, log)
    options = calib.TrainingOptions(
        size=size,
        motor_size=motor_size,
        sensory_size=sensory_size,
        map=map,
        rule=rule,
        epochs=epochs,
        sigma=None if sigma is None else (sigma[0], sigma[1]),
        body=body,
        view=view,
        free=free,
        seed=seed,
    )
    measured = logs if len(logs) > 1 else log
    model = calib.train(measured, options, progress=progress)
    say(model.notes)
    if no_rows:
        model = replace(model, rows=None)
    if photo is not None:
        model = with_photo(model, photo, log)
    elif data and not no_photo:
        model = photo_of_log(model, log, data[0])
    model.save(path)
    return _outcome(model, path)


def _check_sources(
    robot: str | None,
    data: Sequence[str] | None,
    of_robot: Mapping[str, object],
    of_logs: Mapping[str, object],
    of_simulation: Mapping[str, object],
) -> None:
    """Refuse options of what is not there: a robot, logs or a simulation."""
    if robot is None and not data:
        raise BadOption(
            "no source to learn from: expected ROBOT, --data LOG, or both"
        )
    if robot is None:
        refuse(of_robot, "applies to a robot: expected ROBOT too")
    elif robot.lower().endswith(TABLES):
        raise BadOption(
            f"ROBOT {robot!r} is a table: a log is given as --data {robot}"
        )
    if data:
        refuse(
            of_simulation,
            "applies to simulated babbling, which --data replaces",
        )
    else:
        refuse(of_logs, FOR_LOGS)
    if robot is not None and of_logs["prismatic"] is not None:
        raise BadOption(
            "--prismatic applies to a log without ROBOT; ROBOT defines its joints"
        )


def _outcome(model: calib.Model, path: str) -> Outcome:
    """Report how well a model does that was written to a file."""
    from calib.use.evaluate import as_made

    about = model.about
    sensors = [model.by(name) for name in model.sensors]
    warnings: list[str] = []
    for sensor in sensors:
        warnings += assessment.bound_warnings(sensor.about)
    lines = list(map(assessment.accuracy_as_made, sensors))
    learned = f"{about.samples} samples"
    if about.source == "log":
        learned = f"{sum(sensor.about.samples for sensor in sensors)} rows"
        lines.append(assessment.differences_from_drawing(model))
    if not warnings:
        lines.append(assessment.limiting_factor(model, about.errors))
    cost = f"{model.seconds['total']:.2f} s, {Path(path).stat().st_size / 1e6:.2f} MB"
    lines.append(
        f"{path}: {about.options['map']}, {model.size_in_words}, {learned}, {cost}"
    )
    title = f"errors on {as_made(model).source}"
    table = error_table(model, about.errors, title)
    document = summary(model, path, about.errors, model.seconds)
    return Outcome(document, lines, [table], warnings=warnings)


def _default_path(origin: str) -> str:
    """Return the file of a model of a robot or a log, in the current folder."""
    if origin == "-":
        return "log.calib"
    safe = re.sub(r"[^\w.+-]+", "_", Path(origin).stem).lstrip(".")
    return f"{safe or 'robot'}.calib"


def _check_same_origin(path: str, log: calib.Samples) -> None:
    """Refuse a default name that is taken by a model of another robot or log."""
    import numpy as np

    if not Path(path).exists():
        return
    with suppress(calib.CalibError):  # what cannot be read is no model of it
        old = calib.load(path)
        origin = (log.arm.urdf if log.arm else "", bool(log.simulation))
        if origin == (old.about.urdf, old.about.source == "simulation"):
            # the first row distinguishes logs
            first = None if old.rows is None else old.rows.q[:1]
            if first is None or np.array_equal(first, log.q[:1]):
                return
    raise calib.OptionError(
        f"{path} is a model of another robot or log, or none that this program reads",
        hint="name another file with -o, or replace it with `force=True`",
        parameter="force",
    )
