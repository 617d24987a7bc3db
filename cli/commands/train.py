"""The command `calib train`."""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from .. import options as opt
from ..camera import photo_of_log, with_photo
from ..output import NO, Outcome, progress_bar, say
from ..parsing import BadOption, check_file
from ..samples import Babbling, Logged, Selection, Sockets, check_sources
from ..samples import babbled_samples as babbled
from ..samples import measured_by_sensors as measured
from ..summary import (
    accuracy,
    advice,
    contradicted,
    error_table,
    found_by_body,
    summary,
)

if TYPE_CHECKING:
    from calib import Model, Samples


def train(
    robot: Annotated[
        str | None,
        Argument(metavar="ROBOT", help="A URDF, an MJCF or a bundled robot."),
    ] = None,
    data: opt.DataOfSensors = None,
    output: Annotated[
        str | None,
        Option(
            "--output", "-o", metavar="MODEL", help="Default ROBOT.calib, LOG.calib."
        ),
    ] = None,
    force: Annotated[
        bool, Option("--force", help="Replace a model of another robot.")
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
        Option("--lens", metavar="lens.json", help="Of a camera in space (fitted)."),
    ] = None,
    no_rows: Annotated[
        bool, Option("--no-rows", help="Keep no rows of the log.")
    ] = False,
    photo: opt.PhotoFile = None,
    no_photo: opt.NoPhoto = False,
    as_json: opt.Json = False,
    verbose: opt.Verbose = False,
    quiet: opt.Quiet = False,
) -> Outcome:
    """Learn a model from simulated babbling or from a measured log.

    Exit code 3, with the model written, if its own fresh or held-out rows contradict its bound.
    """
    selection = Selection(
        joints=joints,
        tip=tip,
        planar=planar,
        lock=lock,
        ranges=ranges,
        degrees=degrees,
        gravity=gravity,
    )
    babbling = Babbling(samples=samples, noise=noise, change=change)
    logged = Logged(
        columns=columns, unit=unit, time_offset=time_offset, prismatic=prismatic
    )
    sockets = Sockets(distance=distance, plane=plane)
    import calib

    of_logs = {
        **vars(logged),
        **vars(sockets),
        "gravity": gravity,
        "lens": lens,
        "photo": photo,
    }
    check_sources([robot] if robot else [], bool(data), vars(babbling), of_logs)
    if photo is not None and no_photo:
        raise BadOption("--photo and --no-photo are given: expected one of them")
    check_file(output, ())
    if not data:
        logs = [babbled(robot, selection, babbling, seed)]
    else:
        logs = [
            sockets.of(log)
            for log in measured(robot, selection, data, logged, seed, lens)
        ]
    log = logs[0]
    origin = robot or (data or ["robot"])[0]
    safe = re.sub(r"[^\w.+-]+", "_", Path(origin).stem).lstrip(".")
    path = output or ("log.calib" if origin == "-" else f"{safe or 'robot'}.calib")
    check_file(path, ())
    if output is None and not force:
        _check_same_origin(path, log)
    sizes = (size, motor_size, sensory_size)
    how = calib.TrainingOptions(
        *sizes, map, rule, epochs, sigma, body=body, view=view, seed=seed
    )
    with progress_bar() as progress:
        model = calib.train(logs if len(logs) > 1 else log, how, progress=progress)
    say(model.about.notes)
    if no_rows:
        model = replace(model, rows=None)
    if photo is not None:
        model = with_photo(model, photo, log)
    elif data and not no_photo:
        model = photo_of_log(model, log, data[0])
    model.save(path)
    about = model.about
    simulated = about.source == "simulation"
    stated = log.source.get("noise") if log.source.get("unit") == about.unit else None
    what = "fresh exact samples" if simulated else "rows held out in blocks of the log"
    learned = f"{about.samples} {'samples' if simulated else 'rows'}"
    cost = f"{model.seconds['total']:.2f} s, {Path(path).stat().st_size / 1e6:.2f} MB"
    sensors = [model.by(name) for name in model.sensors]
    warnings = [line for seen in sensors for line in contradicted(seen.about)]
    lines = [
        *warnings,
        *(_accuracy_of_sensor(seen, what) for seen in sensors),
        *found_by_body(model),
        *advice(model, about.errors, stated),
        f"{path}: {about.options['map']}, {model.size_in_words}, {learned}, {cost}",
    ]
    table = error_table(model, about.errors, f"errors on {what}")
    document = summary(model, path, about.errors, model.seconds)
    return Outcome(document, lines, [table], code=NO if warnings else 0)


def _accuracy_of_sensor(model: Model, what: str) -> str:
    """Return in one line how accurate a model is, as one of its sensors sees the arm."""
    about = model.about
    line = accuracy(
        model, about.errors, about.within, f"{about.tested} {what}", about.left_out
    )
    return f"{about.sensor}: {line}" if about.sensor else line


def _check_same_origin(path: str, log: Samples) -> None:
    """Refuse a default name that is taken by a model of another robot or log."""
    import numpy as np

    import calib

    if not Path(path).exists():
        return
    with suppress(
        calib.CalibError
    ):  # what cannot be read is no model of this robot either
        old = calib.load(path)
        urdf = log.arm.urdf if log.arm else ""
        about = old.about
        same = (about.urdf, about.joint_names) == (urdf, log.joint_names)
        same &= (log.simulation is None) == (about.source == "log")
        if old.rows is not None and len(old.rows):  # the first tells logs apart
            same &= np.array_equal(
                [*old.rows.q[0], *old.rows.x[0]], [*log.q[0], *log.x[0]]
            )
        if same:
            return
    raise calib.OptionError(
        f"{path} is a model of another robot or log, or none that this program reads",
        hint="name another file with -o, or replace it with `force=True`",
        parameter="force",
    )
