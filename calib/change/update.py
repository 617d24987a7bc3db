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

from ..body.belief import Body, Second
from ..body.body_fit import fit
from ..body.covariance import RADIUS_95, root_of
from ..body.drawing import PlanarDrawing
from ..body.normal import Factor
from ..body.parameters import Indices
from ..body.planar import PlanarStructure
from ..body.rows import Rows
from ..body.settings import STUDENT
from ..common.arrays import Array
from ..common.rows import row_lengths, spread_rows
from .evidence import Evidence
from .explain import SEARCH, Explanation, least_residual
from .settings import BEYOND, CREEP, UPDATING
from .system import Log, own_columns, prior_columns, shared_columns


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
    explanation = _to_update_by(evidence)
    rows = spread_rows(len(evidence.rows), UPDATING.rows)
    log = evidence.data.some(UPDATING.rows)
    body, residual = _updated(explanation, log)
    if learn:  # which only the bound of a new model needs
        body = replace(body, second=_second_after(explanation, log))
    if evidence.attributed:
        body = _as_uncertain(body, explanation, evidence.explanations)
    body = _with_sound_bound(body, evidence.rows.q[rows], row_lengths(residual))
    belief = _Belief(body, rows, residual)
    improved = _is_better(evidence, belief)
    if (learn or not improved) and _is_trainable(evidence, explanation):
        trained = _trained(explanation, evidence.data)
        better = row_lengths(residual) - row_lengths(trained.residual[rows])
        if better.mean() > 0.0:
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
        before=evidence.rows.missed[belief.rows],
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
    before = evidence.rows.missed[belief.rows]
    gain = before - row_lengths(belief.residual)
    share = UPDATING.changed if changed else UPDATING.refined
    needed = max(_chance(gain), (1.0 - share) * float(before.mean()))
    gains = evidence.explained and float(gain.mean()) > needed
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
        and explanation.level.waves > CREEP
        and evidence.rows.widespread
        and isinstance(evidence.reference.structure, PlanarStructure)
        and not evidence.reference.new
        and evidence.cause is None
        and not evidence.data.shared
    )


def _trained(explanation: Explanation, log: Log) -> _Belief:
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
    rows = Rows(log.q, log.z)
    fitted = fit(structure, [rows], begin=explanation.beta)
    return _Belief(fitted.body, np.arange(len(rows)), fitted.held_out)


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


def _updated(explanation: Explanation, log: Log) -> tuple[Body, Array]:
    """The posterior as a body, and held-out residuals (n, m) [unit]."""
    reference = explanation.reference
    old = reference.body
    posterior = _Fit(explanation, log).maximise()
    kappa = old.kappa
    if old.simulated:
        kappa = max(kappa, UPDATING.simulated_kappa)
    smooth = explanation.level.residual * reference.own_sd
    body = replace(
        old,
        beta=posterior.beta,
        active=posterior.active,
        # the bound inflates by kappa what is kept here without it
        root=posterior.root / old.kappa,
        kappa=kappa,
        noise=explanation.noise * reference.sizes,
        residual=np.maximum(old.residual, smooth),
        second=None,
    )
    return body, posterior.held_out()


def _second_after(explanation: Explanation, log: Log) -> Second | None:
    """The second belief of a body after the same log, under the same changes."""
    reference = explanation.reference
    old = reference.body
    if old.second is None:
        return None
    apart = old.second.beta - old.beta
    body = replace(
        old,
        beta=old.second.beta,
        active=old.second.active,
        root=old.second.root,
        kappa=1.0,
    )
    there = replace(reference, body=body, beta=reference.beta + apart)
    beta = explanation.beta + apart
    shifted = replace(explanation, reference=there, beta=beta)
    posterior = _Fit(shifted, log).maximise()
    noise = np.maximum(explanation.noise * reference.sizes, old.second.noise)
    return Second(posterior.beta, posterior.active, posterior.root, noise)


