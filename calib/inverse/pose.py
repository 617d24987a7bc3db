"""Poses: every branch in which an arm reaches a position and an orientation.

A general six-joint arm has up to 16; damped Newton steps find them from many starts, and each
suggests where others may be: a joint half a turn on, or bent the other way.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arm.rotations import logarithm
from ..common.arrays import Array
from ..common.scale import TURN, Scale
from .newton import Newton

_ROUND, _QUIET = 96, 2  # random starts of a round; rounds in a row that must find nothing new
_ROUNDS = 12  # at most
_MOST = 64  # branches; more are those of a redundant arm
_STEPS = 25  # most of a start: those that lead anywhere take fewer
_SLACK = 1e-9  # [rad or m] by which a joint may be rounded beyond its range
_TOGETHER = 50  # poses that are searched side by side: one row costs as much as a hundred
#: A pose is reached within this share of the arm's length, and solutions this far apart [rad or m]
#: are different branches.
TOLERANCE, APART = 1e-9, 1e-3


#: Position (n, 3) [m], orientation (n, 3, 3) and geometric Jacobian (n, 6, dof) at joints (n, dof).
Evaluate = Callable[[Array], tuple[Array, Array, Array]]


@dataclass(frozen=True)
class Poses:
    """Positions and orientations of a chain in its base frame, as rows of 3 and 9 numbers."""

    evaluate: Evaluate
    scale: Scale
    lever: float  # [m], what a radian of turn counts as

    @staticmethod
    def target(position: Array, rotation: Array) -> Array:
        """Targets (n, 12) of positions (n, 3) [m] and orientations (n, 3, 3)."""
        return np.concatenate([position, rotation.reshape(-1, 9)], axis=1)

    def value_and_slope(self, u: Array) -> tuple[Array, Array]:
        """Poses (n, 12), and how residuals shrink with the unit coordinates (n, 6, dof)."""
        place, turn, slope = self.evaluate(self.scale.from_unit(u))
        slope = slope * self.scale.span
        slope[:, 3:] *= self.lever
        return self.target(place, turn), slope

    def gap(self, target: Array, value: Array) -> Array:
        """Residuals (n, 6): of the position, and the lever times the turn that is left."""
        wanted, reached = (part[:, 3:].reshape(-1, 3, 3) for part in (target, value))
        turn = logarithm(wanted @ np.swapaxes(reached, 1, 2))
        return np.concatenate([target[:, :3] - value[:, :3], self.lever * turn], axis=1)


@dataclass(frozen=True)
class Joints:
    """Ranges of joints: `lower`, `upper` (dof,) [rad or m] and which of them turn (dof,)."""

    lower: Array
    upper: Array
    revolute: tuple[bool, ...]

    @property
    def middle(self) -> Array:
        """Middle (dof,) of the ranges."""
        return 0.5 * (self.lower + self.upper)

    def within(self, q: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Joint values (n, dof) by whole turns into the ranges, and whether all are inside (n,)."""
        out = q - self._turns(q - self.middle)
        near = (out >= self.lower - _SLACK) & (out <= self.upper + _SLACK)
        return np.clip(out, self.lower, self.upper), np.asarray(near.all(axis=1))

    @property
    def turning(self) -> Scale:
        """The unit box of joints that turn without limits: a branch beyond leads to others."""
        turns, span = np.asarray(self.revolute), self.upper - self.lower
        lower = np.where(turns, self.middle - np.pi, self.lower - span)
        return Scale(lower, np.where(turns, TURN, 3 * span), turns)

    def apart(self, a: Array, b: Array) -> Array:
        """Largest distance (n,) of any joint between rows (n, dof) and b (dof,); turns wrap."""
        return np.asarray(np.abs(a - b - self._turns(a - b)).max(axis=1))

    def _turns(self, away: Array) -> Array:
        return np.where(self.revolute, TURN * np.round(away / TURN), 0.0)


def pose_branches(
    evaluate: Evaluate,
    position: Array,
    rotation: Array,
    joints: Joints,
    length: float,
    *,
    starts: Array | None = None,
    seed: int = 0,
) -> list[Array]:
    """Every way (b, dof) in which an arm reaches each of some poses (n, 3), (n, 3, 3) [m].

    Joints are within their ranges; sorted; none where nothing reaches it. Of a redundant arm they
    are some of infinitely many. `starts` (n, dof) are tried first, then starts that are drawn by
    `seed`; the search ends when two rounds in a row find nothing new.
    """
    newton = Newton(Poses(evaluate, joints.turning, length), joints.turning, length)
    target, n, dof = Poses.target(position, rotation), len(position), len(joints.lower)
    rng, quiet = np.random.default_rng(seed), np.zeros(n, dtype=int)
    known = [np.empty((0, dof))] * n
    tried = list(known) if starts is None else list(starts[:, None])
    for _ in range(_ROUNDS):
        more = [i for i, own in enumerate(known) if quiet[i] < _QUIET and len(own) <= _MOST]
        drawn = rng.uniform(joints.lower, joints.upper, (_ROUND, dof))
        for some in (more[i : i + _TOGETHER] for i in range(0, len(more), _TOGETHER)):
            rows = [np.vstack([tried[i], drawn]) for i in some]
            owner = np.repeat(some, [len(own) for own in rows])
            u = newton.scale.to_unit(np.concatenate(rows))
            u, left = newton.refine(u, target[owner], 1e-3 * TOLERANCE, _STEPS)
            q, met = newton.scale.from_unit(u), left < TOLERANCE * length
            for i in some:
                before = len(known[i])
                for row in q[met & (owner == i)]:
                    if not len(known[i]) or joints.apart(known[i], row).min() > APART:
                        known[i] = np.vstack([known[i], row])
                quiet[i] = 0 if len(known[i]) > before else quiet[i] + 1
                tried[i] = _flipped(known[i][before:], joints)
    inside = [rows[ok] for rows, ok in map(joints.within, known)]
    return [rows[np.lexsort(rows.T[::-1])] for rows in inside]


def _flipped(q: Array, joints: Joints) -> Array:
    """Starts that branches (k, dof) suggest: turns half round, or bent the other way, and both."""
    turns, eye = np.flatnonzero(joints.revolute), np.eye(q.shape[1])
    bent = [q - 2.0 * q * eye[k] for k in turns]
    rows = bent + [q + np.pi * eye[k] for k in turns]
    rows += [b + np.pi * eye[k] for j, b in zip(turns, bent, strict=True) for k in turns if k != j]
    return np.concatenate([q[:0], *rows])
