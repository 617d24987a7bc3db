"""Telling: poses at which the causes of a drift look different from one another.

A small change of the arm or the sensor moves what is seen by its derivative. Poses whose
derivatives are large and point different ways determine all changes together best: their
information matrix has the largest determinant (D-optimality; the observability index O1 of
Borm and Menq 1991, which Sun and Hollerbach 2008 recommend among five).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..features import find_chain
from ..outliers import spread_points
from ..robust import solve

if TYPE_CHECKING:
    from ..model import Model

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_PRIOR = 1e-2  # information on each change before the first pose; one pose brings about 1
_PASSES = 2  # of exchanges, after which little changes
_APART = 0.05  # least distance of two poses, in units of the joints' ranges


def effects(model: Model, u: Array) -> Array:
    """How small changes move the tip that is seen.

    Parameters
    ----------
    model : Model
    u : (n, dof) array
        Poses in units of the joints' ranges.

    Returns
    -------
    (n, 2, p) array
        For the sensor's frame (shift and linear part), each joint's offset and, where the
        map is one of a chain of links, each link's length; each of mean square 1 over the
        poses.
    """
    said, slope = model.predictor.value_and_slope(u)
    one, none = np.ones(len(u)), np.zeros(len(u))
    columns = []
    for along in (one, *(said - said.mean(axis=0)).T):
        columns += [np.stack([along, none], axis=1), np.stack([none, along], axis=1)]
    columns += list(np.moveaxis(slope, 2, 0))
    turning = model.about.revolute
    points, positions = spread_points(model.predictor.value, u.shape[1])
    chain = find_chain(model.motor.scale, turning, points, positions)
    if chain is not None:
        coefficients = solve(chain.values(points), positions)
        links = chain.values(u)
        for k in np.flatnonzero(turning).tolist():
            own = slice(1 + 2 * k, 3 + 2 * k)
            columns.append(links[:, own] @ coefficients[own])
    changes = np.stack(columns, axis=2)
    size = np.sqrt(np.mean(np.sum(changes**2, axis=1), axis=0))
    return np.asarray(changes / np.maximum(size, 1e-300))


def most_telling(changes: Array, u: Array, n: int) -> Index:
    """Choose poses that tell changes apart best.

    One by one, each where it adds most to the determinant, then exchanged one by one
    (Fedorov 1972) while that helps.

    Parameters
    ----------
    changes : (m, 2, p) array
        See `effects`.
    u : (m, dof) array
        The poses to choose from. Chosen ones are not closer together than a twentieth of
        the joints' ranges while there is room, so that no place is trusted alone.
    n : int
        How many, at most m.

    Returns
    -------
    (n,) int array
        Rows of `changes`.
    """
    from scipy.spatial import cKDTree

    information: Array = _PRIOR * np.eye(changes.shape[2])
    tree = cKDTree(u)
    taken = np.zeros(len(u), dtype=np.intp)  # chosen poses at or near each pose
    chosen: list[int] = []

    def near(row: int) -> list[int]:
        return list(tree.query_ball_point(u[row], _APART))

    def add(row: int) -> None:
        nonlocal information
        chosen.append(row)
        taken[near(row)] += 1
        information = information + changes[row].T @ changes[row]

    def best() -> int:
        free = taken == 0 if (taken == 0).any() else np.ones(len(u), dtype=bool)
        free[chosen] = False
        gain = _gain(changes, np.asarray(np.linalg.inv(information)))
        return int(np.where(free, gain, -np.inf).argmax())

    for _ in range(n):
        add(best())
    for _ in range(_PASSES * n):
        row = chosen.pop(0)
        taken[near(row)] -= 1
        information = information - changes[row].T @ changes[row]
        add(best())
    return np.array(chosen, dtype=np.intp)


def _gain(changes: Array, covariance: Array) -> Array:
    """Factor by which each pose raises the determinant of the information, (m,)."""
    gram = (changes @ covariance) @ np.swapaxes(changes, 1, 2)
    return np.asarray((1.0 + gram[:, 0, 0]) * (1.0 + gram[:, 1, 1]) - gram[:, 0, 1] * gram[:, 1, 0])
