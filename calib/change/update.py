"""Updating: the belief after a log, under the change that explains it best.

The belief is judged by contiguous blocks of rows, each predicted from the others.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from operator import attrgetter

import numpy as np

from ..body.belief import Body
from ..body.body_fit import fit
from ..body.covariance import RADIUS_95
from ..body.parameters import Indices
from ..body.planar import PlanarStructure
from ..body.rows import Rows
from ..body.spatial import SpatialStructure
from ..common.arrays import Array
from ..common.rows import row_lengths, spread_rows
from .causes import CREEP_WAVES
from .evidence import Evidence, tool_turn
from .explain import MARGIN, SEARCH
from .explanation import POSTERIOR, Explanation, Posterior, with_least_waves
from .noise import NOISIER, usual_noise
from .significance import BEYOND


@dataclass(frozen=True)
class UpdateSettings:
    """How a belief is updated."""

    # most rows of an update, whose time is linear in them
    rows: int = 600
    # most rows that are fitted as training fits them: of 10,719 of series A all are as good within
    # .2 %
    rows_of_training: int = 2000
    # size of a log's own residual, times the usual one: with that alone 40 rows of
    # another mounting made errors elsewhere 1.25 times as large
    residual_scale: float = 4.0
    # score from which a change is beyond doubt: then a belief moves as the usual size says, with
    # which windows of 30 and more rows of series C left errors half as large; its bound does not
    clearly: float = 2.0
    # largest share of the held-out error that a change may leave
    changed: float = 0.95
    # the same where nothing changed, also of the error that a belief expects of itself: half of the
    # rows of series A were added to a model of the other, which was then 1.15 times as far off
    refined: float = 0.85
    # the same of a log within which something changed: a sensor that was moved by metres, and by
    # .2 mm along the log, is better known where it is
    within: float = 0.1
    # standard errors by which the held-out blocks must gain
    sure: float = 2.0


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
    # the belief without the doubt of elsewhere, which the rows rule out near them
    at_rows: Body | None = None

    @property
    def after(self) -> Array:
        """Their distances from the updated belief (k,) [unit]."""
        return row_lengths(self.residual)


def update(evidence: Evidence, *, learn: bool) -> Update:
    """Update a belief by the rows of a log.

    learn : whether the best belief is wanted, or whether there is a better one than before
    """
    explanation = _basis(evidence)
    best = _update_by_posterior(evidence, explanation)
    if (learn or not best.improved) and _is_trainable(evidence, explanation):
        trained = _update_by_training(evidence, explanation)
        is_nearer = trained.after.mean() < best.after.mean()
        if is_nearer and (trained.improved or not best.improved):
            best = trained
    if evidence.tool.score > 1.0 and evidence.step is None:
        best = _with_tool(evidence, best)
    return best


def _update(
    evidence: Evidence,
    explanation: Explanation,
    body: Body,
    rows: Indices,
    residual: Array,
) -> Update:
    """An update, with whether it is better by rows (k,) of the log, of residuals (k, m) [unit]."""
    before = evidence.rows.distance[rows]
    return Update(
        body=body,
        explanation=explanation,
        rows=rows,
        before=before,
        residual=residual,
        improved=_is_better(evidence, body, before, row_lengths(residual)),
    )


def _basis(evidence: Evidence) -> Explanation:
    """The best explanation; where nothing is blamed that of no change, which widens the bound."""
    explanations = evidence.explanations
    if not evidence.is_attributed:
        explanations = tuple(e for e in explanations if not e.causes)
    return with_least_waves(explanations)


def _update_by_posterior(
    evidence: Evidence, explanation: Explanation
) -> Update:
    """The posterior of the parameters under an explanation, with a bound that the rows confirm."""
    rows = spread_rows(len(evidence.rows), UPDATING.rows)
    observations = evidence.observations.some(UPDATING.rows)
    usual = Posterior(explanation, observations, 1.0)
    likeliest = usual
    if not evidence.is_attributed:
        larger = Posterior(explanation, observations, UPDATING.residual_scale)
        likeliest = max(usual, larger, key=attrgetter("evidence"))
    # how unsure the belief is the evidence says, how far it moves beside a clear change does not
    is_clear = evidence.is_attributed or evidence.score > UPDATING.clearly
    posterior = usual if is_clear else likeliest
    body = replace(likeliest.body, beta=posterior.body.beta)
    # of play that was taken up no model knows
    logged = evidence.rows.q[rows]
    residual = posterior.cross_residual()
    residual += body.predict(observations.q) - body.predict(logged)
    missed = row_lengths(residual)
    at_rows = None
    if evidence.score > 1.0:
        at_rows = _with_sound_bound(body, logged, missed)
        body = _as_uncertain(body, explanation, evidence)
    body = _with_sound_bound(body, logged, missed)
    update = _update(evidence, explanation, body, rows, residual)
    return replace(update, at_rows=at_rows)


def _with_tool(evidence: Evidence, belief: Update) -> Update:
    """An update with the tool turned, or the tool turned alone where it is no better."""
    log = evidence.rows
    if not belief.improved:
        rows = spread_rows(len(log), UPDATING.rows)
        residual = (log.x - log.predicted)[rows]
        belief = _update(
            evidence, belief.explanation, evidence.prior, rows, residual
        )
    body = belief.body
    tool = tool_turn(log, evidence.reference.structure, body.beta)
    at_rows = None if belief.at_rows is None else tool.of(belief.at_rows)
    return replace(belief, body=tool.of(body), at_rows=at_rows, improved=True)


def _is_better(
    evidence: Evidence, body: Body, before: Array, after: Array
) -> bool:
    """Whether held-out rows gain by more than chance, and by the share that is needed.

    before, after : distances (k,) from the model, and from the updated belief [unit]
    """
    if evidence.is_one_place:
        return False
    within = UPDATING.within * float(before.mean())
    if evidence.step is not None and after.mean() > within:
        return False
    changed = evidence.score > 1.0
    gain = before - after
    share = UPDATING.changed if changed else UPDATING.refined
    needed = max(_chance(gain), (1.0 - share) * float(before.mean()))
    gains = evidence.is_explained and float(gain.mean()) > needed
    if changed or not gains:
        return gains
    # rows of an arm that did not change made a model of half of series A worse by 1.15
    return evidence.tests.noisy is None and _is_surer(evidence, body)


def _chance(gain: Array) -> float:
    """What the mean of gains (k,) by rows may be by chance, as contiguous blocks differ [unit]."""
    blocks = np.array_split(gain, POSTERIOR.blocks)
    means = np.array([block.mean() for block in blocks])
    return (
        UPDATING.sure * float(means.std(ddof=1)) / math.sqrt(POSTERIOR.blocks)
    )


def _is_trainable(evidence: Evidence, explanation: Explanation) -> bool:
    """Whether rows may be fitted as training does, without the old belief's posterior.

    What is known of the change, or of all rows together, such a fit does not ask.
    """
    reference = evidence.reference
    structure = reference.structure
    if reference.has_discrete_cause or evidence.cause is not None:
        return False
    if evidence.observations.shared:
        return False
    if isinstance(structure, PlanarStructure):
        # Waves of joints that nobody measured mean: no arm as drawn; along a line, or in
        # a corner, they would be taken for all else.
        return (
            evidence.score > 1.0
            and evidence.prior.simulated
            and explanation.wave_size > CREEP_WAVES
            and evidence.rows.widespread
        )
    # Without a drawing few rows leave a posterior that is curved: from 30 rows of series C an
    # update with 300 left an error of .70 mm, where training has .20.
    is_open = isinstance(structure, SpatialStructure) and not structure.informed
    return is_open and evidence.score <= 1.0


def _update_by_training(evidence: Evidence, explanation: Explanation) -> Update:
    """The belief of training: its members by held-out rows, noise and scales by evidence.

    A simulation tells neither how noisy the sensor is nor how large the waves of the joints are.
    """
    structure = explanation.reference.structure
    if isinstance(structure, PlanarStructure):
        structure = structure.with_fields(simulated=False)
    observations = evidence.observations
    rows = spread_rows(len(observations), UPDATING.rows_of_training)
    measured = [Rows(observations.q[rows], observations.x[rows])]
    fitted = fit(structure, measured, begin=explanation.beta)
    return _update(evidence, explanation, fitted.body, rows, fitted.held_out)


def _as_uncertain(body: Body, best: Explanation, evidence: Evidence) -> Body:
    """The belief with how far explanations are apart that the evidence does not rule out.

    Rows of a joint that did not move, or in a corner, hardly separate lengths from offsets: one of
    them alone was wrong by 2 mm elsewhere, under a bound of .5 mm.  Two causes pay twice for their
    number: of those within 3 nats alone bounds in corners covered 40 %.  Where a change without a
    name is as likely, or a corner's rows scatter more than usual beside the best explanation, the
    arm may be elsewhere as it was, or as far off as at the rows: with a lens 62 % were covered.
    """
    greatest = evidence.best.evidence
    least = greatest - SEARCH.nats_near
    near = [
        other
        for other in evidence.explanations
        if other.reference is best.reference and other.evidence > least
    ]
    differences = [other.beta - best.beta for other in near]
    if evidence.unnamed > greatest - MARGIN:
        differences.append(best.reference.beta - body.beta)
    usual = usual_noise(best.reference)
    is_all = evidence.is_attributed and best.noise < NOISIER * usual
    is_unknown = not (is_all or evidence.rows.widespread)
    if is_unknown or evidence.unnamed > greatest:
        # in the frame of the log: that of a sensor that was put elsewhere is known
        observations = evidence.observations
        reference = best.reference
        expected = reference.structure.predict(observations.q, reference.beta)
        missed = reference.structure.residual(observations.x, expected)
        size = np.sqrt((missed**2).mean(axis=0))
        body = replace(body, residual=np.maximum(body.residual, size))
    if not differences:
        return body
    apart = np.stack(differences)
    changed = np.flatnonzero(apart.any(axis=0))
    # each may be as likely as the best
    scaled = apart[:, changed] / (math.sqrt(2.0) * body.kappa)
    doubt = scaled.T @ scaled
    if evidence.rows.widespread:
        doubt = _uncontradicted(body, scaled, changed, evidence.rows.q)
    return body.with_covariance(changed, doubt)


def _uncontradicted(
    body: Body, differences: Array, changed: Indices, q: Array
) -> Array:
    """Covariance (p, p) of differences (r, p) of parameters (p,), as far as rows allow them.

    All rows q (n, dof) count for one whose error is that of the body's bound: what moves each of
    them by more is ruled out, be it what an arm as built may hide.
    """
    _, slope = body.structure.linearise(q, body.beta, changed)
    positions = slice(body.structure.blocks[0])
    usual_error = body.bound(q)[:, None, None] / RADIUS_95
    moves = slope[:, positions] @ differences.T / usual_error
    contradiction = np.einsum("nmi,nmj->ij", moves, moves) / len(q)
    remaining = np.linalg.inv(np.eye(len(differences)) + contradiction)
    covariance: Array = differences.T @ remaining @ differences
    return covariance


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
        variance = float(np.einsum("nii->n", spread).mean())
        variances.append(variance * old.kappa**2 + unexplained)
    return variances[0] < UPDATING.refined**2 * variances[1]
