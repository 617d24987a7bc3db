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
from .explain import Explanation, least_residual
from .frame import Reference
from .settings import CHANGED, CREEP, REFINED, SIMULATED_KAPPA, SURE
from .system import Log, own_columns, prior_columns, shared_columns


@dataclass(frozen=True)
class UpdateSettings:
    """How a belief is updated."""

    # that an update takes: linear in them
    rows: int = 600
    # contiguous ones that are held out in turn, each of which tells a gain
    blocks: int = 5
    # at most: along the gauge of an arm without a drawing 12 ended on the way
    steps: int = 60
    # nats by which a step must better the fit
    nothing_left: float = 1e-3
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
    rows = np.flatnonzero(evidence.sound)
    rows = rows[thinned(len(rows), UPDATING.rows)]
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
    explanations = tuple(each for each in explanations if not each.causes)
    if evidence.score > 1.0 or evidence.prior.simulated:
        return least_residual(explanations)
    # with free waves 40 rows of another mounting made an error 1.2 times as large elsewhere, and
    # with the least residual that the evidence allows 1.12 times
    return next(each for each in explanations if each.level.waves <= CREEP)


def _is_surer(evidence: Evidence, body: Body) -> bool:
    """Whether a belief expects errors of itself that are smaller than those of the old one."""
    old = evidence.prior
    unexplained = float((old.tau**2 + old.noise**2).sum())
    variances = []
    for belief in (body, old):
        spread = np.trace(
            belief.spread(evidence.rows.probes), axis1=1, axis2=2
        ).mean()
        variances.append(float(spread) * old.kappa**2 + unexplained)
    return variances[0] < REFINED**2 * variances[1]


def _updated(explanation: Explanation, log: Log) -> tuple[Body, Array]:
    """The posterior as a body, and held-out residuals (n, m) [unit]."""
    reference = explanation.reference
    old = reference.body
    posterior = _Posterior(explanation, log)
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
        wider = _Posterior(
            replace(
                explanation, reference=there, beta=explanation.beta + apart
            ),
            log,
        )
        root = root_of(wider.covariance)
        second = Second(
            wider.beta, wider.active, root, np.maximum(noise, second.noise)
        )
    body = replace(
        old,
        beta=posterior.beta,
        active=posterior.active,
        # the bound inflates by kappa what is kept here without it
        root=root_of(posterior.covariance) / old.kappa,
        kappa=max(old.kappa, SIMULATED_KAPPA) if old.simulated else old.kappa,
        noise=noise,
        residual=np.maximum(
            old.residual, explanation.level.residual * reference.own_sd
        ),
        second=second,
    )
    return body, posterior.held_out()


