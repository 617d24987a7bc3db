"""Hand-eye calibration: where the camera is, from pictures of a board, with the arm that took them.

Arm, what is in its hand, what stands still and the lens are one fit (:mod:`calib.body.corners`).
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..arm.arm import Arm, SpatialArm
from ..arm.rotations import exponential, logarithm, nearest_rotation
from ..body.belief import Body
from ..body.corners import fit_corners, held_of
from ..body.sensor import SensorPose
from ..body.spatial import SpatialStructure, structure_of
from ..common.arrays import Array, Index, Mask
from ..common.choices import EYES
from ..common.parallel import one_blas_thread
from ..common.rows import thinned
from ..common.wording import listed
from ..errors import LogError, OptionError
from ..samples.diagnosis import Finding, readings
from ..samples.samples import Samples
from ..samples.settings import MOST_ORDERED
from .board import Board
from .board_pictures import LEAST, BoardPictures, Source, find_board, held_poses
from .joint_table import JointTable
from .lens import Lens

_TURNED = np.radians(7.5)  # least spread of the hand's turns about each axis
_FOCAL_SD, _CENTRE_SD, _K1_SD = 0.3, 0.05, 0.3  # of a lens to be found, shares of its width
_Z95 = 1.96
_ASTRAY = 8.0  # a picture this many times further off than the median shows another board
_NEAR = 2.0  # px, below which a picture is never astray
_SHARP = 0.5  # px, from which one half of the pictures may fit better
_LEAST_SHARE = 0.4  # of the pictures that must agree
_CLEAR = 0.4  # of the misfit: another reading of the joints explains the pictures better
_FAR = 2e-2  # m, of poses, beyond which other readings are tried
_SIZED, _SURE = 0.01, 5.0  # of the board's size, and sd: beyond both it is wrong
_BUILT = 1e-3  # m, that an arm's origins are off at least where a size is doubted
_TRIED = 10  # pictures that other readings are tried on


@dataclass(frozen=True, eq=False)
class HandEye:
    """Where a camera and a board are.

    Places are of the camera's optical frame (x right, y down, z ahead) or the board's: position
    [m], quaternion (qx, qy, qz, qw) and half-widths of their 95 % intervals, (3,) [m] and
    (3,) [rad], with what no picture tells and without it.
    """

    eye: str  # "hand": the camera is in the hand and the board stands still; or "base"
    pictures: int
    used: int  # pictures that the fit rests on
    hand: dict[str, Any]  # what is in the hand, in the tip's frame
    base: dict[str, Any]  # what stands still, in the base's
    reprojection: dict[str, float]  # mean and largest distance of corners from the fit's [px]
    lens: dict[str, Any]  # focal length with its interval's half-width, centre [px], k1
    limited_by: str  # what limits the accuracy, and what would help most
    notes: tuple[str, ...]
    poses: Samples  # the pictures as a log of poses, as `calib log --eye` writes them
    body: Body

    def to_json(self) -> dict[str, Any]:
        """What `calib handeye --json` prints."""
        names = ("eye", "pictures", "used", "hand", "base", "reprojection", "lens", "limited_by")
        return {**{name: getattr(self, name) for name in names}, "notes": list(self.notes)}


def handeye(
    arm: Arm,
    pictures: Source | BoardPictures,
    joints: str | os.PathLike[str] | JointTable | None,
    board: Board | str | None,
    eye: str,
    *,
    lens: Lens | None = None,
    degrees: bool = False,
    camera: str | None = None,
) -> HandEye:
    """Find camera and board from pictures of a board that an arm took, or held.

    arm : an arm that moves in space, as `load_arm` returns it
    pictures : folder, pattern or LeRobotDataset; or grey pictures (height, width) themselves; or
        the corners that they show, with their joints and the board
    joints : table of joints, one row for each picture; a dataset brings them
    board : ``"7x5:24mm:18mm:5x5_100"``: columns, rows, square, marker, dictionary
    eye : {"hand", "base"}
    lens : the camera's lens where it is known; by default it is fitted to the same pictures
    degrees : whether the table's turning joints are in degrees
    camera : of a dataset with several
    Raises LogError in one line if the pictures tell nothing, OptionError if an option is wrong.
    """
    if eye not in EYES:
        raise OptionError(f"eye {eye!r}: expected one of {', '.join(EYES)}")
    if not isinstance(arm, SpatialArm):
        raise OptionError(f"{arm.name} moves in a plane: expected an arm that moves in space")
    if not isinstance(pictures, BoardPictures):
        if board is None:
            raise OptionError("pictures need the board that they show: expected `board`")
        kinds = zip(arm.joint_names, arm.revolute, strict=True)
        pictures = find_board(
            pictures, joints, board, arm.joint_names, camera=camera, degrees=degrees,
            prismatic=[name for name, turns in kinds if not turns],
        )  # fmt: skip
    with one_blas_thread():
        return _solved(arm, pictures, eye == "hand", lens)


def _solved(arm: SpatialArm, shots: BoardPictures, in_hand: bool, known: Lens | None) -> HandEye:
    lens, doubts = shots.lens(known)
    focal, width = float(lens.focal.mean()), lens.size[0]
    sd = [_FOCAL_SD * focal, _CENTRE_SD * width, _CENTRE_SD * width, _K1_SD]
    if known is not None:
        told = np.sqrt(np.maximum(np.diag(lens.covariance), 0.0))
        sd = [told[:2].mean(), *told[2:5]]
    structure = structure_of(
        arm, "pose", lens=(focal, *map(float, lens.centre), 0.0), lens_sd=tuple(map(float, sd))
    )
    views = _Views.of(shots, lens, in_hand)
    _refuse_readings(structure, views, shots.board)
    _, kept, pixels, body, misses = _explained(structure, views)
    own, sensor = structure.groups["lens"], SensorPose.of(body)
    f, u, v, k1 = (float(value) for value in body.beta[own])
    focal_95 = _Z95 * body.kappa * float(pixels.deviations[own[0]])
    off, poses = float(misses.mean()), views.poses[kept]
    assert sensor is not None  # noqa: S101 - the arm has a drawing
    hand = _placed(held_of(body), body.kappa)
    # corners were fitted without the distortion that was known: what was found comes on top
    glass = replace(
        lens, focal=lens.focal * f / focal, centre=np.array([u, v]),
        distortion=lens.distortion + k1 * np.eye(5)[0],
    )  # fmt: skip
    first, last = arm.joint_names[0], arm.joint_names[-1]
    turn, shift = np.degrees(max(hand["rotation_95"])), 1e3 * max(hand["position_95"])
    gone = [name for name, stays in zip(shots.names, kept, strict=True) if not stays]
    where = f"from {gone[0]} on" if len(gone) > 1 and not kept[-len(gone) :].any() else "in them"
    left = (
        f"{len(gone)} pictures contradict the others and are left out ({listed(gone)}): {where} "
        "camera or board was moved, the camera refocused or zoomed, or the joints are not theirs"
    )
    gauge = (
        f"no picture tells a turn about {first} and a shift along it from where the base stands, "
        f"nor a turn about {last} and a shift along it from what is in the hand: both joints count "
        f"as their encoders say. Of a tip that the true {last} carries, the place in the hand is "
        f"sure to {turn:.2g} deg and {shift:.2g} mm"
    )
    log = shots.log(glass, in_hand).take(kept)
    lower, upper = np.minimum(arm.lower, log.lower), np.maximum(arm.upper, log.upper)
    return HandEye(
        eye="hand" if in_hand else "base",
        pictures=shots.count,
        used=len(poses),
        hand=hand,
        base=_placed(sensor, body.kappa),
        reprojection={"mean": off, "max": float(misses.max())},
        lens={
            "focal": f, "centre": [u, v], "k1": float(glass.distortion[0]), "focal_95": focal_95,
            "known": known is not None,
        },
        limited_by=_limit(poses, listed(arm.joint_names[-2:]), focal_95 / f, off, shift),
        notes=(*shots.notes, *doubts, *[left] * bool(gone), gauge),
        poses=replace(log, lower=lower, upper=upper, revolute=arm.revolute, arm=arm, notes=()),
        body=body,
    )  # fmt: skip


def _placed(place: SensorPose, kappa: float) -> dict[str, Any]:
    """A place and its 95 % intervals."""
    half = _Z95 * kappa
    return {
        "position": place.position.tolist(),
        "quaternion": place.quaternion.tolist(),
        "position_95": (half * place.position_sd).tolist(),
        "rotation_95": (half * place.turn_sd).tolist(),
        "position_95_up_to_gauge": (half * place.told_sd).tolist(),
        "rotation_95_up_to_gauge": (half * place.told_turn_sd).tolist(),
    }


def _limit(poses: Array, wrist: str, focal: float, off: float, hand: float) -> str:
    """What limits the accuracy, and what would help most."""
    turns = np.linalg.svd(poses[:, 3:] - poses[:, 3:].mean(axis=0))[1]
    spread = float(turns[-1]) / np.sqrt(len(poses))
    add = f"add pictures with {wrist} turned by 30 deg and more, each way"
    if spread < _TURNED:
        return f"few turns of the wrist (by {np.degrees(spread):.1f} deg about one axis); {add}"
    if focal > 0.01:
        add = "add pictures with the board tilted, nearer and further away, or give a lens"
        return f"the lens (its focal length is known to {100 * focal:.1f} %); {add}"
    if off > 0.5:
        return f"blur (corners miss by {off:.2g} px); let the arm stand still for each"
    return f"the arm's own errors (hand known to {hand:.1f} mm); {add}"


@dataclass(frozen=True, eq=False)
class _Views:
    """What is in the hand seen from what stands still, and the corners that tell it."""

    q: Array  # (p, dof) [rad or m]
    poses: Array  # (p, 6), shift [m] and rotation vector
    rows: Index  # (n,), the picture of each corner
    corners: Array  # (n, 3), in the board's frame [m]
    pixels: Array  # (n, 2), where a lens without distortion shows them
    in_hand: bool  # whether the camera is

    @staticmethod
    def of(shots: BoardPictures, lens: Lens, in_hand: bool) -> _Views:
        """The views of a board through a lens."""
        turns, shifts = held_poses(shots.poses(lens), in_hand)
        places = np.concatenate([np.array([*found.values()]) for found in shots.corners])
        return _Views(
            shots.q,
            np.column_stack([shifts, logarithm(turns)]),
            np.repeat(np.arange(len(turns)), [len(found) for found in shots.corners]),
            np.concatenate(shots.points),
            float(lens.focal.mean()) * lens.undistort(places) + lens.centre,
            in_hand,
        )


_Fit = tuple[float, Mask, Body, Body, Array]
"""The median picture's miss [px], which agree (p,), bodies of corners and poses, misses [px]."""


