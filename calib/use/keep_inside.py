"""Keeping: poses and moves for which the tip stays within a box of the workspace."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..errors import OptionError
from .pose_space import Space

if TYPE_CHECKING:
    from scipy.sparse import csr_array

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_STEP = 0.01  # share of the workspace's extent between two places that are checked
_PROBES = 4000  # poses that tell how fast joints move the tip
_MOST_STEPS = 400
_CHUNK = 400_000  # places checked at once
_AXES = ("x", "y")


@dataclass(frozen=True, eq=False)
class Keep:
    """A box of the workspace that the tip shall not leave, also between poses.

    Attributes
    ----------
    space : Space
        Predicts where the tip is.
    low, high : (2,) array [unit]
        The box; infinite where there is no bound.
    reach : (dof,) array [unit per range]
        How far the tip moves per range of each joint, about at most.
    step : float [unit]
        Longest way of the tip between two places that are checked. Each has to be within
        the box by half of it, so that the way between them is within the box as well.
    """

    space: Space
    low: Array
    high: Array
    reach: Array
    step: float

    def holds(self, u: Array) -> NDArray[np.bool_]:
        """Whether the tip is well within the box at poses (n, dof) of the unit box, (n,)."""
        return self._inside(self.space.position(self.space.scale.from_unit(u)))

    def clear(self, start: Array, end: Array) -> NDArray[np.bool_]:
        """Whether straight moves in joint space (n, dof) stay within the box, (n,)."""
        way = np.abs(end - start) @ self.reach
        count = np.clip(np.ceil(way / self.step), 1, _MOST_STEPS).astype(np.intp)
        # a move too long to be checked closely is not known to be clear
        clear = np.asarray(way <= _MOST_STEPS * self.step)
        places = len(start) * (1 + int(count.max(initial=1)))
        for part in np.array_split(np.arange(len(start)), 1 + places // _CHUNK):
            most = 1 + int(count[part].max(initial=1))
            share = np.minimum(np.arange(most) / count[part, None], 1.0)[..., None]
            points = start[part, None] + share * (end[part] - start[part])[:, None]
            q = self.space.scale.from_unit(points.reshape(-1, start.shape[1]))
            x = self.space.position(q).reshape(len(part), most, 2)
            # however fast the tip moves: it was looked at closely enough
            close = np.linalg.norm(np.diff(x, axis=1), axis=2) <= self.step
            clear[part] &= self._inside(x).all(axis=1) & close.all(axis=1)
        return clear

    def _inside(self, x: Array) -> NDArray[np.bool_]:
        """Whether positions (..., 2) are well within the box; NaN, which is unknown, is not."""
        room = self.step / 2
        return np.asarray(((x >= self.low + room) & (x <= self.high - room)).all(axis=-1))

    def roadmap(self, u: Array, near: int) -> csr_array:
        """Clear moves among poses and their length, (n, n).

        Parameters
        ----------
        u : (n, dof) array
            Poses in units of the joints' ranges.
        near : int
            Each is joined with so many of its nearest neighbours.
        """
        from scipy.sparse import csr_array
        from scipy.spatial import cKDTree

        near = min(near + 1, len(u))
        index = np.asarray(cKDTree(u).query(u, k=np.arange(1, near + 1))[1], dtype=np.intp)
        pairs = np.stack([np.repeat(np.arange(len(u)), near), index.ravel()], axis=1)
        pairs = np.unique(np.sort(pairs, axis=1), axis=0)
        pairs = pairs[pairs[:, 0] != pairs[:, 1]]
        pairs = pairs[self.clear(u[pairs[:, 0]], u[pairs[:, 1]])]
        a, b = pairs.T
        size = np.maximum(moves(u[a], u[b]), 1e-12)  # 0 would be no entry
        both = np.concatenate([a, b]), np.concatenate([b, a])
        return csr_array((np.tile(size, 2), both), shape=(len(u),) * 2)

    def words(self) -> str:
        """Return the box as it is typed."""
        parts = [
            f"{name}={low:g}:{high:g}"
            for name, low, high in zip(_AXES, self.low, self.high, strict=True)
            if np.isfinite([low, high]).any()
        ]
        return " ".join(parts)


def moves(start: Array, end: Array) -> Array:
    """Lengths (...,) of moves: the longest of the joints', in units of their ranges."""
    return np.asarray(np.abs(end - start).max(axis=-1))


def keep_of(space: Space, box: Mapping[str, tuple[float, float]]) -> Keep:
    """Check a box and find how closely moves have to be looked at.

    Parameters
    ----------
    space : Space
    box : mapping of {"x", "y"} to (low, high) [unit]

    Raises
    ------
    OptionError
        If an axis is unknown or its bounds are no interval.
    """
    low, high = np.full(2, -np.inf), np.full(2, np.inf)
    for axis, (first, last) in box.items():
        if axis not in _AXES:
            raise OptionError(f"keep: {axis!r} is no axis of the plane; expected x or y")
        if not first < last:
            raise OptionError(
                f"keep {axis}={first:g}:{last:g}: expected two numbers, the lower one first"
            )
        low[_AXES.index(axis)], high[_AXES.index(axis)] = first, last
    u = np.random.default_rng(0).random((_PROBES, space.dof))
    x = space.position(space.scale.from_unit(u))
    known = np.isfinite(x).all(axis=1)
    if not known.any():
        raise OptionError("keep: the model has no positions to keep within a box")
    u, x = u[known], x[known]
    reach = np.empty(space.dof)
    for k in range(space.dof):
        ahead = u.copy()
        ahead[:, k] += 1e-4 * np.where(u[:, k] < 0.5, 1, -1)
        slope = np.linalg.norm(space.position(space.scale.from_unit(ahead)) - x, axis=1) / 1e-4
        reach[k] = 1.1 * float(np.nanmax(slope))
    step = _STEP * float(np.ptp(x, axis=0).max())
    return Keep(space, low, high, reach, step)
