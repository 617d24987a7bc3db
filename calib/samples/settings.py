"""Numbers that were chosen for reading and judging logs, each with the case that chose it."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class LogReading:
    """What becomes of a log's values."""

    # rows that are held in memory; of a longer log so many are drawn
    most_rows: int = 200_000
    # shares of a range by which values may leave it: limits are rounded, and arms differ
    rounded: float = 1e-4
    slack: float = 0.05
    # turns further from zero than which an angle is in degrees, or its encoder not reset for long
    most_turns: float = 4.0
    # share of the extent by which positions of a planar arm may leave their plane (rms)
    out_of_plane: float = 0.02
    # a sensor that moves by this many of its last digits from row to row never reads the same twice
    # while the joints move by this share of their mean step: 600 rows of a path with six held runs
    # of 12 missed by 1 mm and showed backlash, .014 without them; by 5 mm of whole mm, an SO-101's
    # whose sensor was stuck for 15 of 450 rows missed by 19 mm, .4 without them
    fine: float = 5.0
    moved: float = 0.25
    # share of three steps that the middle one is in motion, a third, rather than at rest, none;
    # joints read at every third position of a path: bounds of 20 to 150 mm of .1 to .5
    follows: float = 1 / 6
    fewest_followers: int = 20  # such steps, the median of fewer is chance
    # [s], equal joints for longer are a pose, as is a run of so many times the usual one
    longest_hold: float = 0.25
    rest: float = 3.0
    # [m], an extent beyond which positions are most likely in another unit: arms reach 3 m, a log
    # of one in mm extends over hundreds
    largest_arm: float = 20.0
    # a quaternion's length may differ from 1 by this much: files round to a few digits
    rounded_length: float = 0.01


@dataclass(frozen=True)
class LockedJoint:
    """Motion of a locked joint."""

    locked: float  # [rad or m], beyond which it takes part
    still: float  # [rad or m], beyond which it is reported
    most_rows: float = 0.02  # share of the rows that may be wrong readings


@dataclass(frozen=True)
class OnePose:
    """When rows are at one pose."""

    exact: float = 1e-6  # [rad or m], rounding of a log's numbers
    # [rad or m], encoders that read one pose as differently repeat nothing
    most_apart: float = 0.01
    # times further apart than rows of one pose that two poses have to be
    gap: float = 5.0
    # near pairs of rows below which they may be chance: of random rows one pair in 25 logs
    least_pairs: int = 3
    neighbours: int = 8  # of each row, among which rows of one pose are found
    # of more, equal rows alone are one pose: 200,000 took 16 s
    most_rows: int = 20_000


@dataclass(frozen=True)
class Diagnosis:
    """How a log is read otherwise, and when that explains it."""

    # that are looked at: 720 orders of six joints take a second
    rows: int = 400
    # rows below which a similarity in space, or a tool of unknown size, explains nearly anything
    fewest_rows: int = 8
    tool_rows: int = 39
    # an interpretation is reported where its misfit is below this share of the log's own: arms with
    # links off by a tenth and offsets by 8 deg stay above it, exchanged columns below .1
    far_better: float = 0.2
    # shares of the extent below which kinematics are right but for two exchanged columns, and
    # nothing is doubted: a reversed wrist leaves 2 %, a drawing is right to .2 %
    good: float = 0.1
    small: float = 0.005
    most_ordered: int = 6  # joints whose 720 orders are tried
    # median step of the joints over their spread, above which they are no path
    path: float = 0.1
    # an extent between these times the nominal one needs no word: lengths were typed wrong by less
    usual_size: tuple[float, float] = (0.5, 2.0)
    # it is that of another unit within this share: 900 is no millimetre
    same_unit: float = 0.05
    # times the nominal extent beyond which that of pixels
    pixels_ratio: float = 5.0
    most_behind: int = 20  # rows by which positions may follow the joints
    # median turn [rad] beyond which orientations are not those of the joints
    turned: float = 0.3


@dataclass(frozen=True)
class ClearDelay:
    """When a delay is corrected, or a doubt of the rows' joints."""

    deviations: float  # it is corrected beyond this many sds
    share: float  # if it explains this share of the squared residuals
    # [s or rows], an sd, or a doubt, beyond which rows show no delay
    most: float
    least: float = 0.0  # [s or rows], a doubt below which there is none


@dataclass(frozen=True)
class DelaySettings:
    """When a clock is late."""

    # median steps of time beyond which two rows are not one motion
    longest_pause: float = 5.0
    fewest_rows: int = 20  # that determine a delay
    # with 5 sds and .1, models of 40 paths of 6 to 38 s, 3 ms late, erred by .155 mm on the average
    # rather than .131; to a sensor that was mirrored rows were 472 +- 110 ms late
    timed: ClearDelay = ClearDelay(deviations=3.0, share=0.03, most=0.05)
    # rows without times are mostly poses at rest: a real series stays below .02, of 50 windows of
    # 60 rows one reaches 3 and .13; their delays are below .004 rows in 50 windows of 30 to 150
    in_rows: ClearDelay = ClearDelay(
        deviations=5.0, share=0.1, most=1.0, least=0.005
    )
    blocks: int = 20  # of neighbouring rows that vary on their own
    student: float = 4.0  # degrees of freedom of the noise


READING = LogReading()
TURNING = LockedJoint(locked=math.radians(5.0), still=math.radians(0.5))
SLIDING = LockedJoint(locked=2e-2, still=1e-3)
ONE_POSE = OnePose()
DIAGNOSIS = Diagnosis()
DELAY = DelaySettings()
