"""The posterior of an arm of more than three joints, small enough to be asked one row at a time.

It holds the covariance of the geometry, of each joint's curve by itself (one function of the
joint's value), and of what couples them the directions that move positions most.  Parameters are
described by what they move (`KernelArm.derivatives`), so that any body has the same form.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..body.belief import Body, Second
from ..body.covariance import radius_95, root_of
from ..body.curves import HARMONICS, waves_of
from ..body.settings import SHARED
from ..common.arrays import Array, Index, Mask
from ..errors import OptionError
from .arm import KernelArm


@dataclass(frozen=True)
class CompactSettings:
    """How much of a posterior stays."""

    # directions of what couples curves with each other and with the geometry: on a UR10 the bound
    # is within a thirtieth of that of the whole
    ways: int = 32
    rows: int = 400  # joint values by whose positions directions are compared
    # of what parameters move: more is no part of an arm
    unexplained: float = 1e-6
    still: float = 1e-10  # of the largest motion: what moves less moves nothing
    # of the largest motion: how far beliefs are apart is not told by what is less, which would
    # be differences of large numbers
    apart: float = 1e-6
    # rows at a time: a BLAS splits larger products over threads
    chunk: int = 64


COMPACT = CompactSettings()


@dataclass(frozen=True, eq=False)
class Basis:
    """What every part of an arm that may be off moves, at some joint values."""

    columns: Array  # (rows, D), of length one
    size: Array  # (D,), by which they were divided

    @staticmethod
    def of(arm: KernelArm, q: Array, outputs: int) -> Basis:
        """The basis of an arm at joint values (n, dof)."""
        moves = np.moveaxis(arm.derivatives(q)[0], 2, 0)  # (n, D, m)
        columns = np.swapaxes(moves, 1, 2).reshape(len(q) * outputs, -1)
        size = np.linalg.norm(columns, axis=0)
        # such as the load of a joint that stands upright
        still = size < COMPACT.still * size.max()
        columns[:, still] = 0.0
        size[still] = 1.0
        return Basis(columns / size, size)

    def amounts(self, moves: Array, least: float = 1e-12) -> Array:
        """Amounts (D, k) of the basis that make moves (rows, k)."""
        amounts = np.linalg.lstsq(self.columns, moves, rcond=least)[0]
        return np.asarray(amounts / self.size[:, None])

    def explains(self, moves: Array, amounts: Array) -> bool:
        """Whether amounts (D, k) make moves (rows, k)."""
        rest = self.columns @ (amounts * self.size[:, None]) - moves
        largest = np.linalg.norm(moves, axis=0).max()
        return bool(
            (
                np.linalg.norm(rest, axis=0) <= COMPACT.unexplained * largest
            ).all()
        )


@dataclass(frozen=True, eq=False)
class CompactPosterior:
    """What the C source has of a body's beliefs, b of them."""

    arm: KernelArm
    root: Array  # (b, D, r), root of the geometry's covariance
    alone: Array  # (b, dof, 193), variance of each curve as a trigonometric polynomial
    # (b, D, w) and (b, dof, 96, w), coupled directions; the last is by how much beliefs are apart
    coupled: Array
    waved: Array
    gains: Array  # (b, w - 1), their signs
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
        uncertain = np.zeros(structure.size, dtype=bool)
        for belief in beliefs:
            uncertain[belief.active] = True
        slope = structure.linearise(q, body.beta)[1][:, :outputs]
        slope[:, :, ~uncertain] = 0.0
        curves = [
            np.asarray(structure.groups[f"curve.{k}"], int)
            for k in range(structure.dof)
        ]
        geometric = np.ones(structure.size, dtype=bool)
        geometric[np.concatenate(curves)] = False
        basis = Basis.of(arm, q, outputs)
        moves = slope.reshape(-1, structure.size)
        through = basis.amounts(moves[:, geometric])
        if not basis.explains(moves[:, geometric], through):
            raise OptionError(
                "the body has a parameter that the C source does not know"
            )
        strength, vectors = np.linalg.eigh(moves.T @ moves)
        weight = np.sqrt(np.maximum(strength, 1e-14 * strength[-1]))
        bent = not geometric[beliefs[-1].active].all()
        compactor = _Compactor(
            beta=body.beta,
            geometric=geometric,
            through=through,
            curves=curves,
            vectors=vectors,
            weight=weight,
            ways=COMPACT.ways if bent else 0,
        )
        parts = []
        for belief in beliefs:
            other = np.where(geometric, belief.beta, body.beta)
            gap = structure.predict(q, other) - structure.predict(q, body.beta)
            apart = basis.amounts(
                gap[:, :outputs].reshape(-1, 1), COMPACT.apart
            )
            parts.append(compactor.compact(belief, apart[:, 0]))
        rank = max(part.root.shape[1] for part in parts)
        roots = [
            np.pad(part.root, ((0, 0), (0, rank - part.root.shape[1])))
            for part in parts
        ]
        # as in `Body.bound`: the first belief is inflated, the second not
        scale = np.array([(body.kappa, SHARED**2), (1.0, 1.0)][: len(parts)])
        model = body.unexplained(noise=False)
        return CompactPosterior(
            arm,
            _single_precision(roots),
            _single_precision([part.alone for part in parts]),
            _single_precision([part.coupled for part in parts]),
            _single_precision([part.waved for part in parts]),
            np.stack([part.gains for part in parts]),
            scale,
            model,
            body.unexplained(noise=True) - model,
        )

    def bound(self, q: Array, *, noise: bool) -> Array:
        """95 % bounds (n,) on positions at joint values (n, dof), as `Body.bound`."""
        starts = range(0, len(q), COMPACT.chunk)
        parts = [
            self._bound(q[i : i + COMPACT.chunk], noise=noise) for i in starts
        ]
        return np.concatenate([np.zeros(0), *parts])

    def _bound(self, q: Array, *, noise: bool) -> Array:
        by_geometry, by_joints = self.arm.derivatives(q)
        geometry = by_geometry.transpose(2, 1, 0).copy()  # (n, m, D)
        joints = by_joints.transpose(2, 1, 0).copy()  # (n, m, dof)
        extra = np.diag(self.residual + (self.noise if noise else 0.0))
        orders = np.arange(1, 2 * HARMONICS + 1)[:, None]
        turn = np.exp(1j * q.T[:, None] * orders)  # (dof, 96, n)
        first = turn[:, :HARMONICS]
        waves = np.concatenate([first.real, first.imag], axis=1)
        bound = np.zeros(len(q))
        for b, (factor, share) in enumerate(self.scale):
            y = geometry @ self.root[b]
            z = geometry @ self.coupled[b]
            spread = y @ np.swapaxes(y, 1, 2)
            if self.waved.any():
                terms = self.alone[b]
                size = terms[:, :1] + np.einsum(
                    "kh,khn->kn", terms[:, 1::2], turn.real
                )
                size += np.einsum("kh,khn->kn", terms[:, 2::2], turn.imag)
                spread += (joints * size.T[:, None]) @ np.swapaxes(joints, 1, 2)
                along = np.swapaxes(waves, 1, 2) @ self.waved[b]  # (dof, n, w)
                z += joints @ np.swapaxes(along, 0, 1)
            coupled = z[:, :, :-1]
            spread += (coupled * self.gains[b]) @ np.swapaxes(coupled, 1, 2)
            apart = np.linalg.norm(z[:, :, -1], axis=1)
            radius = factor * radius_95(share * spread + extra)
            bound = np.maximum(bound, apart + radius)
        return bound


