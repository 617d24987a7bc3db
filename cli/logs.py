"""Logs: what a command learns from or compares, babbled or measured, by its options."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import calib
from calib.common.wording import by_name, listing

from .output import say
from .parsing import BadOption, OfJoint, refuse
from .units import in_si, revolute_joints

if TYPE_CHECKING:
    from calib.arm.arm import Arm
    from calib.samples.tables import Source

FOR_LOGS = "applies to a log: expected --data LOG too"
ANY_SENSOR = "sensor"
"""What `--in` is where no sensor is typed."""


@dataclass(frozen=True)
class Selection:
    """Which part of a robot, as typed."""

    joints: Sequence[str] | None = None
    tip: str | None = None
    planar: bool = False
    lock: Sequence[OfJoint] | None = None
    ranges: Sequence[OfJoint] | None = None
    degrees: bool = False
    gravity: Sequence[float] | None = None

    def load(
        self,
        robot: str | None,
        locked: Mapping[str, float] | None = None,
        columns: Collection[str] | None = None,
    ) -> Arm:
        """Load the arm; `locked` are further joints [rad or m], `columns` those of a log."""
        if robot is None:
            raise BadOption(
                "ROBOT is missing: expected a URDF file or a bundled robot"
            )
        revolute: dict[str, bool] = {}
        # which joints turn is wanted before the arm is loaded: the file is read twice
        if self.degrees and (self.lock or self.ranges):
            revolute = revolute_joints(robot)
        lock = in_si("--lock", self.lock, revolute, self.degrees)
        return calib.load_arm(
            robot,
            self.joints,
            self.tip,
            lock={
                **(locked or {}),
                **{name: value for name, (value, _) in lock.items()},
            },
            ranges=in_si("--range", self.ranges, revolute, self.degrees),
            planar=self.planar,
            columns=columns,
            gravity=self.gravity,
        )


@dataclass(frozen=True)
class LogFormat:
    """How a log is read, as typed; with a model None means as in the model's own log."""

    columns: Mapping[str, str] | None = None
    unit: str | None = None
    time_offset: float | None = None
    degrees: bool | None = None
    prismatic: Sequence[str] | None = None


def babble_log(
    robot: str | None,
    selection: Selection,
    samples: int | None,
    noise: float | None,
    change: Sequence[str] | None,
    seed: int,
) -> calib.Samples:
    """Babble in simulation, and report what was assumed."""
    from calib.errors import OptionError
    from calib.samples.simulation import parse_changes

    arm = selection.load(robot)
    say(arm.notes)
    joints = zip(arm.joint_names, arm.revolute, strict=True)
    in_degrees = [
        name for name, revolute in joints if revolute and selection.degrees
    ]
    try:
        changes = parse_changes(change or (), degrees=in_degrees)
    except OptionError as error:
        raise BadOption(f"--{error}") from None
    n = 20_000 if samples is None else samples
    return calib.babble(arm, n, seed=seed, noise=noise or 0.0, changes=changes)


def read_measured_log(
    robot: str | None,
    selection: Selection,
    path: str | Source,
    log_format: LogFormat,
    lens: str | None = None,
    sensor: str = "",
) -> calib.Samples:
    """Read a log, for the robot where there is one, and report what was assumed."""
    from calib.samples.tables import open_source, refuse_unnamed

    source = open_source(path)  # once: it may be a pipe
    refuse_unnamed(source)
    sliding = log_format.prismatic or ()
    arm = None
    joints = selection.joints
    revolute = {name: name not in sliding for name in joints or ()}
    if robot is not None:
        arm = _arm_of_log(robot, selection, source, log_format.columns or {})
        say(arm.notes)
        joints = None
        revolute = by_name(arm.joint_names, arm.revolute)
    known_lens = None
    if lens is not None:
        from calib.recording.lens import load_lens

        known_lens = load_lens(lens)[0].to_json()
    log = calib.read_log(
        source,
        arm,
        joints=joints,
        columns=log_format.columns,
        degrees=selection.degrees,
        unit=log_format.unit,
        ranges=in_si("--range", selection.ranges, revolute, selection.degrees),
        prismatic=sliding,
        lens=known_lens,
        time_offset=log_format.time_offset,
    )
    if sensor:
        say(f"{sensor}: {note}" for note in log.notes)
        return replace(log, sensor=sensor)
    say(log.notes)
    return log


def _arm_of_log(
    robot: str, selection: Selection, source: Source, columns: Mapping[str, str]
) -> Arm:
    """Load the arm with its other joints at their values in the log."""
    from calib.samples.column_units import find_column
    from calib.samples.locked_joints import locked_joint_values

    revolute = revolute_joints(robot)
    header = {name for name in revolute if find_column(source.header, name)}
    header |= {*source.header, *columns}
    arm = selection.load(robot, columns=header)
    # its locked joints turn the last link of a planar arm about its joint, as an offset does
    if selection.tip is None and arm.outputs == 2 and arm.locked:
        tip = f"positions are taken as those of {arm.tip}"
        say([f"{tip}; `tip` names the frame that was measured"])
    typed = {value.joint for value in selection.lock or ()}
    others = [name for name in arm.locked if name not in typed]
    locked, notes = locked_joint_values(
        source,
        others,
        columns=columns,
        degrees=selection.degrees,
        prismatic=[name for name in others if not revolute[name]],
    )
    say(notes)
    return selection.load(robot, locked, header) if locked else arm


