"""Poses: which rows stand at one pose, which is one measurement of the arm however often read.

Rows are at one pose where they differ by what encoders read differently: by much less than poses
differ from each other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array, Index
from .settings import ONE_POSE


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
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    # many equal rows would be each other's neighbours alone: they are one row here
    decimals = round(-np.log10(ONE_POSE.exact)) + 1
    distinct, place = np.unique(q.round(decimals), axis=0, return_inverse=True)
    place = np.asarray(place.ravel(), dtype=np.intp)
    count = len(distinct)
    if not 1 < count <= ONE_POSE.most_rows:
        return _numbered(place)
    near = min(ONE_POSE.neighbours + 1, count)
    distance, neighbour = map(
        np.asarray, cKDTree(distinct).query(distinct, k=near, p=np.inf)
    )
    if distance[:, 1].min() > ONE_POSE.most_apart:
        return _numbered(place)
    row = np.repeat(np.arange(count), near)

    def groups(longest: float) -> Index:
        """The group (m,) of each of the different rows, whose further neighbours are others."""
        close = distance.ravel() <= longest
        pairs = (row[close], neighbour.ravel()[close])
        graph = coo_array((np.ones(close.sum()), pairs), (count, count))
        return np.asarray(connected_components(graph)[1], dtype=np.intp)

    # rows of one pose that was often read are each other's neighbours alone: of the next pose
    # only their middles tell how far away it is
    middles = means_of(groups(ONE_POSE.most_apart), distinct)
    lengths = distance[:, 1:].ravel()
    if len(middles) > 1:
        apart = cKDTree(middles).query(middles, k=2, p=np.inf)[0]
        lengths = np.append(lengths, np.asarray(apart)[:, 1])
    return _numbered(groups(_reading_difference(lengths))[place])


def _numbered(labels: Index) -> Index:
    """Return labels (n,) as numbers from 0 in the order in which they come."""
    _, first, index = np.unique(labels, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))
    return rank[index.ravel()]


def _reading_difference(lengths: Array) -> float:
    """Return how far apart rows of one pose may read [rad or m].

    lengths : between neighbours; those within poses are much shorter than those between
    """
    lengths = np.sort(np.maximum(lengths, ONE_POSE.exact))
    short = int(np.count_nonzero(lengths[:-1] <= ONE_POSE.most_apart))
    growth = lengths[1 : short + 1] / lengths[:short]
    # each pair counts from both of its ends
    growth[: 2 * ONE_POSE.least_pairs - 1] = 0.0
    if growth.max(initial=0.0) < ONE_POSE.gap:
        return ONE_POSE.exact
    return float(lengths[growth.argmax()])


def means_of(group: Index, x: Array) -> Array:
    """Return the mean of each group's rows, (groups, m)."""
    sums = [np.bincount(group, axis) for axis in x.T]
    return np.asarray(np.stack(sums, axis=1) / np.bincount(group)[:, None])
