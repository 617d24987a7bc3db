"""Where cameras and boards are: places with intervals, and what is told of them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypedDict

import numpy as np

from ..arm.rotations import cross_matrix, logarithm, nearest_rotation, quaternion_of
from ..body.belief import Body
from ..body.corners import held_of
from ..body.sensor_pose import SensorPose
from ..common.arrays import Array, Mask
from ..common.wording import listed
from ..samples.samples import Samples
from .agreement import agreed, held_out
from .bundle import Fit, Layout, bending, inverse
from .conventions import Convention
from .joint_motions import JointMotions
from .lens import Lens
from .solver import Setting, View

_TURNED = np.radians(7.5)  # least spread of the hand's turns about each axis
_OPEN = 0.01  # m, of an interval, beyond which a direction is open
_TELLING = 4e-3  # of a board's size, that is told
_LENS_OFF = 2e-3  # of the focal length: a lens that was given is doubted

Place = dict[str, list[float]]
"""A place as JSON: position [m], quaternion, and half-widths of 95 % intervals [m, rad]."""


class LensFacts(TypedDict):
    """A lens as JSON, with half-widths of 95 % intervals."""

    focal: float  # [px]
    centre: list[float]
    k1: float
    focal_95: float
    known: bool
    matrix: list[list[float]]
    distortion: list[float]  # k1, k2, p1, p2, k3
    parameters_95: list[float]  # of focal lengths, centre and distortion
    size: list[int]


class Square(TypedDict):
    """The side of a square, or a tag, as said and as measured [m]."""

    said: float
    measured: float
    interval: list[float]


@dataclass(frozen=True, eq=False)
class CameraPlace:
    """One of several cameras."""

    name: str
    eye: str
    place: Place  # in the hand, or in the base
    lens: LensFacts
    from_first: Place | None  # in the frame of the first camera of its eye

    def to_json(self) -> dict[str, object]:
        """What `calib handeye --json` prints of it."""
        where = "hand" if self.eye == "hand" else "base"
        document: dict[str, object] = {"name": self.name, "eye": self.eye}
        document |= {where: self.place, "lens": self.lens}
        if self.from_first is not None:
            document["from_first"] = self.from_first
        return document


@dataclass(frozen=True, eq=False)
class HandEye:
    """Where cameras and a board are.

    Places are of the camera's optical frame (x right, y down, z ahead) or the board's: position
    [m], quaternion (qx, qy, qz, qw) and half-widths of their 95 % intervals, (3,) [m] and
    (3,) [rad], with what no picture tells and without it.
    """

    eye: str  # "hand": the first camera is in the hand and the board stands still; or "base"
    pictures: int
    used: int  # motions that the fit rests on
    hand: Place  # what is in the hand, in the tip's or the flange's frame
    base: Place  # what stands still, in the base's
    reprojection: dict[
        str, float
    ]  # mean and largest distance of corners, motions taken as said
    lens: LensFacts  # focal length with its interval's half-width, centre [px], distortion
    limited_by: str  # what limits the accuracy, and what would help most
    notes: tuple[str, ...]
    repeatability: dict[
        str, float
    ]  # sd of the arm's poses: position [m], rotation [rad]
    square: Square
    board: dict[str, list[list[float]]]  # its corners as fitted, in its frame [m]
    held_out: dict[
        str, float
    ]  # rms and median of pictures that are predicted by the others [px]
    left_out: tuple[str, ...] = ()  # names of pictures
    cameras: tuple[CameraPlace, ...] = ()
    convention: Convention | None = None  # what the poses mean
    poses: Samples | None = (
        None  # of joints: the pictures as `calib log --eye` writes them
    )
    body: Body | None = None

    def to_json(self) -> dict[str, object]:
        """What `calib handeye --json` prints."""
        names = (
            "eye",
            "pictures",
            "used",
            "hand",
            "base",
            "reprojection",
            "lens",
            "limited_by",
            "repeatability",
            "square",
            "board",
            "held_out",
        )
        document: dict[str, object] = {name: getattr(self, name) for name in names}
        document["notes"] = list(self.notes)
        document["left_out"] = list(self.left_out)
        document["cameras"] = [camera.to_json() for camera in self.cameras]
        if self.convention is not None:
            document["convention"] = dict(self.convention)
        return document

    def lines(self, tip: str) -> list[str]:
        """The answer for people; `tip` is what the frame of the hand is called."""
        carried, standing = (
            ("camera", "board") if self.eye == "hand" else ("board", "camera")
        )
        lines = [
            _line(f"{carried} in the frame of {tip}", self.hand),
            _line(f"{standing} in the base frame", self.base),
        ]
        for camera in self.cameras[1:]:
            parent = tip if camera.eye == "hand" else "the base"
            lines.append(_line(f"{camera.name} in the frame of {parent}", camera.place))
            if camera.from_first is not None:
                lines.append(
                    _line(
                        f"{camera.name} in the first camera's frame", camera.from_first
                    )
                )
        repeats = self.repeatability
        lines += [
            f"pictures that the fit did not see are predicted to {self.held_out['rms']:.2g} px; "
            f"corners to {self.reprojection['mean']:.2g} px (largest "
            f"{self.reprojection['max']:.2g}); {self.used} of {self.pictures} pictures",
            f"this arm repeats to {1e3 * repeats['position']:.2g} mm and "
            f"{np.degrees(repeats['rotation']):.2g} deg",
            f"lens: focal length {self.lens['focal']:.1f} ± {self.lens['focal_95']:.2g} px",
            f"limited by {self.limited_by}",
        ]
        return lines


def _line(what: str, place: Place) -> str:
    """A place for people."""
    halves = place["position_95_up_to_gauge"]
    pairs = zip(place["position"], halves, strict=True)
    at = ", ".join(f"{1e3 * value:.2f} ± {1e3 * half:.2g}" for value, half in pairs)
    quaternion = ", ".join(f"{value:.5f}" for value in place["quaternion"])
    turn = np.degrees(max(place["rotation_95_up_to_gauge"]))
    return f"{what}: ({at}) mm, quaternion ({quaternion}) ± {turn:.2g} deg"


def answer(setting: Setting) -> HandEye:
    """Fit the pictures, and tell where all is."""
    problem = setting.problem
    fit, kept = agreed(problem)
    layout = problem.layout
    first = setting.views[0]
    half = _half_width(fit, setting)
    rows = np.flatnonzero(kept)
    out = held_out(problem, fit, kept)
    misses = _misses(setting, fit, kept)
    places = [_camera_place(setting, fit, k, half) for k in range(len(setting.views))]
    hand, base = _both_places(setting, fit, half)
    lens = _lens_words(setting.views[0], fit, layout, 0, half)
    names = _names(setting)
    left_out = tuple(name for name, stays in zip(names, kept, strict=True) if not stays)
    body = None
    log = None
    if isinstance(problem.motions, JointMotions) and setting.arm is not None:
        body = problem.motions.body(fit, layout, 0, first.in_hand)
        log = _log(setting, fit, layout, kept)
    square = _square(setting, fit, layout, half)
    spread = float(np.sqrt(np.mean(out**2)))
    result = HandEye(
        eye="hand" if first.in_hand else "base",
        pictures=first.shots.count,
        used=len(rows),
        hand=hand,
        base=base,
        reprojection={"mean": float(misses.mean()), "max": float(misses.max())},
        lens=lens,
        limited_by="",
        notes=(),
        repeatability={
            "position": float(fit.noise.pose[1]),
            "rotation": float(fit.noise.pose[0]),
        },
        square=square,
        board={"points": _board_points(setting, fit, layout).tolist()},
        held_out={"rms": spread, "median": float(np.median(out))},
        left_out=left_out,
        cameras=tuple(places),
        convention=setting.convention,
        poses=log,
        body=body,
    )
    notes = _notes(setting, fit, result, kept)
    return replace(result, limited_by=_limit(setting, result, kept), notes=notes)


def _half_width(fit: Fit, setting: Setting) -> float:
    """How many sd a 95 % interval is to each side."""
    from scipy.special import stdtrit

    if (
        isinstance(setting.motions, JointMotions)
        and fit.freedom < setting.motions.count
    ):
        return 1.96  # the joints are as good as exact
    return float(stdtrit(max(fit.freedom, 3.0), 0.975))


def _frame(fit: Fit, number: int) -> tuple[Array, Array]:
    """A frame (4, 4), and the covariance (6, 6) of its turn and shift in the parent's axes."""
    pose = fit.unknowns.frames[number]
    some = 6 * number + np.arange(6)
    turn = np.eye(6)
    turn[:3, :3] = pose[:3, :3]
    return pose, turn @ fit.covariance[np.ix_(some, some)] @ turn.T


