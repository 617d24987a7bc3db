"""Numbers of the room that were chosen: each with its unit and its reason."""

import math
from dataclasses import dataclass

from ..body.settings import DRAWN_SHIFT_SD


@dataclass(frozen=True)
class PlanningSettings:
    """How poses are planned."""

    # most poses of a plan; more are babbled, not planned
    most: int = 1000
    # noise of a sensor that is not known yet [m]
    noise: float = 1e-4
    # largest sd of a prior [m or rad]: wider, 200 poses leave no digits
    widest: float = 10.0
    # distance from a joint's limits [rad or m]
    margin: float = math.radians(1.0)
    # largest share of a joint's range that this distance takes
    share: float = 0.02
    # candidates inside of the ranges
    inside: int = 1200
    # candidates with one joint at an end: with few of these errors of two_link after 30, 60, 100
    # poses were 14, 0, 28 % larger (benchmarks/plan.py)
    faces: int = 1000
    # joints of which all corners are candidates
    corners: int = 8
    # postures that show which links always meet
    compared: int = 100
    # share of these in which links meet that are built so
    always: float = 0.9
    # motion below which a joint's origin is at rest [m]
    stands: float = 1e-6


@dataclass(frozen=True)
class AimingSettings:
    """How postures are found that bring the tip to a point, or a board before a camera."""

    # random postures from which searches start
    draws: int = 3000
    # most postures to choose from
    most: int = 400
    # distance within which a posture is at its point [m]
    near: float = 1e-6
    # play of a socket [m]
    play: float = 1e-4
    # a common camera's picture [px]
    picture: tuple[int, int] = (1280, 720)
    # parameters of its lens: focal lengths and centre [px], k1, k2, p1, p2, k3
    lens: tuple[float, ...] = (900, 900, 640, 360, 0, 0, 0, 0, 0)
    # sd of these parameters where the lens may be fitted: wide, and not measured
    lens_sd: tuple[float, ...] = (270, 270, 60, 60, 0.2, 0.2, 0.01, 0.01, 0.2)
    # sd of a board's size [1] and shape [half diagonals]: not measured either
    board_sd: float = 3e-3
    # noise of a corner [px]
    noise: float = 0.3
    # an arm's repeatability in turns [rad] and shifts [m]
    turn: float = 2e-4
    shift: float = 1e-4
    # share of the picture's width that a board fills
    filled: float = 0.25
    # most that a board turns about its axes before the camera [rad]
    tilt: tuple[float, float, float] = (0.8, 0.8, 2.0)
    # factors on the distance at which the board fills its share
    nearer: tuple[float, float] = (0.6, 1.8)
    # random places of camera and board beside the assumed one
    guesses: int = 31
    # sd of turn [rad] and shift [m] of what is in the hand, and turn of the board at the start
    off_turn: float = 0.14
    off_shift: float = 0.04
    # the board's distance at the start, over the assumed one
    off_distance: tuple[float, float] = (0.8, 1.25)


@dataclass(frozen=True)
class CorrectionSettings:
    """Which corrections are trusted."""

    # largest one that is trusted, over the 95 % quantile of the model's own
    usual: float = 3.0
    # least limit of a change [rad or m]: a smaller one would refuse what is harmless
    least: float = 0.01
    # nodes at which the model's own corrections are taken
    nodes: int = 200
    # rows by which the compiled kernel is compared
    compared_rows: int = 5
    # largest difference of its answers [rad or m]
    tolerance: float = 1e-6
    # joints from which on a tool's orientation can be kept
    posed: int = 6


@dataclass(frozen=True)
class FittingSettings:
    """How the geometry is fitted and written."""

    # nodes at which a model without rows is evaluated
    nodes: int = 500
    # independent answers of maps alone, whose errors correlate: of 500 nodes that were taken as
    # independent, links' intervals left out the true lengths in 11 of 12 cases, by up to four times
    # their halves
    patches: int = 5
    # most rows that are fitted
    rows: int = 2_000
    # residual, over the extent, below which it is rounding
    floor: float = 1e-7
    # prior sd of a planar arm's offsets [rad]: servos are put on to that
    offset: float = math.radians(10.0)
    # prior sd of a planar arm's places, but for turns of a link [m]
    along: float = 5.0 * DRAWN_SHIFT_SD
    # prior sd of a planar sensor's angle and scale [rad or 1]
    flat: float = 100.0
    # change of an origin below which it is rounding [m or rad]
    tiny: float = 1e-12


PLANNING = PlanningSettings()
AIMING = AimingSettings()
CORRECTION = CorrectionSettings()
FITTING = FittingSettings()
