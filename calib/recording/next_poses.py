"""Next poses: those with the whole board in view that best place camera and board.

Random boards before the camera are those of pictures, turned, nearer or farther (`draw`).  Each
motion brings the information of the board's corners there; the best ones are taken one by one
(`most_informative`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arm.rigid import (
    inverse,
    place_points,
    rigid,
    shifts_along_parents,
    turn_of,
)
from ..arm.rotations import exponential
from ..body.covariance import Z95
from ..body.information import after_reading
from ..common.arrays import Array, Index, Mask
from ..errors import OptionError
from ..samples.lens import Lens
from .bundle import (
    LENS_SIZE,
    POSE_SIZE,
    SHAPE_SIZE,
    Bundle,
    CornerLayout,
    Motions,
    Unknowns,
)
from .fit import Noise, information, schur_complement
from .joint_motions import JointMotions
from .lens import lens_parameters
from .rig import HandEye, frame_of


@dataclass(frozen=True)
class DrawSettings:
    """How poses are drawn, and how informative they are."""

    draws: int = 2000
    # least cosine between the line of sight and the board's normal
    upright: float = 0.5
    lever: float = 0.1  # from what is in the hand to where it is used [m]
    # information on a direction, over that before any picture, below which it counts as none
    least: float = 1e-2
    # noise of new corners over the errors of those seen, since lens and board stay uncertain (in
    # twelve worlds the intervals were .8 to 1.15 of the predicted ones)
    careful: float = 4.0


DRAW = DrawSettings()


@dataclass(frozen=True)
class Around:
    """How random boards differ from those of pictures."""

    # most that the board turns about each of its axes [rad]
    tilt: tuple[float, float, float] = (0.5, 0.5, 0.5)
    nearer: tuple[float, float] = (0.8, 1.25)  # factors on the distance
    edge: float = 0.05  # share of the picture that stays free


@dataclass(frozen=True, eq=False)
class ExpectedRig:
    """The expected camera X and board Y, with their uncertainty; symbols as in :mod:`.bundle`."""

    eye: str  # "hand" or "base": where the camera is
    frames: Array  # (2, 4, 4), X and Y [m]
    lens: Lens
    points: Array  # (k, 3), the board's corners in its frame [m]
    boards: Array  # (p, 4, 4), the board before the camera, about which others are drawn [m]
    around: Around
    noise: Noise  # of pictures to come
    precision: Array  # (12, 12), of steps of X and Y
    # (LENS_SIZE + SHAPE_SIZE,), sd of the parameters of lens and board, 0 of known ones
    sizes: Array

    @property
    def in_hand(self) -> bool:
        """Whether the camera is in the hand."""
        return self.eye == "hand"

    @staticmethod
    def of(rig: HandEye) -> ExpectedRig:
        """The rig of pictures, whose lens and board count as known."""
        frames = np.stack([frame_of(rig.hand), frame_of(rig.base)])
        covariance = rig.covariance + 1e-14 * np.eye(2 * POSE_SIZE)
        slope = shifts_along_parents(frames)
        precision = slope.T @ np.linalg.inv(covariance) @ slope
        scenes = inverse(frames[1]) @ rig.flange @ frames[0]
        if rig.eye == "hand":
            scenes = inverse(scenes)
        else:  # the camera is at rest
            frames = frames[::-1]
            precision = np.roll(precision, POSE_SIZE, axis=(0, 1))
        turn = max(rig.repeatability["rotation"], 1e-5)
        shift = max(rig.repeatability["position"], 1e-5)
        corner = DRAW.careful * max(rig.reprojection["mean"], 0.1)
        facts = rig.lens
        width, height = facts["size"]
        matrix = np.array(facts["matrix"])
        parameters = lens_parameters(matrix, facts["distortion"])
        return ExpectedRig(
            rig.eye,
            frames,
            Lens.of((width, height), parameters),
            points=np.array(rig.board["points"]),
            boards=scenes,
            around=Around(),
            noise=rig_noise(corner, turn, shift),
            precision=precision,
            sizes=np.zeros(LENS_SIZE + SHAPE_SIZE),
        )

    def draw(self, count: int, rng: np.random.Generator) -> Array:
        """Random flange poses (n, 4, 4) [m] with the board about as pictures show it."""
        around = self.around
        boards = self.boards[rng.integers(len(self.boards), size=count)]
        middle = self.points.mean(axis=0)
        turns = exponential(around.tilt * rng.uniform(-1.0, 1.0, (count, 3)))
        boards = boards @ rigid(turns, middle - turns @ middle)
        boards[:, :3, 3] *= rng.uniform(*around.nearer, (count, 1))
        # the flange that brings it there
        camera, board = self.frames
        motions: Array = camera @ boards @ inverse(board)
        return inverse(motions) if self.in_hand else motions

    def sees(self, flange: Array) -> Mask:
        """Whether all of the board is in the picture, and not too slanted, (n,)."""
        camera, board = self.frames
        motions = inverse(flange) if self.in_hand else flange
        boards = inverse(camera) @ motions @ board
        places = place_points(boards, self.points)
        depth = places[:, :, 2:]
        ahead = (depth > 0.0).all(axis=(1, 2))
        pixels = self.lens.distort(
            places[:, :, :2] / np.where(depth > 0.0, depth, 1.0)
        )
        size = np.array(self.lens.size)
        margin = self.around.edge * size
        inside = (pixels > margin) & (pixels < size - margin)
        upright = turn_of(boards)[:, 2, 2] > DRAW.upright
        return ahead & upright & inside.all(axis=(1, 2))

    def most_informative(
        self, motions: Motions, count: int
    ) -> tuple[Index, Array]:
        """The most informative motions (count,) of some, one after the other.

        Returns the covariance (count, 6, 6) of steps of what is in the hand after each, too.
        """
        # normal equations of corners that are where the rig expects them
        bundle = self._bundle(motions)
        layout = bundle.layout
        values = np.zeros(layout.size)
        values[layout.lenses[0]] = self.lens.parameters
        exact = np.zeros((motions.count, layout.errors))
        predicted = bundle.predict(Unknowns(self.frames, values, exact))
        bundle = replace(bundle, pixels=predicted.pixels)
        products, _ = information(bundle, self.noise, predicted)
        gains = schur_complement(products, self.noise, layout.size)[0]

        # in units of the sd before any picture
        root = self._root(motions, layout)
        squares, axes = np.linalg.eigh(root.T @ gains @ root)
        telling = squares.max(axis=0) > DRAW.least
        sizes = np.sqrt(np.maximum(squares[:, None, telling], 0.0))
        directions = sizes * axes[:, :, telling]
        hand = layout.frames[0 if self.in_hand else 1]
        return _greedy_by_trace(directions.mT, root[hand], count)

    def _root(self, motions: Motions, layout: CornerLayout) -> Array:
        """Root (s, s) of the covariance of all unknowns before any picture."""
        sizes = np.zeros(layout.size)
        sizes[2 * POSE_SIZE : 2 * POSE_SIZE + len(self.sizes)] = self.sizes
        if isinstance(motions, JointMotions):
            for scale in motions.scales(layout.arm):
                sizes[scale.indices] = scale.start
        root = np.diag(sizes)
        frames = layout.frames.ravel()
        covariance = np.linalg.inv(self.precision)
        root[np.ix_(frames, frames)] = np.linalg.cholesky(covariance)
        return root

    def _bundle(self, motions: Motions) -> Bundle:
        """The board's corners at some motions, with no pixels yet."""
        count = motions.count
        corners = np.tile(self.points, (count, 1))
        return Bundle(
            motions,
            in_hand=[self.in_hand],
            points=corners,
            bends=np.zeros((len(corners), 3, SHAPE_SIZE - 1)),
            pixels=corners[:, :2],
            camera=np.zeros(len(corners), int),
            motion=np.repeat(np.arange(count), len(self.points)),
        )