def _place(pose: Array, covariance: Array, half: float) -> Place:
    """A place and its 95 % intervals."""
    sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    position = (half * sd[3:]).tolist()
    rotation = (half * sd[:3]).tolist()
    return {
        "position": pose[:3, 3].tolist(),
        "quaternion": quaternion_of(pose[None, :3, :3])[0].tolist(),
        "position_95": position,
        "rotation_95": rotation,
        "position_95_up_to_gauge": position,
        "rotation_95_up_to_gauge": rotation,
    }


def _gauged(place: SensorPose, half: float) -> Place:
    """A place that joints tell but for what no picture tells of the first and last axis."""
    return {
        "position": place.position.tolist(),
        "quaternion": place.quaternion.tolist(),
        "position_95": (half * place.position_sd).tolist(),
        "rotation_95": (half * place.turn_sd).tolist(),
        "position_95_up_to_gauge": (half * place.told_sd).tolist(),
        "rotation_95_up_to_gauge": (half * place.told_turn_sd).tolist(),
    }


def _both_places(setting: Setting, fit: Fit, half: float) -> tuple[Place, Place]:
    """What is in the hand and what stands still, of the first camera."""
    layout = setting.problem.layout
    in_hand = setting.views[0].in_hand
    motions = setting.motions
    if isinstance(motions, JointMotions):
        body = motions.body(fit, layout, 0, in_hand)
        standing = SensorPose.of(body)
        assert standing is not None  # noqa: S101 - the arm has a drawing
        return _gauged(held_of(body), half), _gauged(standing, half)
    camera = _place(*_frame(fit, 0), half)
    board = _place(*_frame(fit, layout.cameras + layout.board_of(in_hand)), half)
    return (camera, board) if in_hand else (board, camera)


