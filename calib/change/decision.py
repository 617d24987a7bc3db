"""Deciding: what a log makes of a belief under what may have changed, and whether it is better.

The prior is the old posterior, inflated as its bound is, with the freed parameters loosened.  A
residual of this log alone is a part of the fit; its size stays in the new bound.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..body.belief import Body, Second
from ..body.covariance import radius_95, root_of
from ..body.normal import Factor
from ..body.parameters import Indices
from ..common.arrays import Array
from ..common.rows import thinned
from ..training.evaluate import error_sizes
from .adaptation import Adaptation
from .causes import Cause, find_causes
from .comparison import Comparison
from .equations import Log, own_columns, prior_columns, shared_columns
from .explain import Explanation, weighed
from .frame import Reference
from .hypotheses import GROUPS, is_framed
from .settings import CHANGED, CREEP, REFINED, SIMULATED_KAPPA, SURE, UNSURE

_ROWS = 600  # that an update takes: linear in them
_BLOCKS = 5  # contiguous ones that are held out in turn, each of which tells a gain
_STEPS = 4
_ENOUGH = 30  # rows that tell a quantile
_OUTLIER = 2.5  # 95 % radii from which a row is an outlier
_LOUD = ("mirror", "scale", "sign", "lost")


def decide(found: Comparison) -> tuple[Adaptation, Body, tuple[Array, Array], bool]:
    """Explain a log, update the body by it, and judge by rows that were held out.

    `check` asks here too, so that the one promises what the other does.
    Returns the word on it with the old model, the updated belief, joints (n, dof) of held-out rows
    and their residuals (n, m), and whether the sensor's frame was free.
    """
    some, changed = found.explanations, found.changed
    if not changed:  # the rows are added to what was known
        # What waves the rows show belongs to the arm as it was: with free ones 40 rows of another
        # mounting made an error 1.2 times as large elsewhere. A drawing has no waves to start from.
        same = tuple(e for e in some if not e.hypothesis)
        calm = tuple(e for e in same if e.unchanged and e.waves <= CREEP)
        some = (same if found.belief.simulated else calm) or some
    chosen = weighed(some)
    best, log = chosen[0][1], found.log.some(_ROWS)
    body, held = _updated(found.reference, chosen, log)
    kept, held = thinned(len(found.q), _ROWS)[log.kept], held[log.kept]
    before, after = found.missed[kept], np.linalg.norm(held, axis=1)
    improved = found.explained and _improves(found, body, before, after)
    causes, notes = find_causes(found)
    if found.tool.score > 1.0:
        if not improved:  # the tool alone
            body, after, held = found.belief, before, (found.x - found.predicted)[kept]
        body, improved = found.tool_beside(body.structure, body.beta).of(body), True
    known = "no single change explains the log" if found.score > 1.0 else "nothing changed"
    # what nobody may miss: another unit, a mirror, a joint that turns round or not at all
    loud = [c.words for c in causes if c.cause.split(":")[0] in _LOUD]
    correction = best.name if changed else f"{known}, rows added"
    made = kept_model(found, before, after, correction, causes, *loud, *notes)
    if changed:
        groups = found.reference.structure.groups
        left = {g for g, ix in groups.items() if len(ix)} - {*best.hypothesis}
        if len(found.reference.sizes) >= 3:  # a tracker has no lens
            left.discard("lens")
        told = tuple(w.kept for g, w in GROUPS.items() if g in left and w.kept)
        made = replace(made, kept=told)
    rows = found.q[kept], held
    return replace(made, improved=improved), body, rows, is_framed(best.hypothesis)


def kept_model(
    found: Comparison, before: Array, after: Array, correction: str, causes: tuple[Cause, ...],
    *notes: str,
) -> Adaptation:  # fmt: skip
    """An adaptation that keeps the old model, of distances (k,) from held-out rows [unit]."""
    return Adaptation(
        found.model, False, int(np.count_nonzero(found.kept)), found.wrong + found.strays,
        error_sizes(before), error_sizes(after), correction,
        tuple(c for c in causes if c.group != "noise"), ("the arm and the sensor",),
        found.coverage, (*found.notes, *notes), found.spans, found.lost + found.strays,
    )  # fmt: skip


def _improves(found: Comparison, body: Body, before: Array, after: Array) -> bool:
    """Whether the update is worth taking: held-out blocks gain, and by more than chance."""
    gain = [float(part.mean()) for part in np.array_split(before - after, _BLOCKS)]
    error = float(np.std(gain, ddof=1) / np.sqrt(len(gain)))
    ratio = float(after.mean() / max(float(before.mean()), 1e-300))
    sure = float(np.mean(gain)) / max(error, 1e-300)
    if found.changed:
        return ratio < CHANGED and sure > SURE
    noisy = found.tested.noisy is not None and found.score <= 1.0
    if ratio >= REFINED or sure <= SURE or noisy:
        return False
    old = found.belief
    if float(before.mean()) > float(replace(old, second=None).bound(found.q).mean()):
        return sure > 2 * SURE  # rows that the old belief had not thought possible
    # mean square error [unit] that each belief expects of itself over the learned range
    spreads = (np.trace(b.spread(found.probes), axis1=1, axis2=2).mean() for b in (body, old))
    new, usual = (s * old.kappa**2 + (old.tau**2 + old.noise**2).sum() for s in spreads)
    return bool(new < UNSURE**2 * usual)


def _updated(
    reference: Reference, chosen: list[tuple[float, Explanation]], log: Log
) -> tuple[Body, Array]:
    """The posterior as a body, and held-out residuals (n, m) under the likeliest explanation.

    The bound carries what the choice among the explanations, best first with weights, is unsure of.
    """
    old = reference.body
    parts = [(share, *_posterior(reference, e, log)) for share, e in chosen]
    _, beta, _, _, held = parts[0]
    active = np.unique(np.concatenate([part[2] for part in parts]))
    covariance = np.zeros((len(active), len(active)))
    for share, other, known, spread, _ in parts:
        place = np.searchsorted(active, known)
        covariance[np.ix_(place, place)] += share * spread
        covariance += share * np.outer((other - beta)[active], (other - beta)[active])
    own = np.sqrt(sum(share * e.factor**2 for share, e in chosen)) * reference.own_sd
    noise = np.sqrt(sum(share * e.noise**2 for share, e in chosen)) * reference.sizes
    # Student weights find the noise of the calm rows; the bound on a reading needs that of all
    places = slice(old.structure.blocks[0])
    radius = float(radius_95(np.diag(noise[places] ** 2)[None])[0])
    away = np.linalg.norm(held[:, places], axis=1)
    calm = away[away < _OUTLIER * radius]
    if len(calm) >= _ENOUGH:
        noise[places] *= max(1.0, float(np.quantile(calm, 0.95)) / radius)
    second = old.second
    if second is not None:  # after the same log, under the most likely explanation
        e, apart = chosen[0][1], second.beta - old.beta
        wide = replace(old, beta=second.beta, active=second.active, root=second.root, kappa=1.0)
        there = replace(reference, body=wide, beta=reference.beta + apart)
        e = replace(e, origin=e.origin + apart, beta=e.beta + apart)
        wider, known, spread, _ = _posterior(there, e, log)
        second = Second(wider, known, root_of(spread), np.maximum(noise, second.noise))
    body = replace(
        old,
        beta=beta,
        active=active,
        # the bound inflates by kappa what is kept here without it
        root=root_of(covariance) / old.kappa,
        kappa=max(old.kappa, SIMULATED_KAPPA) if old.simulated else old.kappa,
        noise=noise,
        residual=np.maximum(old.residual, own),
        second=second,
    )
    return body, held


def _posterior(
    reference: Reference, e: Explanation, log: Log
) -> tuple[Array, Indices, Array, Array]:
    """Gauss-Newton steps of all parameters from where the explanation ended.

    Returns parameters (d,), which are known (k,), their covariance (k, k), and held-out residuals
    (n, m) [unit] of contiguous blocks of the rows.
    """
    structure = reference.structure
    active, ways = prior_columns(reference, e.waves, freed=e.sd)
    smooth, r = own_columns(reference, log, e.factor), ways.shape[1]
    weight = np.sqrt(log.weight[:, None] / e.temper) / (e.noise * reference.sizes)
    beta = e.beta.copy()
    normals = np.linalg.lstsq(ways, (e.beta - e.origin)[active], rcond=1e-12)[0]
    for step in range(_STEPS + 1):
        predicted, x = structure.linearise(log.q, beta, active)
        shared = shared_columns(reference, log, predicted)
        residual = structure.residual(log.z, predicted)
        columns = np.concatenate([x @ ways, smooth, shared], axis=2)
        flat = (columns * weight[:, :, None]).reshape(weight.size, -1)
        gram, pull = flat.T @ flat, flat.T @ (residual * weight).ravel()
        gram[np.diag_indices(len(gram))] += 1.0
        pull[:r] -= normals  # what the log's own part follows, it follows anew in each step
        factor = Factor(gram)
        if step < _STEPS:
            delta, full = factor.solve(pull)[:r], np.zeros(len(beta))
            full[active] = ways @ delta
            beta, normals = structure.retract(beta, full), normals + delta
    held = np.empty_like(residual)
    for block in np.array_split(np.arange(len(residual)), _BLOCKS):
        # without the block's rows the information is a difference: no fit is needed
        flat = (columns[block] * weight[block, :, None]).reshape(-1, len(gram))
        less = Factor(gram - flat.T @ flat)
        delta = less.solve(pull - flat.T @ (residual[block] * weight[block]).ravel())
        held[block] = residual[block] - columns[block, :, :r] @ delta[:r]
    return beta, active, ways @ factor.inverse()[:r, :r] @ ways.T, held
