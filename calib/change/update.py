"""Updating: a belief under the change that explains a log best, judged by rows that were held out.

The prior is the old posterior, inflated as its bound is, with the freed parameters loosened.  A
residual of this log alone is a part of the fit; its size stays in the new bound.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..body.belief import Body, Second
from ..body.covariance import root_of
from ..body.normal import Factor
from ..body.parameters import Indices
from ..common.arrays import Array
from ..common.rows import thinned
from .evidence import Evidence
from .explain import Explanation, weighed
from .frame import Reference
from .settings import CHANGED, CREEP, REFINED, SIMULATED_KAPPA, SURE
from .system import Log, own_columns, prior_columns, shared_columns

_ROWS = 600  # that an update takes: linear in them
_BLOCKS = 5  # contiguous ones that are held out in turn, each of which tells a gain
_STEPS = 60  # at most: along the gauge of an arm without a drawing 12 ended on the way
_NOTHING_LEFT = 1e-3  # nats by which a step must better the fit
# noises: no step goes along ways by which all rows together move less.  An arm without a drawing
# may be put together in many ways that look alike, along which no step is a small one.
_TOLD = 0.3


@dataclass(frozen=True, eq=False)
class Update:
    """What the rows of a log make of a belief."""

    body: Body
    explanation: Explanation  # that the belief is under
    rows: Indices  # (k,), rows of the log by which it was judged
    before: Array  # (k,), their distances from the model [unit]
    residual: Array  # (k, m), residuals of these rows where they were held out [unit]
    improved: bool  # whether they are predicted better than before

    @property
    def after(self) -> Array:
        """Their distances from the updated belief (k,) [unit]."""
        return np.asarray(np.linalg.norm(self.residual, axis=1))


def update(evidence: Evidence) -> Update:
    """Update a belief by the rows of a log."""
    changed = evidence.score > 1.0
    data = evidence.data.some(_ROWS)
    chosen = weighed(_hypotheses_to_update_by(evidence))
    body, held = _mixed(evidence.reference, chosen, data)
    rows = np.flatnonzero(evidence.sound)
    rows = rows[thinned(len(rows), _ROWS)]
    before = evidence.rows.missed[rows]
    gain = before - np.linalg.norm(held, axis=1)
    gains = np.array([block.mean() for block in np.array_split(gain, _BLOCKS)])
    chance = SURE * float(gains.std(ddof=1)) / np.sqrt(_BLOCKS)
    share = CHANGED if changed else REFINED
    needed = max(chance, (1.0 - share) * float(before.mean()))
    improved = evidence.explained and float(gains.mean()) > needed
    if not changed:
        # rows of an arm that did not change made a model of half of series A worse by 1.15
        improved = (
            improved and evidence.tests.noisy is None and _is_surer(evidence, body)
        )
    tool = evidence.tool
    if tool.score > 1.0:
        if not improved:  # the tool alone
            body = evidence.prior
            held = (evidence.rows.x - evidence.rows.predicted)[rows]
        body = evidence.tool_beside(body.beta).of(body)
        improved = True
    return Update(body, chosen[0][1], rows, before, held, bool(improved))


def _hypotheses_to_update_by(evidence: Evidence) -> tuple[Explanation, ...]:
    """Those of the change; where nothing is blamed those of none, which widen the bound."""
    explanations = evidence.explanations
    if evidence.attributed:
        return explanations
    explanations = tuple(e for e in explanations if not e.causes) or explanations
    # with free waves 40 rows of another mounting made an error 1.2 times as large elsewhere
    if evidence.score <= 1.0 and not evidence.prior.simulated:
        explanations = (
            tuple(e for e in explanations if e.level.waves <= CREEP) or explanations
        )
    return explanations


def _is_surer(evidence: Evidence, body: Body) -> bool:
    """Whether a belief expects errors of itself that are smaller than those of the old one."""
    old = evidence.prior
    probes = evidence.rows.probes
    variances = []
    for belief in (body, old):
        spread = np.trace(belief.spread(probes), axis1=1, axis2=2).mean()
        variances.append(
            float(spread) * old.kappa**2 + float((old.tau**2 + old.noise**2).sum())
        )
    return variances[0] < REFINED**2 * variances[1]


def _mixed(
    reference: Reference, chosen: list[tuple[float, Explanation]], log: Log
) -> tuple[Body, Array]:
    """The posterior as a body, and held-out residuals (n, m) under the likeliest explanation.

    The bound carries what the choice among the explanations, best first with weights, is unsure of.
    """
    old = reference.body
    parts = [(share, *_posterior(e.reference, e, log)) for share, e in chosen]
    _, beta, _, _, held = parts[0]
    active = np.unique(np.concatenate([part[2] for part in parts]))
    covariance = np.zeros((len(active), len(active)))
    for share, other, known, spread, _ in parts:
        place = np.searchsorted(active, known)
        covariance[np.ix_(place, place)] += share * spread
        covariance += share * np.outer((other - beta)[active], (other - beta)[active])
    own = (
        np.sqrt(sum(share * e.level.residual**2 for share, e in chosen))
        * reference.own_sd
    )
    noise = np.sqrt(sum(share * e.noise**2 for share, e in chosen)) * reference.sizes
    second = old.second
    if second is not None:  # after the same log, under the most likely explanation
        e = chosen[0][1]
        apart = second.beta - old.beta
        wide = replace(
            old, beta=second.beta, active=second.active, root=second.root, kappa=1.0
        )
        there = replace(e.reference, body=wide, beta=e.reference.beta + apart)
        e = replace(e, beta=e.beta + apart)
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
    weight = 1.0 / (np.sqrt(e.temper) * e.noise * reference.sizes)
    active, prior = prior_columns(reference, e.level.waves, freed=e.sd)
    smooth = own_columns(reference, log, e.level.residual)

    def whitened(columns: Array) -> Array:
        return np.asarray((columns * weight[:, None]).reshape(log.z.size, -1))

    def seen(beta: Array, normals: Array) -> tuple[Array, Array, float]:
        """Whitened residuals (N,), columns (N, s) of what the rows share, and the cost [nats]."""
        with np.errstate(all="ignore"):
            predicted = structure.predict(log.q, beta)
            y = (structure.residual(log.z, predicted) * weight).ravel()
            shared = shared_columns(reference, log, predicted)
        own = whitened(np.concatenate([smooth, shared], axis=2))
        if not np.isfinite(y).all():
            return y, own, np.inf
        pull = own.T @ y
        cost = (
            y @ y
            - pull @ Factor(_with_ones(own.T @ own)).solve(pull)
            + normals @ normals
        )
        return y, own, 0.5 * float(cost)

    def columns_of(ways: Array) -> Array:
        """Whitened columns (N, k) of parameters along ways (d, k)."""
        return whitened(structure.linearise(log.q, beta, active)[1] @ ways)

    beta = e.beta
    ways = prior @ _told(columns_of(prior), _TOLD)
    start = np.linalg.lstsq(ways, (beta - reference.beta)[active], rcond=1e-12)[0]
    normals = np.asarray(start, dtype=np.float64)
    y, own, cost = seen(beta, normals)
    for _ in range(_STEPS):
        columns = np.concatenate([columns_of(ways), own], axis=1)
        pull = columns.T @ y
        pull[: len(normals)] -= (
            normals  # the log's own part is followed anew in each step
        )
        delta = Factor(_with_ones(columns.T @ columns)).solve(pull)[: len(normals)]
        for share in 0.3 ** np.arange(6.0):
            full = np.zeros(len(beta))
            full[active] = ways @ (share * delta)
            moved = structure.retract(beta, full)
            there = seen(moved, normals + share * delta)
            if there[-1] < cost - _NOTHING_LEFT:
                break
        else:
            break
        beta = moved
        normals = normals + share * delta
        y, own, cost = there
    # what is known after the last step, along all ways that any row tells of
    told = _told(columns_of(prior), 0.0)
    normals = told.T @ np.linalg.lstsq(prior, ways @ normals, rcond=1e-12)[0]
    ways = prior @ told
    x = columns_of(ways)
    columns = np.concatenate([x, own], axis=1)
    gram = _with_ones(columns.T @ columns)
    pull = columns.T @ y
    pull[: len(normals)] -= normals
    held = np.empty_like(y)
    outputs = log.z.shape[1]
    for block in np.array_split(np.arange(len(log.z)), _BLOCKS):
        # without the block's rows the information is a difference: no fit is needed
        rows = slice(block[0] * outputs, (block[-1] + 1) * outputs)
        less = Factor(gram - columns[rows].T @ columns[rows])
        delta = less.solve(pull - columns[rows].T @ y[rows])[: len(normals)]
        held[rows] = y[rows] - x[rows] @ delta
    learned = (
        np.eye(len(normals)) - Factor(gram).inverse()[: len(normals), : len(normals)]
    )
    covariance = prior @ prior.T - ways @ learned @ ways.T
    return beta, active, covariance, held.reshape(log.z.shape) / weight


def _with_ones(gram: Array) -> Array:
    """Information (k, k) of standard normals, in place."""
    gram[np.diag_indices(len(gram))] += 1.0
    return gram


def _told(x: Array, least: float) -> Array:
    """Ways (k, r) of standard normals along which readings tell more than `least` noises.

    x : (N, k), columns of the whitened readings
    """
    _, sizes, ways = np.linalg.svd(x, full_matrices=False)
    return np.asarray(ways[sizes > least].T)
