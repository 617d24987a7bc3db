"""Numbers that were chosen for reading and judging logs, each with the case that chose it."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class LogReading:
    """Limits of a log's values."""

    # most rows that are held in memory; of a longer log this many, evenly spread, are read
    most_rows: int = 200_000
    # shares of a range by which values may leave it, since limits are rounded and since arms differ
    rounded: float = 1e-4
    slack: float = 0.05
    # turns from zero beyond which an angle is in degrees, or its encoder was not reset for long
    most_turns: float = 4.0
    # rms distance of positions of a planar arm from their plane, over their extent
    out_of_plane: float = 0.02
    # A reading that repeats is stuck if the sensor usually moves by at least `fine` of its last
    # digits from row to row, and the joints moved by the share `moved` of their mean step.  A path
    # of 600 rows with six stuck runs of 12 missed by 1 mm and showed backlash, .014 without these
    # rows; an SO-101 with whole mm, whose sensor was stuck for 15 of 450 rows, missed by 19 mm, .4
    # without them.
    fine: float = 5.0
    moved: float = 0.25
    # length of a step over that of three: a third in motion, none at rest; between them is this
    # limit.  Where joints were read at every third position of a path, bounds were 20 to 150 mm
    # instead of .1 to .5.
    follows: float = 1 / 6
    fewest_followers: int = 20  # steps of which a median is meaningful
    # equal joints are a rest if they last longer [s], or this many times the usual run
    longest_hold: float = 0.25
    rest: float = 3.0
    # [m], extent beyond which positions are probably in another unit: arms reach 3 m, in mm that
    # is thousands
    largest_arm: float = 20.0
    # largest difference of a quaternion's length from 1: files round to a few digits
    rounded_length: float = 0.01


@dataclass(frozen=True)
class LockedJoint:
    """Motion of a locked joint."""

    locked: float  # [rad or m], motion beyond which the joint takes part
    still: float  # [rad or m], motion beyond which it is reported
    most_rows: float = 0.02  # largest share of rows with wrong readings


@dataclass(frozen=True)
class OnePose:
    """When rows are at one pose."""

    exact: float = 1e-6  # [rad or m], rounding of a log's numbers
    # [rad or m], largest difference of rows of one pose
    most_apart: float = 0.01
    # least distance of two poses over that of rows of one pose
    gap: float = 5.0
    # least number of near pairs: fewer may be chance, as random rows have one pair in 25 logs
    least_pairs: int = 3
    neighbours: int = (
        8  # of each row, among which rows of its pose are searched
    )
    # most rows that are searched, since 200,000 took 16 s; of more, only equal rows are one pose
    most_rows: int = 20_000


@dataclass(frozen=True)
class Diagnosis:
    """Which interpretations of a log are tried, and when they explain it."""

    # most rows that are compared: 720 orders of six joints take a second
    rows: int = 400
    # rows below which a similarity in space, or a tool of unknown size, explains nearly anything
    fewest_rows: int = 8
    tool_rows: int = 39
    # misfit of an interpretation over the log's own, below which it is reported: arms with links
    # off by a tenth and offsets by 8 deg stay above it, exchanged columns below .1
    far_better: float = 0.2
    # misfits over the extent: below `good` two exchanged columns alone may be wrong, below `small`
    # nothing is.  A reversed wrist leaves 2 %, a drawing is right to .2 %.
    good: float = 0.1
    small: float = 0.005
    most_ordered: int = 6  # most joints of which all orders (720) are tried
    # median step of the joints over their spread, above which they are no path
    path: float = 0.1
    # extents over the nominal one that are not reported: links that were typed wrong differ less
    usual_size: tuple[float, float] = (0.5, 2.0)
    # largest relative difference from the factor of a unit: 900 is not 1000 mm
    same_unit: float = 0.05
    # extent over the nominal one, beyond which positions may be pixels
    pixels_ratio: float = 5.0
    most_behind: int = 20  # most rows by which positions may follow the joints
    # median turn [rad] beyond which orientations are not those of the joints
    turned: float = 0.3


@dataclass(frozen=True)
class ClearDelay:
    """When a delay is corrected, and when it is an uncertainty of the joints."""

    deviations: float  # least delay that is corrected [its sd]
    share: float  # least share of the squared residuals that it explains
    # [s or rows], sd or uncertainty beyond which rows show no delay
    most: float
    least: float = 0.0  # [s or rows], uncertainty below which it counts as none


@dataclass(frozen=True)
class DelaySettings:
    """When a clock is late."""

    # pause, over the median step of time, beyond which two rows are not one motion
    longest_pause: float = 5.0
    fewest_rows: int = 20  # least number that determines a delay
    # of rows with times.  With 5 sds and .1, models of 40 paths of 6 to 38 s, 3 ms late, erred by
    # .155 mm on average instead of .131; rows of a mirrored sensor seemed 472 +- 110 ms late.
    timed: ClearDelay = ClearDelay(deviations=3.0, share=0.03, most=0.05)
    # of rows without times, which are mostly poses at rest: a real series stays below a share of
    # .02; of 50 windows of 60 rows one reaches 3 sds and .13; delays are below .004 rows in 50
    # windows of 30 to 150
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
