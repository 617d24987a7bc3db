"""Motion: the joints row by row, and what of their way matters for where the tip stands."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, fields, replace
from typing import ClassVar, TypeVar

import numpy as np

from ..common.arrays import Array, Index, Mask
from ..errors import OptionError

MAX_GAP = 0.1
"""Joints further apart than this are not interpolated between [s]."""

SETTLE = 0.04
"""Time before and after, over which a joint's speed is taken: encoders count in steps [s]."""

_STILL = 1e-9  # of a joint's largest move: less is no motion
_T = TypeVar("_T", bound="OfRows")


class OfRows:
    """Base of a frozen dataclass whose arrays have an entry for each row."""

    of_joints: ClassVar[
        tuple[str, ...]
    ] = ()  # fields that are the same in all rows

    def take(self: _T, index: Index | Mask | slice) -> _T:
        """Return the rows that `index` picks: a slice, row numbers in any order or a mask."""
        some: dict[str, object] = {}
        for name in {field.name for field in fields(self)} - {*self.of_joints}:  # type: ignore[arg-type]
            value = getattr(self, name)
            if isinstance(value, np.ndarray):
                some[name] = value[index]
            elif isinstance(value, OfRows):
                some[name] = value.take(index)
        return replace(self, **some)  # type: ignore[type-var]


@dataclass(frozen=True, eq=False)
class Motion(OfRows):
    """Joint values, with the side from which each joint came and when, where that is known."""

    q: Array  # (n, dof), joint values [rad or m]
    _: KW_ONLY
    # (n, dof), sign of each joint's last motion: 1, -1, or 0 where it is not known
    side: Array | None = None
    time: Array | None = None  # (n,), when each row was taken [s]
    episode: Array | None = None  # (n,), the series each row is of

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


def joint_speed(when: Array, time: Array, q: Array) -> Array:
    """Return the fastest joint's speed about each time (n,) [rad/s or m/s]; see `joints_at`."""
    before = joints_at(when - SETTLE, time, q)
    after = joints_at(when + SETTLE, time, q)
    return np.asarray(np.abs(after - before).max(axis=1) / (2.0 * SETTLE))


def check_limits(max_gap: float, still: float | None) -> None:
    """Refuse limits of `covered` and of the joints' speed that leave nothing."""
    for name, value in {"max_gap": max_gap, "still": still}.items():
        if value is not None and not value > 0:
            raise OptionError(f"`{name}={value:g}`: expected more than zero")


def covered(when: Array, time: Array, max_gap: float) -> dict[str, Mask]:
    """Tell which times (n,) lie between no joints that are close enough to interpolate, and why.

    Joints have times (m,), and are close at most `max_gap` [s] apart.
    """
    after = np.clip(np.searchsorted(time, when), 1, len(time) - 1)
    outside = (when < time[0]) | (when > time[-1])
    far = ~outside & (time[after] - time[after - 1] > max_gap)
    return {
        "outside of the joints' times": outside,
        f"joints more than {max_gap:g} s apart": far,
    }
