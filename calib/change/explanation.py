"""An explanation: a set of causes that accounts for a log, and the posterior under it.

`climb` maximises a posterior: that of a set's parameters (`explain`), or that of all parameters u
and of a residual w of this log alone::

    z = h(beta) + W w + e,    beta = beta_0 + R u,    u, w ~ N(0, I),    e ~ N(0, scale^2)

R is the root of the old posterior's covariance, inflated by the bound's kappa and widened where the
explanation frees parameters; W w is a smooth residual, whose size stays in the new bound.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import TypeVar

import numpy as np

from ..body.belief import Body
from ..body.covariance import Factor, root_of
from ..body.parameters import Indices
from ..body.settings import NATS
from ..common.arrays import Array
from .causes import CALM_WAVES, CREEP_WAVES, FRAME, cause_kind
from .frame import Reference
from .rows import LogRows
from .system import System, prior_columns


@dataclass(frozen=True)
class ClimbSettings:
    """How a posterior is maximised."""

    # most steps
    steps: int = 12
    # nats that a step must gain
    enough: float = 5e-3
    # first damping after a step without a gain, and its factor after a step with one
    damping: float = 1e-4
    relaxation: float = 1.0 / 8.0


CLIMB = ClimbSettings()


@dataclass(frozen=True, eq=False)
class Iterate:
    """One iterate of `climb`: changes of parameters, and the posterior there."""

    normals: Array  # (k,), changes over their standard deviations
    beta: Array  # (d,), the changed parameters
    fit: float  # log posterior [nats]
    gradient: Array  # (k,), of the log posterior
    precision: Array  # (k, k), Gauss and Newton's


IterateT = TypeVar("IterateT", bound=Iterate)


def climb(
    iterate_at: Callable[[Array], IterateT | None],
    start: Array,
) -> IterateT:
    """The iterate of the greatest posterior, by damped steps (Levenberg 1944, Marquardt 1963).

    (precision + damping diag(precision)) step = gradient

    iterate_at : the iterate at normals (k,), None where predictions are not finite
    start : (k,), normals to begin with
    """
    best = iterate_at(start) or iterate_at(np.zeros_like(start))
    if best is None:
        raise np.linalg.LinAlgError("no prediction is a number")
    damping = 0.0
    for _ in range(CLIMB.steps):
        damped = best.precision.copy()
        damped[np.diag_indices(len(damped))] *= 1.0 + damping
        step = Factor(damped).solve(best.gradient)
        if 0.5 * float(best.gradient @ step) < CLIMB.enough:
            break
        iterate = iterate_at(best.normals + step)
        if iterate is not None and iterate.fit > best.fit:
            gain = iterate.fit - best.fit
            best = iterate
            damping *= CLIMB.relaxation
            if gain < CLIMB.enough:
                break
        else:
            damping = max(damping / CLIMB.relaxation, CLIMB.damping)
    return best


@dataclass(frozen=True, eq=False)
class Explanation:
    """A set of causes that accounts for a log, fitted to it."""

    causes: tuple[str, ...]
    wave_size: float  # one of `Reference.wave_sizes`
    reference: Reference
    indices: Indices  # parameters that are free
    beta: Array  # (d,), parameters of the greatest evidence
    sd: Array  # (d,), prior standard deviations of the changes, zero where not free
    log_evidence: float  # [nats], tempered by the correlation time

    # (d,), posterior standard deviations of the changes, zero where not free
    deviation: Array
    noise: float  # noise of the log, in `Reference.expected_noise`
    # (n, m) [unit], measured minus predicted outputs of the rows compared
    residual: Array

    @property
    def groups(self) -> tuple[str, ...]:
        """Groups of the free parameters, in their order."""
        labels = self.reference.structure.labels
        names = [labels[k].group for k in self.indices.tolist()]
        return tuple(dict.fromkeys(names))

    @property
    def is_no_change(self) -> bool:
        """Whether arm and sensor are unchanged under it."""
        return self.wave_size <= CALM_WAVES and not len(self.indices)

    @property
    def name(self) -> str:
        """Its groups, as in "frame, length"; without any, what else it consists of."""
        names = [
            cause_kind(group).removeprefix("view.")
            for group in self.groups
            if group not in FRAME
        ]
        if FRAME[0] in self.groups:
            names.insert(0, "frame")
        has_waves = self.wave_size > CREEP_WAVES
        shape = "waves of the joints" if has_waves else "a smooth residual"
        return ", ".join(dict.fromkeys(names)) or shape


def with_least_waves(explanations: Sequence[Explanation]) -> Explanation:
    """The best explanation, with the least waves among those of nearly its evidence."""
    best = explanations[0]
    least = best.log_evidence - NATS
    rivals = [
        other
        for other in explanations
        if other.causes == best.causes and other.log_evidence > least
    ]
    return min(rivals, key=attrgetter("wave_size"))


@dataclass(frozen=True)
class PosteriorSettings:
    """How a posterior is judged."""

    # contiguous blocks of rows that are held out in turn
    blocks: int = 5
    # least inflation of a simulated arm's bound, which no row has tested yet; without it the bound
    # of 30 rows with waves of 2 mrad covered 94.4 %
    simulated_kappa: float = 1.2


POSTERIOR = PosteriorSettings()


@dataclass(frozen=True, eq=False)
class RowIterate(Iterate):
    """An iterate of normals (u, w), with the rows linearised there: y = A (u, w) + e."""

    columns: Array  # (n m, k), A = (dh/dbeta R, W) over the scale of e
    residual: Array  # (n m,), (z - h(beta) - W w) over the scale of e


class Posterior:
    """The posterior of u and w after a log.

    residual_sd : (m,), of the log's own smooth residual [unit]
    system : the rows against the reference
    scale : standard deviation of e, in `Reference.expected_noise`; larger where rows err together
    active : (p,), parameters that u changes
    r : (p, number of u), R
    w_columns : (n m, number of w), W over `Reference.expected_noise`
    iterate : the maximum of the posterior
    """

    def __init__(
        self,
        explanation: Explanation,
        observations: LogRows,
        residual_scale: float,
    ) -> None:
        reference = explanation.reference
        self.residual_sd = residual_scale * reference.residual_sd
        self.explanation = explanation
        self.reference = reference
        self.system = System(reference, observations)
        time = observations.correlation_time
        self.scale = math.sqrt(time) * explanation.noise
        self.active, self.r = prior_columns(
            reference,
            # a simulated arm stands for one that is built, whose joints have waves
            wave_size=max(explanation.wave_size, CREEP_WAVES),
            change_sd=explanation.sd,
        )
        # without kappa, which inflates the residual in the bound
        self.w_columns = self.system.log_columns(self.residual_sd)

        # it starts at the explanation: R u = its change
        self.size = self.r.shape[1]
        start = np.zeros(self.size + self.w_columns.shape[1])
        change = (explanation.beta - reference.beta)[self.active]
        start[: self.size] = np.linalg.pinv(self.r, rcond=1e-12) @ change
        self.iterate = climb(self._iterate, start)

    def _iterate(self, normals: Array) -> RowIterate | None:
        """The iterate at (u, w), None without a prediction.

        log p(u, w | z) = -(|y - A (u, w)|^2 + |u|^2 + |w|^2) / 2
        """
        u = normals[: self.size]
        w = normals[self.size :]
        beta, misfit, moves = self.system.after_step(self.active, self.r @ u)
        if not np.isfinite(misfit).all():
            return None
        columns = np.concatenate([moves @ self.r, self.w_columns], axis=1)
        columns /= self.scale
        residual = self.system.whiten(misfit) / self.scale
        residual -= columns[:, self.size :] @ w
        return RowIterate(
            normals=normals,
            beta=beta,
            fit=-0.5 * float(residual @ residual + normals @ normals),
            gradient=columns.T @ residual - normals,
            precision=columns.T @ columns + np.eye(len(normals)),
            columns=columns,
            residual=residual,
        )

    @property
    def log_evidence(self) -> float:
        """Laplace approximation of the log evidence, up to a constant."""
        log_determinant = Factor(self.iterate.precision).log_determinant()
        return self.iterate.fit - 0.5 * log_determinant

    @property
    def body(self) -> Body:
        """The belief of parameters with covariance R cov(u) R', and of the log's noise."""
        old = self.reference.body
        inverse = Factor(self.iterate.precision).inverse()
        u_covariance = inverse[: self.size, : self.size]
        root = root_of(self.r @ u_covariance @ self.r.T)
        kappa = old.kappa
        if old.simulated:
            kappa = max(kappa, POSTERIOR.simulated_kappa)
        return replace(
            old,
            beta=self.iterate.beta,
            active=self.active,
            root=root / old.kappa,  # the bound multiplies it by kappa
            kappa=kappa,
            noise=self.explanation.noise * self.reference.expected_noise,
            residual=np.maximum(old.residual, self.residual_sd),
            second=None,
        )

    def cross_residual(self) -> Array:
        """Held-out residuals (n, m) of blocks of rows that are left out in turn [unit].

        The solution without a block A_b, y_b needs no other fit::

            (u, w) = (A'A + I - A_b'A_b)^-1 (A'y - A_b'y_b),    residual = y_b - A_b (u, 0)

        The part of w that places sockets is kept, too.
        """
        count = self.size + self.system.sockets.shape[2]
        iterate = self.iterate
        y = iterate.residual + iterate.columns @ iterate.normals
        vector = iterate.columns.T @ y
        residual = np.empty_like(self.system.observations.x)
        outputs = residual.shape[1]
        for block in np.array_split(np.arange(len(residual)), POSTERIOR.blocks):
            rows = slice(block[0] * outputs, (block[-1] + 1) * outputs)
            a_block = iterate.columns[rows]
            y_block = y[rows]
            others = Factor(iterate.precision - a_block.T @ a_block)
            normals = others.solve(vector - a_block.T @ y_block)
            misfit = y_block - a_block[:, :count] @ normals[:count]
            residual[block] = misfit.reshape(-1, outputs)
        return residual * self.scale * self.reference.expected_noise
