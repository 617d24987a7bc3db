"""The tour: an order of poses in which the joints travel little."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_LONGEST_RUN = 3  # poses that Or-opt moves together
_SWEEPS = 50  # each lowers the length; far fewer are needed


def shortest_tour(away: Array) -> Index:
    """Order points so that the way from the first one through all others is short.

    Nearest neighbours first, then 2-opt (Croes 1958: a stretch is turned round) and Or-opt
    (Or 1976: a short stretch is moved elsewhere) until neither shortens it. The way is
    open: it does not return.

    Parameters
    ----------
    away : (n, n) array
        Symmetric distances; the way starts at row 0.

    Returns
    -------
    (n,) int array
        A permutation that begins with 0.
    """
    order = _nearest_neighbours(away)
    for _ in range(_SWEEPS):
        before = length(away, order)
        order = _two_opt(away, order)
        order = _or_opt(away, order)
        if length(away, order) >= before * (1 - 1e-12):
            break
    return order


def length(away: Array, order: Index) -> float:
    """Length of the way through the points in this order."""
    return float(away[order[:-1], order[1:]].sum())


def _nearest_neighbours(away: Array) -> Index:
    order = np.zeros(len(away), dtype=np.intp)
    left = np.ones(len(away), dtype=bool)
    left[0] = False
    for k in range(1, len(away)):
        order[k] = np.where(left, away[order[k - 1]], np.inf).argmin()
        left[order[k]] = False
    return order


def _two_opt(away: Array, order: Index) -> Index:
    """Turn round the stretch from i to j that gains most, for each i in turn."""
    order = order.copy()
    n = len(order)
    for i in range(1, n - 1):
        a, b = order[i - 1], order[i]
        ends = order[i + 1 :]
        gain = away[a, b] - away[a, ends]
        gain[:-1] += away[ends[:-1], ends[1:]] - away[b, ends[1:]]  # the last has no successor
        j = int(gain.argmax())
        if gain[j] > 1e-12:
            order[i : i + j + 2] = order[i : i + j + 2][::-1]
    return order


def _or_opt(away: Array, order: Index) -> Index:
    """Move the stretch at each place to where it gains most, turned round if need be."""
    for run in range(1, min(_LONGEST_RUN, len(order) - 2) + 1):
        for i in range(1, len(order) - run + 1):
            stretch, rest = order[i : i + run], np.delete(order, np.s_[i : i + run])
            a, first, last = order[i - 1], stretch[0], stretch[-1]
            saved = away[a, first]
            if i + run < len(order):
                saved += away[last, order[i + run]] - away[a, order[i + run]]
            after = rest[1:]
            cost = []
            for head, tail in ((first, last), (last, first)):
                extra = away[rest, head]
                extra[:-1] += away[tail, after] - away[rest[:-1], after]
                cost.append(extra)
            least = np.minimum(*cost)
            place = int(least.argmin())
            if saved - least[place] > 1e-12:
                if cost[1][place] < cost[0][place]:
                    stretch = stretch[::-1]
                order = np.insert(rest, place + 1, stretch)
    return order
