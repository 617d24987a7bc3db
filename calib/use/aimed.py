"""Aimed poses: postures at one point, and poses that keep a board in a camera's picture.

Random postures are led to where they are aimed by damped Newton steps; those that arrive are what
a plan chooses from.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from ..arm.arm import Arm, SpatialArm
from ..arm.rotations import exponential, logarithm
from ..body.belief import Body
from ..body.corners import Corners
from ..body.spatial import SpatialStructure, structure_of
from ..common.arrays import Array
from ..common.rows import number_rows
from ..common.scale import Scale
from ..errors import OptionError
from ..inverse.newton import Newton
from ..model.model import Model
from ..recording.board import Pattern, parse_board
from .pose_space import PoseSpace
from .settings import AIMING, PLANNING


@dataclass(frozen=True)
class Around:
    """Where a camera stands about a board.

    One that may be 4 cm and 8 deg from where it is assumed saw 73 % of the boards of poses that
    were aimed as those of a known one are, and sees 92 to 99 % so.
    """

    distance: tuple[
        float, float
    ]  # of the one at which the board fills its share
    aside: float  # sd of the angle at which it is aimed beside the board [rad]
    edge: float  # share of the picture that stays free at its edges


KNOWN = Around(distance=(0.7, 1.4), aside=0.1, edge=0.05)
ASSUMED = Around(distance=(1.0, 1.8), aside=0.05, edge=0.33)


Aimed = tuple[Array, Array]
"""Postures (m, dof) [rad or m] to choose from, and directions (m, p, k) in which each tells.

