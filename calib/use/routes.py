"""Routes: an order of poses, and further poses where a straight move would leave the box."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..errors import OptionError
from .keep_inside import Keep, moves
from .pose_space import Space
from .spread import candidates
from .tour import shortest_tour

if TYPE_CHECKING:
    from scipy.sparse import csr_array

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Choose = Callable[[Array, int, Array], Index]
"""Chooses n of some points (m, dof) beside those that are taken (k, dof), in unit ranges."""

_DENSE = 12  # draws of candidates where the tip has to stay within a box
_NODES = 3000  # poses that routes may lead through
_NEAR = 12  # neighbours that each of them is joined with
_DIRECT = 30  # neighbours that a chosen pose is joined with


@dataclass(frozen=True, eq=False)
class Route:
    """Poses in the order in which they are visited.

    Attributes
    ----------
    u : (n, dof) array
        In units of the joints' ranges.
    via : (n,) bool array
        Poses that only lead round what a straight move would cross.
    away : (m, m) array
        Lengths of the ways between the poses to measure, in the order of the route, the
        start first.
    notes : tuple of str
        What the user should be told.
    """

    u: Array
    via: NDArray[np.bool_]
    away: Array
    notes: tuple[str, ...] = ()


def free_route(n: int, start: Array, taken: Array, points: Array, choose: Choose) -> Route:
    """Visit poses of a box of joint values: every straight move is allowed.

    Parameters
    ----------
    n : int
        Number of poses.
    start : (dof,) array
        Where the way begins, in units of the joints' ranges; it is not measured.
    taken : (k, dof) array
        Poses that were measured before.
    points : (m, dof) array
        What to choose from.
    choose : callable
        Which of the points, n of them, given those taken.
    """
    nodes = np.vstack([start, points[choose(points, n, taken)]])
    away = moves(nodes[:, None], nodes[None])
    order = shortest_tour(away)
    return Route(nodes[order[1:]], np.zeros(n, dtype=bool), away[np.ix_(order, order)])


def kept_route(
    keep: Keep,
    n: int,
    start: Array | None,
    taken: Array,
    points: Array,
    choose: Choose,
    rng: np.random.Generator,
) -> Route:
    """Visit poses without the tip leaving a box, where need be through further poses.

    A roadmap (Kavraki et al. 1996) of short moves that were checked joins the poses; those
    that it cannot join to the start without leaving the box are given up.

    Parameters
    ----------
    keep : Keep
    n : int
        Number of poses.
    taken : (k, dof) array
        Poses that were measured before.
    start : (dof,) array or None
        Where the way begins; None for any pose.
    points : (m, dof) array
        What to choose from; those outside of the box are passed over.
    choose : callable
        As for `free_route`.
    rng : Generator
        Thins the roadmap where points abound.

    Raises
    ------
    OptionError
        If the start is outside of the box or the box holds too few poses.
    """
    from scipy.sparse.csgraph import connected_components

    space = keep.space
    if start is not None and not keep.holds(start[None])[0]:
        x, y = space.position(space.scale.from_unit(start[None]))[0].tolist()
        raise OptionError(
            f"keep {keep.words()}: the start's tip is at x = {x:.4g}, y = {y:.4g}, which is "
            f"outside or closer than {keep.step / 2:.2g} {space.unit} to its border",
            hint="give as `start` joint values whose tip is inside",
            parameter="start",
        )
    nodes = points[keep.holds(points)]
    found = len(nodes)
    if found > _NODES:
        nodes = nodes[np.sort(rng.permutation(found)[:_NODES])]
    if start is not None:
        nodes = np.vstack([start, nodes])
    graph = keep.roadmap(nodes, _NEAR) if len(nodes) > 1 else None
    if graph is None:
        raise OptionError(_too_few(keep, points, 0, n))
    label = connected_components(graph, directed=False)[1]
    own = label[0] if start is not None else np.bincount(label).argmax()
    joined = np.flatnonzero(label == own)
    joined = joined[joined > 0] if start is not None else joined
    if len(joined) < n:
        raise OptionError(_too_few(keep, points, len(joined), n))
    chosen = joined[choose(nodes[joined], n, taken)]
    terminals = chosen if start is None else np.append(0, chosen)
    away, before = _ways(keep, nodes, graph, terminals)
    order = shortest_tour(away)
    rows, via = [terminals[order[:1]]], [np.zeros(1, dtype=bool)]
    for a, b in itertools.pairwise(order.tolist()):
        way = _shortcut(keep, nodes, _trace(before[a], terminals[a], terminals[b]))
        rows.append(way)
        via.append(np.arange(len(way)) < len(way) - 1)
    skip = 0 if start is None else 1
    path, between = np.concatenate(rows)[skip:], np.concatenate(via)[skip:]
    notes = []
    others = 1.0 - len(joined) / (len(nodes) - skip)
    if others > 0.02:
        notes.append(
            f"keep {keep.words()}: {100 * others:.0f} % of the poses in the box cannot be reached "
            "from the start without leaving it, such as those of the other elbow; plan them "
            "apart, with `start`"
        )
    return Route(nodes[path], between, away[np.ix_(order, order)], tuple(notes))


def dense(space: Space, rng: np.random.Generator) -> Array:
    """Draw many candidates (m, dof), of which a box of the workspace leaves a part."""
    return np.concatenate([candidates(space, rng) for _ in range(_DENSE)])


def _ways(
    keep: Keep, nodes: Array, graph: csr_array, terminals: Index
) -> tuple[Array, NDArray[np.int32]]:
    """Shortest ways between terminals, (m, m), and the node before each, (m, nodes)."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import dijkstra

    direct = keep.roadmap(nodes[terminals], _DIRECT).tocoo()
    ends = terminals[direct.row], terminals[direct.col]
    graph = graph.maximum(csr_array((direct.data, ends), shape=graph.shape))
    away, before = dijkstra(graph, indices=terminals, return_predecessors=True)
    return away[:, terminals], before


def _trace(before: NDArray[np.int32], start: int, end: int) -> Index:
    """Nodes on the way from start to end, both included."""
    way = [end]
    while before[way[-1]] != start:
        way.append(int(before[way[-1]]))
    return np.array([start, *way[::-1]], dtype=np.intp)


def _shortcut(keep: Keep, nodes: Array, way: Index) -> Index:
    """Leave out nodes that a straight move can pass by; the start is left out too."""
    kept, place = [], 0
    while place < len(way) - 1:
        ahead = np.arange(place + 1, len(way))
        clear = keep.clear(np.repeat(nodes[way[place]][None], len(ahead), 0), nodes[way[ahead]])
        clear[0] = True  # an edge of the roadmap
        place = int(ahead[np.flatnonzero(clear)[-1]])
        kept.append(way[place])
    return np.array(kept, dtype=np.intp)


def _too_few(keep: Keep, points: Array, found: int, n: int) -> str:
    """Say that a box holds too few poses, and what the tip reaches."""
    x = keep.space.position(keep.space.scale.from_unit(points))
    (x0, y0), (x1, y1) = np.nanmin(x, axis=0), np.nanmax(x, axis=0)
    what = f"only {found} poses" if found else "no pose"
    return (
        f"keep {keep.words()}: {what} of the {n} wanted found within it; the tip reaches "
        f"x {x0:.4g} to {x1:.4g}, y {y0:.4g} to {y1:.4g} {keep.space.unit}: give a wider box"
    )
