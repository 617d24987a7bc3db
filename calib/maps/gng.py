"""Growing neural gas (Fritzke, NIPS 1995): nodes and edges that grow where errors are.

With blocks of one sample :func:`present_gng` is the source's algorithm to the letter.  Within a
longer block, of at most a tenth of the nodes, the winners are those at its start.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from ..common.arrays import Array, Index
from .density import Gain, Visit
from .lattice import Graph
from .map import Epoch, nearest_nodes, search_tree

# letters and values of the source: steps towards a sample of the winner and its neighbours, age
# beyond which an edge is removed, share of the error that the parents of a new node keep
EPSILON_B, EPSILON_N, A_MAX, ALPHA = 0.1, 0.006, 50, 0.5
_GROWING = 0.6  # share of the samples during which nodes are inserted
_BLOCK = 512
_PER_NODE = 15  # samples per pass and node; more teach a gas little


@dataclass
class Gas:
    """A gas that grows: its nodes, their errors, the edges and their ages."""

    weights: Array  # (nodes, d), nodes in the unit box
    error: Array  # (nodes,), accumulated squared distance to the samples that each has won
    # (m, 2), edges, the smaller node first
    pairs: Index = field(default_factory=lambda: np.zeros((0, 2), dtype=np.intp))
    # (m,), samples that either end has won since the edge was last renewed
    age: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def graph(self) -> Graph:
        """The edges as they are now, in ascending order."""
        return Graph.of(len(self.weights), self.pairs)

    def neighbours(self, node: int) -> Index:
        """Nodes that are joined to `node`."""
        a, b = self.pairs.T
        return np.concatenate([b[a == node], a[b == node]])


def learn_gng(
    u: Array, nodes: int, gain: Gain | None, epochs: int, rng: np.random.Generator
) -> Iterator[Epoch]:
    """Grow a gas within the first 60 % of the samples; yields after each pass over these.

    gain : varying density: a factor on the errors that are accumulated
    epochs : passes over the samples, each in another order; a pass ends after 15 per node
    """
    gas = Gas(u[rng.permutation(len(u))[:2]] + 1e-9 * rng.random((2, u.shape[1])), np.zeros(2))
    # the source's decay d = 0.995 remembers 200 samples, too few for thousands of nodes
    decay = 1.0 - 1.0 / (2.0 * max(nodes, 100))
    shown, done = min(len(u), _PER_NODE * nodes), 0
    for _ in range(epochs):
        order = u[rng.permutation(len(u))[:shown]]
        total, first = 0.0, 0
        while first < shown:
            block = order[first : first + max(1, min(_BLOCK, len(gas.weights) // 10))]
            first, done = first + len(block), done + len(block)
            progress = min(1.0, done / (_GROWING * epochs * shown))
            total += present_gng(gas, block, decay, gain, progress)
            while len(gas.weights) < 2 + int((nodes - 2) * progress) and len(gas.pairs):
                insert(gas)
        yield Epoch.of(u, gas.weights, gas.graph, 0.0, total / shown)


def present_gng(
    gas: Gas, samples: Array, decay: float = 0.995, gain: Gain | None = None, progress: float = 1.0
) -> float:
    """Move the winners of a block and their neighbours, renew and age edges.

    decay : factor d on every error, per sample
    Returns the sum of the samples' distances to their winners.
    """
    distance, index = nearest_nodes(search_tree(gas.weights), samples, 2)
    n, first, second = len(gas.weights), index[:, 0], index[:, 1]
    square = distance[:, 0] ** 2
    if gain is not None:
        visit = Visit(progress, first, distance[:, 0], gas.weights, gas.graph)
        square = square * gain(visit)
    gas.error = (gas.error + np.bincount(first, square, n)) * decay ** len(samples)
    wins = np.bincount(first, minlength=n).astype(float)
    sums = np.stack([np.bincount(first, c, n) for c in samples.T], axis=1)
    a, b = gas.pairs.T
    gas.age = gas.age + wins[a] + wins[b]
    # what many steps add up to: a node keeps (1 - epsilon)^wins of its place
    own, other = -np.log1p(-EPSILON_B), -np.log1p(-EPSILON_N)
    rate, pull = own * wins, own * sums
    for near, far in ((a, b), (b, a)):
        rate = rate + other * np.bincount(near, wins[far], n)
        pull = pull + other * np.stack([np.bincount(near, c, n) for c in sums[far].T], axis=1)
    moved = np.flatnonzero(rate > 0.0)
    target = pull[moved] / rate[moved, None]
    gas.weights[moved] -= np.expm1(-rate[moved])[:, None] * (target - gas.weights[moved])
    # the two nearest nodes of each sample are joined by an edge of age 0
    fresh = np.unique(np.minimum(first, second) * n + np.maximum(first, second))
    key = gas.pairs[:, 0] * n + gas.pairs[:, 1]
    # fresh is sorted: a search is sooner than np.isin, which sorts all edges
    stay = fresh[np.minimum(np.searchsorted(fresh, key), len(fresh) - 1)] != key
    gas.pairs = np.concatenate([gas.pairs[stay], np.stack(np.divmod(fresh, n), axis=1)])
    gas.age = np.concatenate([gas.age[stay], np.zeros(len(fresh))])
    young = gas.age <= A_MAX
    if not young.all():  # edges that are too old go, and nodes that are left without one
        gas.pairs, gas.age = gas.pairs[young], gas.age[young]
        kept = np.bincount(gas.pairs.ravel(), minlength=n) > 0
        place = np.cumsum(kept) - 1
        gas.weights, gas.error, gas.pairs = gas.weights[kept], gas.error[kept], place[gas.pairs]
    return float(distance[:, 0].sum())


def insert(gas: Gas) -> int:
    """Insert a node between the one with the largest error and its worst neighbour; its number."""
    worst = int(gas.error.argmax())
    near = gas.neighbours(worst)
    if not len(near):
        gas.error[worst] = 0.0
        worst = int(gas.pairs[gas.error[gas.pairs].sum(axis=1).argmax(), 0])
        near = gas.neighbours(worst)
    other = int(near[gas.error[near].argmax()])
    gas.error[[worst, other]] *= ALPHA
    new = len(gas.weights)
    between = 0.5 * (gas.weights[worst] + gas.weights[other])
    gas.weights = np.concatenate([gas.weights, between[None]])
    gas.error = np.append(gas.error, gas.error[worst])
    split = (gas.pairs[:, 0] == min(worst, other)) & (gas.pairs[:, 1] == max(worst, other))
    ends = np.array([[worst, new], [other, new]], dtype=np.intp)
    gas.pairs = np.concatenate([gas.pairs[~split], ends])
    gas.age = np.concatenate([gas.age[~split], np.zeros(2)])
    return new
