"""Maximum of the posterior by Gauss-Newton; noise and prior scales by evidence as it goes."""

from __future__ import annotations

import numpy as np

from .bound import autocorrelation_time
from .fitted import Fit, by_block
from .normal import (
    Factor,
    Sums,
    first_noise,
    information_factor,
    linear_evidence,
    negative_log_likelihood,
    slices,
    student_weights,
    sums_of,
)
from .structure import Array, Hyper, Prior, Structure

INNER = 8
"""Steps of EM for each linearisation."""

SETTLED = 3e-3
"""A change of the noise and of every scale by less than this share ends them earlier."""

MANY = 60
"""Parameters beyond which the information of an earlier step serves where the steps are small."""


class _Search:
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
        noise: Array | None,
        weight: Array | None,
    ) -> None:
        self.structure, self.q, self.z = structure, q, z
        self.active = prior.active
        self.place = np.full(len(prior.sd), -1)
        self.place[self.active] = np.arange(len(self.active))
        self.beta = np.where(prior.sd > 0, beta, prior.mean)
        self.mean, self.sd = prior.mean, prior.sd[self.active].copy()
        self.hypers = [h for h in prior.hypers if (self.place[h.indices] >= 0).all()]
        self.scales = {h.name: h.scale for h in self.hypers}
        self.nu, self.floor = nu, floor
        self.fixed = weight
        self.blocks = structure.blocks
        self.sums: list[Sums] = []
        if noise is None:
            r = structure.residual(z, structure.predict(q, self.beta))
            noise = first_noise(r, floor, self.blocks)
        self.noise = noise

    def distance(self, beta: Array) -> Array:
        """Active parameters (k,) beyond the prior mean."""
        return np.asarray((beta - self.mean)[self.active])

    def see(self, fresh: bool) -> None:
        """Residuals and weights at the present parameters; derivatives too if `fresh`."""
        if fresh:
            predicted, self.x = self.structure.linearise(self.q, self.beta, self.active)
        else:
            predicted = self.structure.predict(self.q, self.beta)
        self.r = self.structure.residual(self.z, predicted)
        self.w = student_weights(self.r, self.noise, self.nu, self.blocks)
        if self.fixed is not None:
            self.w = self.w * self.fixed[:, None]

    def linearise(self, fresh: bool) -> None:
        """Weighted sums at the present parameters.

        Derivatives and information are those of an earlier step unless `fresh`; the residuals are
        not, so that the steps end at the same maximum.
        """
        self.see(fresh)
        old = None if fresh else self.sums
        self.sums = sums_of(self.x, self.r, self.w, self.blocks, old)

    def data(self) -> tuple[Array, Array]:
        """Information (k, k) and moment (k,) of the rows at the present noise."""
        pairs = list(zip(self.sums, slices(self.blocks), strict=True))
        gram = sum(s.gram / self.noise[p.start] ** 2 for s, p in pairs)
        moment = sum(s.moment / self.noise[p.start] ** 2 for s, p in pairs)
        return np.asarray(gram), np.asarray(moment)

    def step(self, learn: bool) -> tuple[Array, Array]:
        """Gauss-Newton step (k,) and posterior variances (k,); EM of noise and scales."""
        start = self.distance(self.beta)
        for _ in range(INNER):
            gram, moment = self.data()
            precision = gram.copy()
            precision[np.diag_indices(len(self.sd))] += self.sd**-2.0
            factor = Factor(precision)
            inverse = factor.inverse()
            delta = factor.solve(moment - start / self.sd**2)
            variance = np.diag(inverse)
            if not learn:
                break
            before = self._levels()
            self._learn(start + delta, delta, variance, inverse)
            if np.abs(self._levels() - before).max() < SETTLED:
                break
        return delta, variance

    def _levels(self) -> Array:
        """Logarithms of the noise and of the scales that EM moves."""
        noise = np.ones(1) if self.noise is None else self.noise
        moving = [self.scales[h.name] for h in self.hypers if not h.choices]
        return np.asarray(np.log(np.concatenate([noise, moving])))

    def _learn(self, value: Array, delta: Array, variance: Array, inverse: Array) -> None:
        """One step of EM: the scales of the hypers without choices, and the noise."""
        for h in self.hypers:
            if h.choices:
                continue
            ix = self.place[h.indices]
            total = float(((value[ix] ** 2 + variance[ix]) / h.shape).sum())
            scale = np.sqrt((total + h.pseudo * h.scale**2) / (len(ix) + h.pseudo))
            self._rescale(h, max(float(scale), 1e-10 * h.scale))
        noise = self.noise.copy()
        for s, part in zip(self.sums, slices(self.blocks), strict=True):
            square = s.square - 2 * float(delta @ s.moment) + float(delta @ s.gram @ delta)
            used = float((inverse * s.gram).sum()) / self.noise[part.start] ** 2
            free = max(s.count - used, s.count / 4 + 1)
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
            outer[np.diag_indices(len(rest))] += self.sd[rest] ** -2.0
            back = Factor(outer).solve(gram[np.ix_(rest, own)])
            inner = inner - gram[np.ix_(own, rest)] @ back
            lead = lead - pull[rest] @ back
        for h in varied:
            best: tuple[float, float] | None = None
            for factor in h.choices:
                self._rescale(h, h.scale * factor)
                value = linear_evidence(inner, lead, start, self.sd[own])
                if best is None or value > best[0] + 1.0:
                    best = (value, h.scale * factor)
            if best is not None:
                self._rescale(h, best[1])

    def objective(self, beta: Array) -> float:
        """Negative log posterior at `beta`, up to a constant; infinite where it overflows."""
        with np.errstate(all="ignore"):
            r = self.structure.residual(self.z, self.structure.predict(self.q, beta))
            if self.fixed is not None:
                r = r * np.sqrt(self.fixed)[:, None]
            value = negative_log_likelihood(r, self.noise, self.nu, self.blocks)
            value += 0.5 * float(((self.distance(beta) / self.sd) ** 2).sum())
        return value if np.isfinite(value) else np.inf

    def move(self, delta: Array) -> float:
        """Move along the step as far as the posterior grows; the share of the step taken."""
        before = self.objective(self.beta)
        full = np.zeros(len(self.beta))
        share = 1.0
        for _ in range(10):
            full[self.active] = share * delta
            beta = self.structure.retract(self.beta, full)
            if self.objective(beta) <= before + 1e-9 * abs(before):
                self.beta = beta
                return share
            share *= 0.4
        return 0.0


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
    weight: Array | None = None,
    learn: bool = True,
    steps: int = 10,
    tolerance: float = 1e-2,
) -> Fit:
    """Fit one member: parameters at the maximum of the posterior, noise and scales by evidence.

    Parameters
    ----------
    structure : Structure
    q : (n, dof) array
        Joint values [rad or m].
    z : (n, m) array
        What the sensor saw.
    beta : (d,) array
        Start.
    prior : Prior
        Parameters with a zero sd stay at the prior's mean.
    nu : float
        Degrees of freedom of the Student noise; infinite for Gaussian.
    floor : (m,) array
        Least noise [unit].
    noise : (m,) array, optional
        Noise to start from.
    weight : (n,) array, optional
        Weights of the rows.
    learn : bool
        Whether noise and scales are learned; otherwise they stay.
    steps : int
        Most linearisations.
    tolerance : float
        A step below this share of the posterior sd ends the search.
    """
    search = _Search(structure, q, z, beta, prior, nu, floor, noise, weight)
    fresh, keeps = True, len(search.active) > MANY and np.isfinite(nu)
    for it in range(steps):
        search.linearise(fresh)
        if learn and 1 <= it <= 3:
            search.choose()
        delta, variance = search.step(learn)
        share = search.move(delta)
        if learn and share < 0.9:  # the linearised residual is no guide to the noise
            predicted = structure.predict(q, search.beta)
            now = first_noise(structure.residual(z, predicted), floor, structure.blocks)
            search.noise = np.maximum(search.noise, now / 1.2)
        moved = np.abs(delta) / np.sqrt(variance)
        fresh = not keeps or it < 1 or share < 0.9 or bool(moved.max() > 1.0)
        if (it > (2 if learn else 0) and moved.max() <= tolerance) or share == 0.0:
            break
    return _finished(search)


