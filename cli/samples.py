"""Samples: what a command learns from, babbled or measured, as its options say."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING

from .output import say
from .parsing import BadOption, JointRange, JointValue
from .units import in_si, kinds_of_joints

if TYPE_CHECKING:
    from calib import Samples
    from calib.arm.arm import Arm
    from calib.model.model import Model
    from calib.samples.tables import Source

_SAMPLES = 20_000  # that are babbled where nobody says how many


@dataclass(frozen=True, kw_only=True)
class Selection:
    """Which part of a robot, as typed."""

    joints: Sequence[str] | None = None
    tip: str | None = None
    planar: bool = False
    lock: Sequence[JointValue] | None = None
    ranges: Sequence[JointRange] | None = None
    degrees: bool = False
    gravity: tuple[float, ...] | None = None

    def load(
        self,
        robot: str | None,
        locked: Mapping[str, float] | None = None,
        columns: Collection[str] | None = None,
    ) -> Arm:
        """Load the arm; `held` are further locked joints [rad or m], `columns` those of a log."""
        import calib

        if robot is None:
            raise BadOption("ROBOT is missing: expected a URDF file or a bundled robot")
        # which joints turn is wanted before the arm is loaded, and the file read twice only then
        turns = (
            kinds_of_joints(robot)
            if self.degrees and (self.lock or self.ranges)
            else {}
        )
        return calib.load_arm(
            robot,
            list(self.joints) if self.joints else None,
            self.tip,
            lock={**(locked or {}), **in_si("--lock", self.lock, turns, self.degrees)},
            ranges=in_si("--range", self.ranges, turns, self.degrees),
            planar=self.planar,
            columns=columns,
            gravity=self.gravity,
        )


@dataclass(frozen=True, kw_only=True)
class Babbling:
    """How an arm babbles in simulation, as typed."""

    samples: int | None = None
    noise: float | None = None
    change: Sequence[str] | None = None


@dataclass(frozen=True, kw_only=True)
class Reading:
    """How a log is read, as typed; with a model what is None is as in the log it was made from."""

    columns: Mapping[str, str] | None = None
    unit: str | None = None
    time_offset: float | None = None


@dataclass(frozen=True, kw_only=True)
class Logged(Reading):
    """How a log is read that a model is made from."""

    prismatic: Sequence[str] | None = None


@dataclass(frozen=True, kw_only=True)
class Compared(Reading):
    """How a log is read that stands beside a model."""

    degrees: bool | None = None


@dataclass(frozen=True, kw_only=True)
class Sockets:
    """What is known of the points that a log's rows touched, as typed."""

    distance: Sequence[str] | None = None
    plane: Sequence[str] | None = None

    def of(self, log: Samples) -> Samples:
        """The log with what was typed."""
        if log.touch is None:
            refuse(
                vars(self), "is of touched points: expected a log with a column `point`"
            )
            return log
        return replace(
            log, touch=log.touch.stated(self.distance or (), self.plane or ())
        )


def check_sources(
    robots: Sequence[str],
    logged: bool,
    simulated: Mapping[str, object],
    of_logs: Mapping[str, object],
) -> None:
    """Refuse that there is nothing to learn from, and options that would be without effect."""
    if not robots and not logged:
        raise BadOption("no source to learn from: expected ROBOT, --data LOG, or both")
    if logged:
        refuse(simulated, "applies to simulated babbling, which --data replaces")
    else:
        refuse(of_logs, "applies to a log: expected --data LOG too")
    if robots and of_logs["prismatic"] is not None:
        raise BadOption(
            "--prismatic applies to a log without ROBOT; ROBOT defines its joints"
        )


def babbled_samples(
    robot: str | None, selection: Selection, babbling: Babbling, seed: int
) -> Samples:
    """Babble in simulation, and say what was assumed."""
    import calib
    from calib.errors import OptionError
    from calib.samples.changes import parse_changes

    arm = selection.load(robot)
    say(arm.notes)
    turning = [
        name for name, turns in zip(arm.joint_names, arm.revolute, strict=True) if turns
    ]
    try:
        changes = parse_changes(
            babbling.change or (), degrees=turning * selection.degrees
        )
    except OptionError as error:
        raise BadOption(f"--{error}") from None
    n = babbling.samples or _SAMPLES
    noise = babbling.noise or 0.0
    return calib.babble(arm, n, seed=seed, noise=noise, changes=changes)


def measured_samples(
    robot: str | None,
    selection: Selection,
    path: str | Source,
    logged: Logged,
    seed: int = 0,
    lens: str | None = None,
    sensor: str = "",
) -> Samples:
    """Read a log, for the robot where there is one, and say what was assumed."""
    import calib
    from calib.samples.tables import open_source

    arm = None
    glass = None
    turns = {
        name: name not in (logged.prismatic or ()) for name in selection.joints or ()
    }
    source = open_source(path)  # once: it may be a pipe
    if robot is not None:
        arm = _arm_of_log(robot, selection, source, logged.columns or {})
        say(arm.notes)
        turns = dict(zip(arm.joint_names, arm.revolute, strict=True))
    if lens is not None:
        from calib.recording.lens import load_lens

        glass = load_lens(lens)[0].to_json()
    log = calib.read_log(
        source,
        arm,
        joints=list(selection.joints) if selection.joints and arm is None else None,
        columns=logged.columns,
        degrees=selection.degrees,
        unit=logged.unit,
        ranges=in_si("--range", selection.ranges, turns, selection.degrees),
        prismatic=logged.prismatic or (),
        seed=seed,
        lens=glass,
        time_offset=logged.time_offset,
    )
    if sensor:
        log = replace(log, sensor=sensor)
        say(f"{sensor}: {note}" for note in log.notes)
    else:
        say(log.notes)
    return log


