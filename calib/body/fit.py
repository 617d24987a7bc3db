"""One maximisation of a posterior by Gauss-Newton; noise and scales by evidence as it goes."""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from ..common.arrays import Array
from ..common.rows import thinned
from .covariance import autocorrelation_time
from .derivative import Derivative
from .normal import (
    Factor,
    Sums,
    first_noise,
    linear_evidence,
    negative_log_likelihood,
    slices,
    student_scale,
    student_weights,
    sums_of,
    with_prior,
)
from .parameters import Hyper, Prior
from .structure import Structure

BLOCKS = 10
"""Contiguous blocks of rows whose information is kept apart."""

MANY = 60
"""Parameters beyond which the information of an earlier step serves where the steps are small."""

_PROBES, _ALIKE = 30, 1.1
"""Rows whose predicted variances are compared, and by how much they may differ."""

_GAINED = 0.05
"""Nats that a damped step gains at least, or the search is at its end."""


class Fit:
    """Some parameters of a structure fitted to n rows of m outputs: the search, and what it found.

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

    derivative: Derivative  # (n, m, k)
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
        nu: float,
        floor: Array,
        noise: Array | None = None,
    ) -> None:
        self.structure, self.q, self.z = structure, q, z
        self.active = prior.active
        self.place = np.full(len(prior.sd), -1)
        self.place[self.active] = np.arange(len(self.active))
        self.beta = np.where(prior.sd > 0, beta, prior.mean)
        self.mean, self.sd = prior.mean, prior.sd[self.active].copy()
        self.known = prior.known
        self.hypers = [h for h in prior.hypers if (self.place[h.indices] >= 0).all()]
        self.scales = {h.name: float(h.scale) for h in self.hypers}
        self.nu, self.floor, self.blocks = nu, floor, structure.blocks
        self.edges = np.linspace(0, len(z), min(BLOCKS, len(z)) + 1).round().astype(int)
        self.sums: list[Sums] = []
        self.residual = self._residual(self.beta)
        self.noise = first_noise(self.residual, floor, self.blocks) if noise is None else noise

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

    def end(self, fresh: bool) -> Fit:
        """Settle the posterior at the parameters found; `fresh` as in `linearise`."""
        self.linearise(fresh)
        self.grams, self.moments = self._summed("grams"), self._summed("moments")
        self.precision = with_prior(self.grams.sum(axis=0), self.sd, self.known)
        factor = Factor(self.precision)
        if not fresh and self.stale(factor):
            return self.end(True)
        away = self._away(self.beta)
        self.gradient = self.moments.sum(axis=0) - self._pull(away)
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

    # The search.

    def linearise(self, fresh: bool) -> None:
        """Weighted sums at the present parameters.

        Derivatives and information are those of an earlier step unless `fresh`; the residuals are
        not, so that the steps end at the same maximum.
        """
        if fresh:
            self.derivative = self.structure.derivative(self.q, self.beta, self.active)[1]
            self.sums = []
        self.weight = student_weights(self.residual, self.noise, self.nu, self.blocks)
        self.sums = sums_of(
            self.derivative, self.residual, self.weight, self.blocks, self.edges, self.sums
        )

    def stale(self, factor: Factor) -> bool:
        """Whether predictions spread further by present derivatives than by those at hand.

        Along what the rows leave open, such as the gauge of a chain without a drawing, a belief
        reaches far, and only derivatives of its own place say that nothing moves there: with those
        of an earlier step such a bound was a thousand times too wide.
        """
        rows = thinned(len(self.q), _PROBES)
        now = self.structure.derivative(self.q[rows], self.beta, self.active)[1]
        spreads = [
            (factor.whiten(x.dense().reshape(-1, x.size).T) ** 2).sum(axis=0).reshape(len(rows), -1)
            for x in (now, self.derivative.rows(rows))
        ]
        new, old = (spread.sum(axis=1) for spread in spreads)
        return bool((new > _ALIKE * old).any())

    def data(self) -> tuple[Array, Array]:
        """Information (k, k) and moment (k,) of the rows at the present noise."""
        return self._summed("gram"), self._summed("moment")

    def step(self, learn: bool) -> tuple[Array, Array]:
        """Gauss-Newton step (k,) and posterior variances (k,); EM of noise and scales."""
        start = self._away(self.beta)
        for _ in range(2):  # of EM: with 8 the same scales were found, in more time
            gram, moment = self.data()
            factor = Factor(with_prior(gram, self.sd, self.known))
            delta = factor.solve(moment - self._pull(start))
            variance = factor.variances()
            if not learn:
                break
            # Numbers that the rows determine: tr(inverse gram), and inverse (gram + prior) = 1.
            used = [len(variance) - float((variance / self.sd**2).sum())]
            if len(self.sums) > 1 or self.known is not None:
                inverse, scales = factor.inverse(), self.noise[np.cumsum(self.blocks) - 1] ** -2.0
                used = [
                    v * float((inverse * s.gram).sum())
                    for s, v in zip(self.sums, scales, strict=True)
                ]
            self._learn(start + delta, delta, variance, used)
        return delta, variance

    def _learn(self, value: Array, delta: Array, variance: Array, used: list[float]) -> None:
        """One step of EM: the scales of the hypers without choices, and the noise.

        `used` are the numbers that each block of outputs determines.
        """
        for h in self.hypers:
            if h.choices:
                continue
            ix = self.place[h.indices]
            # MacKay's (1992) fixed point: that of EM, in a third of the steps.
            told = len(ix) - float((variance[ix] / self.sd[ix] ** 2).sum())
            total = float((value[ix] ** 2 / h.shape).sum())
            scale = np.sqrt((total + h.pseudo * h.scale**2) / (told + h.pseudo))
            self._rescale(h, max(float(scale), 1e-10 * h.scale))
        noise = self.noise.copy()
        for s, part, told in zip(self.sums, slices(self.blocks), used, strict=True):
            square = s.square - 2 * float(delta @ s.moment) + float(delta @ s.gram @ delta)
            free = max(s.count - told, s.count / 4 + 1)
            noise[part] = np.sqrt(max(square, 0.0) / free)
        self.noise = np.maximum(noise, self.floor)

    def choose(self) -> None:
        """Compare the choices of each scale by evidence, one after another."""
        varied = [h for h in self.hypers if h.choices]
        if not varied:
            return
        gram, moment = self.data()
        pull = moment - self._away(self.beta) / self.sd**2
        own = np.unique(np.concatenate([self.place[h.indices] for h in varied]))
        rest = np.setdiff1d(np.arange(len(self.sd)), own)
        inner, start = gram[np.ix_(own, own)], self._away(self.beta)[own]
        lead = moment[own]
        if len(rest):  # what is not varied is marginalised once
            outer = gram[np.ix_(rest, rest)]
            back = Factor(with_prior(outer, self.sd[rest], None)).solve(gram[np.ix_(rest, own)])
            inner = inner - gram[np.ix_(own, rest)] @ back
            lead = lead - pull[rest] @ back
        for h in varied:
            best, chosen = -np.inf, h.scale
            for factor in h.choices:
                self._rescale(h, h.scale * factor)
                value = linear_evidence(inner, lead, start, self.sd[own])
                if value > best + 1.0:  # a nat: one that is as good is not worth a wider prior
                    best, chosen = value, h.scale * factor
            self._rescale(h, chosen)

    def move(self, delta: Array) -> float:
        """Move along the step while the posterior grows; 1 for the whole step, 0 at its end.

        A step that fails is damped (Levenberg 1944, Marquardt 1963): a shorter one would hardly
        move what the rows determine, since directions that they leave open, such as the gauge of
        a chain without a drawing, are the long and curved part of it.  Exact rows have no such
        directions, and there damping ended before rounding did.
        """
        before = self._objective(self.beta, self.residual)
        least = before + 1e-9 * abs(before)
        gaussian = not np.isfinite(self.nu)
        for share in 0.4 ** np.arange(10.0 if gaussian else 2.0):
            beta, r, value = self._after(share * delta)
            if value <= least:
                self.beta, self.residual = beta, r
                return float(share)
        return 0.1 if not gaussian and self.descend(1e-4)[0] > _GAINED else 0.0

    def descend(self, damping: float) -> tuple[float, float, float]:
        """Move by the first of ever more damped steps that gains.

        Returns the gain [nats], 0 where none gains, the step as a share of the sds that the rows
        leave of each parameter alone, and its damping.
        """
        gram, moment = self.data()
        precision = with_prior(gram, self.sd, self.known)
        diagonal, pull = np.diag(precision).copy(), moment - self._pull(self._away(self.beta))
        before = self._objective(self.beta, self.residual)
        for damped in damping * 8.0 ** np.arange(8):
            precision[np.diag_indices(len(pull))] = (1 + damped) * diagonal
            with suppress(np.linalg.LinAlgError):
                delta = Factor(precision).solve(pull)
                beta, r, value = self._after(delta)
                if value < before:
                    self.beta, self.residual = beta, r
                    return before - value, float((np.abs(delta) * np.sqrt(diagonal)).max()), damped
        return 0.0, 0.0, damping

    def settle(self, steps: int) -> tuple[Array, float, float]:
        """Damped steps from anywhere, until one is short beside the parameters' own sds.

        Returns beta : (d,)
        Returns cost : negative log posterior with Student noise, of which the scale was fitted
        Returns noise : share of the extents that the residuals have
        """
        self.edges = np.array([0, len(self.z)])  # nothing is held out
        damping, extents = 1e-3, self.structure.extents
        with np.errstate(all="ignore"):
            for _ in range(steps):
                self.noise = student_scale(self.residual, extents, self.blocks, self.nu)
                self.linearise(fresh=True)
                gain, moved, damping = self.descend(damping)
                if not gain or moved < 1e-3:
                    break
                damping = max(damping / 10, 1e-12)
            self.noise = student_scale(self.residual, extents, self.blocks, self.nu)
            cost = self._objective(self.beta, self.residual)
        return self.beta, cost, float((self.noise / extents).max())

    def _residual(self, beta: Array) -> Array:
        return self.structure.residual(self.z, self.structure.predict(self.q, beta))

    def _away(self, beta: Array) -> Array:
        """Active parameters (k,) beyond the prior mean."""
        return np.asarray((beta - self.mean)[self.active])

    def _pull(self, away: Array) -> Array:
        """Gradient (k,) of the prior's energy, `away` (k,) from its mean."""
        return np.asarray(away / self.sd**2 if self.known is None else self.known @ away)

    def _summed(self, name: str) -> Array:
        """One of the rows' `Sums` at the present noise, over the blocks of outputs."""
        parts = zip(self.sums, slices(self.blocks), strict=True)
        return np.asarray(sum(getattr(s, name) / self.noise[p.start] ** 2 for s, p in parts))

    def _rescale(self, h: Hyper, scale: float) -> None:
        self.scales[h.name] = float(scale)
        self.sd[self.place[h.indices]] = scale * np.sqrt(h.shape)

    def _objective(self, beta: Array, r: Array) -> float:
        """Negative log posterior at `beta` and its residuals, up to a constant, or infinite."""
        with np.errstate(all="ignore"):
            value = negative_log_likelihood(r, self.noise, self.nu, self.blocks)
            away = self._away(beta)
            value += 0.5 * float(away @ self._pull(away))
        return value if np.isfinite(value) else np.inf

    def _after(self, delta: Array) -> tuple[Array, Array, float]:
        """Parameters (d,), residuals and objective after a step (k,) of the active ones."""
        full = np.zeros(len(self.beta))
        full[self.active] = delta
        beta = self.structure.retract(self.beta, full)
        with np.errstate(all="ignore"):
            r = self._residual(beta)
        return beta, r, self._objective(beta, r)


