"""Next poses: flange poses with the board in view that tell most of what a rig left open."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arm.rotations import exponential, matrix_of
from ..common.arrays import Array, Mask
from ..errors import OptionError
from .bundle import POSE, SHAPE, Bundle, Motions, Unknowns
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
    precision = np.linalg.inv(rig.covariance + 1e-14 * np.eye(2 * POSE))
    weight = np.repeat([SETTINGS.lever**2, 1.0], 3)
    chosen = []
    intervals = []
    for _ in range(count):
        after = np.linalg.inv(precision + gain)
        variances = after.diagonal(axis1=1, axis2=2)[:, :POSE]
        best = int(np.argmin(variances @ weight))
        chosen.append(flange[best])
        intervals.append(1.96 * np.sqrt(variances[best, 3:]))
        precision = precision + gain[best]
    return np.array(chosen), np.array(intervals)


def _gains(rig: HandEye, flange: Array) -> tuple[Mask, Array]:
    """Which poses (n,) show the whole board, and what each tells of hand and base (n, 12, 12)."""
    bundle, unknowns = _ahead(rig, flange)
    layout = bundle.layout
    sight = bundle.look(unknowns)
    noise = _noise(rig, layout.size)
    exact_bundle = replace(bundle, pixels=sight.pixels)
    products, _ = information(exact_bundle, noise, sight)
    places = layout.frames
    if rig.eye == "base":
        places = places[::-1]
    some = places.ravel()
    errors = products[:, layout.size :, layout.size :]
    across = products[:, some, layout.size :]
    precision = np.diag(noise.error**-2.0)
    spread = np.linalg.inv(errors + precision)
    gain = products[:, some[:, None], some]
    gain = gain - across @ spread @ np.swapaxes(across, 1, 2)
    size = np.array(rig.lens["size"])
    margin = SETTINGS.edge * size
    inside = (sight.pixels > margin) & (sight.pixels < size - margin)
    inside = inside.reshape(len(flange), -1)
    is_in_view: Mask = np.asarray(inside.all(axis=1))
    return is_in_view, gain


def _noise(rig: HandEye, size: int) -> Noise:
    """The noise of pictures to come, of a number of free unknowns."""
    turn = max(rig.repeatability["rotation"], 1e-5)
    shift = max(rig.repeatability["position"], 1e-5)
    corner = max(rig.reprojection["mean"], 0.1)
    return Noise(
        corner=np.array([SETTINGS.careful * corner]),
        error=np.repeat([turn, shift, 1e-6], [3, 3, 1]),
        prior=np.full(size, np.inf),
    )


def _ahead(rig: HandEye, flange: Array) -> tuple[Bundle, Unknowns]:
    """The board's corners at poses (n, 4, 4), whose pixels are open, and the rig as unknowns."""
    points = np.array(rig.board["points"])
    corners = np.tile(points, (len(flange), 1))
    bundle = Bundle(
        Motions(flange),
        in_hand=[rig.eye == "hand"],
        points=corners,
        bends=np.zeros((len(corners), 3, SHAPE - 1)),
        pixels=corners[:, :2],
        camera=np.zeros(len(corners), int),
        motion=np.repeat(np.arange(len(flange)), len(points)),
    )
    layout = bundle.layout
    values = np.zeros(layout.size)
    lens = rig.lens
    focal = np.diag(lens["matrix"])[:2]
    values[layout.lenses[0]] = [*focal, *lens["centre"], *lens["distortion"]]
    # the camera's frame is the first, then the board's
    frames = np.stack([frame_of(rig.hand), frame_of(rig.base)])
    if rig.eye == "base":
        frames = frames[::-1]
    exact = np.zeros((len(flange), layout.errors))
    return bundle, Unknowns(frames, values, exact)


def frame_of(place: Place) -> Array:
    """A place as a matrix (4, 4)."""
    return rigid(matrix_of(place["quaternion"]), place["position"])


def _candidates(rig: HandEye, rng: np.random.Generator) -> Array:
    """Flange poses (n, 4, 4) of the rig's pictures, in which the board turns about its middle."""
    draws = SETTINGS.draws
    hand = frame_of(rig.hand)
    base = frame_of(rig.base)
    pictures = rng.integers(len(rig.flange), size=draws)
    boards = inverse(base) @ rig.flange[pictures] @ hand
    if rig.eye == "hand":
        boards = inverse(boards)
    middle = np.array(rig.board["points"]).mean(axis=0)
    turns = exponential(SETTINGS.tilt * rng.uniform(-1.0, 1.0, (draws, 3)))
    boards = boards @ rigid(turns, middle - turns @ middle)
    boards[:, :3, 3] *= rng.uniform(*SETTINGS.nearer, (draws, 1))
    if rig.eye == "hand":
        boards = inverse(boards)
    return np.asarray(base @ boards @ inverse(hand))
