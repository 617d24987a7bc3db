"""Updating: a belief under the change that explains a log best, judged by rows that were held out.

The prior is the old posterior, inflated as its bound is, with the freed parameters loosened.  A
residual of this log alone is a part of the fit; its size stays in the new bound.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..body.belief import Body, Second
from ..body.covariance import root_of
from ..body.normal import Factor
from ..body.parameters import Indices
from ..body.settings import STUDENT
from ..common.arrays import Array
from ..common.rows import thinned
from .explain import Explanation, least_residual
from .settings import CHANGED, CREEP, REFINED, SIMULATED_KAPPA, SURE
from .system import Log, own_columns, prior_columns, shared_columns
from .verdict import Evidence


@dataclass(frozen=True)
class UpdateSettings:
    """How a belief is updated."""

    # that an update takes: linear in them
    rows: int = 600
    # contiguous ones that are held out in turn, each of which tells a gain
    blocks: int = 5
    # at most, from where the explanation ended: along the ways in which an arm without a drawing
    # may be put together 12 ended on the way
    steps: int = 60
    # nats by which a step must promise to better the fit
    nothing_left: float = 1e-3
    # what is left of one that does not better the fit
    shorter: float = 0.3
    # noises: no step goes along ways by which all rows together move less.  An arm without a
    # drawing may be put together in many ways that look alike, along which no step is small
    telling: float = 0.3


UPDATING = UpdateSettings()


@dataclass(frozen=True, eq=False)
class Update:
    """What the rows of a log make of a belief."""

    body: Body
    explanation: Explanation  # that the belief is under
    rows: Indices  # (k,), rows of the log by which it was judged
    before: Array  # (k,), their distances from the model [unit]
    # (k, m), residuals of these rows where they were held out [unit]
    residual: Array
    improved: bool  # whether they are predicted better than before

    @property
    def after(self) -> Array:
        """Their distances from the updated belief (k,) [unit]."""
        return np.asarray(np.linalg.norm(self.residual, axis=1))


def update(evidence: Evidence) -> Update:
    """Update a belief by the rows of a log."""
    changed = evidence.score > 1.0
    explanation = _to_update_by(evidence)
    body, residual = _updated(explanation, evidence.data.some(UPDATING.rows))
    rows = thinned(len(evidence.rows), UPDATING.rows)
    before = evidence.rows.missed[rows]
    gain = before - np.linalg.norm(residual, axis=1)
    gains = np.array(
        [block.mean() for block in np.array_split(gain, UPDATING.blocks)]
    )
    chance = SURE * float(gains.std(ddof=1)) / np.sqrt(UPDATING.blocks)
    share = CHANGED if changed else REFINED
    needed = max(chance, (1.0 - share) * float(before.mean()))
    improved = evidence.explained and float(gains.mean()) > needed
    if not changed:
        # rows of an arm that did not change made a model of half of series A worse by 1.15
        improved = (
            improved
            and evidence.tests.noisy is None
            and _is_surer(evidence, body)
        )
    if evidence.tool.score > 1.0:
        if not improved:  # the tool alone
            body = evidence.prior
            residual = (evidence.rows.x - evidence.rows.predicted)[rows]
        body = evidence.tool_beside(body.beta).of(body)
        improved = True
    return Update(body, explanation, rows, before, residual, bool(improved))


def _to_update_by(evidence: Evidence) -> Explanation:
    """The best explanation; where nothing is blamed that of no change, which widens the bound."""
    explanations = evidence.explanations
    if evidence.attributed:
        return least_residual(explanations)
    explanations = tuple(some for some in explanations if not some.causes)
    if evidence.score > 1.0 or evidence.prior.simulated:
        return least_residual(explanations)
    # with free waves 40 rows of another mounting made an error 1.2 times as large elsewhere, and
    # with the least residual that the evidence allows 1.12 times
    return next(some for some in explanations if some.level.waves <= CREEP)


def _is_surer(evidence: Evidence, body: Body) -> bool:
    """Whether a belief expects errors of itself that are smaller than those of the old one."""
    old = evidence.prior
    unexplained = float((old.tau**2 + old.noise**2).sum())
    variances = []
    for belief in (body, old):
        spread = belief.spread(evidence.rows.probes)
        own = float(np.einsum("nii->n", spread).mean())
        variances.append(own * old.kappa**2 + unexplained)
    return variances[0] < REFINED**2 * variances[1]


def _updated(explanation: Explanation, log: Log) -> tuple[Body, Array]:
    """The posterior as a body, and held-out residuals (n, m) [unit]."""
    reference = explanation.reference
    old = reference.body
    noise = explanation.noise * reference.sizes
    second = old.second
    if second is not None:  # after the same log
        apart = second.beta - old.beta
        wide = replace(
            old,
            beta=second.beta,
            active=second.active,
            root=second.root,
            kappa=1.0,
        )
        there = replace(reference, body=wide, beta=reference.beta + apart)
        wider, _ = _posterior(
            replace(
                explanation, reference=there, beta=explanation.beta + apart
            ),
            log,
        )
        second = Second(
            wider.beta,
            wider.active,
            wider.root,
            np.maximum(noise, second.noise),
        )
    posterior, residual = _posterior(explanation, log)
    body = replace(
        old,
        beta=posterior.beta,
        active=posterior.active,
        # the bound inflates by kappa what is kept here without it
        root=posterior.root / old.kappa,
        kappa=max(old.kappa, SIMULATED_KAPPA) if old.simulated else old.kappa,
        noise=noise,
        residual=np.maximum(
            old.residual, explanation.level.residual * reference.own_sd
        ),
        second=second,
    )
    return body, residual


class _Posterior(NamedTuple):
    """All parameters after a log."""

    beta: Array
    active: Indices
    root: Array


def _posterior(explanation: Explanation, log: Log) -> tuple[_Posterior, Array]:
    """All parameters after a log, and residuals (n, m) of held-out blocks of its rows [unit].

    Parameters and the log's own residual are standard normals times columns.  Without the rows of
    a block the information is a difference: no fit is needed.
    """
    reference = explanation.reference
    structure = reference.structure
    level = explanation.level
    active, prior = prior_columns(reference, level.waves, freed=explanation.sd)
    smooth = own_columns(reference, log, level.residual)
    size = prior.shape[1]
    scale = np.sqrt(explanation.temper) * explanation.noise * reference.sizes
    beta = explanation.beta
    moved = (beta - reference.beta)[active]
    normals = np.linalg.lstsq(prior, moved, rcond=1e-12)[0]
    step = np.zeros(size)
    least = np.inf
    n, outputs = log.z.shape
    weight = np.ones(n * outputs)  # root of that of each number
    for _ in range(UPDATING.steps):
        full = np.zeros(structure.size)
        full[active] = prior @ step
        there = structure.retract(beta, full)
        predicted, x = structure.linearise(log.q, there, active)
        shared = shared_columns(reference, log, predicted)
        all_columns = np.concatenate([x @ prior, smooth, shared], axis=2)
        all_columns = (all_columns / scale[:, None]).reshape(n * outputs, -1)
        away = structure.residual(log.z, predicted) / scale
        # what the log's own residual does not follow is Student's
        own = all_columns[:, size:] * weight[:, None]
        follows = Factor(own.T @ own + np.eye(own.shape[1]))
        followed = follows.solve(own.T @ (weight * away.ravel()))
        rest = away.ravel() - all_columns[:, size:] @ followed
        square = explanation.temper * (rest.reshape(n, -1) ** 2).sum(axis=1)
        energy = (STUDENT + outputs) * np.log1p(square / STUDENT).sum()
        cost = float(energy) / explanation.temper + float(followed @ followed)
        cost += float(((normals + step) ** 2).sum())
        if not cost < least:
            step = UPDATING.shorter * step
            continue
        beta = there
        normals = normals + step
        least = cost
        root = np.sqrt((STUDENT + outputs) / (STUDENT + square))
        weight = np.repeat(root, outputs)
        columns = all_columns * weight[:, None]
        y = away.ravel() * weight
        gram = columns.T @ columns
        pull = columns.T @ y
        pull[:size] -= normals  # the log's own part is followed anew
        values, axes = np.linalg.eigh(gram)
        telling = values > UPDATING.telling**2
        along = axes[:, telling].T @ pull / (values[telling] + 1.0)
        step = (axes[:, telling] @ along)[:size]
        if float(pull[:size] @ step) < UPDATING.nothing_left:
            break
    gram[np.diag_indices(len(gram))] += 1.0
    inverse = Factor(gram).inverse()[:size, :size]
    covariance = prior @ inverse @ prior.T
    residual = np.empty_like(y)
    for block in np.array_split(np.arange(n), UPDATING.blocks):
        rows = slice(block[0] * outputs, (block[-1] + 1) * outputs)
        x = columns[rows]
        others = Factor(gram - x.T @ x)
        delta = others.solve(pull - x.T @ y[rows])
        residual[rows] = y[rows] - x[:, :size] @ delta[:size]
    posterior = _Posterior(beta, active, root_of(covariance))
    return posterior, (residual / weight).reshape(n, -1) * scale
