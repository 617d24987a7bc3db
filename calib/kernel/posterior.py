"""The posterior of an arm of more than three joints, small enough to be asked one row at a time.

It holds the covariance of each joint's curve by itself (one function of the joint's value), and of
all else the directions that move positions most.  Parameters are described by what they move
(`KernelArm.derivatives`), so that any body has the same form.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..body.belief import Body, Second
from ..body.covariance import radius_95
from ..body.curves import HARMONICS, waves_of
from ..body.settings import SHARED
from ..common.arrays import Array
from ..errors import OptionError
from .arm import KernelArm


@dataclass(frozen=True)
class CompactSettings:
    """How much of a posterior stays."""

    # directions in which parameters vary together, one for each that an arm in space can show
    ways: int = 31
    # of their variance that may be left out: the bound of a log is within 7 % of the whole's, with
    # all of them within 6 %
    rest: float = 1e-2
    rows: int = 400  # joint values by whose positions directions are compared
    # of what parameters move: more is no part of an arm
    unexplained: float = 1e-6
    # of the largest motion: what moves less is not told apart, by differences of large numbers
    least: float = 1e-12
    apart: float = 1e-6  # the same, of how far beliefs are apart
    # rows at a time: a BLAS splits larger products over threads
    chunk: int = 64


COMPACT = CompactSettings()


@dataclass(frozen=True, eq=False)
class CompactPosterior:
    """What the C source has of a body's beliefs, b of them, in w directions each."""

    arm: KernelArm
    # (D, b, w) and (dof, 96, b, w); the last direction is by how much the beliefs are apart
    geometry: Array
    curves: Array
    gains: Array  # (b, w), sign of each direction's variance, 0 of the last
    alone: Array  # (b, dof, 193), variance of each curve by itself
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
        outputs = structure.blocks[0]
        beliefs: list[Body | Second] = [body]
        if body.second is not None:
            beliefs.append(body.second)
        moves = np.zeros((len(q) * outputs, structure.size))
        active = [belief.active for belief in beliefs]
        uncertain = np.unique(np.concatenate(active))
        slope = structure.linearise(q, body.beta, uncertain)[1][:, :outputs]
        moves[:, uncertain] = slope.reshape(len(moves), -1)
        groups = [
            np.asarray(structure.groups[f"curve.{k}"], int)
            for k in range(structure.dof)
        ]
        every = np.arange(structure.size)
        geometric = np.delete(every, np.concatenate(groups))
        basis = arm.derivatives(q)[0].transpose(2, 1, 0).reshape(len(moves), -1)
        through = _amounts(basis, moves[:, geometric], COMPACT.least)
        rest = basis @ through - moves[:, geometric]
        rest = np.linalg.norm(rest, axis=0)
        largest = np.linalg.norm(moves, axis=0).max()
        if (rest > COMPACT.unexplained * largest).any():
            raise OptionError(
                "the body has a parameter that the C source does not know"
            )
        here = structure.predict(q, body.beta)
        geometry = []
        curves = []
        alone = []
        gains = []
        for belief in beliefs:
            covariance = np.zeros((structure.size, structure.size))
            some = np.ix_(belief.active, belief.active)
            covariance[some] = belief.covariance
            alone.append(_curves_alone(covariance, groups))
            directions, signs = _strongest(covariance, moves)
            apart = belief.beta - body.beta
            directions = np.column_stack([directions, apart])
            gains.append(np.append(signs, 0.0))
            amounts = through @ directions[geometric]
            apart[np.concatenate(groups)] = 0.0
            there = structure.predict(q, body.beta + apart)
            gap = (there - here)[:, :outputs].reshape(-1, 1)
            amounts[:, -1:] = _amounts(basis, gap, COMPACT.apart)
            geometry.append(amounts)
            waves = np.zeros((structure.dof, 2 * HARMONICS, len(signs) + 1))
            for k, group in enumerate(groups):
                if len(group):
                    waves[k] = directions[group]
            curves.append(waves)
        signs = np.array(gains)
        used = np.append(signs[:, :-1].any(axis=0), True)
        # as in `Body.bound`: the first belief is inflated, the second not
        scale = np.array([(body.kappa, SHARED**2), (1.0, 1.0)][: len(beliefs)])
        model = body.unexplained(noise=False)
        return CompactPosterior(
            arm,
            _single_precision(geometry, axis=1)[:, :, used],
            _single_precision(curves, axis=2)[:, :, :, used],
            signs[:, used],
            _single_precision(alone, axis=0),
            scale,
            model,
            body.unexplained(noise=True) - model,
        )

    def bound(self, q: Array, *, noise: bool) -> Array:
        """95 % bounds (n,) on positions at joint values (n, dof), as `Body.bound`."""
        extra = np.diag(self.residual + (self.noise if noise else 0.0))
        bounds = [np.zeros(0)]
        for start in range(0, len(q), COMPACT.chunk):
            rows = q[start : start + COMPACT.chunk]
            spread, apart = self._spread(rows)
            bound = np.zeros(len(rows))
            for b, (factor, share) in enumerate(self.scale):
                radius = factor * radius_95(share * spread[b] + extra)
                bound = np.maximum(bound, apart[:, b] + radius)
            bounds.append(bound)
        return np.concatenate(bounds)

    def _spread(self, q: Array) -> tuple[Array, Array]:
        """Covariances (b, n, m, m) of beliefs, and how far they are apart (n, b)."""
        by_geometry, by_joints = self.arm.derivatives(q)
        # squares of the curves' waves have twice their orders
        angles = q.T[:, :, None] * np.arange(2 * HARMONICS + 1)
        cosines = np.cos(angles)
        sines = np.sin(angles[:, :, 1:])
        terms = np.concatenate([cosines, sines], axis=2)
        size = terms @ np.moveaxis(self.alone, 0, 2)  # (dof, n, b)
        low_cosines = cosines[:, :, 1 : HARMONICS + 1]
        low_sines = sines[:, :, :HARMONICS]
        waves = np.concatenate([low_cosines, low_sines], axis=2)
        dof, n, _ = waves.shape
        curves = self.curves.reshape(dof, 2 * HARMONICS, -1)
        along = waves @ curves
        along = along.reshape(dof, n, *self.gains.shape)
        joints = by_joints.transpose(2, 1, 0)  # (n, m, dof)
        # (b, n, m, w), how each direction moves positions
        z = np.tensordot(by_geometry, self.geometry, (0, 0))
        z = z.transpose(2, 1, 0, 3)
        z = z + joints @ along.transpose(2, 1, 0, 3)
        signed = z * self.gains[:, None, None]
        spread = signed @ np.swapaxes(z, 2, 3)
        # (b, n, m, dof), what each curve moves by itself
        variance = size.transpose(2, 1, 0)
        alone = joints * variance[:, :, None]
        spread += alone @ np.swapaxes(joints, 1, 2)
        apart = np.linalg.norm(z[..., -1], axis=2).T
        return spread, apart


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


