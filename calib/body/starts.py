"""The best of a structure's starts: short robust Levenberg-Marquardt runs without curves."""

from __future__ import annotations

import numpy as np

from .normal import Factor, student_weights, sums_of
from .structure import Array, Prior, Structure

ROWS = 400
KEPT = 8
NU = 6.0


def best_start(
    structure: Structure, q: Array, z: Array, free: tuple[str, ...]
) -> tuple[Structure, Array, float]:
    """Structure (signs, mirror), parameters (d,) and cost of the best start.

    Parameters
    ----------
    structure : Structure
    q : (n, dof) array
    z : (n, m) array
    free : tuple of str
        Groups that the runs fit; the gate's chain.
    """
    if len(q) > ROWS:
        rows = np.sort(np.random.default_rng(0).permutation(len(q))[:ROWS])
        q, z = q[rows], z[rows]
    runs = []
    for each, beta in structure.starts(q, z):
        runs.append((*_refine(each, q, z, beta, each.prior(free), 6), each))
    runs.sort(key=lambda run: run[0])
    best = runs[0]
    for cost, beta, each in runs[:KEPT]:
        cost, beta = _refine(each, q, z, beta, each.prior(free), 40)
        if cost < best[0] - 1e-9 * abs(best[0]):
            best = (cost, beta, each)
    return best[2], best[1], best[0]


def _robust(r: Array, sigma: Array, blocks: tuple[int, ...]) -> float:
    total, at = 0.0, 0
    for p in blocks:
        e2 = ((r[:, at : at + p] / sigma[at : at + p]) ** 2).sum(axis=1)
        total += 0.5 * (NU + p) * float(np.log1p(e2 / NU).sum())
        at += p
    return total


def _spread(r: Array, extents: Array, blocks: tuple[int, ...]) -> Array:
    """Maximum-likelihood Student scale (m,) of residuals, at least 1e-7 of the extents."""
    sigma, at = np.empty(r.shape[1]), 0
    for p in blocks:
        e2 = (r[:, at : at + p] ** 2).sum(axis=1)
        s2 = float(np.median(e2)) / p + 1e-14 * extents[at] ** 2
        for _ in range(12):
            w = (NU + p) / (NU + e2 / s2)
            s2 = float((w * e2).mean()) / p + 1e-14 * extents[at] ** 2
        sigma[at : at + p] = np.sqrt(s2)
        at += p
    return sigma


def _refine(
    structure: Structure, q: Array, z: Array, beta: Array, prior: Prior, steps: int
) -> tuple[float, Array]:
    """Cost and parameters after a short robust Levenberg-Marquardt run."""
    active, blocks, extents = prior.active, structure.blocks, structure.extents
    sd = prior.sd[active]
    mean = prior.mean[active]
    beta = np.where(prior.sd > 0, beta, prior.mean)
    damping = 1e-3

    def posterior(r: Array, b: Array, sigma: Array) -> float:
        return _robust(r, sigma, blocks) + 0.5 * float((((b[active] - mean) / sd) ** 2).sum())

    with np.errstate(all="ignore"):
        for _ in range(steps):
            predicted, x = structure.linearise(q, beta, active)
            r = structure.residual(z, predicted)
            if not (np.isfinite(r).all() and np.isfinite(x).all()):
                return np.inf, beta
            sigma = _spread(r, extents, blocks)
            w = student_weights(r, sigma, NU, blocks)
            parts = sums_of(x / sigma[:, None], r / sigma, w, blocks)
            gram = np.sum([s.gram for s in parts], axis=0)
            pull = np.sum([s.moment for s in parts], axis=0) - (beta[active] - mean) / sd**2
            gram[np.diag_indices(len(sd))] += sd**-2.0
            before = posterior(r, beta, sigma)
            for _ in range(7):
                damped = gram.copy()
                damped[np.diag_indices(len(sd))] *= 1 + damping
                try:
                    delta = Factor(damped).solve(pull)
                except np.linalg.LinAlgError:
                    damping = min(damping * 8, 1e8)
                    continue
                full = np.zeros(len(beta))
                full[active] = delta
                moved = structure.retract(beta, full)
                after = structure.residual(z, structure.predict(q, moved))
                if np.isfinite(after).all() and posterior(after, moved, sigma) < before:
                    break
                damping = min(damping * 8, 1e8)
            else:
                break
            damping = max(damping / 10, 1e-12)
            beta = moved
            if float(np.abs(delta / sd).max()) < 1e-9:
                break
        r = structure.residual(z, structure.predict(q, beta))
        if not np.isfinite(r).all():
            return np.inf, beta
        sigma = _spread(r, extents, blocks)
    cost = posterior(r, beta, sigma) + len(r) * float(np.log(sigma).sum())
    return cost, beta
