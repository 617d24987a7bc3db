"""Samples: what a command learns from, babbled or measured, as its options say."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from calib.common.choices import BODIES, VIEWS

from . import parsing
from .options import GRID
from .output import Notes
from .parsing import Columns, JointRange, JointValue, Names
from .units import in_si, kinds_of_joints
from .usage import BadOption, choice, option, refuse

if TYPE_CHECKING:
    from calib import Samples
    from calib.arm.arm import Arm
    from calib.samples.columns import Source

_SAMPLES = 20_000


@dataclass(frozen=True)
class Selection:
    """Which part of a robot, as typed."""

    joints: Names | None = None  # active joints
    tip: str | None = None  # the frame that is sensed
    planar: bool = False  # whether to look only for planar arms within the robot
    lock: list[JointValue] | None = None
    ranges: list[JointRange] | None = None
    degrees: bool = False  # whether joints that turn are typed in degrees

    def load(
        self,
        robot: str | None,
        held: Mapping[str, float] | None = None,
        columns: Collection[str] | None = None,
    ) -> Arm:
        """Load the arm; `held` are further locked joints [rad or m], `columns` those of a log."""
        import calib

        if robot is None:
            raise BadOption("ROBOT is missing: expected a URDF file or a bundled robot")
        # which joints turn is wanted before the arm is loaded, and the file read twice only then
        turns = kinds_of_joints(robot) if self.degrees and (self.lock or self.ranges) else {}
        return calib.load_arm(
            robot,
            list(self.joints) if self.joints else None,
            self.tip,
            lock={**(held or {}), **in_si("--lock", self.lock, turns, self.degrees)},
            ranges=in_si("--range", self.ranges, turns, self.degrees),
            planar=self.planar,
            columns=columns,
        )


@dataclass(frozen=True)
class Babbling:
    """How an arm babbles in simulation, as typed."""

    samples: int | None = None
    noise: float | None = None
    motion: str | None = None
    change: list[str] | None = None


@dataclass(frozen=True)
class Training:
    """What is trained and how, as typed: arguments of `calib.train`."""

    OPTIONS: ClassVar = {
        "motor_size": option(
            "--motor-size N|NxN", "Nodes of the motor map, where they differ.", parsing.size
        ),
        "sensory_size": option(
            "--sensory-size N|NxN", "Nodes of the sensory map, where they differ.", parsing.size
        ),
        "body": choice(
            "--body",
            BODIES,
            "auto fits a kinematic body under the maps; none learns maps and Hebbian links alone.",
        ),
        "view": choice(
            "--view",
            VIEWS,
            "What the sensor measures: base is the robot's root frame; auto is rigid for "
            "lengths, homography for pixels, pinhole for pixels of an arm in space.",
        ),
    }
    map: str | None = None
    size: int | tuple[int, ...] | None = None
    motor_size: int | tuple[int, ...] | None = None
    sensory_size: int | tuple[int, ...] | None = None
    body: str = "auto"
    view: str = "auto"
    rule: str = "batch"
    epochs: int | None = None
    sigma: tuple[float, float] | None = None


@dataclass(frozen=True)
class Grid:
    """Values to try of each option of a training, as typed."""

    OPTIONS: ClassVar = GRID
    size: tuple[Any, ...] | None = None
    map: tuple[Any, ...] | None = None
    rule: tuple[Any, ...] | None = None
    epochs: tuple[Any, ...] | None = None
    sigma: tuple[Any, ...] | None = None
    samples: tuple[Any, ...] | None = None
    noise: tuple[Any, ...] | None = None


@dataclass(frozen=True)
class Logged:
    """What stands in a log, as typed."""

    columns: Columns | None = None
    unit: str | None = None
    prismatic: Names | None = None


def check_sources(
    robots: Sequence[str],
    logged: bool,
    simulated: Mapping[str, object],
    of_logs: Mapping[str, object],
) -> None:
    """Refuse that there is nothing to learn from, and options that would be without effect.

    simulated, of_logs : options of simulated babbling and of logs by name, and what was given
    """
    if not robots and not logged:
        raise BadOption("no source to learn from: expected ROBOT, --data LOG, or both")
    if logged:
        refuse(simulated, "applies to simulated babbling, which --data replaces")
    else:
        refuse(of_logs, "applies to a log: expected --data LOG too")
    if robots and of_logs["prismatic"] is not None:
        raise BadOption("--prismatic applies to a log without ROBOT; ROBOT defines its joints")


def babbled_samples(
    robot: str | None,
    selection: Selection,
    babbling: Babbling,
    seed: int,
    notes: Notes,
) -> Samples:
    """Babble in simulation, and say what was assumed."""
    import calib
    from calib.errors import OptionError
    from calib.samples.changes import parse_changes

    arm = selection.load(robot)
    notes.say(arm.notes)
    turning = [name for name, turns in zip(arm.joint_names, arm.revolute, strict=True) if turns]
    try:
        changes = parse_changes(babbling.change or (), degrees=turning * selection.degrees)
    except OptionError as error:
        raise BadOption(f"--{error}") from None
    shared: dict[str, Any] = {
        "n": _SAMPLES if babbling.samples is None else babbling.samples,
        "seed": seed,
        "noise": babbling.noise or 0.0,
        "changes": changes,
    }
    log = calib.babble(arm, **shared, method=babbling.motion or "uniform")
    notes.say(log.notes)
    return log


def measured_samples(
    robot: str | None,
    selection: Selection,
    path: str,
    logged: Logged,
    seed: int,
    notes: Notes,
    lens: str | None = None,
) -> Samples:
    """Read a log, for the robot where there is one, and say what was assumed."""
    import calib
    from calib.samples.columns import open_source

    arm = None
    turns = {name: name not in (logged.prismatic or ()) for name in selection.joints or ()}
    source = open_source(path)  # once: it may be a pipe
    if robot is not None:
        arm = _arm_of_log(robot, selection, source, logged.columns, notes)
        notes.say(arm.notes)
        turns = dict(zip(arm.joint_names, arm.revolute, strict=True))
    glass = None
    if lens is not None:
        from calib.recording.lens import read_lens

        glass = read_lens(lens).to_json()
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
    )
    notes.say(log.notes)
    return log


def _arm_of_log(
    robot: str,
    selection: Selection,
    source: Source,
    columns: Mapping[str, str] | None,
    notes: Notes,
) -> Arm:
    """Load the arm with its other joints where the log says that they stood."""
    from calib.samples.locked import locked_from_log

    header = {*source.header, *(columns or {})}
    arm = selection.load(robot, columns=header)
    typed = {joint for joint, _ in selection.lock or ()}
    others = [name for name in arm.locked if name not in typed]
    if not others:
        return arm
    turns = kinds_of_joints(robot)
    held, told = locked_from_log(
        source,
        others,
        columns={name: column for name, column in (columns or {}).items() if name in others},
        degrees=selection.degrees,
        prismatic=[name for name in others if not turns.get(name, True)],
    )
    notes.say(told)
    return selection.load(robot, held, header) if held else arm
