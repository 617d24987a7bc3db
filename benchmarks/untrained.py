"""Maps that no rule has trained: what a trained map has to beat."""

import numpy as np

from calib.common.scale import Scale
from calib.maps.association import Association
from calib.maps.lattice import Graph, Lattice
from calib.maps.links import WIRINGS
from calib.maps.map import Map, nearest_nodes, search_tree

UNTRAINED = ("grid", "random", "rows")
_JOINED = 4  # nearest neighbours that a node without a lattice is joined to


def untrained_map(
    kind: str, u: np.ndarray, scale: Scale, side: int, rng: np.random.Generator
) -> Map:
    """A map of side x side nodes: an even grid, places at random, or rows of `u` (n, d)."""
    lattice = Lattice((side, side))
    n = lattice.size
    if kind == "grid":
        weights = np.full((n, u.shape[1]), 0.5)
        weights[:, : lattice.dim] = (lattice.positions() + 0.5) / np.array(lattice.shape)
        return Map(weights, lattice, scale, np.zeros((0, 4)))
    if kind == "random":
        weights = rng.random((n, u.shape[1]))
    else:
        weights = u[rng.choice(len(u), n, replace=len(u) < n)]
    near = nearest_nodes(search_tree(weights), weights, _JOINED + 1)[1][:, 1:]
    pairs = np.stack([np.repeat(np.arange(n), _JOINED), near.ravel()], axis=1)
    return Map(weights, Graph.of(n, pairs), scale, np.zeros((0, 4)))


def untrained_pair(
    kind: str, scale: Scale, u: np.ndarray, x: np.ndarray, side: int, seed: int
) -> Association:
    """Two such maps for joints `u` (n, dof) of the unit box and positions, linked by the rows."""
    rng = np.random.default_rng(seed)
    positions = Scale.of_data(x)
    v = positions.to_unit(x)
    motor = untrained_map(kind, u, scale, side, rng)
    sensory = untrained_map(kind, v, positions, side, rng)
    return Association.learn(motor, u, sensory, v, WIRINGS["reciprocal"])