def _explained(structure: SpatialStructure, views: _Views) -> _Fit:
    """Fit the pictures that agree; raises LogError if too few do."""
    number = np.arange(len(views.q))
    half, found = len(number) // 2, list[_Fit]()
    # a board that was moved once leaves one half whole
    for start in (number >= 0, number < half, number >= half):
        found += _fitted(structure, views, start)
        if found and found[-1][1].mean() > 0.5 and found[-1][0] < _SHARP:
            break
    # the sharpest that leave out few
    best = min(found, key=lambda each: each[0] / each[1].mean(), default=None)
    if best is None or best[0] > _NEAR or best[1].mean() < _LEAST_SHARE:
        raise LogError(
            "no place of camera and board explains the pictures: check that each row of joints is "
            "of its picture, whether it is this robot, and that camera and board were not moved"
        )
    return best


def _fitted(structure: SpatialStructure, views: _Views, kept: Mask) -> list[_Fit]:
    """The fit of the pictures that agree with those that it begins with, none where it fails."""
    found = list[_Fit]()
    for _ in range(4):
        own = kept[views.rows]
        rows = (np.cumsum(kept) - 1)[views.rows[own]]
        if kept.sum() < LEAST:
            break
        try:
            fit, body = fit_corners(
                structure, views.q[kept], views.poses[kept], rows, views.corners[own],
                views.pixels[own], views.in_hand,
            )  # fmt: skip
        except (LogError, np.linalg.LinAlgError):
            return []
        seen = fit.body.predict(np.column_stack([views.q[views.rows], views.corners]))
        off = np.linalg.norm(views.pixels - seen, axis=1)
        by_picture = np.array([np.median(off[views.rows == k]) for k in range(len(kept))])
        usual = float(np.median(by_picture[kept]))
        found = [(usual, kept, fit.body, body, off[own])]
        before, kept = kept, by_picture < max(_ASTRAY * usual, _NEAR)
        if (kept == before).all():
            break
    return found


