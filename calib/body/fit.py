"""One maximisation of a posterior by Gauss-Newton; noise and scales by evidence as it goes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from itertools import pairwise

import numpy as np

from ..common.arrays import Array
from .covariance import autocorrelation_time
from .normal import Factor, negative_log_likelihood, noise_of, student_weights, with_prior
from .parameters import Prior
from .structure import Structure

BLOCKS = 10
"""Contiguous blocks of rows whose information is kept apart."""

_AT_ONCE = 3000  # rows whose derivatives are held together


class Fit:
    """Some parameters of a structure fitted to n rows of m outputs: the search, and what it found.

    q : (n, dof), joint values [rad or m]
    z : (n, m), what the sensor saw
    beta : (d,), start
    prior : parameters with a zero sd stay at the prior's mean
    nu : degrees of freedom of the Student noise; infinite for Gaussian
    floor : (m,), least noise [unit]
    noise : (m,), noise to start from

    Attributes
    ----------
    beta, active : (d,) and (k,)
        All parameters, and the indices of those that are fitted.
    sd, known : (k,) and (k, k) or None
        Prior sds, with the scales that the evidence chose; or the prior's precision instead.
    noise : (m,)
        Noise sd of each output.
    residual, weight : (n, m)
        Residuals, and their weights under Student noise.
    edges : (b + 1,)
        Limits of contiguous blocks of rows.
    """

    weight: Array
    # of a search that has ended: what each block of rows adds to information and gradient
    grams: Array  # (b, k, k)
    moments: Array  # (b, k)
    precision: Array  # (k, k), weighted information and prior
    gradient: Array  # (k,), of the log posterior: not quite zero where the steps ended early
    autocorrelation: float  # integrated time of the residuals [rows]; 1 for Gaussian noise
    evidence: float  # Laplace approximation of the logarithm of the evidence

    def __init__(
        self,
        structure: Structure,
        q: Array,
        z: Array,
        beta: Array,
        prior: Prior,
        *,
        nu: float,
        floor: Array,
        noise: Array | None = None,
    ) -> None:
        self.structure, self.q, self.z = structure, q, z
        self.active, self.mean, self.known = prior.active, prior.mean, prior.known
        self.sd = prior.sd[self.active].copy()
        self.beta = np.where(prior.sd > 0, beta, prior.mean)
        place = np.full(len(prior.sd), -1)
        place[self.active] = np.arange(len(self.active))
        places = [(each, place[each.indices]) for each in prior.hypers]
        self.hypers = [(each, at) for each, at in places if (at >= 0).all()]
        self.scales = {each.name: float(each.scale) for each, _ in self.hypers}
        self.nu, self.floor, self.blocks = nu, floor, structure.blocks
        self.edges = np.linspace(0, len(z), min(BLOCKS, len(z)) + 1).round().astype(int)
        self.residual = self._residual(self.beta)
        self.noise = noise_of(self.residual, floor, nu, self.blocks) if noise is None else noise

    # The posterior.

    @property
    def told(self) -> float:
        """Share of the rows' information that is left.

        The Student noise loses some, and residuals that are correlated in the order of the log.
        """
        p = self.blocks[0]
        student = (self.nu + p) / (self.nu + p + 2) if np.isfinite(self.nu) else 1.0
        return student / self.autocorrelation

    @property
    def covariance(self) -> Array:
        """Posterior covariance (k, k)."""
        return self.softer(self.grams.sum(axis=0)).inverse()

    def softer(self, gram: Array) -> Factor:
        """Factor of the precision that is left of rows of information `gram` (k, k), and prior."""
        return Factor(with_prior(self.told * gram, self.sd, self.known))

    def derivative(self, rows: slice) -> Array:
        """Derivatives (n, m, k) of some rows' predictions by the fitted parameters."""
        q = self.q if rows == slice(None) else self.q[rows]
        return self.structure.linearise(q, self.beta, self.active)[1]

    def by_blocks(self, *, joined: bool = False) -> Iterator[tuple[slice, Array]]:
        """Each block's rows, and their derivatives (n, m, k); few rows may be `joined`."""
        few = len(self.z) <= _AT_ONCE
        whole = self.derivative(slice(None)) if few else None
        for first, last in pairwise((0, len(self.z)) if few and joined else self.edges):
            rows = slice(first, last)
            yield rows, self.derivative(rows) if whole is None else whole[rows]

    # The search.

    def maximise(self, *, learn: bool = True, steps: int = 10, tolerance: float = 1e-2) -> Fit:
        """Go to the maximum of the posterior, noise and scales by evidence; returns itself.

        learn : whether noise and scales are learned; otherwise they stay
        steps : most linearisations
        tolerance : a step below this share of the posterior sd ends the search
        """
        least = 0 if not learn else 3 if self.hypers else 1
        for it in range(steps):
            precision, gradient = self._equations()
            factor = Factor(precision)
            delta, variance = factor.solve(gradient), factor.variances()
            share = self.move(delta)
            if learn:
                self._learn(factor, variance)
            settled = (np.abs(delta) / np.sqrt(variance)).max(initial=0.0) <= tolerance
            if (it >= least and settled) or share == 0.0:
                break
        return self._end()

    def settle(self, steps: int) -> tuple[Array, float, float]:
        """Damped steps from anywhere, until one is short beside the parameters' own sds.

        Returns beta : (d,)
        Returns cost : negative log posterior with Student noise, of which the scale was fitted
        Returns noise : share of the extents that the residuals have
        """
        damping, floor = 1e-3, 1e-7 * self.structure.extents
        with np.errstate(all="ignore"):
            for _ in range(steps):
                self.noise = noise_of(self.residual, floor, self.nu, self.blocks)
                gain, moved, damping = self.descend(damping)
                if not gain or moved < 1e-3:
                    break
                damping = max(damping / 10, 1e-12)
            self.noise = noise_of(self.residual, floor, self.nu, self.blocks)
            cost = self._objective(self.beta, self.residual)
        return self.beta, cost, float((self.noise / self.structure.extents).max())

    def move(self, delta: Array) -> float:
        """Move along the step while the posterior grows; 1 for the whole step, 0 at its end.

        A step that fails is damped (Levenberg 1944, Marquardt 1963): a shorter one would hardly
        move what the rows determine, since directions that they leave open, such as the gauge of
        a chain without a drawing, are the long and curved part of it.
        """
        before = self._objective(self.beta, self.residual)
        for share in (1.0, 0.4):
            beta, r, value = self._after(share * delta)
            if value <= before + 1e-9 * abs(before):
                self.beta, self.residual = beta, r
                return share
        return 0.1 if self.descend(1e-4)[0] > 0.05 else 0.0

    def descend(self, damping: float) -> tuple[float, float, float]:
        """Move by the first of ever more damped steps that gains.

        Returns the gain [nats], 0 where none gains, the step as a share of the sds that the rows
        leave of each parameter alone, and its damping.
        """
        precision, gradient = self._equations()
        diagonal = np.diag(precision).copy()
        before = self._objective(self.beta, self.residual)
        for damped in damping * 8.0 ** np.arange(8):
            precision[np.diag_indices(len(gradient))] = (1 + damped) * diagonal
            with suppress(np.linalg.LinAlgError):
                delta = Factor(precision).solve(gradient)
                beta, r, value = self._after(delta)
                if value < before:
                    self.beta, self.residual = beta, r
                    return before - value, float((np.abs(delta) * np.sqrt(diagonal)).max()), damped
        return 0.0, 0.0, damping

    def _equations(self, *, kept: bool = False) -> tuple[Array, Array]:
        """Precision (k, k), and the log posterior's gradient (k,); blocks' parts may be kept."""
        self.weight = student_weights(self.residual, self.noise, self.nu, self.blocks)
        root, size = np.sqrt(self.weight) / self.noise, len(self.active)
        gram, moment, parts = np.zeros((size, size)), np.zeros(size), []
        for rows, x in self.by_blocks(joined=not kept):
            flat = (x * root[rows, :, None]).reshape(-1, size)
            parts.append((flat.T @ flat, flat.T @ (root * self.residual)[rows].ravel()))
            gram += parts[-1][0]
            moment += parts[-1][1]
        if kept:
            self.grams, self.moments = (np.array(part) for part in zip(*parts, strict=True))
        return with_prior(gram, self.sd, self.known), moment - self._pull(self.beta)

    def _learn(self, factor: Factor, variance: Array) -> None:
        """One step of EM: scales and noise; `variance` (k,) is that of the posterior."""
        away = (self.beta - self.mean)[self.active]
        held = variance / self.sd**2 if self.known is None else factor.inverse() * self.known
        used = len(away) - float(held.sum())  # numbers that the rows determine
        for h, at in self.hypers:
            # MacKay's (1992) fixed point: that of EM, in a third of the steps
            told = len(at) - float((variance[at] / self.sd[at] ** 2).sum())
            total = float((away[at] ** 2 / h.shape).sum())
            scale = np.sqrt((total + h.pseudo * h.scale**2) / (told + h.pseudo))
            least, most = h.within
            self.scales[h.name] = h.scale * min(max(float(scale) / h.scale, least), most)
            self.sd[at] = self.scales[h.name] * np.sqrt(h.shape)
        self.noise = noise_of(self.residual, self.floor, self.nu, self.blocks, used)

    def _end(self) -> Fit:
        """Settle the posterior at the parameters found."""
        self.precision, self.gradient = self._equations(kept=True)
        factor = Factor(self.precision)
        # rows that err together count once for the time that they do
        self.autocorrelation = 1.0
        if np.isfinite(self.nu):
            self.autocorrelation = autocorrelation_time(self.residual)
        wide = 2 * float(np.log(self.sd).sum())
        if self.known is not None:
            wide = -Factor(self.known).log_determinant()
        self.evidence = -self._objective(self.beta, self.residual)
        self.evidence -= 0.5 * (wide + factor.log_determinant())
        return self

    def _residual(self, beta: Array) -> Array:
        return self.structure.residual(self.z, self.structure.predict(self.q, beta))

    def _pull(self, beta: Array) -> Array:
        """Gradient (k,) of the prior's energy."""
        away = (beta - self.mean)[self.active]
        return np.asarray(away / self.sd**2 if self.known is None else self.known @ away)

    def _objective(self, beta: Array, r: Array) -> float:
        """Negative log posterior at `beta` and its residuals, up to a constant, or infinite."""
        with np.errstate(all="ignore"):
            value = negative_log_likelihood(r, self.noise, self.nu, self.blocks)
            value += 0.5 * float((beta - self.mean)[self.active] @ self._pull(beta))
        return value if np.isfinite(value) else np.inf

    def _after(self, delta: Array) -> tuple[Array, Array, float]:
        """Parameters (d,), residuals and objective after a step (k,) of the active ones."""
        full = np.zeros(len(self.beta))
        full[self.active] = delta
        beta = self.structure.retract(self.beta, full)
        with np.errstate(all="ignore"):
            r = self._residual(beta)
        return beta, r, self._objective(beta, r)
