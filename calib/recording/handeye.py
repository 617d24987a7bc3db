"""Hand-eye calibration: where the camera is, from pictures of a board, with the arm that took them.

Arm, what is in its hand, what stands still and the lens are one fit (:mod:`calib.body.corners`).
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arm.arm import Arm, SpatialArm
from ..arm.rotations import exponential, logarithm, quaternion_of
from ..body.belief import Body
from ..body.corners import fit_corners
from ..body.sensor import SensorPose
from ..body.spatial import SpatialStructure, structure_of
from ..common.arrays import Array, Mask
from ..common.choices import EYES
from ..common.parallel import one_blas_thread
from ..common.wording import listed
from ..errors import LogError, OptionError
from ..samples.samples import Samples
from .board import LEAST_CORNERS, Board, BoardFinder
from .joint_table import JointTable, read_joints
from .lens import Lens, calibrate_lens
from .pictures import list_pictures, match_rows, read_series
from .reference import find_pose

_LEAST = 6  # pictures of the board
_ASTRAY = 8.0  # a picture this many times further off than the median shows another board
_NEAR = 2.0  # px, below which a picture is never astray
_TURNED = np.radians(15.0)  # least spread of the hand's turns about each axis
_CLEAR = 0.5  # of the misfit: the other way round explains the pictures better
_FOCAL_SD, _CENTRE_SD, _K1_SD = 0.3, 0.05, 0.3  # of a lens to be found, shares of its width


@dataclass(frozen=True, eq=False)
class Seen:
    """Pictures of a board, each with the joints at which it was taken."""

    names: tuple[str, ...]  # of the pictures
    q: Array  # (p, dof) [rad or m]
    poses: Array  # (p, 6), what is in the hand seen from what stands still
    rows: Array  # (n,), the picture of each corner
    corners: Array  # (n, 3), in the board's frame [m]
    pixels: Array  # (n, 2), where a lens without distortion shows them

    def take(self, kept: Mask) -> Seen:
        """Return the pictures of a mask (p,)."""
        own = kept[self.rows]
        names = tuple(name for name, stays in zip(self.names, kept, strict=True) if stays)
        number = np.cumsum(kept) - 1
        return Seen(
            names, self.q[kept], self.poses[kept], number[self.rows[own]],
            self.corners[own], self.pixels[own],
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class HandEye:
    """Where a camera and a board are.

    Attributes
    ----------
    eye : {"hand", "base"}
        Whether the camera is in the hand and the board stands still, or the other way round.
    pictures, used : int
        How many there are, and how many the fit rests on.
    hand, base : dict
        Position (3,) [m] and quaternion (qx, qy, qz, qw) of the camera's optical frame (x right,
        y down, z ahead) or the board's, in the tip's frame and in the base's; half-widths of
        their 95 % intervals, (3,) [m] and (3,) [rad].
    reprojection : dict
        Mean and largest distance [px] of corners from where the fit puts them.
    millimetres : float
        The mean as a distance at the board [mm].
    lens : dict
        Focal length and centre [px], k1 and the half-width of the focal length's interval [px].
    limited_by : str
        What limits the accuracy, and what would help most.
    notes : tuple of str
        What else the user should be told.
    poses : Samples
        The pictures as a log of poses.
    """

    eye: str
    pictures: int
    used: int
    hand: dict[str, Any]
    base: dict[str, Any]
    reprojection: dict[str, float]
    millimetres: float
    lens: dict[str, Any]
    limited_by: str
    notes: tuple[str, ...]
    poses: Samples
    body: Body

    def to_json(self) -> dict[str, Any]:
        """What `calib handeye --json` prints."""
        names = ("eye", "pictures", "used", "hand", "base", "reprojection", "lens", "limited_by")
        return {**{name: getattr(self, name) for name in names}, "notes": list(self.notes)}

    def __repr__(self) -> str:
        """The hand's place in a line."""
        x, y, z = self.hand["position"]
        what = "camera" if self.eye == "hand" else "board"
        return f"HandEye({what} at ({x:.4f}, {y:.4f}, {z:.4f}) m in the tip's frame)"