def _refuse_readings(structure: SpatialStructure, views: _Views, board: Board) -> None:
    """Refuse joints, an eye or a board of which another reading explains the poses far better."""
    poses, names = views.poses, structure.joint_names
    own, inverse, sd = _closed_form(structure, views.q, poses)
    some = thinned(len(poses), _TRIED)
    seen, turns = poses[some], exponential(poses[some, 3:])
    back = np.column_stack([-np.einsum("pji,pj->pi", turns, seen[:, :3]), -seen[:, 3:]])
    eye, where = ("base", "stands still") if views.in_hand else ("hand", "is in the hand")
    other = Finding("eye", f"the camera {where}", f"give `eye={eye!r}`")
    late = Finding("late", "they are a row late or early", "check which row is of which picture")
    units, orders, *signs = readings(
        views.q, names, structure.revolute, any_order=len(names) <= MOST_ORDERED
    )
    rolled = ((np.roll(views.q, k, axis=0), late) for k in (-1, 1))
    for group in ([(views.q, other)], units, rolled, *signs, orders) if own > _FAR else ():
        misfits = [  # the simplest first
            (_closed_form(structure, each[some], back if why is other else seen)[0], why)
            for each, why in group
        ]
        left, best = min(misfits, key=lambda each: each[0], default=(np.inf, other))
        if left < _CLEAR * own:
            hint = "correct the header of the joints" if best.kind == "exchanged" else best.hint
            raise LogError(f"the pictures fit the joints only if {best.words}", hint=hint)
    if abs(inverse - 1.0) > _SIZED + _SURE * sd:
        raise LogError(
            f"the board's squares measure {1e3 * board.square / inverse:.4g} mm by the arm's "
            f"motions, {1e3 * board.square:.4g} mm as said: measure the print, and give its size "
            "in `board`"
        )


