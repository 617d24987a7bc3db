"""Next poses: flange poses with the board in view that tell most of what a rig left open."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arm.rotations import exponential, logarithm, matrix_of
from ..common.arrays import Array
from ..errors import OptionError
from .bundle import Bundle, Corners, Motions, Unknowns
from .fit import Fit, Noise, information
from .rig import HandEye, Place
from .rigid import inverse, rigid


@dataclass(frozen=True)
class Settings:
    """Which poses are drawn, and which are left."""

    draws: int = 3000
    tilt: float = float(
        np.radians(45.0)
    )  # of the camera against the board [rad]
    nearer: tuple[float, float] = (0.7, 1.4)  # times the usual distance
    edge: float = 0.05  # share of the picture that stays free
    # of the nearest pose that the arm was in: it may not reach further [m, rad]
    far: float = 0.25
    turned: float = float(np.radians(60.0))
    lever: float = 0.1  # from what is in the hand to where it is used [m]


SETTINGS = Settings()


def next_poses(
    rig: HandEye, count: int = 2, seed: int = 0
) -> tuple[Array, Array]:
    """Flange poses (count, 4, 4) [m], and the 95 % intervals (count, 3) [m] of what is in the hand.

    Each interval is that after its pose and those before it.
    Raises OptionError where no pose keeps the board in view.
    """
    in_hand = rig.eye == "hand"
    hand = frame_of(rig.hand)
    base = frame_of(rig.base)
    points = np.array(rig.board["points"])
    flange = _candidates(rig, hand, base, points, np.random.default_rng(seed))
    if not in_hand:
        hand, base = base, hand  # the camera, then the board
    motion = np.repeat(np.arange(len(flange)), len(points))
    tiled = np.tile(points, (len(flange), 1))
    corners = Corners(tiled, np.zeros((len(tiled), 2)), motion, in_hand, points)
    bundle = Bundle((corners,), Motions(flange))
    layout = bundle.layout
    values = np.zeros(layout.size)
    lens = rig.lens
    matrix = lens["matrix"]
    values[layout.lenses[0]] = [
        matrix[0][0],
        matrix[1][1],
        *lens["centre"],
    ] + lens["distortion"]
    none = np.zeros((len(flange), layout.errors))
    unknowns = Unknowns(np.stack([hand, base]), values, none)
    pixels = bundle.sights(unknowns)[0].pixels.reshape(len(flange), -1, 2)
    size = np.array(lens["size"])
    margin = SETTINGS.edge * size
    is_in_view = ((pixels > margin) & (pixels < size - margin)).all(axis=(1, 2))
    if is_in_view.sum() < count:
        raise OptionError(
            f"{is_in_view.sum()} of {len(flange)} poses near those of the pictures keep the board "
            f"in view: expected {count}"
        )
    turn = max(rig.repeatability["rotation"], 1e-5)
    shift = max(rig.repeatability["position"], 1e-5)
    noise = Noise(
        corner=np.array([max(rig.reprojection["mean"] / 10, 0.1)]),
        error=np.repeat([turn, shift, 1e-6], [3, 3, 1]),
        prior=np.full(layout.size, np.inf),
    )
    products = information(bundle, Fit(unknowns, noise))
    frames = layout.frames.ravel()
    if not in_hand:
        frames = np.roll(frames, 6)
    errors = np.arange(layout.size, layout.size + layout.errors)
    certain = np.diag(noise.error**-2.0)
    own = products[:, errors[:, None], errors] + certain
    across = products[:, frames[:, None], errors]
    told = products[:, frames[:, None], frames]
    told = told - across @ np.linalg.solve(own, np.swapaxes(across, 1, 2))
    told[~is_in_view] = 0.0
    precision = np.linalg.inv(rig.covariance + 1e-14 * np.eye(12))
    weight = np.repeat([SETTINGS.lever**2, 1.0], 3)
    chosen = []
    intervals = []
    for _ in range(count):
        variances = np.linalg.inv(precision + told).diagonal(axis1=1, axis2=2)[
            :, :6
        ]
        best = int(np.argmin(variances @ weight))
        chosen.append(flange[best])
        intervals.append(1.96 * np.sqrt(variances[best, 3:]))
        precision = precision + told[best]
    return np.array(chosen), np.array(intervals)


def frame_of(place: Place) -> Array:
    """A place as a matrix (4, 4)."""
    return rigid(matrix_of(place["quaternion"]), place["position"])


def _candidates(
    rig: HandEye,
    hand: Array,
    base: Array,
    points: Array,
    rng: np.random.Generator,
) -> Array:
    """Flange poses (n, 4, 4) near those of the rig, the camera aimed at the board."""
    draws = SETTINGS.draws
    scenes = inverse(base) @ rig.flange @ hand
    if rig.eye == "hand":
        scenes = inverse(scenes)
    middle = points.mean(axis=0)
    usual = float(
        np.median((scenes[:, :3, :3] @ middle + scenes[:, :3, 3])[:, 2])
    )
    tilt = SETTINGS.tilt * np.sqrt(rng.random(draws))
    side = rng.uniform(-np.pi, np.pi, draws)
    turns = exponential(
        np.stack([tilt * np.cos(side), tilt * np.sin(side), 0.0 * tilt], axis=1)
    )
    roll = np.pad(rng.uniform(-1.5, 1.5, (draws, 1)), ((0, 0), (2, 0)))
    turns = exponential(roll) @ turns
    # the middle of the board is ahead of the camera, nearer or further, a little aside
    ahead = np.zeros((draws, 3))
    ahead[:, 2] = usual * rng.uniform(*SETTINGS.nearer, draws)
    ahead[:, :2] = ahead[:, 2:] * rng.normal(0.0, 0.05, (draws, 2))
    scenes = rigid(turns, ahead - turns @ middle)
    if rig.eye == "hand":
        flange = base @ inverse(scenes) @ inverse(hand)
    else:
        flange = base @ scenes @ inverse(hand)
    gaps = np.linalg.norm(flange[:, None, :3, 3] - rig.flange[:, :3, 3], axis=2)
    relative = (
        np.swapaxes(rig.flange[:, :3, :3], 1, 2) @ flange[:, None, :3, :3]
    )
    angles = np.linalg.norm(logarithm(relative), axis=2)
    is_near = ((gaps < SETTINGS.far) & (angles < SETTINGS.turned)).any(axis=1)
    return np.asarray(flange[is_near])