def maximise(
    structure: Structure,
    q: Array,
    z: Array,
    beta: Array,
    prior: Prior,
    *,
    nu: float,
    floor: Array,
    noise: Array | None = None,
    learn: bool = True,
    steps: int = 10,
    tolerance: float = 1e-2,
    begun: Fit | None = None,
) -> Fit:
    """Fit parameters at the maximum of the posterior, noise and scales by evidence.

    q : (n, dof), joint values [rad or m]
    z : (n, m), what the sensor saw
    beta : (d,), start
    prior : parameters with a zero sd stay at the prior's mean
    nu : degrees of freedom of the Student noise; infinite for Gaussian
    floor : (m,), least noise [unit]
    noise : (m,), noise to start from
    learn : whether noise and scales are learned; otherwise they stay
    steps : most linearisations
    tolerance : a step below this share of the posterior sd ends the search
    begun : a fit of the same rows at `beta`, of which derivatives are taken over
    """
    fit = Fit(structure, q, z, beta, prior, nu, floor, noise)
    keeps = len(fit.active) > MANY and np.isfinite(nu)
    fresh = begun is None or not np.array_equal(begun.active, fit.active)
    if begun is not None and not fresh:
        fit.derivative, fit.sums = begun.derivative, begun.sums
    # noise and scales follow the steps, and choices of scales are compared three times
    least = 0 if not learn else 3 if any(h.choices for h in fit.hypers) else 1
    for it in range(steps):
        fit.linearise(fresh)
        if learn and 1 <= it <= 3:
            fit.choose()
        delta, variance = fit.step(learn)
        share = fit.move(delta)
        if learn and share < 0.9:  # the linearised residual is no guide to the noise
            now = first_noise(fit.residual, floor, structure.blocks)
            fit.noise = np.maximum(fit.noise, now / 1.2)
        moved = np.abs(delta) / np.sqrt(variance)
        fresh = not keeps or bool(moved.max() > 5.0)
        if share < 0.9:  # old weights led too far: new ones of the same derivatives
            fit.sums = []
        if (it >= least and moved.max() <= tolerance) or share == 0.0:
            break
    return fit.end(fresh)