def _camera_place(setting: Setting, fit: Fit, number: int, half: float) -> CameraPlace:
    view = setting.views[number]
    layout = setting.problem.layout
    motions = setting.motions
    if isinstance(motions, JointMotions):
        body = motions.body(fit, layout, number, view.in_hand)
        place = _gauged(held_of(body), half)
        standing = SensorPose.of(body)
        if not view.in_hand and standing is not None:
            place = _gauged(standing, half)
    else:
        place = _place(*_frame(fit, number), half)
    alike = [
        k for k, other in enumerate(setting.views) if other.in_hand == view.in_hand
    ]
    between = _between(fit, alike[0], number, half) if alike[0] != number else None
    eye = "hand" if view.in_hand else "base"
    lens = _lens_words(view, fit, layout, number, half)
    return CameraPlace(view.name, eye, place, lens, between)


def _between(fit: Fit, first: int, second: int, half: float) -> Place:
    """A camera in the frame of another."""
    one = fit.unknowns.frames[first]
    other = fit.unknowns.frames[second]
    pose = inverse(one) @ other
    back = one[:3, :3].T
    slope = np.zeros((6, 12))  # by turn and shift of both
    slope[:3, :3] = -np.eye(3)
    slope[:3, 6:9] = pose[:3, :3]
    slope[3:, :3] = cross_matrix(pose[:3, 3])
    slope[3:, 3:6] = -back
    slope[3:, 9:] = back
    some = np.concatenate([6 * first + np.arange(6), 6 * second + np.arange(6)])
    return _place(pose, slope @ fit.covariance[np.ix_(some, some)] @ slope.T, half)


