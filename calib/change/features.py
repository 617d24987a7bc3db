"""Features: functions of the joints or of a predicted position that corrections are made of."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..common.robust import solve
from ..common.scale import Scale

Array = NDArray[np.float64]

_GEOMETRIC = 0.02  # share of the extent by which a map of a chain of links may differ


@dataclass(frozen=True)
class Chain:
    """What the tip of a planar chain of links is a linear function of.

    The position is a sum of one term per joint: a link that turns by the sum of all angles
    up to its joint, or a slide along a direction that turns by the sum of those before it.
    Its lengths, the joints' offsets and the sensor's frame are the coefficients; only the
    sense in which each joint turns has to be known.

    Attributes
    ----------
    scale : Scale
        Range of the joints.
    senses : tuple of int
        1 or -1 for each joint that turns, 0 for those that slide.
    """

    scale: Scale
    senses: tuple[int, ...]

    def angles(self, u: Array) -> Array:
        """Direction of each joint's link at `u` (n, dof) of the unit box, (n, dof) [rad]."""
        turns = np.where(np.array(self.senses) == 0, 0.0, self.scale.from_unit(u))
        return np.cumsum(turns * np.array(self.senses), axis=1)

    def values(self, u: Array) -> Array:
        """1, then cos and sin of each link's direction, (n, 1 + 2 dof)."""
        angle = self.angles(u)
        slide = np.where(np.array(self.senses) == 0, self.scale.from_unit(u), 1.0)
        columns = [np.ones(len(u))]
        for k in range(u.shape[1]):
            columns += [slide[:, k] * np.cos(angle[:, k]), slide[:, k] * np.sin(angle[:, k])]
        return np.stack(columns, axis=1)


def find_chain(scale: Scale, turning: tuple[bool, ...], u: Array, x: Array) -> Chain | None:
    """Find the senses of the joints, None where no chain of links describes the positions.

    Parameters
    ----------
    scale : Scale
        Range of the joints.
    turning : tuple of bool
        Joints that turn.
    u, x : (n, dof), (n, 2) array
        Joints in the unit box and positions.
    """
    first = turning.index(True) if any(turning) else -1
    choices = [
        (1,) if k == first else (1, -1) if turns else (0,) for k, turns in enumerate(turning)
    ]
    best, least = None, np.inf
    for senses in itertools.product(*choices):
        chain = Chain(scale, tuple(senses))
        features = chain.values(u)
        left = x - features @ solve(features, x)
        error = float(np.sqrt(np.mean(left**2)))
        if error < least * (1 - 1e-9):
            best, least = chain, error
    extent = float(np.linalg.norm(np.ptp(x, axis=0)))
    return best if least <= _GEOMETRIC * extent else None


@dataclass(frozen=True)
class Frame:
    """Polynomials of a predicted position: what moves or bends the sensor's frame.

    Attributes
    ----------
    middle : (2,) array [unit]
    size : float [unit]
        Positions are taken relative to the middle, in units of the size.
    degree : int
        Total degree; 1 is an affine map.
    """

    middle: Array
    size: float
    degree: int

    @staticmethod
    def of(y: Array, degree: int) -> Frame:
        """Polynomials for positions like `y` (n, 2)."""
        return Frame(y.mean(axis=0), float(np.abs(y - y.mean(axis=0)).max()) or 1.0, degree)

    def values(self, y: Array) -> Array:
        """Monomials up to the total degree, lowest first, (n, terms)."""
        from ..maps.local_models import monomials

        return monomials((y - self.middle) / self.size, self.degree)