def handeye(
    arm: Arm,
    pictures: str | os.PathLike[str] | Sequence[Array],
    joints: str | os.PathLike[str] | JointTable,
    board: Board | str,
    eye: str,
    *,
    lens: Lens | None = None,
    degrees: bool = False,
) -> HandEye:
    """Find camera and board from pictures of a board that an arm took, or held.

    arm : an arm that moves in space, as `load_arm` returns it
    pictures : folder or pattern; or grey pictures (height, width) themselves
    joints : table of joints, one row for each picture
    board : ``"7x5:24mm:18mm:5x5_100"``: columns, rows, square, marker, dictionary
    eye : {"hand", "base"}
    lens : the camera's lens where it is known; by default it is fitted to the same pictures
    degrees : whether the table's turning joints are in degrees
    Raises LogError in one line if the pictures tell nothing, OptionError if an option is wrong.
    """
    if eye not in EYES:
        raise OptionError(f"eye {eye!r}: expected one of {', '.join(EYES)}")
    if not isinstance(arm, SpatialArm):
        raise OptionError(
            f"{arm.name} moves in a plane: a camera that it carries needs an arm in space"
        )
    board = Board.parse(board) if isinstance(board, str) else board
    table = joints
    if not isinstance(table, JointTable):
        sliding = [n for n, r in zip(arm.joint_names, arm.revolute, strict=True) if not r]
        table = read_joints(table, arm.joint_names, degrees=degrees, prismatic=sliding)
    found, size, count, notes = _corners(pictures, table, board)
    fitted, doubts = (lens, ()) if lens is not None else calibrate_lens(
        [corners for _, _, corners in found], board, size
    )  # fmt: skip
    notes += doubts
    with one_blas_thread():
        return _solved(arm, table, found, fitted, lens is not None, board, eye, count, notes)


def _corners(
    pictures: Any, table: JointTable, board: Board
) -> tuple[list[tuple[str, int, dict[int, Array]]], tuple[int, int], int, list[str]]:
    """Corners of the board by picture, with its name and its row of joints; the pictures' size."""
    notes: list[str] = []
    if isinstance(pictures, (str, os.PathLike)):
        pairs, notes = match_rows(table, list_pictures(pictures))
        damaged: list[str] = []
        series = read_series([path for _, path in pairs], damaged)
        shots = [(pairs[k][1].name, pairs[k][0], grey) for k, grey in series]
        notes += [f"{text}; left out" for text in damaged[:5]]
    else:
        if len(pictures) != len(table.q):
            raise LogError(f"{len(pictures)} pictures and {len(table.q)} rows of joints")
        shots = [(f"picture {k + 1}", k, grey) for k, grey in enumerate(pictures)]
    finder = BoardFinder(board)
    seen = [(name, row, finder.find(grey)) for name, row, grey in shots]
    found = [each for each in seen if len(each[2]) >= LEAST_CORNERS]
    if len(found) < _LEAST:
        most = max((len(each[2]) for each in seen), default=0)
        raise LogError(
            f"the board is in {len(found)} of {len(shots)} pictures (at most {most} corners found, "
            f"{LEAST_CORNERS} expected in each): {_LEAST} are needed, 20 are better; check the "
            "board's columns, rows and dictionary"
        )
    if missing := [name for name, _, corners in seen if len(corners) < LEAST_CORNERS]:
        notes.append(f"no board in {len(missing)} pictures, left out: {listed(missing)}")
    height, width = shots[0][2].shape[:2]
    return found, (width, height), len(shots), notes


