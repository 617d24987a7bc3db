"""Loading: an arm from the description of a robot.

A planar arm is a serial chain whose active revolute axes are all parallel to one normal and
whose active prismatic axes are all perpendicular to it. Any other serial chain is a spatial
arm. Joints that are not active are locked.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from ..common.arrays import Array, Range
from ..common.wording import listing, one_line, quoted
from ..errors import OptionError, RobotError
from .arm import PlanarArm, SpatialArm, learned_range, notes_of_turns
from .choice import check_limits, check_lock, choose_joints
from .description import parse_robot
from .finding import FINDING, JointChoice, check_planar, check_tip, plane_normal
from .gravity import standard
from .plane import plane_of
from .posture import Posture, chain_of, posture_of, with_masses
from .robot_text import read_robot_text
from .robots import resolve_robot
from .spatial_chain import SpatialChain
from .urdf import Mimic, Urdf


def load_arm(
    robot: str | Path,
    joints: Sequence[str] | None = None,
    tip: str | None = None,
    *,
    lock: Mapping[str, float] | None = None,
    ranges: Mapping[str, Range] | None = None,
    planar: bool = False,
    columns: Collection[str] | None = None,
    gravity: Sequence[float] | None = None,
) -> PlanarArm | SpatialArm:
    """Load an arm from a URDF or MJCF file or from the bundled robots.

    Parallel axes make a planar arm, whose positions are x and y in its plane. Any others make a
    spatial arm, whose positions are x, y and z in the root link's frame.

    Parameters
    ----------
    robot : str or Path
        Path to a URDF or an MJCF, or the name of a bundled robot.
    joints : sequence of str, optional
        Active joints in any order, 2 to 7; by default those of the chain that reaches furthest,
        before its hand.
    tip : str, optional
        The link (or the fixed joint) whose position is sensed.
    lock : mapping of str to float, optional
        Values [rad or m] of other joints, which do not move (default: neutral).
    ranges : mapping of str to (lower, upper), optional
        Part of a joint's range [rad or m] to babble and learn.
    planar : bool
        Whether to take only the joints that move the tip within one plane.
    columns : collection of str, optional
        Columns of a log: without `joints`, joints that are none of them are locked.
    gravity : (3,) sequence of float, optional
        Where gravity points in the root link's frame, of an arm on a wall or a ceiling; of any
        length. By default along its -z.

    Returns
    -------
    PlanarArm or SpatialArm
        Its `notes` list what was chosen or assumed.

    Raises
    ------
    RobotError, OptionError
        In one line, naming what was given, what was expected and what to do.

    Examples
    --------
    >>> import calib
    >>> arm = calib.load_arm("two_link")
    >>> arm.joint_names, arm.tip, arm.forward([0.0, 0.0]).round(3).tolist()
    (('shoulder', 'elbow'), 'tip', [0.55, 0.0])
    """
    path = resolve_robot(robot)
    text = read_robot_text(path)
    try:
        arm = arm_from_urdf(
            text,
            joints,
            tip,
            lock=lock,
            ranges=ranges,
            name=path.stem,
            planar=planar,
            columns=columns,
        )
    except RobotError as error:
        raise error.within(path.name) from None
    return arm if gravity is None else replace(arm, gravity=standard(gravity))


def arm_from_urdf(
    text: str,
    joints: Sequence[str] | None = None,
    tip: str | None = None,
    *,
    lock: Mapping[str, float] | None = None,
    ranges: Mapping[str, Range] | None = None,
    name: str = "robot",
    planar: bool = False,
    columns: Collection[str] | None = None,
) -> PlanarArm | SpatialArm:
    """Build an arm from the text of a URDF or MJCF; see `load_arm`.

    `name` is used where the text gives its robot none.
    """
    urdf = parse_robot(text, name)
    lock = dict(lock or {})
    check_lock(urdf, lock)
    ranges = dict(ranges or {})
    choice, notes = choose_joints(
        urdf,
        posture_of(urdf, lock),
        joints=joints,
        tip=tip,
        lock=lock,
        ranges=ranges,
        planar=planar,
        columns=columns,
    )
    active = choice.joints
    names = [joint.name for joint in active]
    moving = _moving_joints(urdf, choice, lock)
    at_zero = posture_of(urdf, {**lock, **dict.fromkeys(moving, 0.0)})
    normal = _normal(choice, moving, at_zero, planar)
    chain = chain_of(urdf, moving, names, choice.tip, at_zero)
    make: Callable[..., PlanarArm | SpatialArm]
    if normal is None:
        make = SpatialArm
        chain = with_masses(chain, urdf, at_zero, moving)
    else:
        plane = plane_of(normal, at_zero.place(choice.tip))
        make = partial(PlanarArm, plane=plane)

    without_range = [joint for joint in active if joint.name not in ranges]
    check_limits(without_range)
    locked, locked_notes = _locked_joints(urdf, choice, moving, lock)
    turning = {j.name: j.travel for j in without_range if j.revolute}
    notes += [*locked_notes, *notes_of_turns(turning), *_notes_of_size(chain)]
    travel = tuple(joint.travel for joint in active)
    learned = [learned_range(joint.travel, joint.revolute) for joint in active]
    lower, upper = np.transpose(learned)
    arm = make(
        name=urdf.name,
        joint_names=tuple(names),
        lower=lower,
        upper=upper,
        revolute=tuple(joint.revolute for joint in active),
        tip=choice.tip,
        locked=locked,
        urdf=text,
        notes=tuple(map(one_line, (*urdf.notes, *notes))),
        limits=travel,
        travel=travel,
        chain=chain,
    )
    return arm.with_range(ranges)


def _notes_of_size(chain: SpatialChain) -> list[str]:
    """Return a note on an arm that is longer than any, whose lengths may be in mm."""
    if chain.reach < FINDING.giant:
        return []
    return [
        f"links of {chain.reach:.4g} m in all: lengths in a URDF are in metres; if these are in "
        "mm, correct them"
    ]


def _moving_joints(
    urdf: Urdf, choice: JointChoice, lock: Collection[str]
) -> dict[str, Mimic]:
    """Return the joints that move the tip, base to tip, each with the active joint it follows.

    An active joint follows itself.
    """
    names = [joint.name for joint in choice.joints]
    moving: dict[str, Mimic] = {}
    for joint in urdf.path(choice.tip):
        mimic = urdf.mimic_of(joint, lock)
        if joint.movable and mimic.leader in names:
            moving[joint.name] = mimic
    return moving


def _normal(
    choice: JointChoice,
    moving: Mapping[str, Mimic],
    posture: Posture,
    planar: bool,
) -> Array | None:
    """Return the unit normal (3,) of a planar arm's plane, None of an arm in space.

    An arm with mimic joints on the way to its tip is one in space.
    """
    names = [joint.name for joint in choice.joints]
    if planar:
        check_planar(choice.joints, posture)
    normal = plane_normal(choice.joints, posture)
    mimics = [name for name in moving if name not in names]
    if mimics and planar:
        raise RobotError(
            f"joint {quoted(mimics[0])} mimics the active {quoted(moving[mimics[0]].leader)} on "
            "the way to the tip: expected no such joint in a planar arm; choose others"
        )
    if normal is not None and not mimics:
        check_tip(choice.joints[-1], choice.tip, posture)
        return normal
    if len(names) > FINDING.most_joints:
        raise OptionError(
            f"`joints` names {len(names)} joints, expected 2 to {FINDING.most_joints}",
            hint="lock the others",
            parameter="joints",
        )
    return None


def _locked_joints(
    urdf: Urdf,
    choice: JointChoice,
    moving: Collection[str],
    lock: Mapping[str, float],
) -> tuple[dict[str, float], list[str]]:
    """Return values [rad or m] of the joints before the tip that do not move, and notes."""
    values = urdf.values(lock)
    locked = {
        joint.name: values[joint.name]
        for joint in urdf.path(choice.tip)
        if joint.movable and joint.name not in moving
    }
    neutral = [
        f"{name}={value:.4g}"
        for name, value in locked.items()
        if name not in lock
    ]
    if not neutral:
        return locked, []
    note = f"locked at neutral: {listing(neutral, 8)} (`lock` changes it)"
    return locked, [note]
