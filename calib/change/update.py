"""Updating: the belief after a log, under the change that explains it best.

Contiguous blocks of rows, each predicted from the others, show whether it is better than before.
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
from .noise import NOISE_RATIO, usual_noise
from .significance import MOST_BEYOND


@dataclass(frozen=True)
class UpdateSettings:
    """How a belief is updated."""

    # most rows of an update, whose time is linear in them
    rows: int = 600
    # most rows of a fit as in training: all 10,719 of series A are as good within .2 %
    rows_of_training: int = 2000
    # size of a larger smooth residual, over the usual one: with the usual one alone 40 rows of
    # another mounting made errors elsewhere 1.25 times as large
    residual_scale: float = 4.0
    # score from which a change is beyond doubt: the parameters then follow the usual residual,
    # which halved the errors of windows of 30 and more rows of series C; the bound does not
    beyond_doubt: float = 2.0
    # largest share of the held-out error that may be left where something changed
    after_change: float = 0.95
    # the same share where nothing changed, also of the error that a belief expects: half of the
    # rows of series A, added to a model of the other half, made that 1.15 times worse
    after_refinement: float = 0.85
    # the same share where something changed within the log: a sensor that was moved by metres, and
    # by .2 mm along the log, is better known at its new place
    after_step: float = 0.1
    # standard errors by which the held-out blocks must gain
    sure: float = 2.0


UPDATE = UpdateSettings()


@dataclass(frozen=True, eq=False)
class Update:
    """A belief updated by the rows of a log, judged by held-out rows."""

    body: Body
    explanation: Explanation  # the explanation that the belief assumes
    rows: Indices  # (k,), held-out rows of the log
    before: Array  # (k,), distances of these rows from the model [unit]
    # (k, m), their residuals from the updated belief [unit]
    residual: Array
    improved: bool  # whether they are predicted better than before
    # the belief near the rows, which rule out other explanations there
    at_rows: Body | None = None

    @property
    def after(self) -> Array:
        """Distances (k,) of the held-out rows from the updated belief [unit]."""
        return row_lengths(self.residual)


def update(evidence: Evidence, *, learn: bool) -> Update:
    """Update a belief by the rows of a log.

    learn : whether to return the best belief, rather than the first one better than before
    """
    explanation = _explanation_for_update(evidence)
    best = _update_by_posterior(evidence, explanation)
    if (learn or not best.improved) and _is_trainable(evidence, explanation):
        trained = _update_by_training(evidence, explanation)
        is_nearer = trained.after.mean() < best.after.mean()
        if is_nearer and (trained.improved or not best.improved):
            best = trained
    if evidence.tool.score > 1.0 and evidence.step is None:
        best = _with_tool(evidence, best)
    return best


def _judged_update(
    evidence: Evidence,
    explanation: Explanation,
    body: Body,
    rows: Indices,
    residual: Array,
    at_rows: Body | None = None,
) -> Update:
    """The update to a body, judged by held-out rows (k,) with residuals (k, m) [unit]."""
    before = evidence.rows.distance[rows]
    return Update(
        body=body,
        explanation=explanation,
        rows=rows,
        before=before,
        residual=residual,
        improved=_is_better(evidence, body, before, row_lengths(residual)),
        at_rows=at_rows,
    )


def _explanation_for_update(evidence: Evidence) -> Explanation:
    """The best explanation; without a clear cause that of no change, which widens the bound."""
    explanations = evidence.explanations
    if not evidence.is_attributed:
        explanations = tuple(e for e in explanations if not e.causes)
    return with_least_waves(explanations)


def _update_by_posterior(
    evidence: Evidence, explanation: Explanation
) -> Update:
    """The update by the posterior under an explanation, with a bound that the rows confirm."""
    rows = spread_rows(len(evidence.rows), UPDATE.rows)
    observations = evidence.observations.at_most(UPDATE.rows)
    usual = Posterior(explanation, observations, 1.0)
    likeliest = usual
    if not evidence.is_attributed:
        larger = Posterior(explanation, observations, UPDATE.residual_scale)
        likeliest = max(usual, larger, key=attrgetter("log_evidence"))
    # the likelier residual gives the covariance; after a clear change the usual one the parameters
    is_clear = evidence.is_attributed or evidence.score > UPDATE.beyond_doubt
    posterior = usual if is_clear else likeliest
    body = replace(likeliest.body, beta=posterior.body.beta)
    # the new model does not know of a play that the observations are without
    q = evidence.rows.q[rows]
    residual = posterior.cross_residual()
    residual += body.predict(observations.q) - body.predict(q)
    distance = row_lengths(residual)
    at_rows = None
    if evidence.score > 1.0:
        at_rows = _with_sound_bound(body, q, distance)
        body = _as_uncertain(body, explanation, evidence)
    body = _with_sound_bound(body, q, distance)
    return _judged_update(evidence, explanation, body, rows, residual, at_rows)


def _with_tool(evidence: Evidence, best: Update) -> Update:
    """An update with the tool turned, too; where it is no better, with the tool turned alone."""
    log = evidence.rows
    if not best.improved:
        rows = spread_rows(len(log), UPDATE.rows)
        residual = (log.x - log.predicted)[rows]
        best = _judged_update(
            evidence, best.explanation, evidence.prior, rows, residual
        )
    body = best.body
    tool = tool_turn(log, evidence.reference.structure, body.beta)
    at_rows = None if best.at_rows is None else tool.of(best.at_rows)
    return replace(best, body=tool.of(body), at_rows=at_rows, improved=True)


def _is_better(
    evidence: Evidence, body: Body, before: Array, after: Array
) -> bool:
    """Whether held-out rows gain by more than chance, and by the share that is needed.

    before, after : distances (k,) from the model, and from the updated belief [unit]
    """
    if evidence.is_one_place:
        return False
    limit = UPDATE.after_step * float(before.mean())
    if evidence.step is not None and after.mean() > limit:
        return False
    changed = evidence.score > 1.0
    gain = before - after
    share = UPDATE.after_change if changed else UPDATE.after_refinement
    needed = max(_gain_by_chance(gain), (1.0 - share) * float(before.mean()))
    is_gain = evidence.is_explained and float(gain.mean()) > needed
    if changed or not is_gain:
        return is_gain
    # see `UpdateSettings.after_refinement`
    return evidence.tests.noisy_joint is None and _is_surer(evidence, body)


def _gain_by_chance(gain: Array) -> float:
    """Mean gain that may be chance, by how the means of blocks of gains (k,) differ [unit]."""
    blocks = np.array_split(gain, POSTERIOR.blocks)
    means = np.array([block.mean() for block in blocks])
    return UPDATE.sure * float(means.std(ddof=1)) / math.sqrt(POSTERIOR.blocks)


def _is_trainable(evidence: Evidence, explanation: Explanation) -> bool:
    """Whether rows may be fitted as in training, without the old belief's posterior.

    Such a fit ignores the user's stated cause and errors that all rows share, so it is not used
    with either.
    """
    reference = evidence.reference
    structure = reference.structure
    if reference.has_discrete_cause or evidence.cause is not None:
        return False
    if evidence.observations.shared:
        return False
    if isinstance(structure, PlanarStructure):
        # A simulated arm with waves is not as drawn; along a line, or in a corner, waves would be
        # taken for other parameters.
        return (
            evidence.score > 1.0
            and evidence.prior.simulated
            and explanation.wave_size > CREEP_WAVES
            and evidence.rows.widespread
        )
    # Without a drawing the posterior of few rows is curved: 300 rows of series C updated a model of
    # 30 to an error of .70 mm; training on them leaves .20.
    is_open = isinstance(structure, SpatialStructure) and not structure.informed
    return is_open and evidence.score <= 1.0


def _update_by_training(evidence: Evidence, explanation: Explanation) -> Update:
    """The update by a fit as in training, which finds the noise and the sizes of waves anew.

    A simulated model knows neither.
    """
    structure = explanation.reference.structure
    if isinstance(structure, PlanarStructure):
        structure = structure.with_fields(simulated=False)
    observations = evidence.observations
    rows = spread_rows(len(observations), UPDATE.rows_of_training)
    measured = [Rows(observations.q[rows], observations.x[rows])]
    fitted = fit(structure, measured, begin=explanation.beta)
    return _judged_update(
        evidence, explanation, fitted.body, rows, fitted.held_out
    )


def _as_uncertain(body: Body, best: Explanation, evidence: Evidence) -> Body:
    """The belief, its covariance widened by the differences between likely explanations.

    Rows of a joint that did not move, or in a corner, hardly separate lengths from offsets: a wrong
    one was off by 2 mm elsewhere, under a bound of .5 mm.  Two causes cost more evidence than one:
    with explanations within 3 nats alone, bounds in corners covered 40 %.  Where a change without a
    name is as likely, or the rows of a corner are noisier than usual, the arm may be elsewhere as
    it was, or as far off as at the rows: with a lens 62 % were covered.
    """
    greatest = evidence.best.log_evidence
    least = greatest - SEARCH.nats_near
    near = [
        other
        for other in evidence.explanations
        if other.reference is best.reference and other.log_evidence > least
    ]
    differences = [other.beta - best.beta for other in near]
    if evidence.unnamed_log_evidence > greatest - MARGIN:
        differences.append(best.reference.beta - body.beta)
    usual = usual_noise(best.reference)
    explains_all = evidence.is_attributed and best.noise < NOISE_RATIO * usual
    is_unknown = not (explains_all or evidence.rows.widespread)
    if is_unknown or evidence.unnamed_log_evidence > greatest:
        # in the frame of the log, which is known where the sensor was put elsewhere
        observations = evidence.observations
        reference = best.reference
        expected = reference.structure.predict(observations.q, reference.beta)
        misfit = reference.structure.residual(observations.x, expected)
        rms = np.sqrt((misfit**2).mean(axis=0))
        body = replace(body, residual=np.maximum(body.residual, rms))
    if not differences:
        return body
    steps = np.stack(differences)
    changed = np.flatnonzero(steps.any(axis=0))
    # each explanation may be as likely as the best
    steps = steps[:, changed] / (math.sqrt(2.0) * body.kappa)
    covariance = steps.T @ steps
    if evidence.rows.widespread:
        covariance = _uncontradicted(body, steps, changed, evidence.rows.q)
    return body.with_covariance(changed, covariance)


def _uncontradicted(
    body: Body, differences: Array, changed: Indices, q: Array
) -> Array:
    """Covariance (p, p) of differences (r, p) of parameters (p,), as far as the rows allow them.

    The rows q (n, dof) together count as one, with the errors of the body's bound; a difference
    that moves them by more is ruled out.
    """
    _, slope = body.structure.linearise(q, body.beta, changed)
    usual_error = body.bound(q)[:, None, None] / RADIUS_95
    moves = slope[:, body.structure.position] @ differences.T / usual_error
    contradiction = np.einsum("nmi,nmj->ij", moves, moves) / len(q)
    remaining = np.linalg.inv(np.eye(len(differences)) + contradiction)
    covariance: Array = differences.T @ remaining @ differences
    return covariance


def _with_sound_bound(body: Body, q: Array, distance: Array) -> Body:
    """The belief with a bound that held-out distances (k,) of rows (k, dof) do not contradict.

    The cause that a user states may be wrong: a longer link is no lens.
    """
    if np.mean(distance > body.bound(q)) <= MOST_BEYOND:
        return body
    residual = float(np.quantile(distance, 0.95)) / RADIUS_95
    return replace(body, residual=np.maximum(body.residual, residual))


def _is_surer(evidence: Evidence, body: Body) -> bool:
    """Whether a belief expects clearly smaller errors than the old one does."""
    old = evidence.prior
    unexplained = float((old.tau**2 + old.noise**2).sum())
    variances = []
    for belief in (body, old):
        spread = belief.spread(evidence.rows.probes)
        variance = float(np.einsum("nii->n", spread).mean())
        variances.append(variance * old.kappa**2 + unexplained)
    return variances[0] < UPDATE.after_refinement**2 * variances[1]
