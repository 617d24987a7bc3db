"""Next poses: flange poses with the board in view that tell most of what a rig left open."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arm.rotations import exponential, matrix_of
from ..common.arrays import Array
from ..errors import OptionError
from .bundle import SHAPE, Bundle, Motions, Unknowns
from .fit import Noise, information
from .rig import HandEye, Place
from .rigid import inverse, rigid


@dataclass(frozen=True)
class Settings:
    """Which poses are drawn, and which are left."""

    draws: int = 2000
    # most that the board turns about each axis from a picture's pose [rad]
    tilt: float = 0.5
    nearer: tuple[float, float] = (0.8, 1.25)  # times that picture's distance
    edge: float = 0.05  # share of the picture that stays free
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
    motion = np.repeat(np.arange(len(flange)), len(points))
    tiled = np.tile(points, (len(flange), 1))
    bundle = Bundle(
        Motions(flange),
        in_hand=[in_hand],
        points=tiled,
        bends=np.zeros((len(tiled), 3, SHAPE - 1)),
        pixels=tiled[:, :2],
        camera=np.zeros(len(tiled), int),
        motion=motion,
    )
    layout = bundle.layout
    values = np.zeros(layout.size)
    lens = rig.lens
    focal = np.diag(lens["matrix"])[:2]
    values[layout.lenses[0]] = [*focal, *lens["centre"], *lens["distortion"]]
    exact = np.zeros((len(flange), layout.errors))
    frames = np.stack([hand, base])
    order = layout.frames
    if not in_hand:  # the camera is first, then the board
        frames = frames[::-1]
        order = order[::-1]
    sight = bundle.look(Unknowns(frames, values, exact))
    pixels = sight.pixels.reshape(len(flange), -1, 2)
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
    seen = replace(bundle, pixels=sight.pixels)
    products = information(seen, noise, sight)[0]
    places = order.ravel()
    certain = np.diag(noise.error**-2.0)
    own = products[:, layout.size :, layout.size :] + certain
    across = products[:, places, layout.size :]
    gain = products[:, places[:, None], places]
    gain = gain - across @ np.linalg.solve(own, np.swapaxes(across, 1, 2))
    gain[~is_in_view] = 0.0
    precision = np.linalg.inv(rig.covariance + 1e-14 * np.eye(12))
    weight = np.repeat([SETTINGS.lever**2, 1.0], 3)
    chosen = []
    intervals = []
    for _ in range(count):
        after = np.linalg.inv(precision + gain)
        variances = after.diagonal(axis1=1, axis2=2)[:, :6]
        best = int(np.argmin(variances @ weight))
        chosen.append(flange[best])
        intervals.append(1.96 * np.sqrt(variances[best, 3:]))
        precision = precision + gain[best]
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
    """Flange poses (n, 4, 4) of the rig's pictures, in which the board turns about its middle."""
    draws = SETTINGS.draws
    pictures = rng.integers(len(rig.flange), size=draws)
    scenes = inverse(base) @ rig.flange[pictures] @ hand
    if rig.eye == "hand":
        scenes = inverse(scenes)
    middle = points.mean(axis=0)
    turns = exponential(SETTINGS.tilt * rng.uniform(-1.0, 1.0, (draws, 3)))
    scenes = scenes @ rigid(turns, middle - turns @ middle)
    scenes[:, :3, 3] *= rng.uniform(*SETTINGS.nearer, (draws, 1))
    if rig.eye == "hand":
        scenes = inverse(scenes)
    return np.asarray(base @ scenes @ inverse(hand))
