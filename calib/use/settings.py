"""Numbers of the room that were chosen: each with its unit and its reason."""

import math
from dataclasses import dataclass

from ..body.settings import SHIFT


@dataclass(frozen=True)
class Planning:
    """Of postures to choose from, and of what is told of them."""

    # most poses of a plan; more are babbled, not planned
    most: int = 1000
    # noise of a sensor that is not known yet [m]
    noise: float = 1e-4
    # largest sd of a prior [m or rad]: wider, 200 poses leave no digits
    widest: float = 10.0
    # distance from a joint's limits [rad or m], and the share of its range that it takes at most
    margin: float = math.radians(1.0)
    share: float = 0.02
    # candidates inside, and with one joint at an end: with few of these errors of two_link after
    # 30, 60, 100 poses were 14, 0, 28 % larger (benchmarks/plan.py)
    inside: int = 1200
    faces: int = 1000
    # joints of which all corners are candidates
    corners: int = 8
    # links that meet in such a share of so many postures are built so
    compared: int = 100
    always: float = 0.9
    # a joint's origin that moves less stands still [m]
    stands: float = 1e-6


@dataclass(frozen=True)
class Aiming:
    """Of postures that are led to a point, or to a board before a camera."""

    # postures that are led, and most of them to choose from
    drawn: int = 3000
    most: int = 400
    # distance within which a posture is at its point [m]
    near: float = 1e-6
    # play of a socket [m]
    play: float = 1e-4
    # a common camera's picture [px]
    picture: tuple[int, int] = (1280, 720)
    # its focal lengths and centre [px], k1, k2, p1, p2, k3
    lens: tuple[float, ...] = (900, 900, 640, 360, 0, 0, 0, 0, 0)
    # noise of a corner [px]
    noise: float = 0.2
    # noise of the arm's poses [rad, m]
    turn: float = 1e-5
    shift: float = 1e-5
    # share of the picture's width that a board fills
    filled: float = 0.25
    # most that a board turns about its axes before the camera [rad]
    tilt: tuple[float, float, float] = (0.8, 0.8, 2.0)


@dataclass(frozen=True)
class Correction:
    """Of what is trusted of a correction."""

    # times the 95 % quantile of the model's own: a larger one is not trusted
    usual: float = 3.0
    # least limit of a change [rad or m]: a smaller one would refuse what is harmless
    least: float = 0.01
    # nodes at which the model's own corrections are taken
    nodes: int = 200
    # rows by which the compiled kernel is compared, and how close it has to be [rad or m]
    tried: int = 5
    same: float = 1e-6
    # joints from which on a tool's orientation can be kept
    posed: int = 6


@dataclass(frozen=True)
class Fitting:
    """Of the geometry that is fitted and written."""

    # nodes of a model without rows, at which it is asked
    nodes: int = 500
    # independent answers of maps alone, whose errors hang together: of 500 nodes that were taken as
    # independent, links' intervals left out the true lengths in 11 of 12 cases, by up to four times
    # their halves
    patches: int = 5
    # most rows
    rows: int = 2_000
    # share of the extent: a residual below is rounding
    floor: float = 1e-7
    # prior sd of a planar arm's offsets [rad]: servos are put on to that
    offset: float = math.radians(10.0)
    # prior sd of a planar arm's places, but for turns of a link [m]
    along: float = 5.0 * SHIFT
    # prior sd of a planar sensor's angle and scale [rad or 1]
    flat: float = 100.0
    # a smaller change of an origin is rounding [m or rad]
    tiny: float = 1e-12


PLANNING = Planning()
AIMING = Aiming()
CORRECTION = Correction()
FITTING = Fitting()