class _Fit:
    """All parameters fitted to the rows of a log, beside a smooth residual of the log's own.

    Parameters and the log's own residual are standard normals times columns.
    """

    def __init__(self, explanation: Explanation, log: Log) -> None:
        reference = explanation.reference
        level = explanation.level
        self.reference = reference
        self.structure = reference.structure
        self.log = log
        self.temper = explanation.temper
        # [unit], of one number of each output
        self.scale = np.sqrt(self.temper) * explanation.noise * reference.sizes
        self.active, self.prior = prior_columns(
            reference, level.waves, freed=explanation.sd
        )
        self.smooth = own_columns(reference, log, level.residual)
        self.beta = explanation.beta
        moved = (self.beta - reference.beta)[self.active]
        self.normals = np.linalg.lstsq(self.prior, moved, rcond=1e-12)[0]
        # root of that of each number (n m,), for Student noise
        self.weight = np.ones(log.z.size)

    def maximise(self) -> _Fit:
        """Go to the maximum of the posterior, by damped steps (Levenberg 1944, Marquardt 1963).

        Attributes of its end are the weighted columns (n m, k) of all normals, the residuals
        (n m,), the information (k, k) and the gradient (k,).
        """
        size = self.prior.shape[1]
        gain = np.inf
        for _ in range(UPDATING.steps):
            predicted, moved = self.structure.linearise(
                self.log.q, self.beta, self.active
            )
            away = self._away(predicted)
            shared = shared_columns(self.reference, self.log, predicted)
            own = self._flat(np.concatenate([self.smooth, shared], axis=2))
            cost = self._learn_weights(away, own)
            moved = self._flat(moved) * self.weight[:, None]
            own_weighted = own * self.weight[:, None]
            self.columns = np.hstack([moved @ self.prior, own_weighted])
            self.residual = away * self.weight
            self.information = self.columns.T @ self.columns
            self.gradient = self.columns.T @ self.residual
            # the log's own part is followed anew
            self.gradient[:size] -= self.normals
            if gain < UPDATING.nothing_left:
                break
            by_parameter = (moved**2).sum(axis=0)[:, None] * self.prior
            stiffness = self.prior.T @ by_parameter
            gain = self._descend(cost, own, stiffness)
        return self

    def held_out(self) -> Array:
        """Residuals (n, m) of blocks of rows that the fit leaves out in turn [unit].

        Without the rows of a block the information is a difference: no fit is needed.
        """
        n, outputs = self.log.z.shape
        size = self.prior.shape[1]
        all_rows = _with_ones(self.information)
        residual = np.empty_like(self.residual)
        for block in np.array_split(np.arange(n), UPDATING.blocks):
            first = block[0] * outputs
            end = (block[-1] + 1) * outputs
            rows = slice(first, end)
            x = self.columns[rows]
            y = self.residual[rows]
            others = Factor(all_rows - x.T @ x)
            delta = others.solve(self.gradient - x.T @ y)
            by_parameters = x[:, :size] @ delta[:size]
            residual[rows] = y - by_parameters
        unit = (residual / self.weight).reshape(n, -1) * self.scale
        return np.asarray(unit)

    @property
    def root(self) -> Array:
        """Root (k, r) of the posterior covariance of the active parameters."""
        size = self.prior.shape[1]
        inverse = Factor(_with_ones(self.information)).inverse()[:size, :size]
        return root_of(self.prior @ inverse @ self.prior.T)

    def _descend(self, cost: float, own: Array, stiffness: Array) -> float:
        """Move by the first of ever more damped steps that gains, and return the gain."""
        size = len(stiffness)
        weight = self.weight
        normals = self.normals
        for damping in UPDATING.dampings:
            damped = _with_ones(self.information)
            damped[:size, :size] += damping * stiffness
            step = Factor(damped).solve(self.gradient)[:size]
            self.normals = normals + step
            full = np.zeros(self.structure.size)
            full[self.active] = self.prior @ step
            beta = self.structure.retract(self.beta, full)
            with np.errstate(all="ignore"):
                predicted = self.structure.predict(self.log.q, beta)
                away = self._away(predicted)
                gain = cost - self._learn_weights(away, own)
            if gain > 0.0:
                self.beta = beta
                return gain
            self.weight = weight
        self.normals = normals
        return 0.0

    def _learn_weights(self, away: Array, own: Array) -> float:
        """Set the weights of Student noise, and return twice the negative log posterior.

        What the log's own residual does not follow is Student's.
        """
        n, outputs = self.log.z.shape
        weighted = own * self.weight[:, None]
        follows = Factor(_with_ones(weighted.T @ weighted))
        followed = follows.solve(weighted.T @ (self.weight * away))
        rest = (away - own @ followed).reshape(n, outputs)
        square = self.temper * (rest**2).sum(axis=1)
        energy = (STUDENT + outputs) * np.log1p(square / STUDENT).sum()
        weights = (STUDENT + outputs) / (STUDENT + square)
        roots = np.sqrt(weights)
        self.weight = np.repeat(roots, outputs)
        of_rows = float(energy) / self.temper
        of_own = float(followed @ followed)
        of_parameters = float(self.normals @ self.normals)
        return of_rows + of_own + of_parameters

    def _away(self, predicted: Array) -> Array:
        """Residuals (n m,) of the log's rows [scales]."""
        residual = self.structure.residual(self.log.z, predicted)
        return np.asarray((residual / self.scale).ravel())

    def _flat(self, columns: Array) -> Array:
        """Columns (n m, k) of columns (n, m, k) [unit], in scales."""
        scaled = columns / self.scale[:, None]
        return np.asarray(scaled.reshape(self.log.z.size, -1))


def _with_ones(information: Array) -> Array:
    """Precision (k, k) of standard normals of which rows tell so much."""
    precision = information.copy()
    precision[np.diag_indices(len(precision))] += 1.0
    return precision
