"""How the nodes of a map are joined: a lattice, or the graph of one without."""

from __future__ import annotations

import math
import operator
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ..common.arrays import Array, Index, Mask, Shape
from ..errors import OptionError

MAX_NODES = 4_000_000
"""Largest lattice that is built: some 2 GB while training."""

REACH = 4.0
"""The neighbourhood of eq. 3 is cut beyond so many sigma, where it is below exp(-8)."""

Size = int | str | Sequence[int]
"""Nodes along each axis as users give them: 10 or "10" for 10x10, "5x8", (5, 5, 5)."""


def shape_of(size: Size, name: str = "size") -> tuple[int, ...]:
    """A size as the shape of a lattice.

    Raises OptionError if it is none.
    """
    parts = np.atleast_1d(size).tolist()
    if isinstance(size, str):
        parts = size.lower().split("x")
    try:
        shape = tuple(
            int(n) if isinstance(n, str) else operator.index(n) for n in parts
        )
    except (TypeError, ValueError):
        raise OptionError(
            f"{name} {size!r}: expected whole numbers of nodes such as 9, '9x9' or (9, 9)",
            parameter=name,
            value=size,
        ) from None
    # one number means a square
    if len(shape) == 1 and np.ndim(size) == 0:
        shape = 2 * shape
    return Lattice(shape).shape


@dataclass(frozen=True)
class Lattice:
    """A rectangular grid of nodes with unit spacing, of any dimension."""

    # nodes along each axis; node ``i`` is at ``np.unravel_index(i, shape)``
    shape: tuple[int, ...]

    def __post_init__(self) -> None:
        shape = "x".join(str(n) for n in self.shape)
        if not self.shape or any(n < 2 for n in self.shape):
            raise OptionError(
                f"size {shape or 0}: a lattice needs at least 2 nodes along each axis"
            )
        if math.prod(self.shape) > MAX_NODES:
            raise OptionError(
                f"size {shape}: {math.prod(self.shape):,} nodes are more than the {MAX_NODES:,} "
                "that fit into memory, give a smaller `size`"
            )

    @property
    def size(self) -> int:
        """Number of nodes."""
        return math.prod(self.shape)

    @property
    def dim(self) -> int:
        """Number of axes."""
        return len(self.shape)

    def positions(self) -> Array:
        """Lattice position r of each node, (size, dim) [nodes] (eq. 3)."""
        indices = np.indices(self.shape, dtype=float)
        return indices.reshape(self.dim, -1).T

    def neighbour_share(self) -> Array:
        """Fraction of the lattice neighbours, diagonal ones included, of each node, (size,)."""
        # a block of 3 nodes along each axis, 2 at an end, less the node itself
        counts = np.ones(())
        for n in self.shape:
            is_end = np.arange(n) % (n - 1) == 0
            along = np.where(is_end, 2.0, 3.0)
            counts = np.multiply.outer(counts, along)
        most = 3.0**self.dim - 1.0
        return (counts.ravel() - 1.0) / most

    def around(
        self, winner: int, *widths: float
    ) -> tuple[tuple[slice, ...], Array]:
        """The nodes around a winner, and h at each of them (eq. 3).

        widths : sigma [nodes], or one for each axis
        """
        if len(widths) == 1:
            widths = widths * self.dim
        reach = int(REACH * max(widths)) + 1
        winner_place = np.unravel_index(winner, self.shape)
        window = []
        h = np.ones(())
        for n, r_i, sigma in zip(
            self.shape, map(int, winner_place), widths, strict=True
        ):
            begin = max(0, r_i - reach)
            end = min(n, r_i + reach + 1)
            r_j = np.arange(begin, end)
            squares = (r_j - r_i) ** 2
            h_axis = np.exp(squares / (-2.0 * sigma * sigma))  # eq. 3
            h = np.multiply.outer(h, h_axis)
            window.append(slice(begin, end))
        return tuple(window), h

    def beside(self, i: int) -> Index:
        """Nodes around node `i`, diagonal ones included, (k,): O of eq. 7."""
        positions = self.positions()
        gaps = np.abs(positions - positions[i])
        steps = gaps.max(axis=1)
        return np.flatnonzero(steps == 1.0)

    def edges(self) -> Index:
        """Pairs of nodes that are neighbours along an axis, (m, 2)."""
        index = np.arange(self.size).reshape(self.shape)
        pairs = []
        for axis in range(self.dim):
            ahead = np.moveaxis(index, axis, 0)
            first = ahead[:-1].ravel()
            second = ahead[1:].ravel()
            pairs.append(np.stack([first, second], axis=1))
        return np.concatenate(pairs)

    def adjacent(self, i: Index, j: Index) -> Mask:
        """Whether nodes `i` and `j` are neighbours, diagonal ones included, (n,)."""
        place_i = np.unravel_index(i, self.shape)
        place_j = np.unravel_index(j, self.shape)
        steps = np.subtract(place_i, place_j)
        most = np.abs(steps).max(axis=0)
        return np.asarray(most <= 1)

    def resample(self, weights: Array, finer: Lattice) -> Array:
        """Multilinear interpolation of `weights` (size, d) onto another lattice.

        The nodes keep the middle of their cells: node i of n is at (i + 1/2) / n of
        the axis, and beyond the outermost nodes the lattice is continued linearly.
        """
        grid = weights.reshape(*self.shape, -1)
        for axis in range(self.dim):
            old = self.shape[axis]
            new = finer.shape[axis]
            place = (np.arange(new) + 0.5) * (old / new) - 0.5
            floor = np.floor(place).astype(int)
            low = np.clip(floor, 0, old - 2)
            along = [1] * grid.ndim
            along[axis] = new
            rest = (place - low).reshape(along)
            below = np.take(grid, low, axis)
            above = np.take(grid, low + 1, axis)
            grid = below * (1 - rest) + above * rest
        return np.ascontiguousarray(grid.reshape(finer.size, -1))


@dataclass(frozen=True, eq=False)
class Graph:
    """Nodes joined by edges, without places in a lattice, as a neural gas leaves them."""

    size: int  # number of nodes
    # (m, 2), the edges, each once, the smaller node first, in ascending order
    pairs: Annotated[Index, Shape("edges", 2)]

    @staticmethod
    def of(size: int, pairs: Index) -> Graph:
        """The graph of pairs (m, 2) in any order, which may repeat."""
        ascending = np.sort(pairs, axis=1)
        return Graph(size, np.unique(ascending, axis=0))

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of nodes, as the shape of a lattice of no particular form."""
        return (self.size,)

    def neighbour_share(self) -> Array:
        """Edges of each node over those of most nodes inside, (size,), at most 1.

        "Most" is the upper quartile: nodes at the border have fewer.
        """
        degree = np.bincount(self.pairs.ravel(), minlength=self.size)
        most = max(float(np.quantile(degree, 0.75)), 1.0)
        return np.minimum(1.0, degree / most)

    def edges(self) -> Index:
        """Pairs of joined nodes, (m, 2)."""
        return self.pairs

    def adjacent(self, i: Index, j: Index) -> Mask:
        """Whether nodes `i` and `j` are the same or joined, (n,)."""
        low = np.minimum(i, j)
        high = np.maximum(i, j)
        first, second = self.pairs.T
        keys = first * self.size + second
        joined = np.isin(low * self.size + high, keys)
        return np.asarray((low == high) | joined)
