"""The posterior of an arm of more than three joints, small enough to be asked one row at a time.

It holds the directions in which parameters move positions most, and what they leave over of the
variance of each joint's curve, a function of its value.  Parameters are described by what they
move (`KernelArm.derivatives`), so that any body has the same form.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..body.belief import Body, Second
from ..body.covariance import radius_95
from ..body.curves import HARMONICS, waves_of
from ..body.settings import SHARED
from ..body.structure import Structure
from ..common.arrays import Array
from ..errors import OptionError
from .arm import KernelArm


@dataclass(frozen=True)
class CompactSettings:
    """How much of a posterior stays."""

    # directions of a belief.  Of a UR10's logs of 30 to 2,000 rows, with a drawing and without one,
    # the bound at held-out rows is .89 to 1.37 times the whole's (96 % of the rows), with 15 of
    # them .92 to 1.38; two beliefs of 11 fill three vectors of eight
    ways: int = 11
    rows: int = 400  # joint values by whose positions directions are compared
    # of what parameters move: more is no part of an arm
    unexplained: float = 1e-6
    # of the largest motion: what moves less is not told apart, by differences of large numbers
    least: float = 1e-12
    apart: float = 1e-6  # the same, of how far beliefs are apart
    # rows at a time: a BLAS splits larger products over threads
    chunk: int = 64
    # of a turn, between which the variance of a curve is linear
    knots: int = 256


COMPACT = CompactSettings()


@dataclass(frozen=True, eq=False)
class CompactPosterior:
    """A body's b beliefs as the C source has them, in w directions each.

    The last direction is by how much the beliefs are apart.
    """

    arm: KernelArm
    geometry: Mapping[str, Array]  # (D, b, w) of each part of the arm
    curves: Array  # (dof, 96, b, w)
    alone: Array  # (b, dof, knots), variance of each curve by itself, all over a turn
    scale: Array  # (b, 2), factors on the bound and on the covariance
    residual: Array  # (m,), variance of what the bound adds
    noise: Array  # (m,), variance of a reading

    @staticmethod
    def of(body: Body, lower: Array, upper: Array) -> CompactPosterior:
        """The posterior of a body within ranges (dof,) of its joints.

        Raises OptionError if a parameter moves positions as no part of an arm does.
        """
        structure = body.structure
        arm = KernelArm.of(structure, body.beta)
        shape = COMPACT.rows, structure.dof
        rng = np.random.default_rng(0)
        q = rng.uniform(lower, upper, shape)
        outputs = structure.blocks[0]
        beliefs: list[Body | Second] = [body]
        if body.second is not None:
            beliefs.append(body.second)
        groups = [
            np.asarray(structure.groups[f"curve.{k}"], int)
            for k in range(structure.dof)
        ]
        curved = np.concatenate(groups)
        parts, _ = arm.derivatives(q)
        stacked = np.concatenate(list(parts.values()))
        by_row = stacked.transpose(2, 1, 0)
        basis = by_row.reshape(len(q) * outputs, -1)
        here = structure.predict(q, body.beta)
        size = len(beliefs), COMPACT.ways + 1
        curves = np.zeros((structure.dof, 2 * HARMONICS, *size))
        geometry = np.zeros((basis.shape[1], *size))
        alone = []
        for b, belief in enumerate(beliefs):
            moves = _moves(structure, belief, q)
            directions, of_curves = _split(belief.full_root, curved)
            alone.append(_curves_alone(of_curves, groups))
            directions = _principal_root(directions, moves)[:, : COMPACT.ways]
            ways = directions.shape[1]
            apart = belief.beta - body.beta
            for k, group in enumerate(groups):
                if len(group):
                    curves[k, :, b, :ways] = directions[group]
                    curves[k, :, b, -1] = apart[group]
            moves[:, curved] = 0.0
            moved = moves @ directions
            amounts = _amounts(basis, moved, COMPACT.least)
            left_over = basis @ amounts - moved
            rest = np.linalg.norm(left_over)
            most = COMPACT.unexplained * np.linalg.norm(moved)
            if belief is body and rest > most:  # the basis is at its parameters
                raise OptionError(
                    "the body has a parameter that the C source does not know"
                )
            geometry[:, b, :ways] = amounts
            apart[curved] = 0.0
            there = structure.predict(q, body.beta + apart)
            gaps = (there - here)[:, :outputs]
            column = gaps.reshape(-1, 1)
            geometry[:, b, -1:] = _amounts(basis, column, COMPACT.apart)
        sizes = [len(part) for part in parts.values()]
        edges = np.cumsum(sizes)[:-1]
        of_parts = np.split(geometry, edges)
        # as in `Body.bound`: the first belief is inflated, the second not
        factors = [(body.kappa, SHARED**2), (1.0, 1.0)]
        scale = np.array(factors[: len(beliefs)])
        model = body.remaining_variance(noise=False)
        return CompactPosterior(
            arm,
            dict(zip(parts, of_parts, strict=True)),
            curves,
            np.array(alone),
            scale,
            model,
            body.remaining_variance(noise=True) - model,
        )

    def bound(self, q: Array, *, noise: bool) -> Array:
        """95 % bounds (n,) on positions at joint values (n, dof), as `Body.bound`."""
        variance = self.residual + self.noise if noise else self.residual
        extra = np.diag(variance)
        bounds = [np.zeros(0)]
        for start in range(0, len(q), COMPACT.chunk):
            rows = q[start : start + COMPACT.chunk]
            spread, apart = self._spread(rows)
            bound = np.zeros(len(rows))
            for b, (factor, share) in enumerate(self.scale):
                covariance = share * spread[b] + extra
                radius = factor * radius_95(covariance)
                bound = np.maximum(bound, apart[:, b] + radius)
            bounds.append(bound)
        return np.concatenate(bounds)

    def _alone_at(self, q: Array) -> Array:
        """Variances (b, dof, n) of curves by themselves at joint values (n, dof)."""
        turns = q.T / (2 * np.pi)
        place = np.mod(turns, 1.0) * COMPACT.knots
        knots = np.arange(COMPACT.knots)
        size = np.zeros((len(self.alone), *place.shape))
        for b, variances in enumerate(self.alone):
            for k, variance in enumerate(variances):
                size[b, k] = np.interp(
                    place[k], knots, variance, period=COMPACT.knots
                )
        return size

    def _spread(self, q: Array) -> tuple[Array, Array]:
        """Covariances (b, n, m, m) of beliefs, and how far they are apart (n, b)."""
        parts, by_joints = self.arm.derivatives(q)
        by_geometry = np.concatenate(list(parts.values()))
        geometry = np.concatenate(list(self.geometry.values()))
        harmonics = np.arange(1, HARMONICS + 1)
        angles = q.T[:, :, None] * harmonics
        cosines = np.cos(angles)
        sines = np.sin(angles)
        waves = np.concatenate([cosines, sines], axis=2)
        along = np.einsum(
            "knh,khbw->bnkw",
            waves,
            self.curves,
            optimize=True,
        )
        size = self._alone_at(q)
        joints = by_joints.transpose(2, 1, 0)  # (n, m, dof)
        # (b, n, m, w), how each direction moves positions
        along_geometry = np.tensordot(by_geometry, geometry, (0, 0))
        moves = (
            along_geometry.transpose(
                2,
                1,
                0,
                3,
            )
            + joints @ along
        )
        ways = moves[..., :-1]
        spread = ways @ np.swapaxes(ways, 2, 3)
        # (b, n, m, dof), what each curve moves by itself
        size_of_row = size.transpose(0, 2, 1)
        curves = joints * size_of_row[:, :, None]
        spread += curves @ np.swapaxes(joints, 1, 2)
        gaps = moves[..., -1]
        apart = np.linalg.norm(gaps, axis=2).T
        return spread, apart


def _moves(structure: Structure, belief: Body | Second, q: Array) -> Array:
    """How positions at joints (n, dof) move with a body's parameters, (n m, d).

    Where the belief is: what moves nothing there, by which it is hardly known, moves positions at
    the parameters of another.
    """
    _, slope = structure.linearise(q, belief.beta, belief.active)
    outputs = structure.blocks[0]
    numbers = len(q) * outputs
    of_positions = slope[:, :outputs]
    moves = np.zeros((numbers, structure.size))
    moves[:, belief.active] = of_positions.reshape(numbers, -1)
    return moves


def _amounts(basis: Array, moves: Array, least: float) -> Array:
    """Amounts (D, k) of what an arm's parts move (rows, D) that make moves (rows, k)."""
    size = np.linalg.norm(basis, axis=0)
    # such as the load of a joint that stands upright
    still = size < 1e-10 * size.max()
    size = np.where(still, 1.0, size)
    scaled = basis / size
    scaled[:, still] = 0.0
    amounts = np.linalg.lstsq(scaled, moves, rcond=least)[0]
    return np.asarray(amounts / size[:, None])


