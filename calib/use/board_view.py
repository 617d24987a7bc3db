"""Board view: a camera and a board, one of them in the hand, and what the camera sees of the board.

A reading is the pose (6,) of what the hand carries as what stands beside the arm has it: position
[m] and rotation vector [rad].  `readings` draws poses that keep the board in the picture, `sees`
checks those that the arm can take, and `directions` says what a picture of each would tell.
"""

from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from ..arm.arm import SpatialArm
from ..arm.rotations import exponential, logarithm
from ..body.belief import Body
from ..body.corners import Corners
from ..body.spatial import SpatialStructure, structure_of
from ..common.arrays import Array
from ..recording.board import parse_board
from .settings import AIMING
from .whitened import whitened_jacobian

_CORNERS = np.array([(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)])
_OF_CAMERA = ("view.rotation", "view.shift", "tool", "tool.rotation", "lens")
_OF_ARM = ("placement", "offset")


@dataclass(frozen=True)
class Around:
    """Where a camera stands about a board.

    One that may be 4 cm and 8 deg from where it is assumed saw 73 % of the boards of poses that
    were aimed as those of a known one are, and sees 92 to 99 % so.
    """

    # least and most, of the distance at which the board fills its share of the picture
    distance: tuple[float, float]
    aside: float  # sd of the angle at which it is aimed beside the board [rad]
    edge: float  # share of the picture that stays free at its edges


KNOWN = Around(distance=(0.7, 1.4), aside=0.1, edge=0.05)
ASSUMED = Around(distance=(1.0, 1.8), aside=0.05, edge=0.33)


@dataclass(frozen=True, eq=False)
class BoardView:
    """A camera and a board, one of them in the hand."""

    structure: SpatialStructure
    beta: Array  # (d,)
    size: Array  # (2,), of the board [m]
    in_hand: bool  # whether the camera is in the hand, and not the board
    picture: Array  # (2,) [px]
    around: Around  # where the camera may stand

    @property
    def distance(self) -> float:
        """From the board to the camera in whose picture it fills its share [m]."""
        focal = self.beta[self.structure.groups["lens"]][0]
        return float(
            focal * self.size.max() / (AIMING.filled * self.picture[0])
        )

    @property
    def camera(self) -> SpatialStructure:
        """The same chain, whose readings are pixels of corners."""
        corners = Corners(self.structure.viewpoint, self.in_hand)
        pixels = self.structure.with_sensor(view="pose", unit="px")
        return pixels.with_fields(others=(corners,), place=1)

    def corner_rows(self, q: Array) -> Array:
        """Rows (4 n, dof + 3): postures (n, dof), each with the board's outer corners [m]."""
        corners = np.column_stack([0.5 * self.size * _CORNERS, np.zeros(4)])
        postures = np.repeat(q, 4, axis=0)
        return np.column_stack([postures, np.tile(corners, (len(q), 1))])

    def sees(self, q: Array) -> Array:
        """Whether all of the board is in the picture, and not too slanted, (n,)."""
        rows = self.corner_rows(q)
        pixels = self.camera.predict(rows, self.beta).reshape(-1, 4, 2)
        margin = self.around.edge * self.picture
        inside = (pixels > margin) & (pixels < self.picture - margin)
        turn = exponential(self.structure.predict(q, self.beta)[:, 3:])
        upright = turn[:, 2, 2] > AIMING.upright
        return np.asarray(upright & inside.all(axis=(1, 2)))

    def readings(self, rng: np.random.Generator) -> Array:
        """Draw readings (n, 6) of cameras that look at the board from many sides."""
        tilt = _drawn_tilts(rng)
        least, most = self.around.distance
        away = self.distance * rng.uniform(least, most, AIMING.drawn)
        shift = -away[:, None] * tilt[:, :, 2]  # back along the line of sight
        aside = rng.normal(0.0, self.around.aside, (AIMING.drawn, 2))
        roll = rng.uniform(-2, 2, AIMING.drawn)
        turn = tilt @ exponential(np.column_stack([aside, roll]))
        if not self.in_hand:  # the board, as the camera has it
            turn = np.swapaxes(turn, 1, 2)
            shift = -np.einsum("nij,nj->ni", turn, shift)
        return np.concatenate([shift, logarithm(turn)], axis=1)

    def directions(self, q: Array) -> Array:
        """Directions (n, 8, k) in which pictures tell of camera, board and arm."""
        groups = (*_OF_CAMERA, *_OF_ARM)
        rows = self.corner_rows(q)
        by_corner = whitened_jacobian(
            self.camera, self.beta, rows, groups, AIMING.noise
        )
        return by_corner.reshape(len(q), 8, -1)


def _drawn_tilts(rng: np.random.Generator) -> Array:
    """Turns (n, 3, 3) of cameras that lean to any side, evenly over the cone of `AIMING.tilt`."""
    tilt = AIMING.tilt * np.sqrt(rng.random(AIMING.drawn))
    side = rng.uniform(-np.pi, np.pi, AIMING.drawn)
    leaning = np.stack(
        [tilt * np.cos(side), tilt * np.sin(side), 0.0 * tilt], axis=1
    )
    return exponential(leaning)


def view_of_arm(
    arm: SpatialArm, size: Array, in_hand: bool, start: Array
) -> BoardView:
    """Return the view of an arm whose camera and board are not known yet.

    size : (2,), of the board [m]
    start : (dof,) [rad or m], where the board is in the middle of the picture
    """
    structure = structure_of(arm, "pose", lens=AIMING.lens)
    groups = structure.groups
    beta = structure.neutral()
    picture = np.array(AIMING.picture)
    view = BoardView(structure, beta, size, in_hand, picture, ASSUMED)
    (tip,), (hand,) = structure.pose(start[None], beta)
    if in_hand:
        facing = hand
        place = tip + view.distance * hand[:, 2]
    else:
        # the frame of a board in the hand is the tip's, half a turn about its x axis on
        facing = hand @ np.diag([1.0, -1.0, -1.0])
        beta[groups["tool.rotation"]] = (np.pi, 0.0, 0.0)
        place = tip - view.distance * facing[:, 2]
    beta[groups["view.rotation"]] = logarithm(facing.T)
    beta[groups["view.shift"]] = -facing.T @ place
    return view


def view_of_body(body: Body, board: dict[str, Any]) -> BoardView:
    """Return the view of a model of pictures, from its body and what it says of board and lens."""
    structure = cast(SpatialStructure, body.structure).with_sensor(view="pose")
    groups = structure.groups
    size = np.array(parse_board(board["board"]).size)
    in_hand = board["eye"] == "hand"
    lens = board["lens"]
    beta = body.beta.copy()
    focal = np.mean(lens["focal"])
    beta[groups["lens"]] = (focal, *lens["centre"], lens["distortion"][0])
    if in_hand:
        # from the point ahead to the camera, from the corner to the middle
        turn = exponential(beta[groups["tool.rotation"]])
        beta[groups["tool"]] -= turn @ board["point"]
        beta[groups["view.shift"]] -= 0.5 * np.array([*size, 0.0])
    picture = np.array(board["size"])
    return BoardView(structure, beta, size, in_hand, picture, KNOWN)