@dataclass(frozen=True, eq=False)
class _CompactBelief:
    """One belief's arrays, as of :class:`CompactPosterior`."""

    root: Array
    alone: Array
    coupled: Array
    waved: Array
    gains: Array


@dataclass(frozen=True, eq=False)
class _Compactor:
    """Makes beliefs about d parameters small."""

    beta: Array  # (d,), what positions are told by
    geometric: Mask  # (d,), parameters that are no curve's
    through: Array  # (D, g), amounts of what moves by each geometric parameter
    curves: list[Index]  # parameters of each joint's curve
    # (d, d) and (d,), directions of parameters and how much they move positions
    vectors: Array
    weight: Array
    ways: int  # directions that stay of what is coupled

    def compact(self, belief: Body | Second, apart: Array) -> _CompactBelief:
        """A belief; `apart` (D,) is what it predicts beside `beta`, its curves left out."""
        size = len(self.beta)
        covariance = np.zeros((size, size))
        covariance[np.ix_(belief.active, belief.active)] = belief.covariance
        geometry = np.ix_(self.geometric, self.geometric)
        # a sum of squares stays positive in single precision, which the covariance does not
        root = self.through @ root_of(covariance[geometry])
        strength, axes = np.linalg.eigh(root.T @ root)
        root = root @ axes[:, strength > 1e-20 * max(strength[-1], 1e-300)]
        covariance[geometry] = 0.0
        alone = self._curves_alone(covariance)
        moving = self.vectors * self.weight
        strength, axes = np.linalg.eigh(moving.T @ covariance @ moving)
        strongest = np.argsort(-np.abs(strength))[: self.ways]
        spread = np.sqrt(np.abs(strength[strongest]))
        directions = (self.vectors / self.weight) @ axes[:, strongest] * spread
        directions = np.column_stack([directions, belief.beta - self.beta])
        coupled = self.through @ directions[self.geometric]
        coupled[:, -1] = apart
        waved = np.zeros((len(self.curves), 2 * HARMONICS, self.ways + 1))
        for k, curve in enumerate(self.curves):
            if len(curve):
                waved[k] = directions[curve]
        return _CompactBelief(
            root, alone, coupled, waved, np.sign(strength[strongest])
        )

    def _curves_alone(self, covariance: Array) -> Array:
        """Variances (dof, 193) of curves by themselves, which leave the covariance, in place.

        They are trigonometric polynomials, sampled at enough places.
        """
        alone = np.zeros((len(self.curves), 4 * HARMONICS + 1))
        turn: Array = np.linspace(0.0, 2 * np.pi, 8 * HARMONICS, endpoint=False)
        waves = waves_of(turn).T
        for k, curve in enumerate(self.curves):
            if not len(curve):
                continue
            block = np.ix_(curve, curve)
            variance = ((waves @ covariance[block]) * waves).sum(axis=1)
            terms = np.fft.rfft(variance) / len(waves)
            alone[k, 0] = terms[0].real
            alone[k, 1::2] = 2 * terms[1 : 2 * HARMONICS + 1].real
            alone[k, 2::2] = -2 * terms[1 : 2 * HARMONICS + 1].imag
            covariance[block] = 0.0
        return alone


def _single_precision(parts: list[Array]) -> Array:
    """Tables as the C source has them: both have to give the same answers."""
    return np.stack(parts).astype(np.float32).astype(float)