def _solved(
    arm: SpatialArm,
    table: JointTable,
    found: list[tuple[str, int, dict[int, Array]]],
    lens: Lens,
    known: bool,
    board: Board,
    eye: str,
    count: int,
    notes: list[str],
) -> HandEye:
    """Fit, leave out pictures that show another board, fit again, and say what was found."""
    # OpenCV's frame of the board: x to the right, y down, z into it
    world = np.asarray(board.opencv().getChessboardCorners(), float)
    focal, (u, v), width = float(lens.focal.mean()), lens.centre, lens.size[0]
    told = np.sqrt(np.maximum(np.diag(lens.covariance), 0.0))
    sd = (told[:2].mean(), told[2], told[3], told[4]) if known else (
        _FOCAL_SD * focal, _CENTRE_SD * width, _CENTRE_SD * width, _K1_SD
    )  # fmt: skip
    structure = structure_of(
        arm, "pose", lens=(focal, float(u), float(v), 0.0), lens_sd=tuple(float(s) for s in sd)
    )
    q = np.array([table.q[row] for _, row, _ in found])

    def seen(eye: str) -> Seen:
        poses, rows, points, pixels = [], [], [], []
        for k, (_, _, corners) in enumerate(found):
            numbers = sorted(corners)
            places = np.array([corners[n] for n in numbers])
            pose = find_pose(lens, world[numbers], places)
            turn, shift = pose.rotation, pose.shift
            if eye == "hand":
                turn, shift = turn.T, -turn.T @ shift
            poses.append(np.concatenate([shift, logarithm(turn[None])[0]]))
            rows += [k] * len(numbers)
            points.append(world[numbers])
            pixels.append(focal * lens.undistort(places) + lens.centre)
        names = tuple(name for name, _, _ in found)
        return Seen(
            names,
            q,
            np.array(poses),
            np.array(rows),
            np.concatenate(points),
            np.concatenate(pixels),
        )

    own = seen(eye)
    try:
        fit, kept, off = _fitted(structure, own, eye)
    except LogError:
        fit, kept, off = None, np.ones(len(q), bool), np.full(len(own.rows), np.inf)
    other = "base" if eye == "hand" else "hand"
    if fit is None or np.median(off) > _NEAR:
        _refuse_other(structure, seen(other), other, float(np.median(off)))
    if fit is None:
        raise LogError(
            "no place of camera and board explains the pictures: check that each row of joints is "
            "of its picture, the joints' units and order, and whether it is this robot"
        )
    notes = [*notes, *_left_out(own.names, kept)]
    own = own.take(kept)
    return _result(structure, arm, own, fit, off, eye, count, known, notes)


def _fitted(
    structure: SpatialStructure, seen: Seen, eye: str
) -> tuple[tuple[Any, Body], Mask, Array]:
    """The fit of the pictures that agree, which these are, and their corners' errors [px]."""
    kept = np.ones(len(seen.q), bool)
    for _ in range(3):
        part = seen.take(kept)
        fit = fit_corners(
            structure, part.q, part.poses, part.rows, part.corners, part.pixels, eye == "hand"
        )
        body = fit[0].body
        rows = np.column_stack([seen.q[seen.rows], seen.corners])
        off = np.linalg.norm(seen.pixels - body.predict(rows), axis=1)
        by_picture = np.array([np.median(off[seen.rows == k]) for k in range(len(seen.q))])
        limit = max(_ASTRAY * float(np.median(by_picture[kept])), _NEAR)
        now = by_picture < limit
        if (now == kept).all() or now.sum() < _LEAST:
            break
        kept = now
    return fit, kept, off[kept[seen.rows]]


def _refuse_other(structure: SpatialStructure, seen: Seen, eye: str, misfit: float) -> None:
    """Refuse pictures that the other way round explains."""
    try:
        _, kept, off = _fitted(structure, seen, eye)
    except (LogError, np.linalg.LinAlgError):
        return
    if kept.mean() > 0.5 and np.median(off) < _CLEAR * misfit:
        where = "the camera is in the hand" if eye == "hand" else "the board is in the hand"
        raise OptionError(
            f"the pictures are explained to {np.median(off):.2g} px if {where}, to "
            f"{misfit:.2g} px as said: give eye={eye!r}",
            parameter="eye", value=eye,
        )  # fmt: skip


def _left_out(names: Sequence[str], kept: Mask) -> list[str]:
    """Say which pictures show the board elsewhere."""
    gone = [name for name, stays in zip(names, kept, strict=True) if not stays]
    if not gone:
        return []
    at = np.flatnonzero(~kept)
    after = len(at) > 1 and at[-1] == len(kept) - 1 and len(at) == len(kept) - at[0]
    why = (
        f"the board or the camera was moved from {names[at[0]]} on"
        if after
        else "the board stood elsewhere, or the joints are not theirs"
    )
    return [f"{len(gone)} pictures contradict the others and are left out ({listed(gone)}): {why}"]


def _result(
    structure: SpatialStructure,
    arm: SpatialArm,
    seen: Seen,
    fit: tuple[Any, Body],
    off: Array,
    eye: str,
    count: int,
    known: bool,
    notes: list[str],
) -> HandEye:
    corners, body = fit[0].body, fit[1]
    sensor = SensorPose.of(body)
    assert sensor is not None  # noqa: S101 - the arm has a drawing
    own = structure.groups["lens"]
    f, u, v, k1 = (float(value) for value in body.beta[own])
    focal_95 = 1.96 * body.kappa * float(corners.deviations[own[0]])
    depth = float(np.median(np.linalg.norm(seen.poses[:, :3], axis=1)))
    base = {
        "position": sensor.position.tolist(),
        "quaternion": sensor.quaternion.tolist(),
        "position_95": (1.96 * body.kappa * sensor.position_sd).tolist(),
        "rotation_95": (1.96 * body.kappa * sensor.turn_sd).tolist(),
        "position_95_up_to_gauge": (1.96 * body.kappa * sensor.told_sd).tolist(),
    }
    hand = _hand(structure, body)
    return HandEye(
        eye, count, len(seen.q), hand, base,
        {"mean": float(off.mean()), "max": float(off.max())},
        1e3 * float(off.mean()) * depth / f,
        {"focal": f, "centre": [u, v], "k1": k1, "focal_95": focal_95, "known": known},
        _limit(seen, structure, f, focal_95, float(off.mean()), hand),
        (*notes, *_gauge(arm)),
        _log(arm, seen),
        body,
    )  # fmt: skip


