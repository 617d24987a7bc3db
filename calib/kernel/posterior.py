"""The posterior of an arm of more than three joints, small enough to be asked one row at a time.

Kept are the covariance of the geometry, of each joint's curve by itself (one function of the
joint's value), and of what couples them the directions that move positions most.  Parameters are
told through what they move (`KernelArm.derivatives`), so that any body has the same form.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..body.belief import Body, Second
from ..body.covariance import radius_95, root_of
from ..body.curves import HARMONICS, waves_of
from ..body.settings import SHARED
from ..common.arrays import Array
from ..errors import OptionError
from .arm import KernelArm

# directions that are kept of what couples curves with each other and with the geometry: on a UR10
# the bound is within a thirtieth of that of the whole
_WAYS = 32
_ASKED = 400  # joint values by whose positions directions are compared
_TOLD = 1e-6  # of what a parameter moves: more that no part of the arm moves is a parameter of ours
_STILL = 1e-10  # of the largest motion: what moves less moves nothing
_CHUNK = 64  # rows at a time: a BLAS splits larger products over threads, which round otherwise


@dataclass(frozen=True, eq=False)
class CompactPosterior:
    """What the C source keeps of a body's beliefs, b of them."""

    arm: KernelArm
    root: Array  # (b, D, r), root of the geometry's covariance
    own: Array  # (b, dof, 193), variance of each curve as a trigonometric polynomial
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
        arm = KernelArm.of(body.structure, body.beta)
        q = np.random.default_rng(0).uniform(lower, upper, (_ASKED, structure.dof))
        curves = [
            np.asarray(structure.groups[f"curve.{k}"], int)
            for k in range(structure.dof)
        ]
        told = np.ones(structure.size, dtype=bool)  # of the geometry, not of a curve
        told[np.concatenate(curves)] = False
        seen = structure.blocks[0]
        beliefs: list[Any] = [body] if body.second is None else [body, body.second]
        active = beliefs[-1].active
        slope = structure.linearise(q, body.beta)[1][:, :seen]
        # what no belief is over moves nothing
        fixed = np.ones(structure.size, dtype=bool)
        for belief in beliefs:
            fixed[belief.active] = False
        slope[:, :, fixed] = 0.0
        basis = (
            np.moveaxis(arm.derivatives(q)[0], 2, 0)
            .swapaxes(1, 2)
            .reshape(_ASKED * seen, -1)
        )
        rows = slope[:, :, told].reshape(_ASKED * seen, -1)
        size = np.linalg.norm(basis, axis=0)
        still = (
            size < _STILL * size.max()
        )  # such as the load of a joint that stands upright
        basis[:, still], size[still] = 0.0, 1.0
        basis = basis / size
        through = np.linalg.lstsq(basis, rows, rcond=1e-12)[0]
        apart = np.linalg.norm(basis @ through - rows, axis=0)
        if (apart > _TOLD * np.linalg.norm(rows, axis=0).max()).any():
            raise OptionError(
                "the body has a parameter that the C source does not know"
            )
        through /= size[:, None]
        values, vectors = np.linalg.eigh(np.einsum("nma,nmb->ab", slope, slope))
        scales = vectors, np.sqrt(np.maximum(values, 1e-14 * values[-1]))
        ways = _WAYS if not told[active].all() else 0
        parts = []
        for belief in beliefs:
            # what it predicts apart from the first, its curves left out, in amounts of what moves
            other = np.where(told, belief.beta, body.beta)
            gap = structure.predict(q, other) - structure.predict(q, body.beta)
            off = np.linalg.lstsq(basis, gap[:, :seen].ravel(), rcond=1e-12)[0] / size
            parts.append(
                _compact(belief, body.beta, told, through, curves, ways, scales, off)
            )
        rank = max(part[0].shape[1] for part in parts)
        root = np.stack(
            [np.pad(p[0], ((0, 0), (0, rank - p[0].shape[1]))) for p in parts]
        )
        alone, coupled, waved, gains = (
            np.stack([part[k] for part in parts]) for k in range(1, 5)
        )
        # as in `Body.bound`: the first belief is inflated, the second not
        scale = np.array([(body.kappa, SHARED**2), (1.0, 1.0)][: len(parts)])
        # the C source has them in single precision, and both have to give the same answers
        root, alone, coupled, waved = (
            part.astype(np.float32).astype(float)
            for part in (root, alone, coupled, waved)
        )
        model = body.unexplained(noise=False)
        extra = model, body.unexplained(noise=True) - model
        return CompactPosterior(arm, root, alone, coupled, waved, gains, scale, *extra)

    def bound(self, q: Array, *, noise: bool) -> Array:
        """95 % bounds (n,) on positions at joint values (n, dof), as `Body.bound`."""
        parts = [
            self._bound(q[i : i + _CHUNK], noise) for i in range(0, len(q), _CHUNK)
        ]
        return np.concatenate(parts) if parts else np.zeros(0)

    def _bound(self, q: Array, noise: bool) -> Array:
        geometry, own = (
            part.transpose(2, 1, 0).copy() for part in self.arm.derivatives(q)
        )
        extra = np.diag(self.residual + (self.noise if noise else 0.0))
        turn = np.exp(1j * q.T[:, None] * np.arange(1, 2 * HARMONICS + 1)[:, None])
        waves = np.concatenate(
            [turn[:, :HARMONICS].real, turn[:, :HARMONICS].imag], axis=1
        )
        out = np.zeros(len(q))
        for b, (factor, share) in enumerate(self.scale):
            y = geometry @ self.root[b]
            z = geometry @ self.coupled[b]
            spread = y @ np.swapaxes(y, 1, 2)
            if self.waved.any():
                size = self.own[b, :, :1] + np.einsum(
                    "kh,khn->kn", self.own[b, :, 1::2], turn.real
                )
                size = size + np.einsum("kh,khn->kn", self.own[b, :, 2::2], turn.imag)
                spread += (own * size.T[:, None]) @ np.swapaxes(own, 1, 2)
                z += own @ np.swapaxes(np.swapaxes(waves, 1, 2) @ self.waved[b], 0, 1)
            kept = z[:, :, :-1]
            spread += (kept * self.gains[b]) @ np.swapaxes(kept, 1, 2)
            apart = np.linalg.norm(z[:, :, -1], axis=1)
            out = np.maximum(out, apart + factor * radius_95(share * spread + extra))
        return out


