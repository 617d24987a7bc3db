"""A trained map: nodes placed in a space, joined to their lattice neighbours."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Annotated

import numpy as np

from ..common.arrays import Array, Index, Mask, Shape, freeze, frozen
from ..common.rows import group_means, row_lengths
from ..common.scale import Scale
from .lattice import Graph, Lattice

if TYPE_CHECKING:
    import os

    from scipy.spatial import cKDTree

HISTORY = ("nodes", "sigma", "quantization_error", "topographic_error")
"""Columns of a map's history: one row per epoch, errors in the unit box."""

# spacing of nodes that are all at one place, in the unit box
_ONE_PLACE = 1e-12
_FEW = 2_000_000  # distances that take a tenth of the time of SciPy's import
_MANY = 4_000  # places whose search is shared among threads


@dataclass(frozen=True)
class Map:
    """Nodes in the motor or the sensory space.

    Attributes
    ----------
    units : (nodes, d) array
        Weights of the nodes in the unit box of `scale`.
    lattice : Lattice or Graph
        How the nodes are joined; a neural gas has no lattice but a graph.
    scale : Scale
        From the space's own units to the unit box.
    history : (epochs, 4) array
        Nodes, sigma [nodes], quantization and topographic error of each epoch.
    """

    units: Annotated[Array, Shape("nodes", "d")]
    lattice: Lattice | Graph
    scale: Scale
    history: Annotated[Array, Shape("epochs", 4)]

    def __post_init__(self) -> None:
        freeze(self, "units", "history")

    def __repr__(self) -> str:
        nodes = "x".join(map(str, self.lattice.shape))
        axes = self.units.shape[1]
        return f"Map({nodes} nodes in {axes} dimensions, {len(self.history)} epochs)"

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the map into a file, which `calib.load_maps` reads."""
        from ..model_file.container import save_maps

        save_maps(self, path)

    @property
    def weights(self) -> Array:
        """Weights of the nodes, (nodes, d) [rad, m or the sensor's unit]; read-only."""
        return frozen(self.scale.from_unit(self.units))

    @property
    def units_in_box(self) -> Array:
        """Weights (nodes, d) clipped to the unit box, which a varying density makes nodes leave."""
        return np.clip(self.units, 0.0, 1.0)

    @property
    def size(self) -> int:
        """Number of nodes."""
        return len(self.units)

    @cached_property
    def tree(self) -> cKDTree:
        """Search tree of the nodes in the unit box."""
        return search_tree(self.units, self.scale)

    @cached_property
    def edges(self) -> Index:
        """Pairs of joined nodes, (m, 2)."""
        return frozen(self.lattice.edges())

    @cached_property
    def lengths(self) -> Array:
        """Distance of the two nodes of each edge, (m,), in the unit box."""
        a, b = self.edges.T
        first = self.units[a]
        second = self.units[b]
        gap = self.scale.difference(first, second)
        return frozen(row_lengths(gap))

    @cached_property
    def spacing(self) -> float:
        """Mean distance of joined nodes in the unit box: the unit of every radius."""
        return max(float(self.lengths.mean()), _ONE_PLACE)

    @cached_property
    def spacings(self) -> Array:
        """Mean distance of each node to those it is joined to, (nodes,), in the unit box."""
        ends = self.edges.T.ravel()
        lengths = np.tile(self.lengths, 2)
        means = group_means(ends, lengths, self.size)
        # a node on top of its neighbours, or joined to none, has the spacing of the map
        apart = means > 1e-6 * self.spacing
        return frozen(np.where(apart, means, self.spacing))

    @property
    def u_matrix(self) -> Array:
        """Mean distance of each node to its neighbours in the unit box, shaped like the lattice."""
        return self.spacings.reshape(self.lattice.shape)

    def nearest_of(self, members: Mask) -> Index:
        """Each node that is a member of (nodes,), and the nearest member in place of others."""
        source = np.arange(self.size)
        inside = np.flatnonzero(members)
        outside = np.flatnonzero(~members)
        if len(inside) and len(outside):
            places = self.units[outside]
            candidates = self.units[inside]
            _, near = nearest_points(candidates, self.scale, places)
            source[outside] = inside[near[:, 0]]
        return source

    def nearest(self, u: Array, k: int = 1) -> tuple[Array, Index]:
        """Distances and indices, (n, k), of the `k` nodes nearest to `u` in the unit box."""
        if _few(len(u) * self.size):
            return nearest_points(self.units, self.scale, u, k)
        return nearest_nodes(self.tree, u, k)

    def winners(self, x: Array) -> Index:
        """Best matching node of each row of `x` (n, d), in the space's own units (eq. 1)."""
        u = self.scale.to_unit(np.atleast_2d(x))
        _, nodes = self.nearest(u)
        return nodes[:, 0]

    def visited_by(self, u: Array) -> Mask:
        """Nodes (nodes,) that are the best matching one of any point `u` (n, d) of the unit box."""
        visited = np.zeros(self.size, dtype=bool)
        _, nodes = self.nearest(u)
        visited[nodes[:, 0]] = True
        return visited

    def quantization_error(self, x: Array) -> float:
        """Mean distance of the rows of `x` to their winners, in the space's own units."""
        u = self.scale.to_unit(np.atleast_2d(x))
        winners = self.winners(x)
        gap = self.scale.difference(u, self.units[winners])
        way = gap * self.scale.span
        distance = row_lengths(way)
        return float(distance.mean())

    def topographic_error(self, x: Array) -> float:
        """Share of the rows of `x` whose two nearest nodes are no lattice neighbours."""
        u = self.scale.to_unit(np.atleast_2d(x))
        _, nodes = self.nearest(u, 2)
        return folded_share(nodes, self.lattice)


def nearest_points(
    points: Array,
    scale: Scale,
    u: Array,
    k: int = 1,
) -> tuple[Array, Index]:
    """Distances and indices, (n, k), of the `k` points of the unit box nearest to each place.

    Of fewer than `k` points all are found.
    """
    k = min(k, len(points))
    if not _few(len(u) * len(points)):
        tree = search_tree(points, scale)
        return nearest_nodes(tree, scale.wrapped(u), k)
    square = np.zeros((len(u), len(points)))
    for axis in range(u.shape[1]):
        gap = u[:, axis, None] - points[:, axis]
        if scale.periodic[axis]:
            gap -= np.round(gap)
        square += gap * gap
    order = np.argpartition(square, np.arange(k), axis=1)
    index = order[:, :k]
    smallest = np.take_along_axis(square, index, axis=1)
    return np.sqrt(smallest), index


def nearest_nodes(tree: cKDTree, u: Array, k: int = 1) -> tuple[Array, Index]:
    """Distances and indices, (n, k), of the `k` points of a tree nearest to each place (eq. 1)."""
    # for a few places threads take longer to start than to search
    workers = -1 if len(u) > _MANY else 1
    ranks = np.arange(1, k + 1)
    distance, index = tree.query(u, ranks, workers=workers)
    return np.asarray(distance), np.asarray(index, dtype=np.intp)


def _few(distances: int) -> bool:
    """Whether these distances are computed sooner than SciPy is imported."""
    return distances <= _FEW and "scipy.spatial" not in sys.modules


def search_tree(points: Array, scale: Scale | None = None) -> cKDTree:
    """A k-d tree of points in the unit box that knows the periodic coordinates of `scale`."""
    from scipy.spatial import cKDTree

    box = None
    if scale is not None and scale.periodic.any():
        points = scale.wrapped(points)
        box = scale.periodic.astype(float)
    # neither compact nor balanced: built in a fraction of the time, as each epoch needs one
    return cKDTree(
        points, boxsize=box, compact_nodes=False, balanced_tree=False
    )


@dataclass(frozen=True, eq=False)
class Epoch:
    """The state of a network after one pass over some samples."""

    weights: Array  # (nodes, d), weights of the nodes, in the unit box
    lattice: Lattice | Graph  # how they are joined
    sigma: float  # [nodes], neighbourhood radius of this pass
    # mean distance of the samples to their winners, in the unit box
    error: float
    # share of samples whose two nearest nodes are not joined
    topographic: float

    @staticmethod
    def of(
        u: Array,
        weights: Array,
        lattice: Lattice | Graph,
        sigma: float,
        error: float,
    ) -> Epoch:
        """The state after a pass over all samples `u` (n, d)."""
        topographic = topographic_error(u, search_tree(weights), lattice)
        return Epoch(weights, lattice, sigma, error, topographic)

    @property
    def row(self) -> tuple[int, float, float, float]:
        """What a map remembers of it, columns as :data:`calib.maps.map.HISTORY`."""
        return len(self.weights), self.sigma, self.error, self.topographic


def topographic_error(
    u: Array,
    tree: cKDTree,
    lattice: Lattice | Graph,
) -> float:
    """Topographic error on some 500 of the samples `u`."""
    _, nodes = nearest_nodes(tree, u[:: shown_step(len(u))], 2)
    return folded_share(nodes, lattice)


def shown_step(n: int) -> int:
    """Every how many of `n` samples show a topographic error."""
    return max(1, n // 500)


def folded_share(nodes: Index, lattice: Lattice | Graph) -> float:
    """Share of pairs (n, 2) of nodes that are not joined."""
    joined = lattice.adjacent(*nodes.T)
    return float(np.mean(~joined))
