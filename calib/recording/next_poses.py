"""Next poses: flange poses with the board in view that tell most of what a rig left open.

Random poses near those of the pictures (`_candidates`) are each credited with the information that
the board's corners would bring there (`_gains`); of them the best is taken, again and again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arm.rigid import inverse, rigid, shifts_along_parents
from ..arm.rotations import exponential, matrix_of
from ..common.arrays import Array, Mask
from ..errors import OptionError
from .bundle import POSE, SHAPE, Bundle, Motions, Unknowns
from .fit import Noise, information
from .rig import HandEye, Place


@dataclass(frozen=True)
class Settings:
    """How poses are drawn, and which are credited with what."""

    draws: int = 2000
    # most that the board turns about each axis from a picture's pose [rad]
    tilt: float = 0.5
    nearer: tuple[float, float] = (0.8, 1.25)  # times that picture's distance
    edge: float = 0.05  # share of the picture that stays free
    lever: float = 0.1  # from what is in the hand to where it is used [m]
    # times the corners' misses, that new ones are credited with: lens and board stay as open as
    # they are (in twelve worlds the intervals that came out were .8 to 1.15 of the promised)
    careful: float = 4.0


SETTINGS = Settings()


def next_poses(
    rig: HandEye, count: int = 2, seed: int = 0
) -> tuple[Array, Array]:
    """Flange poses (count, 4, 4) [m], and the 95 % intervals (count, 3) [m] of what is in the hand.

    Each interval is that after its pose and those before it.
    Raises OptionError where no pose keeps the board in view.
    """
    flange = _candidates(rig, np.random.default_rng(seed))
    is_in_view, gain = _gains(rig, flange)
    if is_in_view.sum() < count:
        raise OptionError(
            f"{is_in_view.sum()} of {len(flange)} poses near those of the pictures keep the board "
            f"in view: expected {count}"
        )
    gain[~is_in_view] = 0.0

    # add the pose after which what is in the hand is best known, one by one
    covariance = rig.covariance + 1e-14 * np.eye(2 * POSE)
    slope = shifts_along_parents(
        np.stack([frame_of(rig.hand), frame_of(rig.base)])
    )
    precision = slope.T @ np.linalg.inv(covariance) @ slope
    # variance of the place where what is in the hand is used
    weight = np.repeat([SETTINGS.lever**2, 1.0], 3)
    chosen = []
    intervals = []
    for _ in range(count):
        covariances = np.linalg.inv(precision + gain)
        diagonals = covariances.diagonal(axis1=1, axis2=2)
        hand_variances = diagonals[:, :POSE]
        best = int(np.argmin(hand_variances @ weight))
        shift_sd = np.sqrt(hand_variances[best, 3:])
        chosen.append(flange[best])
        intervals.append(1.96 * shift_sd)
        precision = precision + gain[best]
    return np.array(chosen), np.array(intervals)


def _gains(rig: HandEye, flange: Array) -> tuple[Mask, Array]:
    """Which poses (n, 4, 4) show the whole board, and the information (n, 12, 12) that each adds.

    It is of turn and shift of what is in the hand, and of what stands still.
    """
    # normal equations of corners that are where the rig expects them
    bundle = _expected_bundle(rig, flange)
    layout = bundle.layout
    sight = bundle.look(_unknowns(rig, bundle))
    noise = _noise(rig, layout.size)
    bundle = replace(bundle, pixels=sight.pixels)
    products, _ = information(bundle, noise, sight)

    # of the two frames, less what errors of the motion take away
    places = layout.frames if rig.eye == "hand" else layout.frames[::-1]
    frames = places.ravel()
    across = products[:, frames, layout.size :]
    error_products = products[:, layout.size :, layout.size :]
    error_precision = np.diag(noise.error**-2.0)
    spread = np.linalg.inv(error_products + error_precision)
    gain = products[:, frames[:, None], frames]
    gain = gain - across @ spread @ np.swapaxes(across, 1, 2)

    # poses with all corners within the picture
    size = np.array(rig.lens["size"])
    margin = SETTINGS.edge * size
    is_inside = (sight.pixels > margin) & (sight.pixels < size - margin)
    by_pose = is_inside.reshape(len(flange), -1)
    return np.asarray(by_pose.all(axis=1)), gain


def _noise(rig: HandEye, size: int) -> Noise:
    """Noise of pictures to come; all `size` unknowns are free."""
    turn = max(rig.repeatability["rotation"], 1e-5)
    shift = max(rig.repeatability["position"], 1e-5)
    corner = max(rig.reprojection["mean"], 0.1)
    return Noise(
        corner=np.array([SETTINGS.careful * corner]),
        error=np.repeat([turn, shift, 1e-6], [3, 3, 1]),
        prior=np.full(size, np.inf),
    )


def _expected_bundle(rig: HandEye, flange: Array) -> Bundle:
    """The board's corners at flange poses (n, 4, 4) [m], with no pixels yet."""
    points = np.array(rig.board["points"])
    corners = np.tile(points, (len(flange), 1))
    return Bundle(
        Motions(flange),
        in_hand=[rig.eye == "hand"],
        points=corners,
        bends=np.zeros((len(corners), 3, SHAPE - 1)),
        pixels=corners[:, :2],
        camera=np.zeros(len(corners), int),
        motion=np.repeat(np.arange(len(flange)), len(points)),
    )


def _unknowns(rig: HandEye, bundle: Bundle) -> Unknowns:
    """The rig as values of a bundle's unknowns, its motions without errors."""
    layout = bundle.layout
    values = np.zeros(layout.size)
    lens = rig.lens
    focal = np.diag(lens["matrix"])[:2]
    values[layout.lenses[0]] = [*focal, *lens["centre"], *lens["distortion"]]
    # the camera's frame is the first, then the board's
    frames = np.stack([frame_of(rig.hand), frame_of(rig.base)])
    if rig.eye == "base":
        frames = frames[::-1]
    errors = np.zeros((bundle.motions.count, layout.errors))
    return Unknowns(frames, values, errors)


def frame_of(place: Place) -> Array:
    """A place as a matrix (4, 4)."""
    return rigid(matrix_of(place["quaternion"]), place["position"])


def _candidates(rig: HandEye, rng: np.random.Generator) -> Array:
    """Random flange poses (n, 4, 4) [m]: the board as in a picture, turned, nearer or farther."""
    draws = SETTINGS.draws
    hand = frame_of(rig.hand)
    base = frame_of(rig.base)
    pictures = rng.integers(len(rig.flange), size=draws)

    # the board before the camera in a picture
    hand_poses = inverse(base) @ rig.flange[pictures] @ hand
    boards = inverse(hand_poses) if rig.eye == "hand" else hand_poses

    # turned about its middle, nearer or farther
    points = np.array(rig.board["points"])
    middle = points.mean(axis=0)
    vectors = SETTINGS.tilt * rng.uniform(-1.0, 1.0, (draws, 3))
    turns = exponential(vectors)
    shifts = middle - turns @ middle
    boards = boards @ rigid(turns, shifts)
    boards[:, :3, 3] *= rng.uniform(*SETTINGS.nearer, (draws, 1))

    # the flange that brings it there
    hand_poses = inverse(boards) if rig.eye == "hand" else boards
    flange: Array = base @ hand_poses @ inverse(hand)
    return flange
