"""Motion: the joints row by row, their directions and speeds, and rows at the same pose."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, fields, replace
from typing import ClassVar, TypeVar

import numpy as np

from ..common.arrays import Array, Index, Mask
from ..common.rows import components, group_means, row_lengths
from ..errors import OptionError
from .settings import ONE_POSE, READING

MAX_GAP = 0.1
"""Longest time between two joint rows over which joints are interpolated [s]."""

SETTLE = 0.04
"""Time before and after, over which a joint's speed is taken: encoders count in steps [s]."""

_STILL = 1e-9  # of a joint's largest move: less is no motion
_T = TypeVar("_T", bound="RowArrays")


class RowArrays:
    """Base of a frozen dataclass whose arrays have an entry for each row.

    `take` takes every array field by row unless it is named in `not_by_row`: a new array of another
    length must be added there.
    """

    # arrays that are the same in all rows
    not_by_row: ClassVar[tuple[str, ...]] = ()

    def take(self: _T, index: Index | Mask | slice) -> _T:
        """Return the rows that `index` picks: a slice, row numbers in any order or a mask."""
        arrays: dict[str, object] = {}
        for name in {field.name for field in fields(self)} - {*self.not_by_row}:  # type: ignore[arg-type]
            value = getattr(self, name)
            if isinstance(value, np.ndarray):
                arrays[name] = value[index]
            elif isinstance(value, RowArrays):
                arrays[name] = value.take(index)
        return replace(self, **arrays)  # type: ignore[type-var]


@dataclass(frozen=True, eq=False)
class Motion(RowArrays):
    """Joint values, with the side from which each joint came and when, where that is known."""

    q: Array  # (n, dof), joint values [rad or m]
    _: KW_ONLY
    # (n, dof), sign of each joint's last motion: 1, -1, or 0 where it is not known
    side: Array | None = None
    time: Array | None = None  # (n,), when each row was taken [s]
    # (n, dof), sd of q by the uncertainty of a corrected clock, which all rows share [rad or m]
    clock_sd: Array | None = None
    episode: Array | None = None  # (n,), the series of each row

    def __len__(self) -> int:
        return len(self.q)


def directions(q: Array) -> Array:
    """Sign of the last motion of each joint (n, dof), for joint values in the order of motion.

    1 or -1; 0 before a joint's first motion, where it is not known.
    """
    step = np.diff(q, axis=0, prepend=q[:1])
    least = _STILL * np.abs(step).max(axis=0, initial=0.0)
    sign = np.where(np.abs(step) > least, np.sign(step), 0.0)
    # a joint that rests keeps the side from which it came
    moved = np.where(sign != 0.0, np.arange(len(q))[:, None], 0)
    latest = np.maximum.accumulate(moved, axis=0)
    return np.take_along_axis(sign, latest, axis=0)


def joints_at(when: Array, time: Array, q: Array) -> Array:
    """Interpolate joints q (m, joints), recorded at times (m,), to times `when` (n,) [s]."""
    return np.stack([np.interp(when, time, column) for column in q.T], axis=1)


def new_rows(values: Array) -> Mask:
    """Which rows (n,) of values (n, k) differ from the one before, to the last digit.

    Steps of few digits, as of whole pixels or of coarse encoders, may be equal at two places: then
    all rows are new.
    """
    step = row_lengths(np.diff(values, axis=0))
    is_new = np.concatenate([[True], step > 0.0])
    if not is_new[1:].any():
        return np.ones_like(is_new)
    digits = np.concatenate([np.diff(np.unique(axis)) for axis in values.T])
    if np.median(step[is_new[1:]]) <= READING.fine * digits.min():
        return np.ones_like(is_new)
    return is_new


def rows_of_motion(time: Array, q: Array) -> Index:
    """Rows (k,) of recorded joints q (m, joints) at times (m,) [s] that a motion goes through.

    A driver that publishes more often than it reads makes stairs of a motion: the first row of each
    counts.  All rows count of a rest, which is longer, and where there are no stairs.
    """
    is_new = new_rows(q)
    lengths = np.diff(np.flatnonzero(is_new), append=len(q))
    usual = float(np.median(lengths))
    hold = usual * float(np.median(np.diff(time)))
    if usual < 2.0 or hold > READING.longest_hold:
        return np.arange(len(q))
    is_rest = np.repeat(lengths > READING.rest * usual, lengths)
    return np.flatnonzero(is_new | is_rest)


