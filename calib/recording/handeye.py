"""Hand-eye calibration: where the camera is, from pictures of a board, with the arm that took them.

Arm, what is in its hand, what stands still and the lens are one fit (:mod:`calib.body.corners`).
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..arm.arm import Arm, SpatialArm
from ..body.belief import Body
from ..body.corners import Held, held_of
from ..body.sensor import SensorPose
from ..body.spatial import SpatialStructure, structure_of
from ..common.choices import EYES
from ..common.parallel import one_blas_thread
from ..common.wording import listed
from ..errors import OptionError
from ..samples.samples import Samples
from .board import Board
from .board_pictures import BoardPictures, BoardViews, Source, find_board
from .board_trouble import explain
from .joint_table import JointTable
from .lens import Lens

_TURNED = np.radians(7.5)  # least spread of the hand's turns about each axis
_FOCAL_SD, _CENTRE_SD, _K1_SD = 0.3, 0.05, 0.3  # of a lens to be found, shares of its width
_Z95 = 1.96


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
    millimetres: float  # the mean as a distance at the board [mm]
    lens: dict[str, Any]  # focal length with its interval's half-width, centre [px], k1
    limited_by: str  # what limits the accuracy, and what would help most
    notes: tuple[str, ...]
    poses: Samples  # the pictures as a log of poses, as `calib log --eye` writes them
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
    structure = _structure(arm, lens, known is not None)
    found = explain(structure, shots.seen(lens, in_hand), shots.board)
    body, own, views = found.body, structure.groups["lens"], found.views
    f, u, v, k1 = (float(value) for value in body.beta[own])
    focal_95 = _Z95 * body.kappa * float(found.fit.body.deviations[own[0]])
    sensor, held = SensorPose.of(body), held_of(body)
    assert sensor is not None  # noqa: S101 - the arm has a drawing
    hand = _placed(held, body.kappa)
    off = float(found.off.mean())
    depth = float(np.median(np.linalg.norm(views.poses[:, :3], axis=1)))
    # corners were fitted without the distortion that was known: what was found comes on top
    glass = replace(
        lens, focal=lens.focal * f / lens.focal.mean(), centre=np.array([u, v]),
        distortion=lens.distortion + k1 * np.eye(5)[0],
    )  # fmt: skip
    first, last = arm.joint_names[0], arm.joint_names[-1]
    turn, shift = np.degrees(max(hand["rotation_95"])), 1e3 * max(hand["position_95"])
    gauge = (
        f"no picture tells a turn about {first} and a shift along it from where the base stands, "
        f"nor a turn about {last} and a shift along it from what is in the hand: both joints count "
        f"as their encoders say. Of a tip that the true {last} carries, the place in the hand is "
        f"sure to {turn:.2g} deg and {shift:.2g} mm"
    )
    return HandEye(
        eye="hand" if in_hand else "base",
        pictures=shots.count,
        used=len(views.q),
        hand=hand,
        base=_placed(sensor, body.kappa),
        reprojection={"mean": off, "max": float(found.off.max())},
        millimetres=1e3 * off * depth / f,
        lens={
            "focal": f, "centre": [u, v], "k1": float(glass.distortion[0]), "focal_95": focal_95,
            "known": known is not None,
        },
        limited_by=_limit(views, listed(arm.joint_names[-2:]), focal_95 / f, off, shift),
        notes=(*shots.notes, *doubts, *found.notes, gauge),
        poses=_samples(arm, shots.log(glass, in_hand), found.kept),
        body=body,
    )  # fmt: skip


def _structure(arm: SpatialArm, lens: Lens, known: bool) -> SpatialStructure:
    """The arm before a camera, with what is known of its lens."""
    focal, width = float(lens.focal.mean()), lens.size[0]
    sd = [_FOCAL_SD * focal, _CENTRE_SD * width, _CENTRE_SD * width, _K1_SD]
    if known:
        told = np.sqrt(np.maximum(np.diag(lens.covariance), 0.0))
        sd = [told[:2].mean(), *told[2:5]]
    u, v = map(float, lens.centre)
    return structure_of(arm, "pose", lens=(focal, u, v, 0.0), lens_sd=tuple(map(float, sd)))


def _placed(place: SensorPose | Held, kappa: float) -> dict[str, Any]:
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


def _limit(views: BoardViews, wrist: str, focal: float, off: float, hand: float) -> str:
    """What limits the accuracy, and what would help most."""
    turns = np.linalg.svd(views.poses[:, 3:] - views.poses[:, 3:].mean(axis=0))[1]
    spread = float(turns[-1]) / np.sqrt(len(views.q))
    found = f"the arm's own errors (hand known to {hand:.1f} mm)"
    add = f"add pictures with {wrist} turned by 30 deg and more, each way"
    if spread < _TURNED:
        found = f"few turns of the wrist (by {np.degrees(spread):.1f} deg about one axis)"
    elif focal > 0.01:
        found = f"the lens (its focal length is known to {100 * focal:.1f} %)"
        add = "add pictures with the board tilted, nearer and further away, or give a lens"
    elif off > 0.5:
        found, add = f"blur (corners miss by {off:.2g} px)", "let the arm stand still for each"
    return f"{found}; {add}"


def _samples(arm: SpatialArm, log: Any, kept: Any) -> Samples:
    """The pictures that agree as a log of poses."""
    q = log.q[kept]
    return Samples(
        q, log.x[kept], arm.joint_names, np.minimum(arm.lower, q.min(axis=0)),
        np.maximum(arm.upper, q.max(axis=0)), arm.revolute, arm=arm,
        orientation=log.quaternion[kept], source=log.about(),
    )  # fmt: skip