def _lens_words(
    view: View, fit: Fit, layout: Layout, number: int, half: float
) -> LensFacts:
    """The lens as JSON, with half-widths of 95 % intervals."""
    places = layout.lens(number)
    lens = fit.unknowns.values[places]
    some = 6 * layout.frames + places
    sd = half * np.sqrt(np.maximum(np.diag(fit.covariance)[some], 0.0))
    matrix = [[lens[0], 0.0, lens[2]], [0.0, lens[1], lens[3]], [0.0, 0.0, 1.0]]
    return {
        "focal": float(lens[:2].mean()),
        "centre": lens[2:4].tolist(),
        "k1": float(lens[4]),
        "focal_95": float(sd[:2].mean()),
        "known": view.known is not None,
        "matrix": [[float(cell) for cell in row] for row in matrix],
        "distortion": lens[4:].tolist(),
        "parameters_95": sd.tolist(),
        "size": list(view.shots.size),
    }


def _glass(view: View, fit: Fit, layout: Layout, number: int) -> Lens:
    """The lens as found."""
    places = layout.lens(number)
    lens = fit.unknowns.values[places]
    some = 6 * layout.frames + places
    covariance = fit.covariance[np.ix_(some, some)]
    return Lens(
        view.shots.size,
        lens[:2].copy(),
        lens[2:4].copy(),
        lens[4:].copy(),
        rms=float(np.sqrt(2.0) * fit.noise.corner[number]),
        covariance=covariance,
    )


def _square(setting: Setting, fit: Fit, layout: Layout, half: float) -> Square:
    """The side of a square, or a tag, as said and as measured."""
    said = setting.views[0].shots.board.side
    place = layout.square(layout.board_of(setting.views[0].in_hand))
    measured = said * float(np.exp(fit.unknowns.values[place]))
    number = 6 * layout.frames + place
    sd = measured * float(np.sqrt(fit.covariance[number, number]))
    interval = [measured - half * sd, measured + half * sd]
    return {"said": said, "measured": measured, "interval": interval}


def _board_points(setting: Setting, fit: Fit, layout: Layout) -> Array:
    """The board's corners (n, 3) as fitted, in its frame [m]."""
    points = setting.views[0].shots.board.points()
    board = layout.board_of(setting.views[0].in_hand)
    values = fit.unknowns.values
    bent = points + bending(points, points) @ values[layout.shape(board)]
    return np.asarray(np.exp(values[layout.square(board)]) * bent)


def _names(setting: Setting) -> list[str]:
    """What the motions' pictures are called."""
    names = [""] * len(setting.rows)
    for view in setting.views:
        for place, name in zip(
            np.searchsorted(setting.rows, view.rows), view.shots.names, strict=True
        ):
            names[place] = names[place] or name
    return names


def _misses(setting: Setting, fit: Fit, kept: Mask) -> Array:
    """Distance (N,) [px] of all corners from where the motions alone put them."""
    rows = np.flatnonzero(kept)
    bundle = setting.problem.bundle(rows)
    still = replace(fit.unknowns, errors=np.zeros((len(rows), 6)))
    pixels = bundle.predict(still)
    away = [c.corners - seen for c, seen in zip(bundle.cameras, pixels, strict=True)]
    return np.asarray(np.linalg.norm(np.concatenate(away), axis=1))


