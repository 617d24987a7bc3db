"""Notes: remarks on a calibration for people, and what limits its accuracy."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import radians

import numpy as np

from ..arm.arm import SpatialArm
from ..body.covariance import Z95
from ..common.arrays import Array, Mask
from ..common.scale import METRES
from ..common.wording import listing, two_digits
from .bundle import POSE_SIZE
from .fit import CornerFit
from .joint_motions import JointMotions
from .problem import Problem
from .refusals import turning
from .rig import HandEye


@dataclass(frozen=True)
class NoteLimits:
    """Limits beyond which a note is written."""

    # least spread of the hand's turns [rad]
    turn: float = radians(7.5)
    open: float = (
        0.01  # half of an interval beyond which a direction is unknown [m]
    )
    size: float = 4e-3  # of a board's size
    unit: float = 0.05  # of a factor between two units
    focal: float = 2e-3  # of the focal length of a lens that was given
    doubtful: float = 0.01  # of the focal length, half of its interval
    focus: float = 1e-3  # sd of the focal length from picture to picture
    # [px], sd of a corner beyond what lens and board explain
    corner: float = 0.5
    posed: float = (
        0.2  # sd of a corner of boards that were given as poses [deg]
    )
    repeats: tuple[float, float] = (
        1e-4,
        3.5e-4,
    )  # repeatability by joints [m, rad]
    poses: tuple[float, float] = (
        1e-3,
        radians(0.2),
    )  # by flange poses [m, rad]
    # largest errors of a drawing's joint origins [m, rad]
    drawing: tuple[float, float] = (5e-3, radians(1.0))
    near: float = (
        0.3  # plausible distance of what is in the hand from the flange [m]
    )
    # poses up to which noise hides that camera or board was moved: with 5 in 6 of 10 worlds, with 6
    # seldom
    few: int = 6


NOTE_LIMITS = NoteLimits()


def limit_of(problem: Problem, rig: HandEye, agreeing: Mask) -> str:
    """What limits the accuracy, and what would help most."""
    turns, _ = turning(rig.flange[agreeing])
    wrist = "the hand"
    if problem.arm is not None:
        wrist = listing(problem.arm.joint_names[-2:])
    add = f"add pictures with {wrist} turned by 30 deg and more, each way"
    if turns[1] < NOTE_LIMITS.turn:
        return f"few turns of the wrist (by {np.degrees(turns[1]):.1f} deg about one axis); {add}"
    focal = rig.lens["focal_95"] / rig.lens["focal"]
    if focal > NOTE_LIMITS.doubtful:
        return (
            f"the lens (its focal length is known to {100 * focal:.1f} %); add pictures with the "
            "board tilted, nearer and further away, or give a lens"
        )
    hand = 1e3 * max(rig.hand["position_95_up_to_gauge"])
    return (
        f"the arm, which repeats to {rig.repeats} (what is in the hand is known to "
        f"{two_digits(hand)} mm); {add}, or let the arm stand still for each"
    )


def notes_of(
    problem: Problem, fit: CornerFit, rig: HandEye, agreeing: Mask
) -> tuple[str, ...]:
    """All notes on a calibration."""
    notes: list[str] = []
    for view in problem.views:
        camera = f"{view.name}: " if len(problem.views) > 1 else ""
        notes += [f"{camera}{note}" for note in view.notes]
    choice = problem.choice
    if choice is not None:
        convention = choice.convention
        words = f"the next reading fits {convention['ratio']:.3g} times worse"
        if choice.ties:
            words = (
                f"not told apart from it: {', or '.join(choice.ties)}; give `rotation`, or add "
                "pictures with the hand at other places"
            )
        notes.append(
            f"poses are read as {choice.reading.words}, lengths in {convention['unit']}; {words}"
        )
    notes += _contradicting(rig, agreeing)
    notes += _open(rig, agreeing)
    # what was moved, a little, looks as of another focal length, too
    arm = problem.arm
    if arm is not None:
        notes += _arm(problem, arm, fit, rig)
    else:
        notes += _poses(rig)
    if problem.views[0].is_of_poses:
        notes += _posed_boards(fit, rig)
    else:
        notes += _size(rig)
        notes += _lenses(problem, fit)
    return tuple(notes)


def _contradicting(rig: HandEye, agreeing: Mask) -> Iterator[str]:
    names = rig.left_out
    if not names:
        return
    count = np.count_nonzero(~agreeing)
    is_end = count > 1 and not agreeing[-count:].any()
    where = f"from {names[0]} on" if is_end else "in them"
    yield (
        f"pictures contradict the others and are left out ({listing(names)}): {where} "
        "camera or board was moved, the camera refocused or zoomed, or the joints or poses are "
        "not theirs"
    )


def _open(rig: HandEye, agreeing: Mask) -> Iterator[str]:
    """A direction that the motions hardly determine, and two poses that would."""
    if max(rig.hand["position_95_up_to_gauge"]) < NOTE_LIMITS.open:
        return
    squares, directions = np.linalg.eigh(rig.covariance[3:6, 3:6])
    half = 1e3 * Z95 * float(np.sqrt(max(squares[-1], 0.0)))
    turns, axes = turning(rig.flange[agreeing])
    first, second, third = map(two_digits, np.degrees(turns).tolist())
    yield (
        f"what is in the hand is open along {_direction(directions[:, -1])} of the flange, to "
        f"± {two_digits(half)} mm: "
        f"the hand turns by {first} deg about one axis, by {second} and {third} about the others. "
        f"Two poses more determine it: turned by 30 deg about {_direction(axes[1])} and about "
        f"{_direction(axes[2])} of the flange"
    )


def _direction(axis: Array) -> str:
    """A direction (3,) in words."""
    return f"({', '.join(f'{value:+.2f}' for value in axis)})"


def _is_of_another_size(rig: HandEye) -> bool:
    """Whether the board is not of the stated size."""
    stated = rig.square["said"]
    low, high = rig.square["interval"]
    off = abs(rig.square["measured"] / stated - 1.0)
    return off > NOTE_LIMITS.size and not low < stated < high


def _size(rig: HandEye) -> Iterator[str]:
    if _is_of_another_size(rig):
        low, high = rig.square["interval"]
        yield (
            f"the board's squares measure {1e3 * rig.square['measured']:.4g} mm (95 %: "
            f"{1e3 * low:.4g} to {1e3 * high:.4g}) by the arm's motions, "
            f"{1e3 * rig.square['said']:.4g} mm as said: the measured "
            "size is used; measure the print, and give its size in `board`"
        )


def _posed_boards(fit: CornerFit, rig: HandEye) -> Iterator[str]:
    """Notes by motions on boards that were given as poses."""
    if _is_of_another_size(rig):
        ratio = rig.square["said"] / rig.square["measured"]
        side = "long" if ratio > 1.0 else "short"
        off = f"{two_digits(100 * abs(ratio - 1.0))} %"
        why = "of a tag of another size"
        for unit, factor in METRES.items():
            if unit != "m" and abs(ratio / factor - 1.0) < NOTE_LIMITS.unit:
                off = f"{factor:.4g} times"
                why = f"where they are in {unit} and no m"
        yield (
            f"shifts of the boards are {off} too {side} by the arm's motions, as {why}: the "
            "motions' size is used"
        )
    turn = np.degrees(fit.noise.corner[0] / rig.lens["focal"])
    if turn > NOTE_LIMITS.posed:
        yield (
            f"the boards are seen {two_digits(turn)} deg beside where the motions put their "
            "corners: a small or blurred tag, or another lens, of which intervals know the "
            "scatter alone"
        )


def _lenses(problem: Problem, fit: CornerFit) -> Iterator[str]:
    lenses = problem.bundle.layout.lenses
    for number, view in enumerate(problem.views):
        focus = float(fit.noise.error[POSE_SIZE + number])
        corner = float(fit.noise.corner[number])
        if corner > NOTE_LIMITS.corner:
            yield (
                f"{view.name}: corners are off by {two_digits(corner)} px, whatever lens and board "
                "are: blurred pictures, or a lens that five terms do not describe (fisheye), "
                "of which the intervals know nothing"
            )
        elif focus > NOTE_LIMITS.focus:
            yield (
                f"{view.name}: the focal length changes by {two_digits(100 * focus)} % from "
                "picture to picture: switch the camera's autofocus off and take the pictures "
                "again; the intervals are wider for it"
            )
        if view.stated_lens is None:
            continue
        focal = fit.unknowns.values[lenses[number, :2]].mean()
        given = float(view.stated_lens.focal.mean())
        off = focal / given - 1.0
        if abs(off) > NOTE_LIMITS.focal:
            yield (
                f"the lens that was given has a focal length of {given:.1f} px, the pictures show "
                f"{focal:.1f} ({100 * off:+.2g} %): it is of another camera, or the camera "
                "refocused or zoomed; the lens of the pictures is used"
            )


def _moved(rig: HandEye) -> str:
    """The words that something was moved, and whether the pictures would show it."""
    words = "camera or board was moved"
    if len(rig.names) <= NOTE_LIMITS.few:
        words += f" (which {len(rig.names)} poses may not show: add pictures)"
    return words


def _is_loose(rig: HandEye, most: tuple[float, float]) -> bool:
    """Whether the arm repeats worse than to a shift [m] and a turn [rad]."""
    shift, turn = most
    repeatability = rig.repeatability
    return repeatability["rotation"] > turn or repeatability["position"] > shift


def _poses(rig: HandEye) -> Iterator[str]:
    """How well flange poses agree with the pictures, and whether the eye is the other one."""
    if _is_loose(rig, NOTE_LIMITS.poses):
        yield (
            f"poses and pictures agree to {rig.repeats} only: {_moved(rig)}, a few "
            "rows are of other pictures, or the arm moved while they were taken"
        )
    hand, base = rig.distances
    if rig.eye_is_doubtful or hand > max(base, NOTE_LIMITS.near):
        yield rig.eye_doubt


def _arm(
    problem: Problem, arm: SpatialArm, fit: CornerFit, rig: HandEye
) -> Iterator[str]:
    """How good the arm is, whether it is this one, and what no picture shows of joints."""
    bundle = problem.bundle
    if _is_loose(rig, NOTE_LIMITS.repeats):
        yield (
            f"the arm repeats to {rig.repeats} (sd of a pose beyond what zeros and geometry "
            f"explain): play, {_moved(rig)}, or joints were read while it moved"
        )
    assert isinstance(bundle.motions, JointMotions)  # noqa: S101 - of an arm
    moves = bundle.motions.largest_move(fit.unknowns.values[bundle.layout.arm])
    name, shifted, turned = moves
    if shifted > NOTE_LIMITS.drawing[0] or turned > NOTE_LIMITS.drawing[1]:
        yield (
            f"the chain has to move by {two_digits(1e3 * shifted)} mm and "
            f"{two_digits(np.degrees(turned))} deg at "
            f"{name}, more than a drawing is off by: is this the drawing of another robot?"
        )
    first = arm.joint_names[0]
    last = arm.joint_names[-1]
    about = np.degrees(max(rig.hand["rotation_95"]))
    along = 1e3 * max(rig.hand["position_95"])
    yield (
        f"no picture shows a turn about {first} or a shift along it apart from the base's place, "
        f"nor the same about {last} apart from what is in the hand: both joints are taken from "
        f"their encoders. Of a tip that the true {last} carries, the place in the hand is "
        f"sure to {two_digits(about)} deg and {two_digits(along)} mm"
    )
