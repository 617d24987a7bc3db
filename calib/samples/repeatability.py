"""Repeatability: how far readings at one pose scatter, the sensor's share and the arm's apart.

A pose that was measured again tells the noise without any model.  Readings that follow each other
while the arm stands are one visit: they differ by the sensor's noise alone.  Visits to one pose
differ by the arm's return as well.  With readings r of visits v to poses p, along each axis::

    x_pvr = mean_p + return_pv + noise_pvr

The two variances follow from the sums of squares within and between visits (a nested analysis of
variance), their intervals from chi-squared with the degrees of freedom that those rest on.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ..common.arrays import Array, Index
from ..errors import LogError
from .samples import Samples

_NEIGHBOURS = 8  # of each row, among which rows of one pose are found
_MOST_APART = (
    0.01  # [rad or m]; encoders that read one pose as differently repeat nothing
)
_GAP = 5.0  # times further apart than rows of one pose that two poses have to be
_EXACT = 1e-6  # [rad or m], rounding of a log's numbers
_ROUNDED = 7  # decimals below which numbers of a log are rounding
_TAILS = (0.975, 0.025)


@dataclass(frozen=True, eq=False)
class Visits:
    """Which rows stand at a pose that was measured again, and in which visit to it."""

    rows: Index  # (k,), rows at such poses
    pose: Index  # (k,), number of each row's pose, from 0
    visit: Index  # (k,), number of each row's visit, from 0


@dataclass(frozen=True)
class Repeatability:
    """Standard deviations along an axis; NaN where the log cannot tell one.

    Attributes
    ----------
    sensor : float [unit]
        Of readings of one visit.
    arm : float [unit]
        Of the place that the arm returns to.  Where each visit has one reading it contains the
        sensor's noise.
    sensor_interval, arm_interval : (float, float) [unit]
        95 % intervals.
    poses : int
        Poses that were measured more than once.
    repeats : int
        Their readings beyond the first of each.
    returns : int
        Their visits beyond the first of each.
    unit : str
        Of the positions.
    """

    sensor: float
    arm: float
    sensor_interval: tuple[float, float]
    arm_interval: tuple[float, float]
    poses: int
    repeats: int
    returns: int
    unit: str = "m"

    def to_json(self) -> dict[str, Any]:
        """Return what `calib noise --json` prints."""
        document = asdict(self)
        document["return"] = document.pop("arm")
        document["intervals"] = {
            "sensor": document.pop("sensor_interval"),
            "return": document.pop("arm_interval"),
        }
        return document


def repeatability(samples: Samples) -> Repeatability:
    """Return how far a log's readings of the same poses scatter.

    Raises LogError if no pose was measured twice.
    """
    visits = visits_of(samples.q)
    if not len(visits.rows):
        raise LogError(
            f"none of the log's {len(samples)} rows stands where another one did: the noise cannot "
            "be told",
            hint="go to some poses again, and read each a few times",
        )
    return scatter(visits, samples.x[visits.rows], samples.unit)


def visits_of(q: Array) -> Visits:
    """Return the rows of joints (n, dof) at poses that were measured again, in their order.

    Rows are at one pose where they differ by what encoders read differently: by much less than
    poses differ from each other, and by 0.01 rad or m at most.
    """
    pose = _clusters(q)
    counts = np.bincount(pose)
    rows = np.flatnonzero(counts[pose] > 1)
    arrivals = np.cumsum(np.diff(pose, prepend=-1) != 0)
    numbers = [
        np.unique(values[rows], return_inverse=True)[1] for values in (pose, arrivals)
    ]
    return Visits(
        rows, *(np.asarray(number, dtype=np.intp).ravel() for number in numbers)
    )


def _clusters(q: Array) -> Index:
    """Return the number of the pose of each row (n,)."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components, minimum_spanning_tree
    from scipy.spatial import cKDTree

    n = len(q)
    # many equal rows would be each other's neighbours alone: they are one row here
    distinct, place = np.unique(q.round(_ROUNDED), axis=0, return_inverse=True)
    place = place.ravel()
    m = len(distinct)
    if m == 1:
        return np.zeros(n, dtype=np.intp)
    count = min(_NEIGHBOURS + 1, m)
    distance, other = map(
        np.asarray, cKDTree(distinct).query(distinct, k=count, p=np.inf)
    )
    first = np.repeat(np.arange(m), distance.shape[1])
    graph = coo_array((distance.ravel(), (first, other.ravel())), shape=(m, m)).tocsr()
    tree = minimum_spanning_tree(graph).tocoo()
    near = tree.data <= _same_within(np.append(tree.data, _between(distinct, tree)))
    joined = coo_array(
        (np.ones(int(near.sum())), (tree.row[near], tree.col[near])), shape=(m, m)
    )
    label = connected_components(joined, directed=False)[1]
    return np.asarray(label[place], dtype=np.intp)