def _log(setting: Setting, fit: Fit, layout: Layout, kept: Mask) -> Samples:
    """The first camera's pictures as a log of poses."""
    arm = setting.arm
    view = setting.views[0]
    assert arm is not None  # noqa: S101 - called with joints alone
    stays = kept[np.searchsorted(setting.rows, view.rows)]
    log = view.shots.log(_glass(view, fit, layout, 0), view.in_hand).take(stays)
    lower = np.minimum(arm.lower, log.lower)
    upper = np.maximum(arm.upper, log.upper)
    return replace(
        log, lower=lower, upper=upper, revolute=arm.revolute, arm=arm, notes=()
    )


def _limit(setting: Setting, result: HandEye, kept: Mask) -> str:
    """What limits the accuracy, and what would help most."""
    turns, _ = _turning(setting, kept)
    wrist = "the hand"
    if setting.arm is not None:
        wrist = listed(setting.arm.joint_names[-2:])
    add = f"add pictures with {wrist} turned by 30 deg and more, each way"
    if turns[1] < _TURNED:
        return f"few turns of the wrist (by {np.degrees(turns[1]):.1f} deg about one axis); {add}"
    lens = result.lens
    focal = lens["focal_95"] / lens["focal"]
    if focal > 0.01:
        add = "add pictures with the board tilted, nearer and further away, or give a lens"
        return f"the lens (its focal length is known to {100 * focal:.1f} %); {add}"
    shift = 1e3 * result.repeatability["position"]
    turn = np.degrees(result.repeatability["rotation"])
    if shift > 0.02 or turn > 5e-3:
        return (
            f"the arm's repeatability ({shift:.2g} mm and {turn:.2g} deg in each pose); "
            f"{add}, or let the arm stand still for each"
        )
    off = result.reprojection["mean"]
    if off > 0.5:
        return f"blur (corners miss by {off:.2g} px); let the arm stand still for each"
    hand = 1e3 * max(result.hand["position_95_up_to_gauge"])
    return f"the arm's own errors (hand known to {hand:.1f} mm); {add}"


def _turning(setting: Setting, kept: Mask) -> tuple[Array, Array]:
    """Rms turns (3,) [rad] of the motions about three axes (3, 3) of the flange, largest first."""
    problem = setting.problem
    flange = problem.motions.poses(problem.start.values[problem.layout.arm_values])[
        kept
    ]
    mean = nearest_rotation(flange[:, :3, :3].sum(axis=0))
    vectors = logarithm(mean.T @ flange[:, :3, :3])
    _, sizes, axes = np.linalg.svd(vectors - vectors.mean(axis=0), full_matrices=False)
    return np.asarray(sizes / np.sqrt(len(vectors))), axes


def _notes(setting: Setting, fit: Fit, result: HandEye, kept: Mask) -> tuple[str, ...]:
    """What else has to be known."""
    notes = [
        note for view in setting.views for note in (*view.shots.notes, *view.doubts)
    ]
    if setting.convention is not None:
        ratio = setting.convention["ratio"]
        unit = setting.convention["unit"]
        notes.append(
            f"poses are read as {setting.words}, lengths in {unit}; the next reading fits "
            f"{ratio:.3g} times worse"
        )
        if setting.ties:
            notes.append(f"not told apart from it: {'; '.join(setting.ties)}")
    gone = result.left_out
    if gone:
        last = len(gone) > 1 and not kept[-len(gone) :].any()
        where = f"from {gone[0]} on" if last else "in them"
        notes.append(
            f"{len(gone)} pictures contradict the others and are left out ({listed(gone)}): "
            f"{where} camera or board was moved, the camera refocused or zoomed, or the "
            f"{'joints' if setting.arm else 'poses'} are not theirs"
        )
    notes += _open_notes(setting, fit, kept)
    notes += _size_notes(setting, result)
    notes += _lens_notes(setting, fit)
    if setting.arm is None:
        notes += _nearness(result)
    else:
        notes += _arm_notes(setting, result)
    return tuple(notes)


