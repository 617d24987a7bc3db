"""The command `calib train`."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calib.common.wording import for_people
from calib.show.facts import size_in_words

from .. import options as o
from ..output import Notes, progress_bar, show, show_json, tell
from ..photo import NoPhotoOption, PhotoOption, photo_of_log, with_photo
from ..samples import Selection, babbled, check_sources, measured
from ..summary import compact_table, summary
from ..usage import BadOption, argument, check_output, flag, option

if TYPE_CHECKING:
    from calib import Model, Samples


def train(
    robot: Annotated[
        str | None,
        argument(
            "ROBOT", "A URDF file, or a bundled robot (calib robots). Not needed with --data."
        ),
    ] = None,
    data: o.DataOption = None,
    output: Annotated[
        str | None,
        option(
            "--output -o MODEL", "The model's file (default ROBOT.calib, without ROBOT LOG.calib)."
        ),
    ] = None,
    force: Annotated[
        bool, flag("--force", "Replace a model of another robot or log by that name.")
    ] = False,
    joints: o.JointsOption = None,
    tip: o.TipOption = None,
    planar: o.PlanarOption = False,
    lock: o.LockOption = None,
    ranges: o.RangeOption = None,
    map_: o.MapOption = None,
    size: o.SizeOption = None,
    motor_size: o.MotorSizeOption = None,
    sensory_size: o.SensorySizeOption = None,
    body: o.BodyOption = "auto",
    view: o.SensorViewOption = "auto",
    rule: o.RuleOption = "batch",
    epochs: o.EpochsOption = None,
    sigma: o.SigmaOption = None,
    samples: o.SamplesOption = None,
    noise: o.NoiseOption = None,
    seed: o.SeedOption = 0,
    motion: o.MotionOption = None,
    change: o.ChangeOption = None,
    columns: o.ColumnsOption = None,
    unit: o.UnitOption = None,
    prismatic: o.PrismaticOption = None,
    lens: Annotated[
        str | None,
        option(
            "--lens lens.json",
            "The calibrated lens of a camera that sees an arm in space (default: fitted).",
        ),
    ] = None,
    no_rows: Annotated[
        bool, flag("--no-rows", "Keep no rows of the log in the model (default up to 5000).")
    ] = False,
    photo: PhotoOption = None,
    no_photo: NoPhotoOption = False,
    degrees: o.DegreesOption = False,
    as_json: o.JsonOption = False,
) -> None:
    """Learn a model from simulated babbling or from a measured log."""
    import calib

    simulated = {"--samples": samples, "--noise": noise, "--motion": motion, "--change": change}
    of_logs = {"--columns": columns, "--unit": unit, "--prismatic": prismatic}
    of_logs |= {"--lens": lens, "--photo": photo}
    check_sources([robot] if robot else [], data is not None, simulated, of_logs)
    if photo is not None and no_photo:
        raise BadOption("--photo and --no-photo are given: expected one of them")
    if output is not None:
        check_output(output)
    selection = Selection(robot, joints, tip, lock or (), ranges or (), degrees, planar)
    notes = Notes()
    if data is None:
        log = babbled(
            selection,
            samples=samples,
            noise=noise,
            motion=motion,
            changes=change or (),
            seed=seed,
            notes=notes,
        )
    else:
        log = measured(
            selection,
            data,
            columns=columns,
            unit=unit,
            prismatic=prismatic or (),
            seed=seed,
            notes=notes,
            lens=lens,
        )
    path = output or f"{_file_name(_stem(robot or data))}.calib"
    check_output(path)
    if output is None and not force:
        _check_same_origin(path, log)
    with progress_bar(log.unit) as progress:
        model = calib.train(
            log,
            size=size and size.plain(),
            motor_size=motor_size and motor_size.plain(),
            sensory_size=sensory_size and sensory_size.plain(),
            map=map_,
            rule=rule,
            epochs=epochs,
            sigma=sigma,
            body=body,
            view=view,
            seed=seed,
            progress=progress,
        )
    notes.say([*model.about.notes, *_unexplained(model, log)])
    if no_rows:
        model = replace(model, rows=None)
    if photo is not None:
        model = with_photo(model, photo, log)
    elif data is not None and not no_photo:
        model = photo_of_log(model, log, data, notes)
    model.save(path)
    if as_json:
        show_json(summary(model, path, model.about.errors, model.seconds))
    else:
        _report(model, path)


def _report(model: Model, path: str) -> None:
    about = model.about
    what = "fresh exact samples" if about.source == "simulation" else "held out blocks of the log"
    show(compact_table(model, about.errors, f"errors on {what}"))
    tell(
        f"{path}: {about.options['map']}, {size_in_words(model)}, {about.samples} samples, "
        f"{model.seconds['total']:.2f} s, {Path(path).stat().st_size / 1e6:.2f} MB"
    )


def _unexplained(model: Model, log: Samples) -> list[str]:
    """Tell of rows that are predicted far worse than their log says that they were measured."""
    stated, unit = log.source.get("noise"), model.about.unit
    left = next(iter(model.about.errors.values()))["forward"]["distance"]["mean"]
    if not isinstance(stated, float) or log.source.get("unit") != unit or left < 10.0 * stated:
        return []
    factor, name = for_people(unit)
    return [
        f"rows are predicted to {factor * left:.2g} {name} and were measured to "
        f"{factor * stated:.2g} {name}: too few rows, or something moved that no joint tells, such "
        "as a camera that refocuses, a loose tag or play"
    ]


def _check_same_origin(path: str, log: Samples) -> None:
    """Refuse a default name that is taken by a model of another robot or log."""
    import numpy as np

    import calib

    if not Path(path).exists():
        return
    try:
        old = calib.load(path)
    except calib.CalibError:
        what = "a file that is no model which this program reads"
    else:
        urdf = log.arm.urdf if log.arm else ""
        simulated = log.simulation is not None
        same = (old.about.urdf, old.about.joint_names) == (urdf, log.joint_names)
        if not simulated and old.rows is not None and len(old.rows):
            pairs = ((old.rows.q, log.q), (old.rows.x, log.x))
            same &= all(bool(np.array_equal(a[0], b[0])) for a, b in pairs)
        if same and simulated == (old.about.source == "simulation"):
            return
        what = "a model of another robot or log"
    raise calib.OptionError(
        f"{path} is {what}",
        hint="name another file with -o, or replace it with `force=True`",
        parameter="force",
    )


def _stem(source: str | None) -> str:
    return "log" if source in (None, "-") else Path(str(source)).stem


def _file_name(name: str) -> str:
    """Return a name without what would lead to another folder or hide the file."""
    return re.sub(r"[^\w.+-]+", "_", name).lstrip(".") or "robot"
