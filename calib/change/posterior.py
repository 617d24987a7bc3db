"""The posterior of a belief after a new log, under what may have changed.

The prior is the old posterior, inflated as its bound is, with the freed parameters loosened.  The
rows' likelihood is tempered, and holds a residual of this log alone, whose size stays in the new
bound because nobody knows it elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..body.belief import Body
from ..body.covariance import RADIUS_95, radius_95, root_of
from ..body.normal import Factor
from ..body.parameters import Indices
from ..common.arrays import Array
from .equations import Log, OwnResidual, prior_columns, shared_columns
from .explain import Explanation
from .frame import Reference
from .settings import OWN_GAIN, PARTITIONS, SURE, UPDATED_ROWS

_ENOUGH = 30  # rows that tell a quantile
_OUTLIER = 2.5  # 95 % radii from which a row is an outlier
_STEPS = 4


@dataclass(frozen=True, eq=False)
class Smooth:
    """What a log shows beyond its hypothesis: a residual that fades away from its rows."""

    own: OwnResidual
    mean: Array  # (p m,), of its standard normals, and their covariance (p m, p m)
    covariance: Array

    def value(self, q: Array) -> Array:
        """Mean (k, m) at joints (k, dof) [unit]."""
        return np.asarray(self.own.columns(q) @ self.mean)

    def bound(self, q: Array) -> Array:
        """95 % bound (k,) [unit] on what is not known of it at joints (k, dof)."""
        x = self.own.columns(q)
        spread = np.einsum("kmi,ij,klj->kml", x, self.covariance, x, optimize=True)
        unseen = np.maximum(1.0 - (self.own.features(q) ** 2).sum(axis=1), 0.0)
        deviation = np.einsum("kmm->km", spread) + unseen[:, None] * self.own.sd**2
        return np.asarray(RADIUS_95 * np.sqrt(deviation.max(axis=1)))


@dataclass(frozen=True, eq=False)
class Posterior:
    """Belief over the parameters after a log, under one explanation."""

    beta: Array  # (d,)
    active: Indices  # (k,)
    covariance: Array  # (k, k)
    # (n, m) [unit], residuals of contiguous blocks of the rows, predicted from the others
    held_out: Array
    smooth: Smooth | None  # where held-out blocks ask for it, and what they are with it
    held_out_with: Array


def posterior_of(reference: Reference, e: Explanation, log: Log) -> Posterior:
    """Gauss-Newton steps of all parameters from where the explanation ended."""
    structure = reference.structure
    active, ways = prior_columns(reference, e.waves, freed=e.sd)
    own = OwnResidual.of(reference, log, e.factor)
    smooth, r = own.columns(log.q), ways.shape[1]
    weight = np.sqrt(log.weight[:, None] / e.temper) / (e.noise * reference.sizes)
    beta = e.beta.copy()
    normals = np.linalg.lstsq(ways, (e.beta - e.origin)[active], rcond=1e-12)[0]
    for step in range(_STEPS + 1):
        predicted, x = structure.linearise(log.q, beta, active)
        shared = shared_columns(reference, log, predicted)
        columns = np.concatenate([x @ ways, smooth, shared], axis=2)
        residual = structure.residual(log.z, predicted)
        flat = (columns * weight[:, :, None]).reshape(weight.size, -1)
        gram, pull = flat.T @ flat, flat.T @ (residual * weight).ravel()
        gram[np.diag_indices(len(gram))] += 1.0
        pull[:r] -= normals  # what the log's own part follows, it follows anew in each step
        factor = Factor(gram)
        delta = factor.solve(pull)
        if step == _STEPS:
            break
        full = np.zeros(len(beta))
        full[active] = ways @ delta[:r]
        beta, normals = structure.retract(beta, full), normals + delta[:r]
    covariance = factor.inverse()
    alone, joint = _held_out(columns, residual, weight, gram, pull, r)
    at, kept = slice(r, r + smooth.shape[2]), None
    if len(residual) >= 2 * max(PARTITIONS) and _gains(alone, joint):
        kept = Smooth(own, delta[at], covariance[at, at])
    spread = ways @ covariance[:r, :r] @ ways.T
    return Posterior(beta, active, spread, alone[-1], kept, joint[-1])


def _held_out(
    columns: Array, residual: Array, weight: Array, gram: Array, pull: Array, count: int
) -> Array:
    """Residuals (2, p, n, m) of blocks that the others predict, for each number p of blocks.

    The first by the `count` parameters alone, the second with the log's own residual: without the
    block's rows the information is a difference, and no fit is needed.
    """
    found = np.empty((2, len(PARTITIONS), *residual.shape))
    for k, parts in enumerate(PARTITIONS):
        for block in np.array_split(np.arange(len(residual)), parts):
            flat = (columns[block] * weight[block, :, None]).reshape(-1, len(gram))
            y = (residual[block] * weight[block]).ravel()
            delta = Factor(gram - flat.T @ flat).solve(pull - flat.T @ y)
            found[0, k, block] = residual[block] - columns[block, :, :count] @ delta[:count]
            found[1, k, block] = residual[block] - columns[block] @ delta
    return found


def _gains(alone: Array, joint: Array) -> bool:
    """Whether the log's own residual clearly predicts each number of blocks better."""
    before, after = (np.linalg.norm(each, axis=2) for each in (alone, joint))
    if (after.mean(axis=1) > (1.0 - OWN_GAIN) * before.mean(axis=1)).any():
        return False
    return gain_on_held_out(before[-1], after[-1])[1] > SURE


