"""Updating: a belief under the change that explains a log best, judged by rows that were held out.

The prior is the old posterior, inflated as its bound is, with the freed parameters loosened.  A
residual of this log alone is a part of the fit; its size stays in the new bound.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..body.belief import Body
from ..body.body_fit import fit
from ..body.covariance import RADIUS_95, root_of
from ..body.drawing import PlanarDrawing
from ..body.normal import Factor
from ..body.parameters import Indices
from ..body.planar import PlanarStructure
from ..body.rows import Rows
from ..common.arrays import Array
from ..common.rows import row_lengths, spread_rows
from .evidence import Evidence
from .explain import SEARCH
from .explanation import Explanation, Place, climb, with_least_waves
from .settings import BEYOND, CREEP, UPDATING
from .system import Log, frame_columns, prior_columns, residual_columns


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
        return row_lengths(self.residual)


class _Belief(NamedTuple):
    """A belief after a log, with the rows that it was judged by."""

    body: Body
    rows: Indices  # (k,), of the log
    residual: Array  # (k, m), of these rows where they were held out [unit]


def update(evidence: Evidence, *, learn: bool) -> Update:
    """Update a belief by the rows of a log.

    learn : whether the best belief is wanted, or whether there is a better one than before
    """
    explanation = _basis(evidence)
    rows = spread_rows(len(evidence.rows), UPDATING.rows)
    log = evidence.data.some(UPDATING.rows)
    body, residual = _posterior_belief(explanation, log)
    # of play that was taken up no model knows
    logged = evidence.rows.q[rows]
    residual += body.predict(log.q) - body.predict(logged)
    if evidence.is_attributed:
        body = _as_uncertain(body, explanation, evidence.explanations)
    body = _with_sound_bound(body, logged, row_lengths(residual))
    belief = _Belief(body, rows, residual)
    improved = _is_better(evidence, belief)
    if (learn or not improved) and _is_trainable(evidence, explanation):
        trained = _belief_of_training(explanation, evidence.data)
        missed = row_lengths(trained.residual)
        if missed.mean() < row_lengths(residual).mean():
            belief = trained
            improved = _is_better(evidence, belief)
    if evidence.tool.score > 1.0:
        if not improved:  # the tool alone
            belief = _as_it_was(evidence)
        tool = evidence.tool_beside(belief.body.beta)
        belief = belief._replace(body=tool.of(belief.body))
        improved = True
    return Update(
        body=belief.body,
        explanation=explanation,
        rows=belief.rows,
        before=evidence.rows.distance[belief.rows],
        residual=belief.residual,
        improved=improved,
    )


def _as_it_was(evidence: Evidence) -> _Belief:
    """The belief before the log, judged by the rows as the model predicts them."""
    rows = spread_rows(len(evidence.rows), UPDATING.rows)
    measured = evidence.rows.x - evidence.rows.predicted
    return _Belief(evidence.prior, rows, measured[rows])


def _is_better(evidence: Evidence, belief: _Belief) -> bool:
    """Whether held-out rows gain by more than chance, and by the share that is needed."""
    changed = evidence.score > 1.0
    before = evidence.rows.distance[belief.rows]
    gain = before - row_lengths(belief.residual)
    share = UPDATING.changed if changed else UPDATING.refined
    needed = max(_chance(gain), (1.0 - share) * float(before.mean()))
    gains = evidence.is_explained and float(gain.mean()) > needed
    if changed or not gains:
        return gains
    # rows of an arm that did not change made a model of half of series A worse by 1.15
    return evidence.tests.noisy is None and _is_surer(evidence, belief.body)


def _chance(gain: Array) -> float:
    """What the mean of gains (k,) by rows may be by chance, as contiguous blocks differ [unit]."""
    blocks = np.array_split(gain, UPDATING.blocks)
    means = np.array([block.mean() for block in blocks])
    return UPDATING.sure * float(means.std(ddof=1)) / math.sqrt(UPDATING.blocks)


def _is_trainable(evidence: Evidence, explanation: Explanation) -> bool:
    """Whether rows may be fitted as training does: in the plane, of an arm that nobody measured.

    Waves of its joints say that it is no arm as drawn; along a line, or in a corner, they would be
    taken for all else.  What is known of the change, or of all rows together, such a fit does not
    ask.
    """
    return (
        evidence.score > 1.0
        and evidence.prior.simulated
        and explanation.waves > CREEP
        and evidence.rows.widespread
        and isinstance(evidence.reference.structure, PlanarStructure)
        and not evidence.reference.new
        and evidence.cause is None
        and not evidence.data.shared
    )


def _belief_of_training(explanation: Explanation, log: Log) -> _Belief:
    """The belief of training: its members by held-out rows, noise and scales by evidence.

    The old belief is its drawing.  A simulation tells neither how noisy the sensor is nor how
    large the waves of the joints are.
    """
    reference = explanation.reference
    structure = reference.structure
    assert isinstance(structure, PlanarStructure)  # noqa: S101 - such rows are trainable
    old = reference.body.beta
    groups = structure.groups
    drawing = PlanarDrawing(
        lengths=tuple(old[groups["length"]].tolist()),
        offsets=tuple(old[groups["offset"]].tolist()),
        rotation=float(old[groups["view.rotation"]][0]),
        shift=tuple(old[groups["view.shift"]].tolist()),
        mirror=structure.mirror,
        signs=structure.signs,
    )
    structure = structure.with_fields(nominal=drawing, simulated=False)
    rows = spread_rows(len(log.q), UPDATING.rows_of_training)
    measured = [Rows(log.q[rows], log.z[rows])]
    fitted = fit(structure, measured, begin=explanation.beta)
    return _Belief(fitted.body, rows, fitted.held_out)


def _basis(evidence: Evidence) -> Explanation:
    """The best explanation; where nothing is blamed that of no change, which widens the bound."""
    explanations = evidence.explanations
    if evidence.is_attributed:
        return with_least_waves(explanations)
    explanations = tuple(some for some in explanations if not some.causes)
    if evidence.score > 1.0 or evidence.prior.simulated:
        return with_least_waves(explanations)
    # with free waves 40 rows of another mounting made an error 1.2 times as large elsewhere
    return next(some for some in explanations if some.waves <= CREEP)


def _as_uncertain(
    body: Body, best: Explanation, explanations: Sequence[Explanation]
) -> Body:
    """The belief with how far explanations are apart that the evidence does not rule out.

    Rows of a joint that did not move, or in a corner, hardly tell lengths from offsets: one of
    them alone was wrong by 2 mm elsewhere, under a bound of .5 mm.  Two causes pay twice for their
    number: of those within 3 nats alone bounds in corners covered 40 %.
    """
    least = max(some.evidence for some in explanations) - SEARCH.near
    beside = [
        some
        for some in explanations
        if some.reference is best.reference and some.evidence > least
    ]
    apart = np.stack([some.beta - best.beta for some in beside])
    active = np.union1d(body.active, np.flatnonzero(apart.any(axis=0)))
    # each may be as likely as the best
    scaled = apart[:, active] / (math.sqrt(2.0) * body.kappa)
    covariance = scaled.T @ scaled
    place = np.searchsorted(active, body.active)
    covariance[np.ix_(place, place)] += body.covariance
    return replace(body, active=active, root=root_of(covariance))


def _with_sound_bound(body: Body, q: Array, missed: Array) -> Body:
    """The belief with a bound that rows (k, dof) do not contradict, of held-out distances (k,).

    What is known of a change may be wrong: a link that is longer is no lens.
    """
    if np.mean(missed > body.bound(q)) <= BEYOND:
        return body
    residual = float(np.quantile(missed, 0.95)) / RADIUS_95
    return replace(body, residual=np.maximum(body.residual, residual))


def _is_surer(evidence: Evidence, body: Body) -> bool:
    """Whether a belief expects errors of itself that are smaller than those of the old one."""
    old = evidence.prior
    unexplained = float((old.tau**2 + old.noise**2).sum())
    variances = []
    for belief in (body, old):
        spread = belief.spread(evidence.rows.probes)
        own = float(np.einsum("nii->n", spread).mean())
        variances.append(own * old.kappa**2 + unexplained)
    return variances[0] < UPDATING.refined**2 * variances[1]


def _posterior_belief(explanation: Explanation, log: Log) -> tuple[Body, Array]:
    """The posterior as a body, and held-out residuals (n, m) [unit]."""
    reference = explanation.reference
    old = reference.body
    posterior = _Posterior(explanation, log)
    kappa = old.kappa
    if old.simulated:
        kappa = max(kappa, UPDATING.simulated_kappa)
    body = replace(
        old,
        beta=posterior.place.beta,
        active=posterior.active,
        # the bound inflates by kappa what is kept here without it
        root=posterior.root / old.kappa,
        kappa=kappa,
        noise=explanation.noise * reference.sizes,
        residual=np.maximum(old.residual, reference.residual_sd),
        second=None,
    )
    return body, posterior.cross_residual()


@dataclass(frozen=True, eq=False)
class _PlaceOfRows(Place):
    """Where all parameters may be; about it the rows are linear, rest = A du + e.

    The first normals u say what the belief does not know, the others what the log has of its own.
    """

    columns: Array  # (n m, k), A
    rest: Array  # (n m,), residuals less what the log has of its own


class _Posterior:
    """All parameters after a log, beside a smooth residual of the log's own."""

    def __init__(self, explanation: Explanation, log: Log) -> None:
        reference = explanation.reference
        structure = reference.structure
        self.reference = reference
        self.log = log
        # [unit], of one number of each output
        self.scale = (
            math.sqrt(explanation.temper) * explanation.noise * reference.sizes
        )
        self.active, self.prior = prior_columns(
            reference, explanation.waves, freed=explanation.sd
        )
        self.size = self.prior.shape[1]
        # which the bound inflates, too
        smooth = residual_columns(reference, log) / reference.body.kappa
        predicted = structure.predict(log.q, explanation.beta)
        shared = frame_columns(reference, log, predicted)
        self.own = np.concatenate([smooth, shared], axis=2)
        start = np.zeros(self.size + self.own.shape[2])
        change = (explanation.beta - reference.beta)[self.active]
        start[: self.size] = np.linalg.pinv(self.prior, rcond=1e-12) @ change
        self.place = climb(
            self._place, start, most=UPDATING.steps, enough=UPDATING.enough
        )

    def _place(self, normals: Array) -> _PlaceOfRows | None:
        """Compare the rows with normals (k,), None without a prediction."""
        structure = self.reference.structure
        step = np.zeros(structure.size)
        step[self.active] = self.prior @ normals[: self.size]
        beta = structure.retract(self.reference.beta, step)
        with np.errstate(all="ignore"):
            predicted, moves = structure.linearise(
                self.log.q, beta, self.active
            )
            residual = structure.residual(self.log.z, predicted)
        if not np.isfinite(residual).all():
            return None
        columns = np.concatenate([moves @ self.prior, self.own], axis=2)
        columns /= self.scale[:, None]
        columns = columns.reshape(residual.size, -1)
        rest = (residual / self.scale).ravel()
        rest -= columns[:, self.size :] @ normals[self.size :]
        return _PlaceOfRows(
            normals=normals,
            beta=beta,
            fit=-0.5 * float(rest @ rest + normals @ normals),
            gradient=columns.T @ rest - normals,
            precision=columns.T @ columns + np.eye(len(normals)),
            columns=columns,
            rest=rest,
        )

    @property
    def root(self) -> Array:
        """Root (p, r) of the posterior covariance of the active parameters."""
        inverse = Factor(self.place.precision).inverse()
        of_parameters = inverse[: self.size, : self.size]
        return root_of(self.prior @ of_parameters @ self.prior.T)

    def cross_residual(self) -> Array:
        """Residuals (n, m) of blocks of rows that are left out in turn [unit].

        Without the rows of a block the information is a difference: no fit is needed.
        """
        place = self.place
        values = place.rest + place.columns @ place.normals
        moments = place.columns.T @ values
        residual = np.empty_like(self.log.z)
        for block in np.array_split(np.arange(len(residual)), UPDATING.blocks):
            outputs = residual.shape[1]
            rows = slice(block[0] * outputs, (block[-1] + 1) * outputs)
            x = place.columns[rows]
            y = values[rows]
            others = Factor(place.precision - x.T @ x)
            normals = others.solve(moments - x.T @ y)
            rest = y - x[:, : self.size] @ normals[: self.size]
            residual[block] = rest.reshape(-1, outputs)
        return residual * self.scale
