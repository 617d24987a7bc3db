"""One maximisation of a posterior: its parameters, noise and prior scales, and the steps."""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from ..common.arrays import Array
from ..common.rows import thinned
from .normal import (
    Factor,
    Sums,
    first_noise,
    linear_evidence,
    negative_log_likelihood,
    slices,
    student_weights,
    sums_of,
    with_prior,
)
from .parameters import Hyper, Prior
from .structure import Structure

BLOCKS = 10
"""Contiguous blocks of rows whose information is kept apart."""

_INNER = 2
"""Steps of EM for each linearisation; with 8 the same scales were found, in more time."""

_PROBES, _ALIKE = 30, 1.1
"""Rows whose predicted variances are compared, and by how much they may differ."""

_SETTLED = 3e-3
"""A change of the noise and of every scale by less than this share ends them earlier."""

_DAMPING = 1e-4
"""First damping of a step that fails, as a share of the diagonal of the information."""

_GAINED = 0.05
"""Nats that a damped step gains at least, or the search is at its end."""


class Search:
    """The state of one maximisation: parameters, noise, prior scales."""

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
        self.scales = {h.name: h.scale for h in self.hypers}
        self.nu, self.floor = nu, floor
        self.blocks = structure.blocks
        self.edges = np.linspace(0, len(z), min(BLOCKS, len(z)) + 1).round().astype(int)
        self.sums: list[Sums] = []
        self.r = self.residual(self.beta)
        self.noise = first_noise(self.r, floor, self.blocks) if noise is None else noise

    def pull(self, away: Array) -> Array:
        """Gradient (k,) of the prior's energy, `away` (k,) from its mean."""
        return np.asarray(away / self.sd**2 if self.known is None else self.known @ away)

    def distance(self, beta: Array) -> Array:
        """Active parameters (k,) beyond the prior mean."""
        return np.asarray((beta - self.mean)[self.active])

    def residual(self, beta: Array) -> Array:
        """Residuals (n, m) at `beta`."""
        return self.structure.residual(self.z, self.structure.predict(self.q, beta))

    def linearise(self, fresh: bool) -> None:
        """Weighted sums at the present parameters.

        Derivatives and information are those of an earlier step unless `fresh`; the residuals are
        not, so that the steps end at the same maximum.
        """
        if fresh:
            self.x = self.structure.derivative(self.q, self.beta, self.active)[1]
            self.sums = []
        self.w = student_weights(self.r, self.noise, self.nu, self.blocks)
        self.sums = sums_of(self.x, self.r, self.w, self.blocks, self.edges, self.sums)

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
            for x in (now, self.x.rows(rows))
        ]
        new, old = (spread.sum(axis=1) for spread in spreads)
        return bool((new > _ALIKE * old).any())

    def data(self) -> tuple[Array, Array]:
        """Information (k, k) and moment (k,) of the rows at the present noise."""
        return self.summed("gram"), self.summed("moment")

    def summed(self, name: str) -> Array:
        """One of the rows' `Sums` at the present noise, over the blocks of outputs."""
        parts = zip(self.sums, slices(self.blocks), strict=True)
        return np.asarray(sum(getattr(s, name) / self.noise[p.start] ** 2 for s, p in parts))

    def step(self, learn: bool) -> tuple[Array, Array]:
        """Gauss-Newton step (k,) and posterior variances (k,); EM of noise and scales."""
        start = self.distance(self.beta)
        for _ in range(_INNER):
            gram, moment = self.data()
            factor = Factor(with_prior(gram, self.sd, self.known))
            delta = factor.solve(moment - self.pull(start))
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
            before = self._levels()
            self._learn(start + delta, delta, variance, used)
            if np.abs(self._levels() - before).max() < _SETTLED:
                break
        return delta, variance

    def _levels(self) -> Array:
        """Logarithms of the noise and of the scales that EM moves."""
        moving = [self.scales[h.name] for h in self.hypers if not h.choices]
        return np.asarray(np.log(np.concatenate([self.noise, moving])))

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

    def _rescale(self, h: Hyper, scale: float) -> None:
        self.scales[h.name] = scale
        self.sd[self.place[h.indices]] = scale * np.sqrt(h.shape)

    def choose(self) -> None:
        """Compare the choices of each scale by evidence, one after another."""
        varied = [h for h in self.hypers if h.choices]
        if not varied:
            return
        gram, moment = self.data()
        pull = moment - self.distance(self.beta) / self.sd**2
        own = np.unique(np.concatenate([self.place[h.indices] for h in varied]))
        rest = np.setdiff1d(np.arange(len(self.sd)), own)
        inner, start = gram[np.ix_(own, own)], self.distance(self.beta)[own]
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

    def objective(self, beta: Array, r: Array) -> float:
        """Negative log posterior at `beta` and its residuals, up to a constant, or infinite."""
        with np.errstate(all="ignore"):
            value = negative_log_likelihood(r, self.noise, self.nu, self.blocks)
            away = self.distance(beta)
            value += 0.5 * float(away @ self.pull(away))
        return value if np.isfinite(value) else np.inf

    def move(self, delta: Array) -> float:
        """Move along the step while the posterior grows; 1 for the whole step, 0 at its end.

        A step that fails is damped (Levenberg 1944, Marquardt 1963): a shorter one would hardly
        move what the rows determine, since directions that they leave open, such as the gauge of
        a chain without a drawing, are the long and curved part of it.  Exact rows have no such
        directions, and there damping ended before rounding did.
        """
        before = self.objective(self.beta, self.r)
        least = before + 1e-9 * abs(before)
        gaussian = not np.isfinite(self.nu)
        for share in 0.4 ** np.arange(10.0 if gaussian else 2.0):
            beta, r, value = self.after(share * delta)
            if value <= least:
                self.beta, self.r = beta, r
                return float(share)
        if gaussian:
            return 0.0
        gain, _, _ = self.descend(_DAMPING)
        return 0.1 if gain > _GAINED else 0.0

    def descend(self, damping: float) -> tuple[float, float, float]:
        """Move by the first of ever more damped steps that gains.

        Returns the gain [nats], 0 where none gains, the step as a share of the sds that the rows
        leave of each parameter alone, and its damping.
        """
        gram, moment = self.data()
        precision = with_prior(gram, self.sd, self.known)
        diagonal, pull = np.diag(precision).copy(), moment - self.pull(self.distance(self.beta))
        before = self.objective(self.beta, self.r)
        for damped in damping * 8.0 ** np.arange(8):
            precision[np.diag_indices(len(pull))] = (1 + damped) * diagonal
            with suppress(np.linalg.LinAlgError):
                delta = Factor(precision).solve(pull)
                beta, r, value = self.after(delta)
                if value < before:
                    self.beta, self.r = beta, r
                    return before - value, float((np.abs(delta) * np.sqrt(diagonal)).max()), damped
        return 0.0, 0.0, damping

    def after(self, delta: Array) -> tuple[Array, Array, float]:
        """Parameters (d,), residuals and objective after a step (k,) of the active ones."""
        full = np.zeros(len(self.beta))
        full[self.active] = delta
        beta = self.structure.retract(self.beta, full)
        with np.errstate(all="ignore"):
            r = self.residual(beta)
        return beta, r, self.objective(beta, r)