class _Posterior:
    """All parameters after Gauss-Newton steps from where an explanation ended.

    Attributes
    ----------
    beta, active, covariance : (d,), (k,) and (k, k)
        Parameters, which of them are known, and how well.
    """

    def __init__(self, explanation: Explanation, log: Log) -> None:
        self.reference: Reference = explanation.reference
        self.log = log
        self.beta = explanation.beta
        scale = np.sqrt(explanation.temper) * explanation.noise
        self.weight = 1.0 / (scale * self.reference.sizes)
        self.active, prior = prior_columns(
            self.reference, explanation.level.waves, freed=explanation.sd
        )
        self.smooth = own_columns(
            self.reference, log, explanation.level.residual
        )
        ways = prior @ _telling(self._columns(prior), UPDATING.telling)
        away = (self.beta - self.reference.beta)[self.active]
        normals = np.asarray(np.linalg.lstsq(ways, away, rcond=1e-12)[0])
        normals = self._descend(ways, normals)
        # what is known after the last step, along all ways that any row tells of
        directions = _telling(self._columns(prior), 0.0)
        self.normals = (
            directions.T
            @ np.linalg.lstsq(prior, ways @ normals, rcond=1e-12)[0]
        )
        ways = prior @ directions
        self.y, smooth, _ = self._state(self.beta, self.normals)
        self.columns = np.concatenate([self._columns(ways), smooth], axis=1)
        size = len(self.normals)
        known = (
            np.eye(size) - Factor(_with_ones(self.gram)).inverse()[:size, :size]
        )
        self.covariance = prior @ prior.T - ways @ known @ ways.T

    @property
    def gram(self) -> Array:
        """Information (k, k) of all rows."""
        return np.asarray(self.columns.T @ self.columns)

    def _whitened(self, columns: Array) -> Array:
        return np.asarray(
            (columns * self.weight[:, None]).reshape(self.log.z.size, -1)
        )

    def _columns(self, ways: Array) -> Array:
        """Whitened columns (N, k) of parameters along ways (d, k)."""
        x = self.reference.structure.linearise(
            self.log.q, self.beta, self.active
        )[1]
        return self._whitened(x @ ways)

    def _state(self, beta: Array, normals: Array) -> tuple[Array, Array, float]:
        """Whitened residuals (N,), columns (N, s) of what the rows share, and the cost [nats]."""
        structure = self.reference.structure
        with np.errstate(all="ignore"):
            predicted = structure.predict(self.log.q, beta)
            y = (
                structure.residual(self.log.z, predicted) * self.weight
            ).ravel()
            shared = shared_columns(self.reference, self.log, predicted)
        smooth = self._whitened(np.concatenate([self.smooth, shared], axis=2))
        if not np.isfinite(y).all():
            return y, smooth, np.inf
        pull = smooth.T @ y
        follows = pull @ Factor(_with_ones(smooth.T @ smooth)).solve(pull)
        return y, smooth, 0.5 * float(y @ y - follows + normals @ normals)

    def _descend(self, ways: Array, normals: Array) -> Array:
        """Step along ways (d, k) until no step is better; return the standard normals (k,)."""
        y, smooth, cost = self._state(self.beta, normals)
        size = len(normals)
        for _ in range(UPDATING.steps):
            columns = np.concatenate([self._columns(ways), smooth], axis=1)
            pull = columns.T @ y
            pull[:size] -= (
                normals  # the log's own part is followed anew in each step
            )
            delta = Factor(_with_ones(columns.T @ columns)).solve(pull)[:size]
            for share in 0.3 ** np.arange(6.0):
                full = np.zeros(len(self.beta))
                full[self.active] = ways @ (share * delta)
                beta = self.reference.structure.retract(self.beta, full)
                state = self._state(beta, normals + share * delta)
                if state[-1] < cost - UPDATING.nothing_left:
                    break
            else:
                break
            self.beta = beta
            normals = normals + share * delta
            y, smooth, cost = state
        return normals

    def held_out(self) -> Array:
        """Residuals (n, m) [unit] of contiguous blocks of rows, each predicted by the others.

        Without the block's rows the information is a difference: no fit is needed.
        """
        size = len(self.normals)
        gram = _with_ones(self.gram)
        pull = self.columns.T @ self.y
        pull[:size] -= self.normals
        residual = np.empty_like(self.y)
        outputs = self.log.z.shape[1]
        for block in np.array_split(
            np.arange(len(self.log.z)), UPDATING.blocks
        ):
            rows = slice(block[0] * outputs, (block[-1] + 1) * outputs)
            x = self.columns[rows]
            delta = Factor(gram - x.T @ x).solve(pull - x.T @ self.y[rows])
            residual[rows] = self.y[rows] - x[:, :size] @ delta[:size]
        return np.asarray(residual.reshape(self.log.z.shape) / self.weight)


def _with_ones(gram: Array) -> Array:
    """Information (k, k) of standard normals, in place."""
    gram[np.diag_indices(len(gram))] += 1.0
    return gram


def _telling(x: Array, least: float) -> Array:
    """Ways (k, r) of standard normals along which readings tell more than `least` noises.

    x : (N, k), columns of the whitened readings
    """
    _, sizes, ways = np.linalg.svd(x, full_matrices=False)
    return np.asarray(ways[sizes > least].T)
