"""Growing neural gas (Fritzke, NIPS 1995): nodes and edges that grow where errors are.

With blocks of one sample :func:`present_gng` is the source's algorithm to the letter.  Within a
longer block, of at most a tenth of the nodes, the winners are those at its start.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from ..common.arrays import Array, Index
from ..common.rows import group_sums
from .density import Gain, Visit
from .lattice import Graph
from .map import Epoch, nearest_nodes, search_tree
from .settings import GROWING


@dataclass
class Gas:
    """A gas that grows: its nodes, their errors, the edges and their ages."""

    weights: Array  # (nodes, d), nodes in the unit box
    # (nodes,), accumulated squared distance to the samples that each has won
    error: Array
    # (m, 2), edges, the smaller node first
    pairs: Index = field(
        default_factory=lambda: np.zeros((0, 2), dtype=np.intp)
    )
    # (m,), samples that either end has won since the edge was last renewed
    age: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def graph(self) -> Graph:
        """The edges as they are now, in ascending order."""
        return Graph.of(len(self.weights), self.pairs)

    def neighbours(self, node: int) -> Index:
        """Nodes that are joined to `node`."""
        a, b = self.pairs.T
        after = b[a == node]
        before = a[b == node]
        return np.concatenate([after, before])


def learn_gng(
    u: Array,
    nodes: int,
    gain: Gain | None,
    epochs: int,
    rng: np.random.Generator,
) -> Iterator[Epoch]:
    """Grow a gas within the first 60 % of the samples; yields after each pass over these.

    gain : varying density: a factor on the errors that are accumulated
    epochs : passes over the samples, each in another order; a pass ends after 15 per node
    """
    two_samples = u[rng.permutation(len(u))[:2]]
    noise = rng.random((2, u.shape[1]))
    apart = 1e-9 * noise
    gas = Gas(two_samples + apart, np.zeros(2))
    # the source's decay d = 0.995 remembers 200 samples, too few for thousands of nodes
    decay = 1.0 - 1.0 / (2.0 * max(nodes, 100))
    shown = min(len(u), GROWING.samples_per_node * nodes)
    until_grown = GROWING.growing * epochs * shown
    done = 0
    for _ in range(epochs):
        order = u[rng.permutation(len(u))[:shown]]
        total = 0.0
        first = 0
        while first < shown:
            length = min(GROWING.block, len(gas.weights) // 10)
            block = order[first : first + max(1, length)]
            first += len(block)
            done += len(block)
            progress = min(1.0, done / until_grown)
            total += present_gng(gas, block, decay, gain, progress)
            wanted = 2 + int((nodes - 2) * progress)
            while len(gas.weights) < wanted and len(gas.pairs):
                insert(gas)
        error = total / shown
        yield Epoch.of(u, gas.weights, gas.graph, 0.0, error)


def present_gng(
    gas: Gas,
    samples: Array,
    decay: float,
    gain: Gain | None,
    progress: float,
) -> float:
    """Move the winners of a block and their neighbours, renew and age edges.

    decay : factor d on every error, per sample
    Returns the sum of the samples' distances to their winners.
    """
    n = len(gas.weights)
    tree = search_tree(gas.weights)
    distances, nodes = nearest_nodes(tree, samples, 2)
    distance = distances[:, 0]
    winner = nodes[:, 0]
    second = nodes[:, 1]
    error = distance**2
    if gain is not None:
        visit = Visit(
            progress,
            winner,
            distance,
            gas.weights,
            gas.graph,
        )
        error = error * gain(visit)
    gas.error = gas.error + group_sums(winner, error, n)
    gas.error = gas.error * decay ** len(samples)
    wins = group_sums(winner, np.ones(len(samples)), n)
    wins_of_ends = wins[gas.pairs].sum(axis=1)
    gas.age = gas.age + wins_of_ends
    _move_nodes(gas, wins, group_sums(winner, samples, n))
    _renew_edges(gas, winner, second)
    _remove_old_edges(gas)
    return float(distance.sum())


def _move_nodes(
    gas: Gas,
    wins: Array,
    sums: Array,
) -> None:
    """Move each node towards the samples that it and its neighbours won.

    wins, sums : (nodes,), (nodes, d), number and sum of the samples that each node won
    """
    n = len(wins)
    ends = gas.pairs.T.ravel()
    swapped = gas.pairs[:, ::-1]
    neighbours = swapped.T.ravel()
    # what many steps add up to: a node keeps (1 - epsilon)^wins of its place
    rate_winner = -np.log1p(-GROWING.epsilon_b)
    rate_neighbour = -np.log1p(-GROWING.epsilon_n)
    won = np.column_stack([wins, sums])
    near = group_sums(ends, won[neighbours], n)
    pull = rate_winner * won + rate_neighbour * near
    rate = pull[:, 0]
    moved = np.flatnonzero(rate > 0.0)
    target = pull[moved, 1:] / rate[moved, None]
    share = -np.expm1(-rate[moved])[:, None]
    step = target - gas.weights[moved]
    gas.weights[moved] += share * step


def _renew_edges(
    gas: Gas,
    winner: Index,
    second: Index,
) -> None:
    """Join the two nearest nodes of each sample by an edge of age 0."""
    n = len(gas.weights)
    low = np.minimum(winner, second)
    high = np.maximum(winner, second)
    new_keys = np.unique(low * n + high)
    new_ends = np.divmod(new_keys, n)
    new_pairs = np.stack(new_ends, axis=1)
    first, other = gas.pairs.T
    keys = first * n + other
    stays = ~np.isin(keys, new_keys)
    gas.pairs = np.concatenate([gas.pairs[stays], new_pairs])
    ages = np.zeros(len(new_keys))
    gas.age = np.concatenate([gas.age[stays], ages])


def _remove_old_edges(gas: Gas) -> None:
    """Remove edges that are too old, and nodes without any."""
    young = gas.age <= GROWING.a_max
    if young.all():
        return
    gas.pairs = gas.pairs[young]
    gas.age = gas.age[young]
    ends = gas.pairs.ravel()
    edges = np.bincount(ends, minlength=len(gas.weights))
    joined = edges > 0
    new_number = np.cumsum(joined) - 1
    gas.weights = gas.weights[joined]
    gas.error = gas.error[joined]
    gas.pairs = new_number[gas.pairs]


def insert(gas: Gas) -> int:
    """Insert a node between the one with the largest error and its worst neighbour; its number."""
    worst = int(gas.error.argmax())
    near = gas.neighbours(worst)
    # every node has an edge: those that lose all are removed
    other = int(near[gas.error[near].argmax()])
    gas.error[[worst, other]] *= GROWING.alpha
    gas.error = np.append(gas.error, gas.error[worst])
    new = len(gas.weights)
    between = 0.5 * (gas.weights[worst] + gas.weights[other])
    gas.weights = np.concatenate([gas.weights, between[None]])
    low, high = sorted((worst, other))
    split = (gas.pairs == (low, high)).all(axis=1)
    ends = np.array([[worst, new], [other, new]], dtype=np.intp)
    gas.pairs = np.concatenate([gas.pairs[~split], ends])
    ages = np.zeros(2)
    gas.age = np.concatenate([gas.age[~split], ages])
    return new