def _closed_form(structure: SpatialStructure, q: Array, poses: Array) -> tuple[float, float, float]:
    """Median misfit [m] of poses that the drawing predicts, one over the board's size, its sd.

    Turns between two pictures are conjugate, Z_k Z_l' = Y A_k A_l' Y' (Park and Martin 1994); then
    places z = Y p / size + Y R tool + shift are linear in tool, shift and 1 / size.
    """
    place, turns = structure.with_view("base").pose(q, structure.neutral())
    seen, away, count = exponential(poses[:, 3:]), np.linalg.norm(poses[:, :3], axis=1), len(q)
    first, second = np.triu_indices(count, 1)
    a, b = (logarithm(each[first] @ np.swapaxes(each[second], 1, 2)) for each in (turns, seen))
    frame = nearest_rotation(b.T @ a)
    turned = frame @ turns
    hand = nearest_rotation((np.swapaxes(turned, 1, 2) @ seen).sum(axis=0))
    # what neither tool nor shift follow of the tip's places, and of the poses'
    others = np.concatenate([turned, np.tile(np.eye(3), (count, 1, 1))], axis=2).reshape(-1, 6)
    both = np.column_stack([(place @ frame.T).ravel(), poses[:, :3].ravel()])
    tip, told = (both - others @ np.linalg.lstsq(others, both, rcond=1e-9)[0]).T
    miss = np.linalg.norm((told - tip).reshape(count, 3), axis=1)
    bent = away * np.linalg.norm(logarithm(seen @ np.swapaxes(turned @ hand, 1, 2)), axis=1)
    square = max(float(tip @ tip), 1e-9)  # of few joints nothing tells the size
    inverse = float(tip @ told) / square
    noise = max(float(((told - inverse * tip) ** 2).mean()), _BUILT**2)
    return float(np.median(miss + bent)), inverse, float(np.sqrt(noise / square))