def _hand(structure: SpatialStructure, body: Body) -> dict[str, Any]:
    """What is in the hand, in the tip's frame."""
    groups, still = structure.groups, structure.with_view("base")
    index = np.concatenate([groups["tool"], groups["tool.rotation"]])
    q = np.zeros((1, structure.dof))

    def placed(beta: Array) -> tuple[Array, Array]:
        bare = beta.copy()
        bare[index] = 0.0
        (p,), (turn,) = still.pose(q, beta)
        (p0,), (turn0,) = still.pose(q, bare)
        return turn0.T @ (p - p0), turn0.T @ turn

    position, turn = placed(body.beta)
    slope = np.empty((6, 6))
    for k in range(6):
        step = np.zeros(structure.size)
        step[index[k]] = 1e-6
        p, t = placed(structure.retract(body.beta, step))
        slope[:3, k] = (p - position) / 1e-6
        slope[3:, k] = logarithm((t @ turn.T)[None])[0] / 1e-6
    place = np.searchsorted(body.active, index)
    spread = slope @ body.covariance[np.ix_(place, place)] @ slope.T
    half = 1.96 * body.kappa * np.sqrt(np.diag(spread))
    return {
        "position": position.tolist(),
        "quaternion": quaternion_of(turn).tolist(),
        "position_95": half[:3].tolist(),
        "rotation_95": half[3:].tolist(),
    }


def _gauge(arm: SpatialArm) -> list[str]:
    """What no picture tells."""
    first, last = arm.joint_names[0], arm.joint_names[-1]
    return [
        f"a turn about {first} and a shift along it are not told by pictures: what stands still is "
        f"known in the base frame but for them; {first}'s offset is zero by convention, and a turn "
        f"of what is in the hand about {last} is one with that joint's offset"
    ]


def _limit(
    seen: Seen, structure: SpatialStructure, f: float, focal_95: float, off: float, hand: Any
) -> str:
    """What limits the accuracy, and what would help most."""
    turns = np.linalg.svd(seen.poses[:, 3:] - seen.poses[:, 3:].mean(axis=0))[1]
    spread = float(turns[-1]) / np.sqrt(len(seen.q))
    wrist = listed(structure.joint_names[-2:])
    if spread < _TURNED / 2:
        return (
            f"few turns of the wrist: they spread by {np.degrees(spread):.1f} deg about one axis; "
            f"add pictures with {wrist} turned by 30 deg and more, each way"
        )
    if focal_95 > 0.01 * f:
        return (
            f"the lens: its focal length is known to {100 * focal_95 / f:.1f} %; add pictures with "
            "the board tilted, nearer and further away, or give a calibrated lens"
        )
    if len(seen.q) < 15:
        return f"few pictures: {len(seen.q)}; 20 to 30 are better, with the wrist turned each way"
    if off > 0.5:
        return (
            f"the arm's own errors, or blurred pictures: corners miss by {off:.2g} px; "
            "let the arm stand still before each picture"
        )
    worst = 1e3 * max(hand["position_95"])
    return (
        f"the arm's own errors (hand known to {worst:.1f} mm); more pictures with {wrist} turned "
        "help most"
    )


def _log(arm: SpatialArm, seen: Seen) -> Samples:
    """The pictures as a log of poses of what is in the hand, in the frame of what stands still."""
    lower, upper = arm.lower.copy(), arm.upper.copy()
    return Samples(
        seen.q, seen.poses[:, :3], arm.joint_names, np.minimum(lower, seen.q.min(axis=0)),
        np.maximum(upper, seen.q.max(axis=0)), arm.revolute, arm=arm,
        orientation=quaternion_of(exponential(seen.poses[:, 3:])),
    )  # fmt: skip
