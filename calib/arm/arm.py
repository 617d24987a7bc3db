"""Arm: what planar and spatial arms share: joints, ranges, checks of joint values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..common.rows import number_rows
from ..common.wording import quoted, suggestion
from ..errors import OptionError, QueryError
from .ranges import TURN, Range, checked_range, cut_to_one_turn, notes_of_turns

Array = NDArray[np.float64]
_A = TypeVar("_A", bound="Arm")


@dataclass(frozen=True, eq=False, kw_only=True)
class Arm:
    """A serial arm: names, ranges and the URDF that they come from.

    Attributes
    ----------
    name : str
        The robot's name.
    joint_names : tuple of str
        Active joints, base to tip.
    lower, upper : (dof,) array [rad or m]
        Range of each joint that is babbled and learned.
    revolute : tuple of bool
        Whether each joint turns (rad) or slides (m).
    tip : str
        The link whose position is sensed.
    locked : dict of str to float [rad or m]
        The other movable joints between root and tip, and the values they are held at.
    urdf : str
        The URDF's own text.
    notes : tuple of str
        What was assumed or mended, for the user.
    limits : tuple of (float, float) [rad or m]
        What each joint can mechanically reach; `lower` and `upper` lie within.
    """

    name: str
    joint_names: tuple[str, ...]
    lower: Array
    upper: Array
    revolute: tuple[bool, ...]
    tip: str
    locked: dict[str, float]
    urdf: str
    notes: tuple[str, ...]
    limits: tuple[Range, ...]

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in ("lower", "upper"):
            array = np.array(getattr(self, name), dtype=float)
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @property
    def outputs(self) -> int:
        """Number of coordinates of a position: 2 in a plane, 3 in space."""
        raise NotImplementedError

    @property
    def link_lengths(self) -> dict[str, float]:
        """Length of the link that each joint moves [m]."""
        raise NotImplementedError

    def forward(self, q: ArrayLike) -> Array:
        """Positions (n, outputs) or (outputs,) [m] at joint values (n, dof) or (dof,)."""
        raise NotImplementedError

    def with_link_length(self: _A, joint: str, length: float) -> _A:
        """Return the arm with the link that a joint moves at a new length [m]."""
        raise NotImplementedError

    @property
    def dof(self) -> int:
        """Number of active joints."""
        return len(self.joint_names)

    @property
    def periodic(self) -> tuple[bool, ...]:
        """Whether each joint's range is a full turn, so that its ends meet."""
        widths = self.upper - self.lower
        return tuple(
            turns and bool(width >= TURN - 1e-9)
            for turns, width in zip(self.revolute, widths, strict=True)
        )

    def with_range(self: _A, ranges: Mapping[str, Range]) -> _A:
        """Return the arm with only a part of some joints' ranges.

        Parameters
        ----------
        ranges : mapping of str to (lower, upper) [rad or m]
        """
        lower, upper = self.lower.copy(), self.upper.copy()
        cut: dict[str, Range] = {}
        for name, chosen in ranges.items():
            k = self._index(name, "ranges")
            unit = "rad" if self.revolute[k] else "m"
            lower[k], upper[k] = checked_range(name, chosen, self.limits[k], unit)
            if self.revolute[k]:
                turn, more = cut_to_one_turn((lower[k], upper[k]))
                lower[k], upper[k] = turn
                if more:
                    cut[name] = turn
        return replace(self, lower=lower, upper=upper, notes=(*self.notes, *notes_of_turns(cut)))

    def _index(self, joint: str, what: str) -> int:
        if joint not in self.joint_names:
            raise OptionError(
                f"{what}: {quoted(joint)} is not an active joint: "
                f"{suggestion(joint, self.joint_names)}"
            )
        return self.joint_names.index(joint)

    def _rows(self, q: ArrayLike) -> tuple[Array, bool]:
        """Check joint values and return them as (n, dof), and whether they were one vector."""
        rows, single = number_rows(q, self.joint_names, "joint values")
        if not np.isfinite(rows).all():
            bad = int(np.flatnonzero(~np.isfinite(rows).all(axis=1))[0])
            raise QueryError(f"joint values of row {bad} are not finite: {rows[bad]}")
        return rows, single