def _split(root: Array, curved: NDArray[np.intp]) -> tuple[Array, Array]:
    """Two roots of a covariance, which add up: of the geometry, and of curves where it is known.

    What rows tell together of a curve and of the geometry, such as its mean and its joint's offset,
    is in the first one alone.
    """
    geometric = np.delete(np.arange(len(root)), curved)
    geometric = geometric[root[geometric].any(axis=1)]
    turn, _ = np.linalg.qr(root[geometric].T, mode="complete")
    turned = root @ turn
    count = len(geometric)
    return turned[:, :count], turned[:, count:]


def _principal_root(root: Array, moves: Array) -> Array:
    """The root (d, k) of a covariance whose first columns move positions most."""
    moved = moves @ root
    _, axes = np.linalg.eigh(moved.T @ moved)
    return np.asarray(root @ axes[:, ::-1])


def _curves_alone(root: Array, groups: list[NDArray[np.intp]]) -> Array:
    """Variances (dof, knots) of curves by themselves, from a root (d, k) of their covariance."""
    alone = np.zeros((len(groups), COMPACT.knots))
    whole_turn = 2 * np.pi
    turn: Array = np.linspace(
        0.0,
        whole_turn,
        COMPACT.knots,
        endpoint=False,
    )
    waves = waves_of(turn).T
    for k, group in enumerate(groups):
        if len(group):
            moved = waves @ root[group]
            alone[k] = (moved**2).sum(axis=1)
    return alone
