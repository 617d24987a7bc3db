"""Sound rows of a log's file: rows that are whole, that a sensor saw, and in range."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..arm.urdf import Range
from ..common.arrays import Array, Index, Mask
from ..common.rows import LARGEST
from ..common.wording import listed
from ..errors import LogError
from .joint_values import wrap
from .roles import QUATERNION, ROUNDING, Roles
from .settings import READING


class SoundRows:
    """Rows that are left of a log, and how many missed a value or saw nothing."""

    def __init__(
        self,
        label: str,
        values: Array,
        numbers: Index,
        roles: Roles,
        revolute: Sequence[bool],
    ) -> None:
        self.label = label
        # (n, names), of which wrong ones and wrapped ones change
        self.values = values
        self.numbers = numbers  # (n,), of the rows in the file
        self.roles = roles
        self.revolute = revolute
        self.sound: Mask = np.ones(len(values), dtype=bool)
        self.notes: list[str] = []
        self.dropped = 0
        self.left_out = 0

    @property
    def rows(self) -> Index:
        """Those that are left."""
        return np.flatnonzero(self.sound)

    def leave_out(self, ranges: Mapping[str, Range]) -> None:
        """Leave out what is wrong.  Raises LogError if nothing is left."""
        self.dropped = self._without_numbers()
        for name, (low, high) in ranges.items():
            if name in self.roles.joints:
                self._outside_of_range(name, low, high)
        q, x, turns, triangles = self.roles.split(self.values)
        self.left_out = self._zeros(q, x)
        if self.roles.turns == QUATERNION:
            self.left_out += self._unturned(turns)
        if self.roles.covariance:
            self.left_out += self._unsure(triangles)

    def _drop(self, wrong: Mask, words: str) -> int:
        """Leave out rows (n,), and return how many."""
        wrong = wrong & self.sound
        count = int(wrong.sum())
        if not (self.sound & ~wrong).any():
            raise LogError(
                f"{self.label}: no row is left: {count} of {len(wrong)} rows {words}"
            )
        if count:
            shown = rows_in_words(self.numbers[wrong])
            self.notes.append(
                f"{count:,} of {len(wrong):,} rows {words}; left out: {shown}"
            )
        self.sound = self.sound & ~wrong
        return count

    def _without_numbers(self) -> int:
        finite = np.abs(self.values) < LARGEST
        columns = np.array(self.roles.names)[~finite.all(axis=0)]
        words = f"miss a finite number (2.5, not 2,5) of {listed(columns)}"
        count = self._drop(np.asarray(~finite.all(axis=1)), words)
        self.values[~self.sound] = 0.0
        return count

    def _outside_of_range(self, name: str, low: float, high: float) -> None:
        k = self.roles.joints.index(name)
        column = self.values[:, k]
        if self.revolute[k]:
            column = wrap(column, low, high)
        edge = READING.rounded * (high - low)
        away = (column < low - edge) | (column > high + edge)
        self._drop(np.asarray(away), f"have {name} outside of the chosen range")
        self.values[:, k] = np.clip(column, low, high)

    def _zeros(self, q: Array, x: Array) -> int:
        zero: Mask = self.sound & (x == 0.0).all(axis=1)
        # a single row, or one place of the joints, may be the origin of the sensor
        if (
            zero.sum() < 2
            or not np.ptp(q[zero], axis=0).any()
            or zero[self.sound].all()
        ):
            return 0
        return self._drop(
            zero, "hold zeros for a position, as where a sensor saw nothing"
        )

    def _unturned(self, turns: Array) -> int:
        length = np.linalg.norm(turns, axis=1)
        wrong = self.sound & (np.abs(length - 1) > ROUNDING)
        words = f"hold no orientation: qx, qy, qz, qw of length {length[np.argmax(wrong)]:.4g}"
        return self._drop(wrong, f"{words}, expected 1")

    def _unsure(self, triangles: Array) -> int:
        variance = triangles[:, [0, 6, 11]].sum(axis=1)  # of x, y and z
        usual = np.median(np.abs(variance[self.sound]))
        return self._drop(
            variance > READING.unsure**2 * usual,
            "have a covariance far wider than usual",
        )


def rows_in_words(numbers: Index) -> str:
    """Name the first of some numbers of rows."""
    shown = f"{', '.join(map(str, numbers[:5]))}{', ...' if len(numbers) > 5 else ''}"
    return f"row{'s' * (len(numbers) > 1)} {shown}"
