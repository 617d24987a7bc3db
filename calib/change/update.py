"""Updating: the belief after a log, under the change that explains it best.

    z = h(beta) + W w + e,    beta = beta_0 + R u,    u, w ~ N(0, I),    e ~ N(0, scale^2)

R is the root of the old posterior, inflated as its bound is and loosened where the explanation
frees parameters; W w is a smooth residual of this log alone, whose size stays in the new bound.
The belief is judged by contiguous blocks of rows, each predicted from the others.
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
from ..body.spatial import SpatialStructure
from ..common.arrays import Array
from ..common.rows import row_lengths, spread_rows
from .bound import BEYOND
from .evidence import Evidence
from .explain import SEARCH
from .explanation import Explanation, Place, climb, with_least_waves
from .observations import Observations
from .settings import CREEP, UPDATING
from .system import frame_columns, prior_columns, residual_columns
from .tool import tool_turn


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

    @property
    def missed(self) -> Array:
        """Distances (k,) of these rows [unit]."""
        return row_lengths(self.residual)


def update(evidence: Evidence, *, learn: bool) -> Update:
    """Update a belief by the rows of a log.

    learn : whether the best belief is wanted, or whether there is a better one than before
    """
    explanation = _basis(evidence)
    belief = _posterior_belief(evidence, explanation)
    improved = _is_better(evidence, belief)
    if (learn or not improved) and _is_trainable(evidence, explanation):
        trained = _belief_of_training(explanation, evidence.observations)
        trained_is_better = _is_better(evidence, trained)
        nearer = trained.missed.mean() < belief.missed.mean()
        if nearer and (trained_is_better or not improved):
            belief = trained
            improved = trained_is_better
    if evidence.tool.score > 1.0:
        if not improved:  # the tool alone
            belief = _as_it_was(evidence)
        structure = evidence.reference.structure
        tool = tool_turn(evidence.rows, structure, belief.body.beta)
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


def _posterior_belief(evidence: Evidence, explanation: Explanation) -> _Belief:
    """The posterior of the parameters under an explanation, with a bound that the rows confirm."""
    rows = spread_rows(len(evidence.rows), UPDATING.rows)
    observations = evidence.observations.some(UPDATING.rows)
    is_clear = evidence.is_attributed or evidence.score > UPDATING.clearly
    sizes = (1.0,) if is_clear else UPDATING.own_residuals
    posteriors = [_Posterior(explanation, observations, size) for size in sizes]
    posterior = max(posteriors, key=lambda some: some.evidence)
    body = posterior.body
    # of play that was taken up no model knows
    logged = evidence.rows.q[rows]
    residual = posterior.cross_residual()
    residual += body.predict(observations.q) - body.predict(logged)
    if evidence.is_attributed:
        body = _as_uncertain(body, explanation, evidence.explanations)
    body = _with_sound_bound(body, logged, row_lengths(residual))
    return _Belief(body, rows, residual)


def _as_it_was(evidence: Evidence) -> _Belief:
    """The belief before the log, judged by the rows as the model predicts them."""
    rows = spread_rows(len(evidence.rows), UPDATING.rows)
    measured = evidence.rows.x - evidence.rows.predicted
    return _Belief(evidence.prior, rows, measured[rows])


def _is_better(evidence: Evidence, belief: _Belief) -> bool:
    """Whether held-out rows gain by more than chance, and by the share that is needed."""
    changed = evidence.score > 1.0
    before = evidence.rows.distance[belief.rows]
    gain = before - belief.missed
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
        # Waves of joints that nobody measured say that it is no arm as drawn; along a line, or in
        # a corner, they would be taken for all else.
        return (
            evidence.score > 1.0
            and evidence.prior.simulated
            and explanation.waves > CREEP
            and evidence.rows.widespread
        )
    # Without a drawing few rows leave a posterior that is curved: from 30 rows of series C an
    # update with 300 left an error of .70 mm, where training has .20.
    is_open = isinstance(structure, SpatialStructure) and not structure.informed
    return is_open and evidence.score <= 1.0


def _belief_of_training(
    explanation: Explanation, observations: Observations
) -> _Belief:
    """The belief of training: its members by held-out rows, noise and scales by evidence.

    In the plane the old belief is its drawing.  A simulation tells neither how noisy the sensor is
    nor how large the waves of the joints are.
    """
    structure = explanation.reference.structure
    if isinstance(structure, PlanarStructure):
        structure = _drawn_as_believed(structure, explanation.reference.body)
    rows = spread_rows(len(observations.q), UPDATING.rows_of_training)
    measured = [Rows(observations.q[rows], observations.z[rows])]
    fitted = fit(structure, measured, begin=explanation.beta)
    return _Belief(fitted.body, rows, fitted.held_out)


def _drawn_as_believed(
    structure: PlanarStructure, body: Body
) -> PlanarStructure:
    """The structure of a measured arm whose drawing is what a belief says."""
    old = body.beta
    groups = structure.groups
    drawing = PlanarDrawing(
        lengths=tuple(old[groups["length"]].tolist()),
        offsets=tuple(old[groups["offset"]].tolist()),
        rotation=float(old[groups["view.rotation"]][0]),
        shift=tuple(old[groups["view.shift"]].tolist()),
        mirror=structure.mirror,
        signs=structure.signs,
    )
    return structure.with_fields(nominal=drawing, simulated=False)


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


@dataclass(frozen=True, eq=False)
class _PlaceOfRows(Place):
    """Normals (u, w), and the rows as they are linear about them: y = A (u, w) + e."""

    columns: Array  # (n m, k), A = (dh/dbeta R, W) over the scale of e
    rest: Array  # (n m,), (z - h(beta) - W w) over the scale of e


class _Posterior:
    """The posterior of u and w after a log.

    residual : (m,), standard deviation of the log's own smooth residual [unit]
    scale : (m,), standard deviation of e, of rows that err together [unit]
    active : (p,), parameters that u changes
    r : (p, number of u), R
    w_columns : (n, m, number of w), W [unit]
    place : where the posterior is greatest
    """

    def __init__(
        self,
        explanation: Explanation,
        observations: Observations,
        own_residual: float,
    ) -> None:
        reference = explanation.reference
        self.residual = own_residual * reference.residual_sd
        q = observations.q
        self.explanation = explanation
        self.reference = reference
        self.observations = observations
        noise = math.sqrt(explanation.temper) * explanation.noise
        self.scale = noise * reference.sizes
        self.active, self.r = prior_columns(
            reference, explanation.waves, freed=explanation.sd
        )
        # without kappa, by which the bound inflates the residual as well
        smooth = residual_columns(reference, observations)
        smooth *= own_residual / reference.body.kappa
        predicted = reference.structure.predict(q, explanation.beta)
        shared = frame_columns(reference, observations, predicted)
        self.w_columns = np.concatenate([smooth, shared], axis=2)

        # from the explanation: R u = its change
        self.size = self.r.shape[1]
        start = np.zeros(self.size + self.w_columns.shape[2])
        change = (explanation.beta - reference.beta)[self.active]
        start[: self.size] = np.linalg.pinv(self.r, rcond=1e-12) @ change
        self.place = climb(
            self._place, start, most=UPDATING.steps, enough=UPDATING.enough
        )

    def _place(self, normals: Array) -> _PlaceOfRows | None:
        """Compare the rows with (u, w), None without a prediction.

        log p(u, w | z) = -(|rest|^2 + |u|^2 + |w|^2) / 2
        """
        structure = self.reference.structure
        u = normals[: self.size]
        w = normals[self.size :]
        step = np.zeros(structure.size)
        step[self.active] = self.r @ u
        beta = structure.retract(self.reference.beta, step)
        with np.errstate(all="ignore"):
            predicted, moves = structure.linearise(
                self.observations.q, beta, self.active
            )
            residual = structure.residual(self.observations.z, predicted)
        if not np.isfinite(residual).all():
            return None
        columns = np.concatenate([moves @ self.r, self.w_columns], axis=2)
        columns /= self.scale[:, None]
        columns = columns.reshape(residual.size, -1)
        rest = (residual / self.scale).ravel()
        rest -= columns[:, self.size :] @ w
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
    def evidence(self) -> float:
        """Laplace approximation of the logarithm of the evidence, up to a constant."""
        volume = Factor(self.place.precision).log_determinant()
        return self.place.fit - 0.5 * volume

    @property
    def body(self) -> Body:
        """The belief: parameters, their covariance R cov(u) R', noise and residual of the log."""
        old = self.reference.body
        inverse = Factor(self.place.precision).inverse()
        of_u = inverse[: self.size, : self.size]
        root = root_of(self.r @ of_u @ self.r.T)
        kappa = old.kappa
        if old.simulated:
            kappa = max(kappa, UPDATING.simulated_kappa)
        return replace(
            old,
            beta=self.place.beta,
            active=self.active,
            # the bound inflates by kappa what is kept here without it
            root=root / old.kappa,
            kappa=kappa,
            noise=self.explanation.noise * self.reference.sizes,
            residual=np.maximum(old.residual, self.residual),
            second=None,
        )

    def cross_residual(self) -> Array:
        """Residuals (n, m) of blocks of rows that are left out in turn [unit].

        Without a block A_b, y_b the solution needs no fit::

            (u, w) = (A'A + I - A_b'A_b)^-1 (A'y - A_b'y_b),    residual = y_b - A_b (u, 0)
        """
        place = self.place
        y = place.rest + place.columns @ place.normals
        vector = place.columns.T @ y
        residual = np.empty_like(self.observations.z)
        outputs = residual.shape[1]
        for block in np.array_split(np.arange(len(residual)), UPDATING.blocks):
            rows = slice(block[0] * outputs, (block[-1] + 1) * outputs)
            a_block = place.columns[rows]
            y_block = y[rows]
            others = Factor(place.precision - a_block.T @ a_block)
            normals = others.solve(vector - a_block.T @ y_block)
            u = normals[: self.size]
            rest = y_block - a_block[:, : self.size] @ u
            residual[block] = rest.reshape(-1, outputs)
        return residual * self.scale