def _finished(search: _Search) -> Fit:
    """Posterior at the parameters found."""
    search.see(True)
    edges, grams, moments = by_block(search.x, search.r, search.w, search.noise, search.blocks)
    gram, moment = grams.sum(axis=0), moments.sum(axis=0)
    k = np.diag_indices(len(search.sd))
    precision = gram.copy()
    precision[k] += search.sd**-2.0
    factor = Factor(precision)
    # Rows that err together count once for the time that they do.
    time = autocorrelation_time(search.r) if np.isfinite(search.nu) else 1.0
    softer = gram * (information_factor(search.structure, search.nu) / time)
    softer[k] += search.sd**-2.0
    distance = search.distance(search.beta)
    evidence = -negative_log_likelihood(search.r, search.noise, search.nu, search.blocks)
    evidence -= 0.5 * float(((distance / search.sd) ** 2).sum())
    evidence -= 0.5 * factor.log_determinant() + float(np.log(search.sd).sum())
    return Fit(
        search.structure,
        search.beta,
        search.active,
        search.sd,
        search.noise,
        search.nu,
        search.r,
        search.x,
        search.w,
        precision,
        Factor(softer).inverse(),
        moment - distance / search.sd**2,
        edges,
        grams,
        moments,
        time,
        dict(search.scales),
        evidence,
    )