def _open_notes(setting: Setting, fit: Fit, kept: Mask) -> list[str]:
    """Directions that the motions hardly tell, and two poses that would."""
    layout = setting.problem.layout
    hand = (
        0
        if setting.views[0].in_hand
        else layout.cameras + layout.board_of(in_hand=False)
    )
    _, covariance = _frame(fit, hand)
    squares, directions = np.linalg.eigh(covariance[3:, 3:])
    off = 1.96 * float(np.sqrt(max(squares[-1], 0.0)))
    if off < _OPEN:
        return []
    turns, axes = _turning(setting, kept)
    along = ", ".join(f"{value:+.2f}" for value in directions[:, -1])
    second, third = (", ".join(f"{value:+.2f}" for value in axis) for axis in axes[1:])
    return [
        f"what is in the hand is open along ({along}) of the flange, to ± {1e3 * off:.2g} mm: the "
        f"hand turns by {np.degrees(turns[0]):.2g} deg about one axis, by "
        f"{np.degrees(turns[1]):.2g} and {np.degrees(turns[2]):.2g} about the others. Two poses "
        f"more tell it: turned by 30 deg about ({second}) and about ({third}) of the flange"
    ]


def _size_notes(setting: Setting, result: HandEye) -> list[str]:
    said = result.square["said"]
    measured = result.square["measured"]
    low, high = result.square["interval"]
    off = abs(measured / said - 1.0)
    if off < _TELLING or low < said < high:
        return []
    by = "the drawn arm's size" if setting.arm else "the flange's motions"
    return [
        f"the board's squares measure {1e3 * measured:.4g} mm (95 %: {1e3 * low:.4g} to "
        f"{1e3 * high:.4g}) by {by}, {1e3 * said:.4g} mm as said: the measured size is used; "
        "measure the print, and give its size in `board`"
    ]


def _lens_notes(setting: Setting, fit: Fit) -> list[str]:
    notes = []
    layout = setting.problem.layout
    for number, view in enumerate(setting.views):
        if view.known is None:
            continue
        focal = fit.unknowns.values[layout.lens(number)[:2]].mean()
        given = float(view.known.focal.mean())
        off = focal / given - 1.0
        if abs(off) > _LENS_OFF:
            notes.append(
                f"the lens that was given has a focal length of {given:.1f} px, the pictures say "
                f"{focal:.1f} ({100 * off:+.2g} %): it is of another camera, or the camera "
                "refocused or zoomed; what the pictures say is used"
            )
    return notes


def _nearness(result: HandEye) -> list[str]:
    """Doubt an eye of which what is in the hand is further off than what stands still."""
    hand = np.linalg.norm(result.hand["position"])
    base = np.linalg.norm(result.base["position"])
    if hand < base or hand < 0.3:
        return []
    other = "base" if result.eye == "hand" else "hand"
    return [
        f"with eye {result.eye} what is in the hand is {hand:.2g} m from the flange, what stands "
        f"still {base:.2g} m from the base: is it `eye={other!r}`? Poses alone do not tell"
    ]


def _arm_notes(setting: Setting, result: HandEye) -> list[str]:
    """What no picture tells of joints, and how good the arm is."""
    arm = setting.arm
    assert arm is not None  # noqa: S101 - called with joints alone
    notes = []
    shift = 1e3 * result.repeatability["position"]
    turn = np.degrees(result.repeatability["rotation"])
    if shift > 0.1 or turn > 0.02:
        notes.append(
            f"the arm repeats to {turn:.2g} deg and {shift:.2g} mm (sd of a pose beyond what zeros "
            "and geometry explain): play, or joints that were read while it moved"
        )
    first = arm.joint_names[0]
    last = arm.joint_names[-1]
    about = np.degrees(max(result.hand["rotation_95"]))
    along = 1e3 * max(result.hand["position_95"])
    notes.append(
        f"no picture tells a turn about {first} and a shift along it from where the base stands, "
        f"nor a turn about {last} and a shift along it from what is in the hand: both joints count "
        f"as their encoders say. Of a tip that the true {last} carries, the place in the hand is "
        f"sure to {about:.2g} deg and {along:.2g} mm"
    )
    return notes
