"""One maximisation of a posterior by Gauss-Newton; noise and scales by evidence as it goes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from ..common.arrays import Array
from .covariance import autocorrelation_time
from .normal import Factor, with_prior
from .parameters import Prior
from .rows import Part, Rows
from .structure import Structure

BLOCKS = 10
"""Contiguous blocks of rows whose information is kept apart."""


@dataclass(frozen=True, eq=False)
class Others:
    """What some of a fit's rows tell of its parameters."""

    gram: Array  # (k, k), their information
    gradient: Array  # (k,), with the prior's
    precision: Array  # (k, k), with the prior's

    @property
    def step(self) -> Array:
        """From the fit's parameters to those that these rows would have, (k,)."""
        return Factor(self.precision).solve(self.gradient)


class Fit:
    """Some parameters of a structure fitted to rows of one sensor or several.

    structure : of several sensors that which `rows.together` gives
    rows : what each sensor saw; what is said of a fit's residuals and noise is of the first
    beta : (d,), start
    prior : parameters with a zero sd stay at the prior's mean
    nu : degrees of freedom of the Student noise; infinite for Gaussian

    Attributes
    ----------
    beta, active : (d,) and (k,)
        All parameters, and the indices of those that are fitted.
    sd, known : (k,) and (k, k) or None
        Prior sds, with the scales that the evidence chose; or the prior's precision instead.
    parts : list of Part
        Residuals, weights and noise of each sensor.
    """

    # of a search that has ended: what each block of rows adds to information and gradient
    grams: Array  # (b, k, k)
    moments: Array  # (b, k)
    precision: Array  # (k, k), weighted information and prior
    gradient: Array  # (k,), of the log posterior: not quite zero where the steps ended early
    autocorrelation: float  # integrated time of the residuals [rows]; 1 for Gaussian noise
    evidence: float  # Laplace approximation of the logarithm of the evidence

    def __init__(
        self, structure: Structure, rows: Sequence[Rows], beta: Array, prior: Prior, *, nu: float
    ) -> None:
        self.structure, self.nu = structure, nu
        self.active, self.mean, self.known = prior.active, prior.mean, prior.known
        self.sd = prior.sd[self.active].copy()
        self.beta = np.where(prior.sd > 0, beta, prior.mean)
        place = np.full(len(prior.sd), -1)
        place[self.active] = np.arange(len(self.active))
        places = [(each, place[each.indices]) for each in prior.hypers]
        self.hypers = [(each, at) for each, at in places if (at >= 0).all()]
        self.scales = {each.name: float(each.scale) for each, _ in self.hypers}
        blocks = min(BLOCKS, len(rows[0]))
        self.parts = [Part(structure, each, self.beta, nu, blocks) for each in rows]

    @property
    def residual(self) -> Array:
        """Residuals (n, m)."""
        return self.parts[0].residual

    @property
    def weight(self) -> Array:
        """Weights (n, m) of the residuals under Student noise."""
        return self.parts[0].weight

    @property
    def noise(self) -> Array:
        """Noise sd (m,) of each output."""
        return self.parts[0].noise

    def beginning(self, rows: Sequence[Rows], prior: Prior) -> Fit:
        """A fit of rows of the same sensors under another prior, from what was found on."""
        pairs = zip(rows, self.parts, strict=True)
        rows = [replace(each, noise=part.noise) for each, part in pairs]
        return Fit(self.structure, rows, self.beta, prior, nu=self.nu)

    # The posterior.

    @property
    def told(self) -> float:
        """Share of the rows' information that is left.

        The Student noise loses some, and residuals that are correlated in the order of the log.
        """
        p = self.structure.blocks[0]
        student = (self.nu + p) / (self.nu + p + 2) if np.isfinite(self.nu) else 1.0
        return student / self.autocorrelation

    @property
    def covariance(self) -> Array:
        """Posterior covariance (k, k)."""
        return self.softer(self.grams.sum(axis=0)).inverse()

    def softer(self, gram: Array) -> Factor:
        """Factor of the precision that is left of rows of information `gram` (k, k), and prior."""
        return Factor(with_prior(self.told * gram, self.sd, self.known))

    def without(self, blocks: slice) -> Others:
        """The information of all rows but those of some blocks."""
        others = np.ones(len(self.grams), dtype=bool)
        others[blocks] = False
        # summed, not subtracted: a parameter that these blocks alone tell, such as where a socket
        # is, has a prior that is lost in the rounding of a difference
        gram = self.grams[others].sum(axis=0)
        gradient = self.moments[others].sum(axis=0) - self._pull(self.beta)
        return Others(gram, gradient, with_prior(gram.copy(), self.sd, self.known))

    # The search.

    def maximise(self, *, learn: bool = True, steps: int = 10, tolerance: float = 1e-2) -> Fit:
        """Go to the maximum of the posterior, noise and scales by evidence; returns itself.

        learn : whether noise and scales are learned; otherwise they stay
        steps : most linearisations
        tolerance : a step below this share of the posterior sd ends the search
        """
        least = 0 if not learn else 3 if self.hypers else 1
        for it in range(steps):
            self._linearise()
            factor = Factor(self.precision)
            variance = factor.variances()
            # A step that fails is damped: a shorter one would hardly move what the rows determine,
            # since directions that they leave open, such as the gauge of a chain without a
            # drawing, are the long and curved part of it.
            gain, delta, damping = self.descend((0.0, *1e-4 * 8.0 ** np.arange(8)))
            if learn:
                self._learn(factor, variance)
            settled = (np.abs(delta) / np.sqrt(variance)).max(initial=0.0) <= tolerance
            if (it >= least and settled) or (damping > 0 and gain <= 0.05):
                break
        self._linearise(kept=True)
        # rows that err together count once for the time that they do
        times = [autocorrelation_time(part.residual) for part in self.parts]
        self.autocorrelation = max(times) if np.isfinite(self.nu) else 1.0
        wide = 2 * float(np.log(self.sd).sum())
        if self.known is not None:
            wide = -Factor(self.known).log_determinant()
        energy = self._energy(self.beta, [part.residual for part in self.parts])
        self.evidence = -energy - 0.5 * (wide + Factor(self.precision).log_determinant())
        return self

    def settle(self, steps: int) -> tuple[Array, float, float]:
        """Damped steps from anywhere, until one is short beside the parameters' own sds.

        Returns beta : (d,)
        Returns cost : negative log posterior with Student noise, of which the scale was fitted
        Returns noise : share of the extents that the residuals have
        """
        damping = 1e-3
        for _ in range(steps):
            for part in self.parts:
                part.learn_noise()
            self._linearise()
            gain, delta, damping = self.descend(damping * 8.0 ** np.arange(8))
            if gain <= 0 or (np.abs(delta) * np.sqrt(np.diag(self.precision))).max() < 1e-3:
                break
            damping = max(damping / 10, 1e-12)
        for part in self.parts:
            part.learn_noise()
        cost = self._energy(self.beta, [part.residual for part in self.parts])
        return self.beta, cost, float((self.noise / self.structure.extents).max())

    def descend(self, dampings: Iterable[float]) -> tuple[float, Array, float]:
        """Move by the first of ever more damped steps that gains (Levenberg 1944, Marquardt 1963).

        Returns the gain [nats], 0 where none gains, the step (k,) and its damping.
        """
        before = self._energy(self.beta, [part.residual for part in self.parts])
        damped, delta, damping = self.precision.copy(), np.zeros(len(self.active)), np.inf
        for damping in dampings:
            np.fill_diagonal(damped, (1 + damping) * np.diag(self.precision))
            with suppress(np.linalg.LinAlgError):
                delta = Factor(damped).solve(self.gradient)
                full = np.zeros(len(self.beta))
                full[self.active] = delta
                with np.errstate(all="ignore"):
                    beta = self.structure.retract(self.beta, full)
                residuals = [part.residual_at(beta) for part in self.parts]
                gain = before - self._energy(beta, residuals)
                if gain > 0 or (damping == 0 and gain >= -1e-9 * abs(before)):
                    self.beta = beta
                    for part, residual in zip(self.parts, residuals, strict=True):
                        part.residual = residual
                    return gain, delta, damping
        return 0.0, delta, damping

    def _linearise(self, *, kept: bool = False) -> None:
        """Set the precision and the gradient; what each block of rows adds may be kept."""
        size, blocks = len(self.active), len(self.parts[0].edges) - 1 if kept else 1
        self.grams, self.moments = np.zeros((blocks, size, size)), np.zeros((blocks, size))
        for part in self.parts:
            root = part.weigh()
            for k, (rows, x) in enumerate(part.by_blocks(self.beta, self.active)):
                flat = (x * root[rows, :, None]).reshape(-1, size)
                self.grams[k % blocks] += flat.T @ flat
                self.moments[k % blocks] += flat.T @ (root[rows] * part.residual[rows]).ravel()
        self.precision = with_prior(self.grams.sum(axis=0), self.sd, self.known)
        self.gradient = self.moments.sum(axis=0) - self._pull(self.beta)

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
        share = used / sum(part.z.size for part in self.parts)
        for part in self.parts:
            part.learn_noise(share)

    def _pull(self, beta: Array) -> Array:
        """Gradient (k,) of the prior's energy."""
        away = (beta - self.mean)[self.active]
        return np.asarray(away / self.sd**2 if self.known is None else self.known @ away)

    def _energy(self, beta: Array, residuals: list[Array]) -> float:
        """Negative log posterior of parameters and residuals, up to a constant, or infinite."""
        with np.errstate(all="ignore"):
            pairs = zip(self.parts, residuals, strict=True)
            value = sum(part.energy(residual) for part, residual in pairs)
            value += 0.5 * float((beta - self.mean)[self.active] @ self._pull(beta))
        return value if np.isfinite(value) else np.inf
