"""Gravity on a chain: how the weights that it carries pull at each of its joints.

A weight ``m`` at a point ``x`` pulls at a joint that turns about ``a`` through ``o`` with the
torque ``g . (a x m (x - o))``, and at a joint that slides along ``a`` with the force ``g . m a``.
A URDF's masses are one set of weights; where it has none, unit weights at the joints'
origins and the tip are a basis of what masses on the links can do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from ..errors import OptionError
from .spatial_chain import ChainState, SpatialChain, cross, rotate

_STANDARD = 9.80665
"""Standard gravity [m/s2]."""

GRAVITY = (0.0, 0.0, -_STANDARD)
"""Gravity in the root frame of an arm that is mounted upright [m/s2]."""


def standard(direction: Sequence[float]) -> tuple[float, float, float]:
    """Standard gravity (3,) [m/s2] along a direction (3,) of any length.

    Raises OptionError if it is none.
    """
    vector = np.asarray(direction, dtype=float)
    length = float(np.linalg.norm(vector))
    if vector.shape != (3,) or not (np.isfinite(length) and length > 0.0):
        raise OptionError(
            f"gravity {direction!r:.60}: expected three numbers that are not all zero, such as "
            "(0, 0, -9.81) of an arm that stands upright",
            parameter="gravity",
            value=direction,
        )
    x, y, z = (_STANDARD * vector / length).tolist()
    return x, y, z


@dataclass(frozen=True, eq=False)
class Loads:
    """``e`` loads on the joints of a chain, made of the weights of ``p`` points on its links."""

    chain: SpatialChain
    joints: NDArray[np.intp]  # (e,), the joint at which each load pulls
    weights: Array  # (e, p), how much each point weighs in a load; 0 for points before the joint
    points: Array  # (p, 3) [m], at the zero posture
    links: NDArray[np.intp]  # (p,), the joint that carries each point

    @staticmethod
    def of_masses(chain: SpatialChain) -> Loads:
        """One load [kg] for each of m joints: the masses that the URDF has beyond it."""
        joints = np.arange(chain.joints)
        beyond = np.triu(np.ones((chain.joints, chain.joints)))
        return Loads(
            chain, joints, beyond * chain.masses, chain.centres, joints
        )

    @staticmethod
    def of_unit_weights(chain: SpatialChain) -> Loads:
        """A load for each joint and each link from it on, with a unit weight at the link's end."""
        joints, ends = np.triu_indices(chain.joints)
        weights = np.zeros((len(joints), chain.joints))
        weights[np.arange(len(joints)), ends] = 1.0
        points = np.vstack([chain.points[1:], chain.tip])
        return Loads(chain, joints, weights, points, np.arange(chain.joints))

    @staticmethod
    def together(parts: Sequence[Loads]) -> Loads:
        """The loads of several sets on one chain, one after another."""
        from scipy.linalg import block_diag

        return Loads(
            parts[0].chain,
            np.concatenate([part.joints for part in parts]),
            block_diag(*(part.weights for part in parts)),
            np.vstack([part.points for part in parts]),
            np.concatenate([part.links for part in parts]),
        )

    def scaled(self, factor: float) -> Loads:
        """The loads of `factor` times the weights."""
        return replace(self, weights=factor * self.weights)

    def levers(self, q: Array) -> Array:
        """Loads by unit gravity along each axis of the root frame: (n, dof) -> (e, 3, n) [m].

        For a weight in kg and gravity in m/s2 a load is ``gravity . lever`` [N m, N of a slide].
        """
        motion = self.chain.state(q)
        return self._pull(motion, self._point_positions(motion), self.joints)

    def slopes(self, q: Array, gravity: Array) -> Array:
        """Derivatives (e, dof, n) of the loads under gravity (3,) by the joint values (n, dof)."""
        motion = self.chain.state(q)
        positions = self._point_positions(motion)
        across = cross(gravity[:, None], motion.axes)
        across *= self.chain.nominal_links.turning
        joints = np.arange(self.chain.joints)[:, None]
        # a joint before the load's turns the whole lever, one beyond it the points that follow
        first = np.minimum(self.joints, joints)
        last = np.maximum(self.joints, joints)
        moved = self._pull(motion, positions, last)
        by_joint = (across[first] * moved).sum(axis=2)
        slopes = np.einsum("ken,kd->edn", by_joint, self.chain.coupling)
        return np.asarray(slopes)

    def _point_positions(self, motion: ChainState) -> Array:
        """Positions (p, 3, n) [m] of the points."""
        arms = self.points - self.chain.points[self.links]
        frames = motion.frames[1:][self.links]
        return motion.places[self.links] + rotate(frames, arms[..., None])

    def _pull(
        self, motion: ChainState, positions: Array, joints: NDArray[np.intp]
    ) -> Array:
        """How joints (..., e) move the weighted sum of points beyond them, (..., e, 3, n)."""
        weights = self.weights * (self.links >= joints[..., None])
        total = weights.sum(axis=-1)[..., None, None]
        points, _, n = positions.shape
        moments = weights @ positions.reshape(points, 3 * n)
        moments = moments.reshape(*joints.shape, 3, n)
        moments -= total * motion.places[joints]
        axes = motion.axes[joints]
        turning = self.chain.nominal_links.turning[joints]
        return np.where(turning, cross(axes, moments), total * axes)
