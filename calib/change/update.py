"""Updating: the posterior of a belief after a new log, averaged over what may have changed.

The prior is the old posterior, inflated as its bound is, with the freed parameters loosened.
The rows' likelihood is tempered, and holds a residual of this log alone: a Gaussian process
over the joints, marginalised, whose size stays in the new bound because nobody knows it
elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..body.belief import Body, Second
from ..body.covariance import radius_95, root_of
from ..body.fitting import fit_body
from ..body.likeness import lengths_of, matern
from ..body.nominal import nominal_of
from ..body.normal import Factor
from ..body.parameters import Indices
from ..body.posterior import BodyFit
from ..common.arrays import Array
from ..common.rows import thinned
from ..common.scale import METRES
from ..errors import CalibError
from .comparison import Comparison
from .explain import Explanation
from .members import ANYWHERE, anywhere, drift
from .reference import Reference
from .rows import UPDATED_ROWS, Log

_NODES = 60  # places of the log's own residual
_BLOCKS = 5
_ENOUGH = 30  # rows that tell a quantile
_OUTLIER = 2.5  # 95 % radii from which a row is an outlier
_STEPS = 3
_CLEAN = 0.01  # of the residual that a log is allowed: half of its rows are nearer than that
_BETTER = 0.95  # share of the update's held-out error that a fit from a drawing has to reach


@dataclass(frozen=True)
class Posterior:
    """Belief over the parameters after a log, under one explanation."""

    beta: Array  # (d,)
    active: Indices  # (k,)
    covariance: Array  # (k, k)
    # (n, m) [unit], residuals of contiguous blocks of the rows, predicted from the others
    held_out: Array


def updated(
    reference: Reference, chosen: list[tuple[float, Explanation]], log: Log, probes: Array
) -> tuple[Body, Array]:
    """The averaged posterior as a body, and held-out residuals (n, m) of the log's rows.

    reference : the old belief in the frame of the log
    chosen : what explains the log, best first
    log : `z` less what maps add to the body
    probes : (p, dof), joints all over the learned range, where predictions are averaged
    """
    old = reference.body
    log = log.some(UPDATED_ROWS)
    parts = [(w, _posterior(reference, e, log)) for w, e in chosen]
    active = np.unique(np.concatenate([p.active for _, p in parts]))
    best = parts[0][1].beta
    held = np.sum([w * p.held_out for w, p in parts], axis=0)
    covariance = np.zeros((len(active), len(active)))
    for weight, part in parts:
        place = np.searchsorted(active, part.active)
        covariance[np.ix_(place, place)] += weight * part.covariance
        away = (part.beta - best)[active]
        covariance += weight * np.outer(away, away)
    beta = _averaged(reference, [(w, p.beta) for w, p in parts], active, covariance, probes)
    own = np.sqrt(sum(w * e.factor**2 for w, e in chosen)) * reference.own_sd
    noise = np.sqrt(sum(w * e.noise**2 for w, e in chosen)) * reference.sizes
    noise = _readings(old, noise, held)
    second = None
    if old.second is not None:
        second = _second(old.second, reference, chosen[0][1], log, noise)
    body = replace(
        old,
        beta=beta,
        active=active,
        # the bound inflates by kappa what is kept here without it
        root=root_of(covariance) / old.kappa,
        noise=noise,
        residual=np.maximum(old.residual, own),
        second=second,
    )
    return body, held


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


def _averaged(
    reference: Reference,
    parts: list[tuple[float, Array]],
    active: Indices,
    covariance: Array,
    probes: Array,
) -> Array:
    """Parameters whose predictions are the average of those of the parts.

    Predictions are averaged, not parameters: a camera's scale and the length of all links say
    the same, and half of each would not.
    """
    beta = parts[0][1]
    if len(parts) == 1 or not len(active):
        return beta
    structure, size = reference.structure, reference.sizes
    here, x = structure.linearise(probes, beta, active)
    gap = np.sum(
        [w * structure.residual(structure.predict(probes, b), here) for w, b in parts], axis=0
    )
    flat = (x / size[:, None]).reshape(-1, len(active))
    total = flat @ covariance @ flat.T
    total[np.diag_indices(len(total))] += 1e-2
    full = np.zeros(len(beta))
    full[active] = covariance @ flat.T @ np.linalg.solve(total, (gap / size).ravel())
    return np.asarray(structure.retract(beta, full))


def _posterior(reference: Reference, e: Explanation, log: Log) -> Posterior:
    """Gauss-Newton steps of all parameters from where the explanation ended."""
    old, structure = reference.body, reference.structure
    creep = drift(old, e.waves)
    loose = np.sqrt(e.sd**2 + creep**2)
    if e.member.framed:
        loose[anywhere(structure, reference.forgotten)] *= ANYWHERE
    active = np.union1d(old.active, np.flatnonzero(loose > 0)).astype(np.intp)
    prior = np.diag(loose[active] ** 2)
    place = np.searchsorted(active, old.active)
    known = old.covariance * old.kappa**2
    if e.member.framed and len(reference.forgotten):
        lost = np.isin(old.active, reference.forgotten)
        known = np.where(lost[:, None] | lost, 0.0, known)
    prior[np.ix_(place, place)] += known
    fixed = np.diag(prior) <= 0.0
    active, prior = active[~fixed], prior[np.ix_(~fixed, ~fixed)]
    information = Factor(prior).inverse()
    beta, moved, k = e.beta.copy(), (e.beta - e.origin)[active], len(active)
    for share in (1.0, _CLEAN, _CLEAN**2):
        allowed = replace(e, factor=share * e.factor, noise=share * e.noise)
        root, own = _own_columns(reference, allowed, log)
        prior_own = np.arange(k, k + own.shape[2])
        for step in range(_STEPS + 1):
            predicted, x = structure.linearise(log.q, beta, active)
            residual = structure.residual(log.z, predicted)
            full, y = np.concatenate([x * root[:, :, None], own], axis=2), residual * root
            flat = full.reshape(-1, full.shape[2])
            gram, pull = flat.T @ flat, flat.T @ y.ravel()
            gram[prior_own, prior_own] += 1.0  # standard normal
            pull[:k] -= information @ moved
            gram[:k, :k] += information
            if step == _STEPS:
                break
            delta = Factor(gram).solve(pull)[:k]
            step_taken = np.zeros(len(beta))
            step_taken[active] = delta
            beta, moved = structure.retract(beta, step_taken), moved + delta
        if share == 1.0:
            found = Factor(gram).inverse()[:k, :k]
        held = np.empty_like(residual)
        for block in np.array_split(np.arange(len(residual)), _BLOCKS):
            flat = full[block].reshape(-1, len(gram))
            # without the block's rows the information is a difference: no new fit
            less = Factor(gram - flat.T @ flat)
            delta = less.solve(pull - flat.T @ y[block].ravel())[:k]
            held[block] = residual[block] - x[block] @ delta
        # rows that are far more exact than was allowed for: the prior must not hold them back
        if np.median(np.abs(held / (e.factor * reference.own_sd))) > share * _CLEAN:
            break
    return Posterior(beta, active, found, held)


def _own_columns(reference: Reference, e: Explanation, log: Log) -> tuple[Array, Array]:
    """What whitens rows, (n, m), and derivatives (n, m, k) by the log's own residual, whitened.

    The residual has nodes of its own for each output, with a standard normal prior.
    """
    nodes = log.q[thinned(len(log.q), _NODES)]
    lengths = lengths_of(reference.body, log.q)
    alike = matern(nodes, nodes, lengths)
    alike[np.diag_indices(len(nodes))] += 1e-6
    factor = np.linalg.cholesky(alike)
    features = np.linalg.solve(factor, matern(nodes, log.q, lengths)).T
    own = e.factor * reference.own_sd
    # what the nodes do not follow of the process counts as noise (FITC, Snelson 2006)
    unexplained = np.maximum(1.0 - (features**2).sum(axis=1), 0.0)
    variance = (e.noise * reference.sizes) ** 2 / log.weight[:, None] + unexplained[
        :, None
    ] * own**2
    root = 1.0 / np.sqrt(variance * e.temper)
    (n, m), count = root.shape, len(nodes)
    columns = np.zeros((n, m, m * count))
    for j in range(m):
        size = own[j] * np.sqrt(e.temper)
        columns[:, j, j * count : (j + 1) * count] = features * (size * root[:, j, None])
    return root, columns


def _second(second: Second, reference: Reference, e: Explanation, log: Log, noise: Array) -> Second:
    """The second belief, after the same log under the best explanation."""
    old = reference.body
    apart = second.beta - old.beta
    other = replace(
        old, beta=second.beta, active=second.active, root=second.root, kappa=1.0,
        second=None,
    )  # fmt: skip
    place = replace(reference, body=other, beta=reference.beta + apart)
    start = replace(e, origin=e.origin + apart, beta=e.beta + apart)
    found = _posterior(place, start, log)
    return replace(
        second,
        beta=found.beta,
        active=found.active,
        root=root_of(found.covariance),
        noise=np.maximum(noise, second.noise),
    )


def gain_on_held_out(before: Array, after: Array) -> tuple[float, float]:
    """How much held-out rows gained: mean ratio of errors, and gain over its standard error.

    before, after : (n,) [unit], distances of the same rows from the old prediction, and from the
        new one without their block
    """
    gain = [float(part.mean()) for part in np.array_split(before - after, _BLOCKS)]
    error = float(np.std(gain, ddof=1)) / np.sqrt(len(gain))
    ratio = float(after.mean() / max(float(before.mean()), 1e-300))
    return ratio, float(np.mean(gain)) / max(error, 1e-300)


def fit_from_drawing(found: Comparison, after: float) -> BodyFit | None:
    """The body of the rows with a simulated model's geometry as prior, where it serves better.

    A model that was trained in simulation knows the arm as it was drawn.  Its update moves the
    parameters that the log asks for; a fit with the drawing as prior also learns how far arms of
    this kind are from their drawings.

    found : the log beside the model
    after : [unit], mean held-out error of the update, which the fit has to beat
    Returns BodyFit or None, none for a model of a log, an arm in space, rows of a line or a corner,
    or a fit that is no better.
    """
    body, reference, about = found.model.body, found.reference, found.model.about
    if body is None or not body.simulated or body.structure.outputs != 2:
        return None
    if about.unit not in METRES or reference.turned or reference.locked or not found.spans:
        return None
    kept, known = found.log.kept, (about.lower, about.upper, about.revolute)
    try:
        fit = fit_body(
            found.q[kept], found.x[kept], joint_names=about.joint_names, revolute=about.revolute,
            nominal=nominal_of(body.predict, *known), unit=about.unit, lower=about.lower,
            upper=about.upper,
        )  # fmt: skip
    except CalibError:  # joints out of the plane, or rows that place no arm
        return None
    error = float(np.linalg.norm(fit.held_out, axis=1).mean())
    return fit if error < _BETTER * after else None
