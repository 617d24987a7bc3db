"""Numbers of the room that were chosen: each with its unit and its reason."""

import math
from dataclasses import dataclass

from ..body.settings import SHIFT


@dataclass(frozen=True)
class Planning:
    """Of postures to choose from, and of what is told of them."""

    most: int = 1000  # poses; more are babbled, not planned
    noise: float = 1e-4  # of a sensor that is not known yet [m]
    # sd of a prior [m or rad]: wider, 200 poses leave no digits
    widest: float = 10.0
    margin: float = math.radians(1.0)  # from a joint's limits [rad or m]
    share: float = 0.02  # of a joint's range that the margin takes at most
    # candidates: with few on faces errors of two_link after 30, 60, 100 poses were 14, 0, 28 %
    # larger (benchmarks/plan.py)
    inside: int = 1200
    faces: int = 1000  # with one joint at an end
    corners: int = 8  # joints of which all corners are candidates
    # postures; links that meet in most of them are built so
    compared: int = 100
    always: float = 0.9  # share of these postures
    stands: float = 1e-6  # a joint's origin that moves less stands still [m]


@dataclass(frozen=True)
class Aiming:
    """Of postures that are led to a point, or to a board before a camera."""

    drawn: int = 3000  # postures that are led
    most: int = 400  # of them to choose from
    near: float = 1e-6  # within which a posture is at its point [m]
    play: float = 1e-4  # of a socket [m]
    picture: tuple[int, int] = (1280, 720)  # a common camera's [px]
    # its focal lengths and centre [px], k1, k2, p1, p2, k3
    lens: tuple[float, ...] = (900, 900, 640, 360, 0, 0, 0, 0, 0)
    noise: float = 0.2  # of a corner [px]
    turn: float = 1e-5  # of the arm's poses [rad]
    shift: float = 1e-5  # the same [m]
    filled: float = 0.25  # share of the picture's width that a board fills
    # most that a board turns about its axes before the camera [rad]
    tilt: tuple[float, float, float] = (0.8, 0.8, 2.0)


@dataclass(frozen=True)
class Correction:
    """Of what is trusted of a correction."""

    # times the 95 % quantile of the model's own: a larger one is not trusted
    usual: float = 3.0
    # limit [rad or m]: a smaller one would refuse what is harmless
    least: float = 0.01
    nodes: int = 200  # at which the model's own corrections are taken
    tried: int = 5  # rows by which the compiled kernel is compared
    same: float = 1e-6  # how close it has to be [rad or m]
    posed: int = 6  # joints from which on a tool's orientation can be kept


@dataclass(frozen=True)
class Fitting:
    """Of the geometry that is fitted and written."""

    nodes: int = 500  # of a model without rows, at which it is asked
    # of maps alone, whose errors hang together: of 500 nodes that were taken as independent, links'
    # intervals left out the true lengths in 11 of 12 cases, by up to four times their halves
    patches: int = 5
    rows: int = 2_000  # at most
    floor: float = 1e-7  # of the extent: a residual below is rounding
    offset: float = math.radians(
        10.0
    )  # prior sd of a planar arm's: servos are put on to that
    along: float = (
        5.0 * SHIFT
    )  # prior sd of a planar arm's places, but for turns of a link [m]
    # prior sd of a planar sensor's angle and scale [rad or 1]
    flat: float = 100.0
    tiny: float = 1e-12  # a smaller change of an origin is rounding [m or rad]


PLANNING = Planning()
AIMING = Aiming()
CORRECTION = Correction()
FITTING = Fitting()