def gain_on_held_out(before: Array, after: Array) -> tuple[float, float]:
    """How much held-out rows gained: mean ratio of errors, and gain over its standard error.

    before, after : (n,) [unit], distances of the same rows from the old prediction, and from the
        new one without their block
    """
    gain = [float(part.mean()) for part in np.array_split(before - after, PARTITIONS[-1])]
    error = float(np.std(gain, ddof=1)) / np.sqrt(len(gain))
    ratio = float(after.mean() / max(float(before.mean()), 1e-300))
    return ratio, float(np.mean(gain)) / max(error, 1e-300)


def updated(
    reference: Reference, chosen: list[tuple[float, Explanation]], log: Log
) -> tuple[Body, Posterior]:
    """The posterior as a body, and that of the most likely explanation.

    The bound carries what the choice among the explanations is unsure of.

    reference : the old belief in the frame of the log
    chosen : what explains the log, best first, with weights
    log : `z` less what maps add to the body
    """
    old, log = reference.body, log.some(UPDATED_ROWS)
    parts = [(w, posterior_of(reference, e, log)) for w, e in chosen]
    best = parts[0][1]
    active = np.unique(np.concatenate([p.active for _, p in parts]))
    covariance = np.zeros((len(active), len(active)))
    for share, part in parts:
        place = np.searchsorted(active, part.active)
        covariance[np.ix_(place, place)] += share * part.covariance
        away = (part.beta - best.beta)[active]
        covariance += share * np.outer(away, away)
    own = np.sqrt(sum(w * e.factor**2 for w, e in chosen)) * reference.own_sd
    noise = np.sqrt(sum(w * e.noise**2 for w, e in chosen)) * reference.sizes
    noise = _readings(old, noise, best.held_out)
    second = old.second
    if second is not None:
        moved = old.structure.retract(second.beta, best.beta - old.beta)
        second = replace(second, beta=moved, noise=np.maximum(noise, second.noise))
    body = replace(
        old,
        beta=best.beta,
        active=active,
        # the bound inflates by kappa what is kept here without it
        root=root_of(covariance) / old.kappa,
        noise=noise,
        residual=np.maximum(old.residual, own),
        second=second,
    )
    return body, best


def _readings(old: Body, noise: Array, held: Array) -> Array:
    """Noise (m,) that covers 95 % of the held-out rows, outliers apart.

    Student weights find the noise of the calm rows; the bound on a reading needs that of all.
    """
    out, at = noise.copy(), 0
    for size in old.structure.blocks:
        part = slice(at, at + size)
        distance = np.linalg.norm(held[:, part], axis=1)
        radius = float(radius_95(np.diag(noise[part] ** 2)[None])[0])
        calm = distance[distance < _OUTLIER * radius]
        if len(calm) >= _ENOUGH:
            out[part] *= max(1.0, float(np.quantile(calm, 0.95)) / radius)
        at += size
    return out