def _strongest(covariance: Array, moves: Array) -> tuple[Array, Array]:
    """Directions (d, w) whose squares make up most of what a covariance moves, and signs (w,)."""
    strength, vectors = np.linalg.eigh(moves.T @ moves)
    moved = strength > 1e-14 * strength[-1]
    vectors = vectors[:, moved]
    weight = np.sqrt(strength[moved])
    moving = vectors * weight
    strength, axes = np.linalg.eigh(moving.T @ covariance @ moving)
    strongest = np.argsort(-np.abs(strength))[: COMPACT.ways]
    size = np.abs(strength[strongest])
    enough = np.cumsum(size) - size < (1.0 - COMPACT.rest) * size.sum()
    size = np.where(enough, size, 0.0)
    spread = np.sqrt(size)
    directions = (vectors / weight) @ axes[:, strongest] * spread
    return directions, np.sign(strength[strongest]) * enough


def _curves_alone(covariance: Array, groups: list[NDArray[np.intp]]) -> Array:
    """Variances (dof, 193) of curves by themselves, which leave the covariance, in place.

    They are trigonometric polynomials: the mean, cosines and sines.
    """
    alone = np.zeros((len(groups), 4 * HARMONICS + 1))
    turn: Array = np.linspace(0.0, 2 * np.pi, 8 * HARMONICS, endpoint=False)
    waves = waves_of(turn).T
    for k, group in enumerate(groups):
        if not len(group):
            continue
        block = np.ix_(group, group)
        spread = waves @ covariance[block]
        variance = (spread * waves).sum(axis=1)
        terms = np.fft.rfft(variance) / len(turn)
        terms = terms[: 2 * HARMONICS + 1]
        terms[1:] *= 2
        alone[k] = np.concatenate([terms.real, -terms[1:].imag])
        covariance[block] = 0.0
    return alone


def _single_precision(parts: list[Array], axis: int) -> Array:
    """Tables as the C source has them: both have to give the same answers."""
    return np.stack(parts, axis=axis).astype(np.float32).astype(float)