def _between(q: Array, tree: Any) -> Array:
    """Return how far the groups of rows that may be one pose are from their neighbours, (g,).

    Rows of one pose that was often read are each other's neighbours alone: no edge of the `tree`
    tells how far away the next pose is.
    """
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    edges = tree.copy()
    edges.data = np.where(edges.data <= _MOST_APART, edges.data, 0.0)
    edges.eliminate_zeros()
    count, group = connected_components(edges, directed=False)
    if count < 2:
        return np.zeros(0)
    centres = _means(np.asarray(group, dtype=np.intp), q)
    distance = np.asarray(
        cKDTree(centres).query(centres, k=2, p=np.inf)[0], dtype=float
    )
    return distance[:, 1]


def _same_within(edges: Array) -> float:
    """Return how far apart rows of one pose may read [rad or m].

    edges : lengths of the shortest tree through all poses; those within poses are much shorter than
        those between
    """
    lengths = np.sort(np.maximum(edges, _EXACT))
    small = np.flatnonzero(lengths[:-1] <= _MOST_APART)
    if not len(small):
        return _EXACT
    growth = lengths[small + 1] / lengths[small]
    largest = int(growth.argmax())
    return float(lengths[small[largest]]) if growth[largest] >= _GAP else _EXACT


def scatter(visits: Visits, x: Array, unit: str = "m") -> Repeatability:
    """Return the standard deviations of positions (k, m) [unit] of the rows of `visits`."""
    axes = x.shape[1]
    readings = np.bincount(visits.visit)
    means = _means(visits.visit, x)
    pose = visits.pose[np.unique(visits.visit, return_index=True)[1]]
    total = np.bincount(pose, readings)
    centres = (
        np.stack([np.bincount(visits.pose, axis) for axis in x.T], axis=1)
        / total[:, None]
    )
    within = float(((x - means[visits.visit]) ** 2).sum())
    between = float((readings[:, None] * (means - centres[pose]) ** 2).sum())
    free_within = axes * (len(x) - len(readings))
    free_between = axes * (len(readings) - len(total))
    sensor, sensor_interval = _deviation(within, free_within)
    # E[between] = free * noise^2 + size * return^2, with the visits' weights in each pose
    size = axes * float(
        (total - np.bincount(pose, readings.astype(float) ** 2) / total).sum()
    )
    noise = sensor**2 if free_within else 0.0
    arm = math.nan
    arm_interval = (math.nan, math.nan)
    if free_between:
        arm = math.sqrt(max(between - free_between * noise, 0.0) / size)
        low, high = _deviation(between, free_between)[1]
        least, most = sensor_interval if free_within else (0.0, 0.0)
        share = free_between / size
        arm_interval = (
            math.sqrt(max(share * (low**2 - most**2), 0.0)),
            math.sqrt(max(share * (high**2 - least**2), 0.0)),
        )
    repeats = len(x) - len(total)
    returns = len(readings) - len(total)
    return Repeatability(
        sensor, arm, sensor_interval, arm_interval, len(total), repeats, returns, unit
    )


def _means(group: Index, x: Array) -> Array:
    """Return the mean of each group's rows, (groups, m)."""
    counts = np.bincount(group)
    sums = [np.bincount(group, axis) for axis in x.T]
    return np.asarray(np.stack(sums, axis=1) / counts[:, None])


def _deviation(squares: float, freedom: int) -> tuple[float, tuple[float, float]]:
    """Return a standard deviation and its 95 % interval from a sum of squares."""
    from scipy.special import chdtri

    if not freedom:
        return math.nan, (math.nan, math.nan)
    low, high = (
        math.sqrt(squares / float(chdtri(freedom, 1.0 - tail))) for tail in _TAILS
    )
    return math.sqrt(squares / freedom), (low, high)