def with_facts(
    log: calib.Samples,
    distance: Sequence[str] | None,
    plane: Sequence[str] | None,
) -> calib.Samples:
    """Return a log with what was typed of the points that its rows touched."""
    if log.touch is None:
        why = "is of touched points: expected a log with a column `point`"
        refuse({"distance": distance, "plane": plane}, why)
        return log
    return replace(
        log, touch=log.touch.with_stated_facts(distance or (), plane or ())
    )


def log_for(
    model: calib.Model,
    path: str,
    log_format: LogFormat,
    sensor: str = ANY_SENSOR,
) -> calib.Samples:
    """Read a log of a model's joints, in the model's unit where that is known.

    sensor : that measured it, as typed
    """
    from calib.common.scale import METRES
    from calib.errors import LogError
    from calib.samples.joint_values import check_joint_values
    from calib.samples.tables import names_of_sensors, open_source

    source = open_source(path)  # once: it may be a pipe
    names = names_of_sensors(source)
    sensor = sensor_of_log(model, source.label, names, sensor)
    if sensor in names:
        source = source.of_sensor(sensor)
    model = model.by(sensor)
    about = model.about
    unit = log_format.unit or source.unit or about.unit
    # other units have no factor between them, and the plane of a camera model is another
    if unit != about.unit and not {unit, about.unit} <= METRES.keys():
        raise LogError(
            f"{path} is in {unit}, the model in {about.unit}",
            hint="give `unit` as the model has it, record it with the same reference as the "
            "model's log, or train a model of it",
        )
    degrees = (
        about.degrees if log_format.degrees is None else log_format.degrees
    )
    joints = zip(about.joint_names, about.revolute, strict=True)
    usual = {k: v for k, v in about.columns.items() if v in source.header}
    log = calib.read_log(
        source,
        joints=about.joint_names,
        columns={**usual, **(log_format.columns or {})},
        time_offset=log_format.time_offset,
        outputs=len(model.axes),
        degrees=degrees,
        unit=unit,
        prismatic=[name for name, revolute in joints if not revolute],
    )
    if sensor:
        log = replace(log, sensor=sensor)
    if about.board:
        from calib.recording.board_pictures import with_lens_of

        log = with_lens_of(model, log)
    say(log.notes)
    ranges = (about.joint_names, about.lower, about.upper, about.revolute)
    check_joint_values(log.q, *ranges, degrees=degrees, label=path)
    if unit == about.unit:
        return log
    factor = METRES[about.unit] / METRES[unit]
    say([f"positions converted from {unit} to {about.unit}"])
    # that noise is a length too, in the unit of the log that states it
    facts = {**log.source, "noise_of_reference": log.common_sd * factor}
    return replace(log, x=log.x * factor, unit=about.unit, source=facts)


def sensor_of_log(
    model: calib.Model, label: str, names: Sequence[str], typed: str
) -> str:
    """Name the sensor, among a model's, that measured a log: as typed, else as the log says.

    label : name of the log's file
    names : in its column `sensor`; the file's name counts where there are none
    Raises LogError where neither says one of several sensors.
    """
    from calib.errors import LogError

    check_sensor(model, typed)
    sensors = [name for name in model.sensors if name]
    column = f"the column `sensor` of {label} names {listing(names)}"
    if typed != ANY_SENSOR and typed in sensors:
        if typed not in names and {*names} & {*sensors}:
            raise BadOption(f"--in {typed}: {column}")
        return typed
    if not sensors or (len(sensors) == 1 and not names):
        return ""
    said = tuple(names) or (Path(label).stem,)
    if len(said) == 1 and said[0] in sensors:
        return said[0]
    what = column if names else f"{label} is named after no sensor"
    raise LogError(
        f"{what}: expected one of the model's, {listing(sensors)}",
        hint="say --in SENSOR, or name the file, or its rows in the column `sensor`, after it",
    )


def check_sensor(model: calib.Model, typed: str, *others: str) -> None:
    """Refuse what `--in` names, if it is none of a model's sensors and of `others`."""
    sensors = [name for name in model.sensors if name]
    if typed not in (*sensors, *others, ANY_SENSOR):
        choices = (*(sensors or [ANY_SENSOR]), *others)
        raise BadOption(f"--in {typed!r}: expected {', '.join(choices)}")


def log_of(
    model: calib.Model,
    path: str | None,
    log_format: LogFormat,
    sensor: str = ANY_SENSOR,
) -> calib.Samples | None:
    """Read a log to look at; None where none is given."""
    if path is None:
        refuse(vars(log_format), FOR_LOGS)
        return None
    return log_for(model, path, log_format, sensor)