def _compact(
    belief: Body | Second,
    beta: Array,
    told: Array,
    through: Array,
    curves: list[Any],
    ways: int,
    scales: tuple[Array, Array],
    apart: Array,
) -> tuple[Array, Array, Array, Array, Array]:
    """Root of the geometry, the curves' own terms, coupled directions, their waves and signs."""
    # directions are chosen where positions move most: vectors (d, d) of parameters times (d,); what
    # a belief predicts `apart` from `beta` is the last of them, to first order
    size, dof, (vectors, weight) = len(beta), len(curves), scales
    bent = [k for k, curve in enumerate(curves) if len(curve)]
    covariance = np.zeros((size, size))
    covariance[np.ix_(belief.active, belief.active)] = belief.covariance
    geometry = np.ix_(told, told)
    # a sum of squares stays positive in single precision, which the covariance itself does not
    root = through @ root_of(covariance[geometry])
    strength, kept = np.linalg.eigh(root.T @ root)
    root = root @ kept[:, strength > 1e-20 * max(strength[-1], 1e-300)]
    remaining = covariance.copy()
    remaining[geometry] = 0.0
    own = np.zeros((dof, 4 * HARMONICS + 1))
    # of a curve by itself the variance is a trigonometric polynomial, sampled at enough places
    turn: Array = np.linspace(0.0, 2 * np.pi, 8 * HARMONICS, endpoint=False)
    waves = waves_of(turn).T
    for k in bent:
        block = np.ix_(curves[k], curves[k])
        terms = np.fft.rfft(((waves @ covariance[block]) * waves).sum(axis=1)) / len(
            waves
        )
        own[k, 0], remaining[block] = float(terms[0].real), 0.0
        own[k, 1::2] = 2 * terms[1 : 2 * HARMONICS + 1].real
        own[k, 2::2] = -2 * terms[1 : 2 * HARMONICS + 1].imag
    strength, kept = np.linalg.eigh(
        (vectors * weight).T @ remaining @ (vectors * weight)
    )
    most = np.argsort(-np.abs(strength))[:ways]
    directions = (vectors / weight) @ kept[:, most] * np.sqrt(np.abs(strength[most]))
    directions = np.column_stack([directions, belief.beta - beta])
    coupled = through @ directions[told]
    coupled[:, -1] = apart
    waved = np.zeros((dof, 2 * HARMONICS, ways + 1))
    for k in bent:
        waved[k] = directions[curves[k]]
    return root, own, coupled, waved, np.sign(strength[most])
