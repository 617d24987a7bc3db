"""The posterior of an arm of more than three joints, small enough to evaluate one row at a time.

It holds the directions in which parameters move positions most, and what they leave over of the
variance of each joint's curve, a function of its value.  Parameters are described by what they
move (`KernelArm.derivatives`), so that any body has the same form.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..body.belief import Body, GuardFit
from ..body.covariance import radius_95
from ..body.curves import HARMONICS, waves_of
from ..body.settings import SHARED
from ..body.structure import Structure
from ..common.arrays import Array
from ..common.scale import TURN
from ..errors import OptionError
from .arm import KernelArm


@dataclass(frozen=True)
class CompactSettings:
    """How much of a posterior stays."""

    # directions of one belief, and of each of two.  Of a UR10's logs of 30 to 2,000 rows, with a
    # drawing and without one, the bound at held-out rows is .89 to 1.37 times the whole's (96 % of
    # the rows), with 15 of them .92 to 1.38.  A belief without a second knows all of the geometry
    # about as well: of a simulated UR5 11 directions give .42 to .86 of the bound, 31 all of it.
    # With the gap between beliefs they fill whole vectors of eight
    ways: tuple[int, int] = (31, 11)
    rows: int = 400  # joint values by whose positions directions are compared
    # of what parameters move: more is no part of an arm
    unexplained: float = 1e-6
    # of the largest motion: what moves less is lost in differences of large numbers
    least: float = 1e-12
    apart: float = 1e-6  # of the largest motion, of how far beliefs are apart
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
        q = np.random.default_rng(0).uniform(lower, upper, shape)
        parts, _ = arm.derivatives(q)
        moves = np.concatenate(list(parts.values()))
        basis = moves.transpose(2, 1, 0).reshape(-1, len(moves))
        beliefs: list[Body | GuardFit] = [body]
        factors = [(body.kappa, SHARED**2)]
        if body.second is not None:
            beliefs.append(body.second)
            # see `Body.bound`: the first belief is inflated, the second not
            factors.append((1.0, 1.0))
        ways = COMPACT.ways[len(beliefs) - 1]
        compact = [
            compact_belief(body, belief, q, basis, ways) for belief in beliefs
        ]
        geometry = np.stack([belief.geometry for belief in compact], axis=1)
        edges = np.cumsum([len(part) for part in parts.values()])[:-1]
        of_parts = np.split(geometry, edges)
        residual = body.remaining_variance(noise=False)
        return CompactPosterior(
            arm=arm,
            geometry=dict(zip(parts, of_parts, strict=True)),
            curves=np.stack([belief.curves for belief in compact], axis=2),
            alone=np.array([belief.alone for belief in compact]),
            scale=np.array(factors),
            residual=residual,
            noise=body.remaining_variance(noise=True) - residual,
        )

    def bound(self, q: Array, *, noise: bool) -> Array:
        """95 % bounds (n,) on positions at joint values (n, dof), see `Body.bound`."""
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
        turns = q.T / TURN
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
        along = np.einsum("knh,khbw->bnkw", waves, self.curves, optimize=True)
        size = self._alone_at(q)
        joints = by_joints.transpose(2, 1, 0)  # (n, m, dof)
        # (b, n, m, w), how each direction moves positions
        along_geometry = np.tensordot(by_geometry, geometry, (0, 0))
        moves = along_geometry.transpose(2, 1, 0, 3) + joints @ along
        ways = moves[..., :-1]
        spread = ways @ np.swapaxes(ways, 2, 3)
        # (b, n, m, dof), what each curve moves by itself
        size_of_row = size.transpose(0, 2, 1)
        curves = joints * size_of_row[:, :, None]
        spread += curves @ np.swapaxes(joints, 1, 2)
        gaps = moves[..., -1]
        apart = np.linalg.norm(gaps, axis=2).T
        return spread, apart


@dataclass(frozen=True, eq=False)
class CompactBelief:
    """A belief in w directions, of which the last is by how much its mean is off the first's."""

    geometry: Array  # (D, w) of an arm's parts
    curves: Array  # (dof, 96, w)
    # (dof, knots), variance of each curve by itself, all over a turn
    alone: Array


def compact_belief(
    body: Body, belief: Body | GuardFit, q: Array, basis: Array, ways: int
) -> CompactBelief:
    """A belief of a body in the w directions that move positions at joints (n, dof) most.

    basis : (n m, D), how positions move with an arm's parts at the body's parameters
    Raises OptionError if a parameter moves positions as no part of an arm does.
    """
    structure = body.structure
    groups = [
        np.asarray(structure.groups[f"curve.{k}"], int)
        for k in range(structure.dof)
    ]
    curved = np.concatenate(groups)
    shared, of_curves = _split(belief.full_root, curved)
    moves = _moves(structure, belief, q)
    directions = _principal_root(shared, moves)[:, :ways]
    moves[:, curved] = 0.0
    moved = moves @ directions
    amounts = _amounts(basis, moved, COMPACT.least)
    rest = np.linalg.norm(basis @ amounts - moved)
    most = COMPACT.unexplained * np.linalg.norm(moved)
    if belief is body and rest > most:  # the basis is at its parameters
        raise OptionError(
            "the body has a parameter that the C source does not know"
        )
    count = amounts.shape[1]
    geometry = np.zeros((len(amounts), ways + 1))
    geometry[:, :count] = amounts
    curves = np.zeros((structure.dof, 2 * HARMONICS, ways + 1))
    apart = belief.beta - body.beta
    for k, group in enumerate(groups):
        if len(group):
            curves[k, :, :count] = directions[group]
            curves[k, :, -1] = apart[group]
    apart[curved] = 0.0
    ahead = structure.predict(q, body.beta + apart)
    gaps = (ahead - structure.predict(q, body.beta))[:, structure.position]
    column = gaps.reshape(-1, 1)
    geometry[:, -1:] = _amounts(basis, column, COMPACT.apart)
    return CompactBelief(geometry, curves, _curves_alone(of_curves, groups))


def _moves(structure: Structure, belief: Body | GuardFit, q: Array) -> Array:
    """How positions at joints (n, dof) move with a body's parameters, (n m, d).

    At the belief's parameters: one that moves nothing there is hardly known for that reason, and
    moves positions at the parameters of another belief.
    """
    _, slope = structure.linearise(q, belief.beta, belief.active)
    outputs = structure.output_sizes[0]
    numbers = len(q) * outputs
    of_positions = slope[:, :outputs]
    moves = np.zeros((numbers, structure.size))
    moves[:, belief.active] = of_positions.reshape(numbers, -1)
    return moves


def _amounts(basis: Array, moves: Array, least: float) -> Array:
    """Amounts (D, k) of parts, which move positions by a basis (rows, D), for moves (rows, k)."""
    size = np.linalg.norm(basis, axis=0)
    # such as the load of an upright joint
    still = size < 1e-10 * size.max()
    size = np.where(still, 1.0, size)
    scaled = basis / size
    scaled[:, still] = 0.0
    amounts = np.linalg.lstsq(scaled, moves, rcond=least)[0]
    return amounts / size[:, None]


def _split(root: Array, curved: NDArray[np.intp]) -> tuple[Array, Array]:
    """Two roots of a covariance, which add up: of the geometry, and of curves where it is known.

    What rows show of a curve and the geometry together, such as its mean and its joint's offset,
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
    angles: Array = np.linspace(0.0, TURN, COMPACT.knots, endpoint=False)
    waves = waves_of(angles).T
    for k, group in enumerate(groups):
        if len(group):
            moved = waves @ root[group]
            alone[k] = (moved**2).sum(axis=1)
    return alone
