"""The commands from poses to a model: `calib plan`, `calib babble` and `calib train`."""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument

from calib.common.choices import Eye

from .. import options as opt
from ..camera import photo_of_log, with_photo
from ..options import Text, flag, option
from ..output import Outcome, fields, progress_bar, say
from ..parsing import TABLES, BadOption, check_file, not_negative, reals
from ..samples import Babbling, Compared, Logged, Selection, Sockets, check_sources, log_for, refuse
from ..samples import babbled_samples as babbled
from ..samples import measured_samples as measured
from ..summary import accuracy, advice, error_table, found_by_body, summary
from ..units import JointFormat, in_si

if TYPE_CHECKING:
    from calib import Model, Samples
    from calib.arm.arm import Arm


def plan(
    robot: Annotated[str, Argument(metavar="ROBOT|MODEL", help="To measure, or to improve.")],
    *,
    output: Annotated[str, option("--output -o FILE", "CSV, or Parquet by its name (- stdout).")],
    poses: Annotated[int, option("--poses -n N", "How many poses.", min=1, max=1000)] = 60,
    selection: Selection,
    margin: Annotated[Any, option("--margin M", "From limits (1 deg).", not_negative)] = None,
    start: Annotated[Any, option("--from Q1,Q2", "Joints before the first pose.", reals)] = None,
    data: opt.Data = None,
    columns: opt.Columns = None,
    touch: Annotated[Any, option("--touch X,Y,Z", "A point of the base frame [m].", reals)] = None,
    handeye: Annotated[bool, flag("--handeye", "A camera sees --board in all poses.")] = False,
    board: opt.BoardSpec = None,
    eye: Annotated[Eye | None, flag("--eye", "Of --handeye (default hand).")] = None,
    seed: opt.Seed = 0,
) -> Outcome:
    """Plan poses to measure: within the limits, well spread, with short moves between them.

    With --data the plan covers what that log has not measured. With --handeye the board is in the
    middle of the picture at --from, or where the model of `calib handeye -o` knows it. Obstacles
    are not checked: move slowly the first time.
    """
    is_model, degrees = robot.endswith(".calib"), selection.degrees
    of_robot = ("joints", "tip", "lock")
    if not handeye or is_model:
        refuse({"board": board, "eye": eye}, "is for --handeye of ROBOT: a model knows its board")
    elif board is None:
        raise BadOption("--handeye needs --board, such as 7x5:24mm:18mm:5x5_100")
    check_file(output, TABLES, stream=True)
    if data is None:
        refuse({"columns": columns}, "applies to a log: expected --data LOG too")
    import calib
    from calib.samples.tables import write_table

    known: Arm | Model
    rows = ranges = None
    if is_model:
        why = "is for ROBOT: a model has its joints and its tip already"
        refuse({name: getattr(selection, name) for name in of_robot}, why)
        known = calib.load(robot)
        facts: Any = known.about
        if data is not None:
            reading = Compared(columns=columns, degrees=degrees or None)
            rows = log_for(known, data, reading)
        # an arm was loaded with its ranges, which it may need where it states no limits
        turning = dict(zip(facts.joint_names, facts.revolute, strict=True))
        ranges = in_si("--range", selection.ranges, turning, degrees)
    else:
        known = facts = selection.load(robot)
        say(known.notes)
        if data is not None:
            rows = measured(robot, selection, data, Logged(columns=columns))
    joints = JointFormat(facts, degrees)
    found = calib.plan(
        known,
        poses,
        seed=seed,
        margin=None if margin is None else [margin / factor for factor in joints.typed],
        ranges=ranges,
        start=joints.one_each("--from", start),
        measured=rows,
        touch=touch,
        handeye=board or (True if handeye else None),
        eye=eye or "hand",
    )
    say(found.notes)
    names, kinds, table = joints.names, facts.units_of_joints, found.columns()
    table |= dict(zip(names, (found.q * joints.typed).T, strict=True))
    write_table(output, table)
    document = {
        "output": output,
        "rows": len(found),
        "joints": found.joint_names,
        "seed": seed,
        "travel": dict(zip(names, found.travel.tolist(), strict=True)),
        "poses": found.columns(),
        **fields(found, "start length random_length unit why"),
        "units": {"joints": dict(zip(names, kinds, strict=True)), "positions": found.unit},
    }
    units = "deg" if degrees else "rad"
    line = f"{output}: {len(found)} rows of {', '.join(table)} [{units}, {found.unit}]"
    ways = ", ".join(joints.change(k, way) for k, way in enumerate(found.travel.tolist()))
    return Outcome(document, [line, *found.why, f"joints travel {ways}"])


