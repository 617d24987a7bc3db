"""Poses: which rows stand at one pose, which is one measurement of the arm however often read.

Rows are at one pose where they differ by what encoders read differently: by much less than poses
differ from each other.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..common.arrays import Array, Index
from .settings import ONE_POSE

if TYPE_CHECKING:
    from scipy.sparse import csr_array


@dataclass(frozen=True, eq=False)
class Visits:
    """Which rows stand at a pose that was measured again, and in which visit to it."""

    rows: Index  # (k,), rows at such poses
    pose: Index  # (k,), number of each row's pose, from 0
    visit: Index  # (k,), number of each row's visit, from 0


def visits_of(q: Array) -> Visits:
    """Return the rows of joints (n, dof) at poses that were measured again, in their order."""
    pose = pose_index(q)
    rows = np.flatnonzero(np.bincount(pose)[pose] > 1)
    arrivals = np.cumsum(np.diff(pose, prepend=-1) != 0)
    return Visits(rows, _numbered(pose[rows]), _numbered(arrivals[rows]))


def pose_index(q: Array) -> Index:
    """Return the number of the pose of each row (n,), in the order in which joints show them."""
    from scipy.spatial import cKDTree

    # many equal rows would be each other's neighbours alone: they are one row here
    decimals = round(-np.log10(ONE_POSE.exact)) + 1
    distinct, place = np.unique(q.round(decimals), axis=0, return_inverse=True)
    place = np.asarray(place.ravel(), dtype=np.intp)
    if not 1 < len(distinct) <= ONE_POSE.most_rows:
        return _numbered(place)
    count = min(ONE_POSE.neighbours + 1, len(distinct))
    tree = cKDTree(distinct)
    distance, neighbour = map(
        np.asarray, tree.query(distinct, k=count, p=np.inf)
    )
    if distance[:, 1].min() > ONE_POSE.most_apart:
        return _numbered(place)
    return _numbered(_joined(distinct, distance, neighbour)[place])


def _numbered(labels: Index) -> Index:
    """Return labels (n,) as numbers from 0 in the order in which they come."""
    _, first, index = np.unique(labels, return_index=True, return_inverse=True)
    rank = np.empty(len(first), dtype=np.intp)
    rank[np.argsort(first)] = np.arange(len(first))
    return rank[index.ravel()]


def _joined(q: Array, distance: Array, neighbour: Index) -> Index:
    """Return the group (m,) of each of different rows (m, dof) by its neighbours (m, k)."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import minimum_spanning_tree

    count = len(q)
    first = np.repeat(np.arange(count), distance.shape[1])
    edges = coo_array(
        (distance.ravel(), (first, neighbour.ravel())), shape=(count, count)
    )
    tree = minimum_spanning_tree(edges.tocsr())
    # rows of one pose that was often read are each other's neighbours alone: no edge of the tree
    # tells how far away the next pose is
    groups = _groups(tree, ONE_POSE.most_apart)
    lengths = np.append(tree.data, _apart(means_of(groups, q)))
    return _groups(tree, _reading_difference(lengths))


def _groups(tree: csr_array, longest: float) -> Index:
    """Return the group (m,) of each row of a tree whose longer edges are cut."""
    from scipy.sparse.csgraph import connected_components

    edges = tree.copy()
    edges.data = np.where(edges.data <= longest, edges.data, 0.0)
    edges.eliminate_zeros()
    return np.asarray(
        connected_components(edges, directed=False)[1], dtype=np.intp
    )


def _apart(centres: Array) -> Array:
    """Return how far each of the centres (g, dof) is from its neighbour, (g,)."""
    from scipy.spatial import cKDTree

    if len(centres) < 2:
        return np.zeros(0)
    return np.asarray(cKDTree(centres).query(centres, k=2, p=np.inf)[0])[:, 1]


def _reading_difference(lengths: Array) -> float:
    """Return how far apart rows of one pose may read [rad or m].

    lengths : between neighbours; those within poses are much shorter than those between
    """
    lengths = np.sort(np.maximum(lengths, ONE_POSE.exact))
    short = int(np.count_nonzero(lengths[:-1] <= ONE_POSE.most_apart))
    if short < ONE_POSE.least_pairs:
        return ONE_POSE.exact
    growth = lengths[1 : short + 1] / lengths[:short]
    growth[: ONE_POSE.least_pairs - 1] = 0.0
    largest = int(growth.argmax())
    return (
        float(lengths[largest])
        if growth[largest] >= ONE_POSE.gap
        else ONE_POSE.exact
    )


def means_of(group: Index, x: Array) -> Array:
    """Return the mean of each group's rows, (groups, m)."""
    sums = [np.bincount(group, axis) for axis in x.T]
    return np.asarray(np.stack(sums, axis=1) / np.bincount(group)[:, None])