def rig_noise(corner: float, turn: float, shift: float) -> Noise:
    """Noise of one camera's corners [px] and of motions [rad, m], whose focal length stays."""
    return Noise(
        corner=np.array([corner]),
        error=np.repeat([turn, shift, 1e-6], [3, 3, 1]),
        prior=np.zeros(0),
    )


def _greedy_by_trace(
    directions: Array, hand: Array, count: int
) -> tuple[Index, Array]:
    """Rows after which what is in the hand is best known, one by one, and its covariances.

    directions : (n, r, s), of each row, as :func:`calib.body.information.greedy` takes them
    hand : (6, s), how turn and shift of what is in the hand follow these
    """
    # variance of the place where what is in the hand is used
    weight = np.repeat([DRAW.lever**2, 1.0], 3)
    chosen: list[int] = []
    covariances: list[Array] = []
    for _ in range(count):
        across = directions @ hand.T
        spread = directions @ directions.mT
        spread += np.eye(directions.shape[1])
        explained = (across * np.linalg.solve(spread, across)).sum(axis=1)
        worth = explained @ weight
        worth[chosen] = -1.0
        best = int(worth.argmax())
        chosen.append(best)
        reading = directions[best]
        directions = after_reading(directions, reading)
        hand = after_reading(hand, reading)
        covariances.append(hand @ hand.T)
    return np.array(chosen, np.intp), np.array(covariances)


def next_poses(
    rig: HandEye, count: int = 2, seed: int = 0
) -> tuple[Array, Array]:
    """Flange poses (count, 4, 4) [m], and the 95 % intervals (count, 3) [m] of what is in the hand.

    Each interval is that after its pose and those before it.
    Raises OptionError where no pose keeps the board in view.
    """
    expected = ExpectedRig.of(rig)
    flange = expected.draw(DRAW.draws, np.random.default_rng(seed))
    in_view = flange[expected.sees(flange)]
    if len(in_view) < count:
        raise OptionError(
            f"{len(in_view)} of {len(flange)} poses near those of the pictures keep the board in "
            f"view: expected {count}"
        )
    chosen, covariances = expected.most_informative(Motions(in_view), count)
    along_parent = turn_of(frame_of(rig.hand))
    shifts = along_parent @ covariances[:, 3:, 3:] @ along_parent.T
    sd = np.sqrt(shifts.diagonal(axis1=1, axis2=2))
    return in_view[chosen], Z95 * sd