Directions are in units of the noise and of the prior.
"""


@dataclass(frozen=True)
class _Aim:
    """What an arm's sensor reads, as a task for Newton's steps."""

    structure: SpatialStructure
    beta: Array
    scale: Scale
    count: int
    size: float = 1.0

    def residual(self, u: Array, target: Array) -> tuple[Array, Array]:
        """Residuals (n, m) and their derivatives by the unit coordinates (n, m, dof)."""
        q = self.scale.from_unit(u)
        value, slope = self.structure.predict_and_slope(q, self.beta)
        return self.structure.residual(target, value), slope * self.scale.span


def _joints_towards(
    structure: SpatialStructure,
    beta: Array,
    q: Array,
    target: Array,
    space: PoseSpace,
) -> tuple[Array, Array]:
    """Joints (n, dof) within their limits near targets (n, m), and their distance (n,)."""
    turning = np.zeros(structure.dof, dtype=bool)
    scale = Scale(space.lower, space.upper - space.lower, turning)
    newton = Newton(_Aim(structure, beta, scale, target.shape[1]), scale)
    stand = newton.refine(scale.to_unit(q), target, 0.1 * AIMING.near)
    return scale.from_unit(stand.u), stand.miss


def at_point(
    source: Arm | Model,
    space: PoseSpace,
    point: Sequence[float],
    rng: np.random.Generator,
) -> Aimed:
    """Return postures whose tip is at a point (3,) of the arm's base frame [m].

    Where the point is, is not known.  Raises OptionError if none is found.
    """
    body = None if isinstance(source, Arm) else source.body
    if isinstance(source, SpatialArm):
        structure = structure_of(source, "base")
        beta = structure.neutral()
    elif body is not None and isinstance(body.structure, SpatialStructure):
        structure = body.structure.with_sensor(view="base")
        beta = body.beta
    else:
        raise OptionError(
            "`touch`: expected a robot that moves in space, or a model of one"
        )
    target = number_rows(
        np.ravel(point), ("x", "y", "z"), "touch", OptionError
    )[0][0]
    start = rng.uniform(space.lower, space.upper, (AIMING.drawn, structure.dof))
    q, distance = _joints_towards(
        structure, beta, start, np.tile(target, (AIMING.drawn, 1)), space
    )
    q = q[distance < AIMING.near][: AIMING.most]
    if not len(q):
        raise OptionError(
            f"touch {', '.join(f'{value:g}' for value in target)}: no posture within the limits "
            "reaches this point of the base frame [m]; give another"
        )
    if body is None:
        groups = ("tool", "placement", "offset")
        tip = directions(structure, beta, q, groups, AIMING.play)
    else:
        slope = structure.linearise(q, beta, body.active)[1]
        tip = slope @ body.root / AIMING.play
    place = PLANNING.widest / AIMING.play * np.eye(3)
    places = np.broadcast_to(place, (len(q), 3, 3))
    return q, np.concatenate([tip, places], axis=2)


def directions(
    structure: SpatialStructure,
    beta: Array,
    rows: Array,
    groups: Sequence[str],
    noise: float,
) -> Array:
    """Directions (n, m, k) in which readings of rows tell of groups of parameters.

    They are in units of the noise [unit] and of the prior.
    """
    prior = structure.prior(groups)
    sd = np.minimum(prior.sd, PLANNING.widest)
    lens = structure.groups["lens"]
    sd[lens] = prior.sd[lens]  # pixels of a lens have wide priors
    slope = structure.linearise(rows, beta, prior.active)[1]
    return slope * sd[prior.active] / noise


@dataclass(frozen=True, eq=False)
class Scene:
    """A camera and a board, one of them in the hand; the pose of that one is the reading."""

    structure: SpatialStructure
    beta: Array  # (d,)
    size: Array  # (2,), of the board [m]
    in_hand: bool  # whether the camera is
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

    def corners(self, q: Array) -> Array:
        """Rows (4 n, dof + 3) of the board's outer corners at each posture (n, dof)."""
        signs = np.array([(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)])
        corners = np.column_stack([0.5 * self.size * signs, np.zeros(4)])
        return np.column_stack(
            [np.repeat(q, 4, axis=0), np.tile(corners, (len(q), 1))]
        )

    def sees(self, q: Array) -> Array:
        """Whether all of the board is in the picture, and not too slanted, (n,)."""
        pixels = self.camera.predict(self.corners(q), self.beta).reshape(
            -1, 4, 2
        )
        margin = self.around.edge * self.picture
        inside = (pixels > margin) & (pixels < self.picture - margin)
        turn = exponential(self.structure.predict(q, self.beta)[:, 3:])
        upright = turn[:, 2, 2] > AIMING.upright
        return np.asarray(upright & inside.all(axis=(1, 2)))

    def readings(self, rng: np.random.Generator) -> Array:
        """Readings (n, 6) of cameras about the board: tilted, rolled, nearer, aimed beside it."""
        tilt = AIMING.tilt * np.sqrt(rng.random(AIMING.drawn))
        side = rng.uniform(-np.pi, np.pi, AIMING.drawn)
        leaning = np.stack(
            [tilt * np.cos(side), tilt * np.sin(side), 0.0 * tilt], axis=1
        )
        turn = exponential(leaning)
        away = self.distance * rng.uniform(*self.around.distance, AIMING.drawn)
        shift = -away[:, None] * turn[:, :, 2]
        aside = rng.normal(0.0, self.around.aside, (AIMING.drawn, 2))
        turn = turn @ exponential(
            np.column_stack([aside, rng.uniform(-2, 2, AIMING.drawn)])
        )
        if not self.in_hand:  # the same seen from the camera
            turn = np.swapaxes(turn, 1, 2)
            shift = -np.einsum("nij,nj->ni", turn, shift)
        return np.concatenate([shift, logarithm(turn)], axis=1)

    def directions(self, q: Array) -> Array:
        """Directions (n, 8, k) in which pictures tell of camera, board and arm."""
        groups = (
            *("view.rotation", "view.shift", "tool", "tool.rotation"),
            *("lens", "placement", "offset"),
        )
        rows = self.corners(q)
        corners = directions(self.camera, self.beta, rows, groups, AIMING.noise)
        return corners.reshape(len(q), 8, -1)


