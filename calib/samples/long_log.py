"""A long log: more rows than are held at once, to be gone through again."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..errors import LogError
from .log_ranges import wrap
from .measured_rows import MeasuredRows

if TYPE_CHECKING:
    from ..arm.plane import Plane

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LongLog:
    """All usable rows of a log of which some were drawn.

    Attributes
    ----------
    measured : MeasuredRows
        Reads them.
    lower, upper : (dof,) array [rad or m]
        Range of each joint.
    revolute : tuple of bool
        Whether each joint turns.
    plane : Plane or None
        For a log of x, y, z the plane that was fitted to it.
    rows : int
        How many they were when some were drawn.
    """

    measured: MeasuredRows
    lower: Array
    upper: Array
    revolute: tuple[bool, ...]
    plane: Plane | None
    rows: int

    def batches(self) -> Iterator[tuple[Array, Array]]:
        """Yield joint values (n, dof) [rad or m] and positions (n, 2) of the next rows.

        Values of a joint that turns are wrapped by the range of the rows that were drawn;
        a few of the others may lie a little beyond its ends.

        Raises
        ------
        LogError
            If the file is not what it was.
        """
        dof, rows = len(self.lower), 0
        for values, _ in self.measured.batches():
            rows += len(values)
            q, x = values[:, :dof].copy(), values[:, dof:]
            for k, turns in enumerate(self.revolute):
                if turns:
                    q[:, k] = wrap(q[:, k], float(self.lower[k]), float(self.upper[k]))
            yield q, x if self.plane is None else self.plane.project(x)
        if rows != self.rows:
            raise LogError(
                f"{self.measured.source.label} has {rows:,} usable rows, it had {self.rows:,} a "
                "moment ago: leave it as it is while it is read"
            )
