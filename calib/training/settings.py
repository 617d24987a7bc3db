"""Numbers that were chosen for training and evaluating, each with its reason."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Learning:
    """What a model is learned from."""

    fewest_poses: int = 10  # that anything can be learned and checked from
    # of a log that the body and the local models rest on
    most_rows: int = 50_000
    imagined: int = 5  # samples of a body for each motor node
    # nodes along each axis of a plane lattice, as in the paper's best table
    side: int = 70
    rows_per_node: int = 5  # of a log
    # fewest nodes along a side, without a body, which imagines samples where a log has no rows, and
    # with one: its links have to propose starts for every branch
    least_side: int = 4
    least_side_of_body: int = 20
    collapsed: float = 1e-9  # mean distance of joined nodes in the unit box
    # share of the extent: a body that is further off explains nothing
    no_arm: float = 0.02
    unlimited: float = 1e6  # [rad] of a joint that turns without end


@dataclass(frozen=True)
class Testing:
    """Numbers of rows that errors are measured on: more change no figure."""

    fresh: int = 10_000  # exact points of a simulation
    # of maps without a body that have more than three joints: 10,000 searches for joints on six
    # joints' maps had not ended after ten minutes
    fresh_of_maps: int = 300
    maps: int = 5_000  # rows that maps are tested on
    # rows that a body is tested on, whose inverses are sought
    body: int = 1_000
    # blocks of rows that maps are tested on, each with maps of the other blocks
    folds: int = 20
    # rows that an undisturbed arm's distortions are learned from
    baseline: int = 20_000
    # fewest unlearned rows for which errors are reported
    fewest: int = 10
    placed: int = 10  # fewest rows that place a frame
    # largest share of the median error that is left where the sensor was moved
    nearer: float = 0.5
    # exact samples that the bounds of a simulation are learned from
    draws: int = 12_000
    # share of the extent: what an answer in double precision is sure of at best
    rounding: float = 4e-15


@dataclass(frozen=True)
class WrongRows:
    """Which rows contradict the others."""

    # a residual is gross beyond so many medians, so many times what seven rows in ten stay below,
    # and this share of the extent: no row of 80 clean logs of 20 to 600 rows is
    gross: float = 10.0
    spread: float = 4.0
    share: float = 1e-4
    # neighbours that a row is compared with, how many times as far as usual they may be (in a
    # corner of the range twice as far), and by how many times their scatter it has to differ
    neighbours: int = 15
    most_distance: float = 2.5
    scatters: float = 10.0
    # share of the rows that can be wrong; beyond it the fit is
    most_rows: float = 0.25
    # rows that show how far neighbours usually are
    sampled: int = 1500


@dataclass(frozen=True)
class Backlash:
    """What backlash is learned from."""

    fewest: int = 20  # rows
    most: int = 5_000
    rounds: int = 3
    # share of the largest play: a round that moves less is the last
    settled: float = 0.01
    trend: int = 7  # degree of a joint's direction as a function of its value


@dataclass(frozen=True)
class LateClock:
    """The search for a delay."""

    steps: int = 16  # of a delay and the parameters fitted with it
    rows: int = 4_000  # neighbouring rows that a delay rests on
    settled: float = 0.05  # sds that the last step moves at most
    falls: float = 0.95  # share of the residual before from which it does not fall any more


@dataclass(frozen=True)
class Touching:
    """What arms and sockets are fitted to."""

    most: float = 0.25  # share of rows that may be wrong
    # fits, each without the rows that strayed from the one before
    attempts: int = 3
    few: int = 12  # fewest touches that determine an arm in space
    few_of_one: int = 4  # of them in one socket
    # [rad or m], joints that moved less in each socket are undetermined
    alike: float = 0.05
    clearly: float = 3.0  # sds by which two sizes of an arm have to differ
    # relative; no drawing is further from its arm's size
    most_doubt: float = 0.05


DISAGREEMENT = 5.0
"""Ratio to a sensor's own error beyond which the common body shows it is of another arm.

With 40 rows: 1.0 for one arm, 25 and more with a joint 3 deg off or a link 5 % longer."""

LEARNING = Learning()
TESTING = Testing()
WRONG = WrongRows()
BACKLASH = Backlash()
LATE_CLOCK = LateClock()
TOUCHING = Touching()