def in_sight(
    source: Arm | Model,
    space: PoseSpace,
    board: Pattern | str | bool,
    eye: str,
    start: Array | None,
    rng: np.random.Generator,
) -> Aimed:
    """Return postures in which a camera sees all of a board, from many sides.

    Of a model of pictures of a board, camera and board are known.  Of an arm the camera in the hand
    looks along the tip's z axis, or the board's print faces along it, and at the posture `start`
    (dof,) it sees the board in the middle of its picture; all that more or less.
    Raises OptionError if fewer than three are found.
    """
    if isinstance(source, SpatialArm):
        if isinstance(board, bool) or start is None:
            raise OptionError(
                "handeye: expected the board and `start`, joint values at which the camera sees it "
                "in the middle of its picture"
            )
        scene = _scene_of_arm(
            source, np.array(parse_board(board).size), eye == "hand", start
        )
    elif (
        isinstance(source, Model)
        and source.body is not None
        and "board" in source.about.options
    ):
        scene = _scene_of_body(source.body, source.about.options["board"])
    else:
        raise OptionError(
            "handeye: expected a robot that moves in space, or a model that `calib handeye -o` made"
        )
    readings = scene.readings(rng)
    begin = rng.uniform(
        space.lower, space.upper, (AIMING.drawn, scene.structure.dof)
    )
    if start is not None:
        begin[: AIMING.drawn // 2] = start
    q, _ = _joints_towards(scene.structure, scene.beta, begin, readings, space)
    q = np.unique(q[scene.sees(q)].round(4), axis=0)
    q = q[rng.permutation(len(q))[: AIMING.most]]
    if len(q) < 3:
        raise OptionError(
            f"handeye: the camera sees the board in {len(q)} of the postures about the start; "
            "give `start` where it does, further from the joints' limits"
        )
    return q, scene.directions(q)


def _scene_of_arm(
    arm: SpatialArm, size: Array, in_hand: bool, start: Array
) -> Scene:
    """Return the scene of an arm whose camera and board are not known yet."""
    structure = structure_of(arm, "pose", lens=AIMING.lens)
    groups = structure.groups
    beta = structure.neutral()
    scene = Scene(
        structure, beta, size, in_hand, np.array(AIMING.picture), ASSUMED
    )
    (tip,), (hand,) = structure.pose(start[None], beta)
    if in_hand:
        facing = hand
        place = tip + scene.distance * hand[:, 2]
    else:
        # the frame of a board in the hand is the tip's, half a turn about its x axis on
        facing = hand @ np.diag([1.0, -1.0, -1.0])
        beta[groups["tool.rotation"]] = (np.pi, 0.0, 0.0)
        place = tip - scene.distance * facing[:, 2]
    beta[groups["view.rotation"]] = logarithm(facing.T)
    beta[groups["view.shift"]] = -facing.T @ place
    return scene


def _scene_of_body(body: Body, board: dict[str, Any]) -> Scene:
    """Return the scene of a model of pictures of a board, with its lens."""
    structure = cast(SpatialStructure, body.structure).with_sensor(view="pose")
    groups = structure.groups
    size = np.array(parse_board(board["board"]).size)
    in_hand = board["eye"] == "hand"
    lens = board["lens"]
    beta = body.beta.copy()
    focal = np.mean(lens["focal"])
    beta[groups["lens"]] = (focal, *lens["centre"], lens["distortion"][0])
    if (
        in_hand
    ):  # from the point ahead to the camera, from the corner to the middle
        turn = exponential(beta[groups["tool.rotation"]])
        beta[groups["tool"]] -= turn @ board["point"]
        beta[groups["view.shift"]] -= 0.5 * np.array([*size, 0.0])
    return Scene(structure, beta, size, in_hand, np.array(board["size"]), KNOWN)
