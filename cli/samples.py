"""Samples: what a command learns from, babbled or measured, as its options say."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from . import options as opt
from .measurements import refuse
from .output import say
from .parsing import BadOption
from .units import in_si, kinds_of_joints

if TYPE_CHECKING:
    from calib import Samples
    from calib.arm.arm import Arm
    from calib.samples.tables import Source

_SAMPLES = 20_000  # that are babbled where nobody says how many


@dataclass(frozen=True, kw_only=True)
class Selection:
    """Which part of a robot, as typed."""

    joints: opt.JointNames = None
    tip: opt.Tip = None
    planar: opt.Planar = False
    lock: opt.Lock = None
    ranges: opt.Ranges = None
    degrees: opt.Degrees = False

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


@dataclass(frozen=True, kw_only=True)
class Babbling:
    """How an arm babbles in simulation, as typed."""

    samples: opt.Number = None
    noise: opt.Noise = None
    change: opt.Changes = None


@dataclass(frozen=True, kw_only=True)
class Logged:
    """What stands in a log, as typed."""

    columns: opt.Columns = None
    unit: opt.Unit = None
    time_offset: opt.TimeOffset = None
    prismatic: opt.Prismatic = None


@dataclass(frozen=True, kw_only=True)
class Sockets:
    """What is known of the points that a log's rows touched, as typed."""

    distance: opt.Distances = None
    plane: opt.Planes = None

    def of(self, log: Samples) -> Samples:
        """The log with what was typed."""
        if log.touch is None:
            refuse(vars(self), "is of touched points: expected a log with a column `point`")
            return log
        return replace(log, touch=log.touch.stated(self.distance or (), self.plane or ()))


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
        raise BadOption("--prismatic applies to a log without ROBOT; ROBOT defines its joints")


def babbled_samples(
    robot: str | None, selection: Selection, babbling: Babbling, seed: int
) -> Samples:
    """Babble in simulation, and say what was assumed."""
    import calib
    from calib.errors import OptionError
    from calib.samples.changes import parse_changes

    arm = selection.load(robot)
    say(arm.notes)
    turning = [name for name, turns in zip(arm.joint_names, arm.revolute, strict=True) if turns]
    try:
        changes = parse_changes(babbling.change or (), degrees=turning * selection.degrees)
    except OptionError as error:
        raise BadOption(f"--{error}") from None
    n, noise = babbling.samples or _SAMPLES, babbling.noise or 0.0
    return calib.babble(arm, n, seed=seed, noise=noise, changes=changes)


def measured_samples(
    robot: str | None,
    selection: Selection,
    path: str,
    logged: Logged,
    seed: int = 0,
    lens: str | None = None,
) -> Samples:
    """Read a log, for the robot where there is one, and say what was assumed."""
    import calib
    from calib.samples.tables import open_source

    arm = None
    turns = {name: name not in (logged.prismatic or ()) for name in selection.joints or ()}
    source = open_source(path)  # once: it may be a pipe
    if robot is not None:
        arm = _arm_of_log(robot, selection, source, logged.columns or {})
        say(arm.notes)
        turns = dict(zip(arm.joint_names, arm.revolute, strict=True))
    glass = None
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
    say(log.notes)
    return log


def _arm_of_log(
    robot: str, selection: Selection, source: Source, columns: Mapping[str, str]
) -> Arm:
    """Load the arm with its other joints where the log says that they stood."""
    from calib.samples.log_joints import locked_from_log

    header = {*source.header, *columns}
    arm = selection.load(robot, columns=header)
    # its locked joints turn the last link of a planar arm about its joint, as an offset does
    if selection.tip is None and arm.outputs == 2 and arm.locked:
        say([f"positions are taken as those of {arm.tip}; `tip` names the frame that was measured"])
    typed = {joint for joint, _ in selection.lock or ()}
    others = [name for name in arm.locked if name not in typed]
    if not others:
        return arm
    turns = kinds_of_joints(robot)
    held, told = locked_from_log(
        source,
        others,
        columns={name: column for name, column in columns.items() if name in others},
        degrees=selection.degrees,
        prismatic=[name for name in others if not turns.get(name, True)],
    )
    say(told)
    return selection.load(robot, held, header) if held else arm