def babble(
    robot: opt.RobotFile,
    *,
    output: Annotated[str, option("--output -o LOG", "CSV, or Parquet by its name (- stdout).")],
    babbling: Babbling,
    selection: Selection,
    seed: opt.Seed = 0,
) -> Outcome:
    """Write a log of simulated babbling [rad, m]."""
    import calib

    check_file(output, TABLES, stream=True)
    log = babbled(robot, selection, babbling, seed)
    calib.write_log(log, output)
    turning = zip(log.joint_names, log.revolute, strict=True)
    document = {
        "log": output,
        "robot": log.arm.name if log.arm else None,
        "joints": log.joint_names,
        "samples": len(log),
        "seed": seed,
        "noise": babbling.noise or 0.0,
        "changes": babbling.change or [],
        "unit": log.unit,
        "units": {
            "joints": {name: "rad" if turns else "m" for name, turns in turning},
            "positions": log.unit,
        },
    }
    line = f"{len(log)} rows of {', '.join([*log.joint_names, *log.axes])} [rad, m]"
    return Outcome(document, [f"{output}: {line}"])


def train(
    robot: Annotated[Text, Argument(metavar="ROBOT", help="A URDF or a bundled robot.")] = None,
    *,
    data: opt.Data = None,
    output: Annotated[Text, option("--output -o MODEL", "Default ROBOT.calib, LOG.calib.")] = None,
    force: Annotated[bool, flag("--force", "Replace a model of another robot.")] = False,
    selection: Selection,
    map: opt.MapName = None,  # noqa: A002
    size: opt.MapSize = None,
    motor_size: opt.MotorSize = None,
    sensory_size: opt.SensorySize = None,
    body: opt.BodyKind = "auto",
    view: opt.SensorView = "auto",
    rule: opt.TrainingRule = "batch",
    epochs: opt.Epochs = None,
    sigma: opt.Sigma = None,
    babbling: Babbling,
    seed: opt.Seed = 0,
    logged: Logged,
    sockets: Sockets,
    lens: Annotated[Text, option("--lens lens.json", "Of a camera in space (fitted).")] = None,
    no_rows: Annotated[bool, flag("--no-rows", "Keep no rows of the log.")] = False,
    photo: opt.PhotoFile = None,
    no_photo: opt.NoPhoto = False,
) -> Outcome:
    """Learn a model from simulated babbling or from a measured log."""
    import calib

    of_logs = {**vars(logged), **vars(sockets), "lens": lens, "photo": photo}
    check_sources([robot] if robot else [], data is not None, vars(babbling), of_logs)
    if photo is not None and no_photo:
        raise BadOption("--photo and --no-photo are given: expected one of them")
    check_file(output, ())
    if data is None:
        log = babbled(robot, selection, babbling, seed)
    else:
        log = sockets.of(measured(robot, selection, data, logged, seed, lens))
    safe = re.sub(r"[^\w.+-]+", "_", Path(str(robot or data)).stem).lstrip(".")
    path = output or ("log.calib" if (robot or data) == "-" else f"{safe or 'robot'}.calib")
    check_file(path, ())
    if output is None and not force:
        _check_same_origin(path, log)
    sizes = (size, motor_size, sensory_size)
    how = calib.TrainingOptions(*sizes, map, rule, epochs, sigma, body=body, view=view, seed=seed)
    with progress_bar() as progress:
        model = calib.train(log, how, progress=progress)
    say(model.about.notes)
    if no_rows:
        model = replace(model, rows=None)
    if photo is not None:
        model = with_photo(model, photo, log)
    elif data is not None and not no_photo:
        model = photo_of_log(model, log, data)
    model.save(path)
    about = model.about
    simulated = about.source == "simulation"
    stated = log.source.get("noise") if log.source.get("unit") == about.unit else None
    what = "fresh exact samples" if simulated else "rows held out in blocks of the log"
    learned = f"{about.samples} {'samples' if simulated else 'rows'}"
    size = f"{model.seconds['total']:.2f} s, {Path(path).stat().st_size / 1e6:.2f} MB"
    lines = [
        accuracy(model, about.errors, about.within, f"{about.tested} {what}", about.left_out),
        *found_by_body(model),
        *advice(model, about.errors, stated),
        f"{path}: {about.options['map']}, {model.size_in_words}, {learned}, {size}",
    ]
    table = error_table(model, about.errors, f"errors on {what}")
    return Outcome(summary(model, path, about.errors, model.seconds), lines, [table])


def _check_same_origin(path: str, log: Samples) -> None:
    """Refuse a default name that is taken by a model of another robot or log."""
    import numpy as np

    import calib

    if not Path(path).exists():
        return
    with suppress(calib.CalibError):  # what cannot be read is no model of this robot either
        old = calib.load(path)
        urdf, about = log.arm.urdf if log.arm else "", old.about
        same = (about.urdf, about.joint_names) == (urdf, log.joint_names)
        same &= (log.simulation is None) == (about.source == "log")
        if old.rows is not None and len(old.rows):  # the first tells logs apart
            same &= np.array_equal([*old.rows.q[0], *old.rows.x[0]], [*log.q[0], *log.x[0]])
        if same:
            return
    raise calib.OptionError(
        f"{path} is a model of another robot or log, or none that this program reads",
        hint="name another file with -o, or replace it with `force=True`",
        parameter="force",
    )