def joint_speed(when: Array, time: Array, q: Array) -> Array:
    """Return the fastest joint's speed about each time (n,) [rad/s or m/s]; see `joints_at`."""
    before = joints_at(when - SETTLE, time, q)
    after = joints_at(when + SETTLE, time, q)
    return np.asarray(np.abs(after - before).max(axis=1) / (2.0 * SETTLE))


def check_limits(max_gap: float, still: float | None) -> None:
    """Refuse a largest gap or a largest speed that leaves no row."""
    for name, value in {"max_gap": max_gap, "still": still}.items():
        if value is not None and not value > 0:
            raise OptionError(f"`{name}={value:g}`: expected more than zero")


def unknown_times(when: Array, time: Array, max_gap: float) -> dict[str, Mask]:
    """Times (n,) at which joints cannot be interpolated, by the reason.

    time : (m,) [s], of the joints; two of them are close if at most `max_gap` [s] apart
    """
    after = np.clip(np.searchsorted(time, when), 1, len(time) - 1)
    outside = (when < time[0]) | (when > time[-1])
    far = ~outside & (time[after] - time[after - 1] > max_gap)
    return {
        "outside of the joints' times": outside,
        f"joints more than {max_gap:g} s apart": far,
    }


@dataclass(frozen=True, eq=False)
class Visits:
    """Which rows are at a pose that was measured again, and in which visit to it."""

    rows: Index  # (k,), rows at such poses
    pose: Index  # (k,), number of each row's pose, from 0
    visit: Index  # (k,), number of each row's visit, from 0


def visits_of(q: Array) -> Visits:
    """Return the rows of joints (n, dof) at poses that were measured again, in their order."""
    pose = pose_index(q)
    rows = np.flatnonzero(np.bincount(pose)[pose] > 1)
    arrivals = np.cumsum(np.diff(pose, prepend=-1) != 0)
    return Visits(
        rows, label_numbers(pose[rows]), label_numbers(arrivals[rows])
    )


def pose_index(q: Array) -> Index:
    """Return the number of the pose of each row (n,), in the order in which joints show them."""
    from scipy.spatial import cKDTree

    # many equal rows would be each other's neighbours alone: they are one row here
    decimals = round(-np.log10(ONE_POSE.exact)) + 1
    distinct, place = np.unique(q.round(decimals), axis=0, return_inverse=True)
    place = np.asarray(place.ravel(), np.intp)
    count = len(distinct)
    if not 1 < count <= ONE_POSE.most_rows:
        return label_numbers(place)
    near = min(ONE_POSE.neighbours + 1, count)
    distance, neighbour = map(
        np.asarray, cKDTree(distinct).query(distinct, k=near, p=np.inf)
    )
    is_close = distance <= ONE_POSE.most_apart
    if not is_close[:, 1].any():
        return label_numbers(place)
    lengths = distance[:, 1:].ravel()
    # rows of one pose that was often read are each other's neighbours alone: of the next pose
    # only their middles show how far away it is
    middles = group_means(_joined(neighbour, is_close), distinct)
    if len(middles) > 1:
        between = cKDTree(middles).query(middles, k=2, p=np.inf)[0]
        lengths = np.append(lengths, np.asarray(between)[:, 1])
    is_same = distance <= _reading_difference(lengths)
    return label_numbers(_joined(neighbour, is_same)[place])


def _joined(neighbour: Index, is_joined: Mask) -> Index:
    """The group (m,) of each row, of rows that are joined to some of their neighbours (m, k)."""
    row = np.nonzero(is_joined)[0]
    return components(len(neighbour), row, neighbour[is_joined])


def label_numbers(labels: Index) -> Index:
    """Return labels (n,) as numbers from 0 in the order in which they come."""
    _, first, index = np.unique(labels, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))
    return rank[index.ravel()]


def _reading_difference(lengths: Array) -> float:
    """Return how far apart rows of one pose may read [rad or m].

    lengths : between neighbours; those within poses are much shorter than those between
    """
    lengths = np.sort(np.maximum(lengths, ONE_POSE.exact))
    short = int(np.count_nonzero(lengths[:-1] <= ONE_POSE.most_apart))
    growth = lengths[1 : short + 1] / lengths[:short]
    # each pair counts from both of its ends
    growth[: 2 * ONE_POSE.least_pairs - 1] = 0.0
    if growth.max(initial=0.0) < ONE_POSE.gap:
        return ONE_POSE.exact
    return float(lengths[growth.argmax()])