def measured_by_sensors(
    robot: str | None,
    selection: Selection,
    paths: Sequence[str],
    logged: Logged,
    seed: int = 0,
    lens: str | None = None,
) -> list[Samples]:
    """Read the log of each sensor, a file each or by a column `sensor`; see `measured_samples`."""
    from calib.samples.sensors import sources_by_sensor

    return [
        measured_samples(robot, selection, source, logged, seed, lens, sensor)
        for sensor, source in sources_by_sensor(paths).items()
    ]


def _arm_of_log(
    robot: str, selection: Selection, source: Source, columns: Mapping[str, str]
) -> Arm:
    """Load the arm with its other joints where the log says that they stood."""
    from calib.samples.joint_values import locked_from_log

    header = {*source.header, *columns}
    arm = selection.load(robot, columns=header)
    # its locked joints turn the last link of a planar arm about its joint, as an offset does
    if selection.tip is None and arm.outputs == 2 and arm.locked:
        say(
            [
                f"positions are taken as those of {arm.tip}; "
                "`tip` names the frame that was measured"
            ]
        )
    others = {*arm.locked} - {joint for joint, _ in selection.lock or ()}
    turns = kinds_of_joints(robot) if others else {}
    locked, notes = locked_from_log(
        source,
        [name for name in arm.locked if name in others],
        columns=columns,
        degrees=selection.degrees,
        prismatic=[n for n in others if not turns.get(n, True)],
    )
    say(notes)
    return selection.load(robot, locked, header) if locked else arm


def refuse(typed: Mapping[str, object], why: str) -> None:
    """Refuse the first of some options that was given; None is not given."""
    for name, value in typed.items():
        if value is not None:
            raise BadOption(f"--{name.replace('_', '-')} {why}")


def log_for(model: Model, path: str, reading: Compared) -> Samples:
    """Read a log of a model's joints, in the model's unit where that is known."""
    import calib
    from calib.common.scale import METRES
    from calib.errors import LogError
    from calib.samples.joint_values import check_joint_values
    from calib.samples.tables import open_source

    source = open_source(path)  # once: it may be a pipe
    sensor = sensor_of_log(model, source)
    model = model.by(sensor)
    about = model.about
    unit = reading.unit or source.unit
    # pixels and metres have no factor between them, and the plane of a camera model is another
    if unit is not None and (unit == "px") != (about.unit == "px"):
        raise LogError(
            f"{path} is in {unit}, the model in {about.unit}",
            hint="record it with the same reference as the model's log, or train a model of it",
        )
    degrees = about.degrees if reading.degrees is None else reading.degrees
    log = calib.read_log(
        source,
        joints=list(about.joint_names),
        columns=reading.columns,
        time_offset=reading.time_offset,
        usual=about.columns,
        outputs=len(model.axes),
        degrees=degrees,
        unit=unit or about.unit,
        prismatic=[
            n for n, t in zip(about.joint_names, about.revolute, strict=True) if not t
        ],
    )
    if sensor:
        log = replace(log, sensor=sensor)
    say(log.notes)
    ranges = (about.joint_names, about.lower, about.upper, about.revolute)
    check_joint_values(log.q, *ranges, degrees=degrees, label=path)
    if unit is not None and unit != about.unit and {unit, about.unit} <= set(METRES):
        factor = METRES[about.unit] / METRES[unit]
        say([f"positions converted from {unit} to {about.unit}"])
        # that noise is a length too, in the unit of the log that states it
        shared = {"noise_of_reference": log.shared * factor}
        log = replace(
            log, x=log.x * factor, unit=about.unit, source={**log.source, **shared}
        )
    return log


def sensor_of_log(model: Model, source: Source) -> str:
    """Name the sensor of a log among a model's: by its column `sensor`, or the file's name.

    It is the first one's where neither says another.
    """
    from calib.errors import LogError
    from calib.samples.sensors import names_of_sensors

    if len(model.sensors) == 1:
        return ""
    names = names_of_sensors(source) or (Path(source.label).stem,)
    measured = [name for name in names if name in model.sensors]
    if len(measured) > 1:
        raise LogError(
            f"{source.label} has rows of {', '.join(measured)}: expected a log of one sensor",
            hint="write the rows of each sensor to a file of its own",
        )
    return measured[0] if measured else model.sensors[0]


def log_of(model: Model, path: str | None, reading: Compared) -> Samples | None:
    """Read a log to look at, with a note where it does not fit the model; None for none."""
    import numpy as np

    from calib.samples.diagnosis import spread, unit_hint

    if path is None:
        typed = {field.name: getattr(reading, field.name) for field in fields(Compared)}
        refuse(typed, "applies to a log: expected --data LOG too")
        return None
    log = log_for(model, path, reading)
    predicted = model.forward(log.q)
    answered = np.isfinite(predicted[:, 0])
    if log.touch is not None or not answered.any():
        return log
    # medians: single wrong rows decide nothing; the bound of an ideal arm is rounding
    gap = float(np.nanmedian(np.linalg.norm(predicted - log.x, axis=1)))
    bound = float(np.nanmedian(model.expected_error(log.q)))
    size = spread(predicted)
    if gap > max(3.0 * bound, 0.02 * size):
        hint = unit_hint(spread(log.x[answered]) / max(size, 1e-300))
        far = f"{gap / size:.2g} times their spread{hint}; calib check names the cause"
        say([f"the log does not fit the model: measured positions are off by {far}"])
    return log
