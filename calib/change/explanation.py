"""An explanation: a set of causes that accounts for a log, and the posterior under it.

`climb` finds where a posterior is greatest: that of a set's parameters (`explain`), or of all
parameters u and of a residual w of this log alone::

    z = h(beta) + W w + e,    beta = beta_0 + R u,    u, w ~ N(0, I),    e ~ N(0, scale^2)

R is the root of the old posterior, inflated as its bound is and loosened where the explanation
frees parameters; W w is a smooth residual of this log alone, whose size stays in the new bound.
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
from .causes import CALM_WAVES, CREEP_WAVES, FRAME, kind_of
from .frame import Reference
from .rows import LogRows
from .system import System, prior_columns


@dataclass(frozen=True)
class ClimbSettings:
    """How the greatest posterior is found."""

    # most steps
    steps: int = 12
    # nats that a step must gain
    enough: float = 5e-3
    # share of each parameter's information that is added where a step does not gain, and of it
    # after a step that does
    damping: float = 1e-4
    bolder: float = 1.0 / 8.0


CLIMB = ClimbSettings()


@dataclass(frozen=True, eq=False)
class Place:
    """Changes of parameters over their standard deviations, and the posterior there."""

    normals: Array  # (k,)
    beta: Array  # (d,), parameters that have changed so
    fit: float  # log posterior [nats]
    gradient: Array  # (k,), of the log posterior
    precision: Array  # (k, k), Gauss and Newton's


P = TypeVar("P", bound=Place)


def climb(
    place_at: Callable[[Array], P | None],
    start: Array,
) -> P:
    """The place of the greatest posterior, by damped steps (Levenberg 1944, Marquardt 1963).

    (precision + damping diag(precision)) step = gradient

    place_at : the place at normals (k,), None where no prediction is a number
    start : (k,)
    """
    best = place_at(start) or place_at(np.zeros_like(start))
    if best is None:
        raise np.linalg.LinAlgError("no prediction is a number")
    damping = 0.0
    for _ in range(CLIMB.steps):
        damped = best.precision.copy()
        damped[np.diag_indices(len(damped))] *= 1.0 + damping
        step = Factor(damped).solve(best.gradient)
        if 0.5 * float(best.gradient @ step) < CLIMB.enough:
            break
        place = place_at(best.normals + step)
        if place is not None and place.fit > best.fit:
            gain = place.fit - best.fit
            best = place
            damping *= CLIMB.bolder
            if gain < CLIMB.enough:
                break
        else:
            damping = max(damping / CLIMB.bolder, CLIMB.damping)
    return best


@dataclass(frozen=True, eq=False)
class Explanation:
    """A set of causes that accounts for a log, fitted to it."""

    causes: tuple[str, ...]
    wave_size: float  # of `Reference.wave_sizes`, that the joints may have
    reference: Reference
    indices: Indices  # parameters that are free
    beta: Array  # (d,), parameters of the greatest evidence
    sd: Array  # (d,), standard deviations by which they were free to change
    evidence: float  # logarithm of the tempered evidence [nats]

    # (d,), posterior standard deviations of those that are free, zero elsewhere
    deviation: Array
    noise: float  # noise of the log, in `Reference.sizes`
    # (n, m) [unit], measured less predicted outputs of the rows compared
    residual: Array

    @property
    def groups(self) -> tuple[str, ...]:
        """Groups of the parameters that are free, in their order."""
        labels = self.reference.structure.labels
        names = [labels[k].group for k in self.indices.tolist()]
        return tuple(dict.fromkeys(names))

    @property
    def is_no_change(self) -> bool:
        """Whether arm and sensor are unchanged in it."""
        return self.wave_size <= CALM_WAVES and not len(self.indices)

    @property
    def name(self) -> str:
        """Such as "frame, length", or what it is where nothing is freed."""
        names = [
            kind_of(group).removeprefix("view.")
            for group in self.groups
            if group not in FRAME
        ]
        if FRAME[0] in self.groups:
            names.insert(0, "frame")
        has_waves = self.wave_size > CREEP_WAVES
        shape = "waves of the joints" if has_waves else "a smooth residual"
        return ", ".join(dict.fromkeys(names)) or shape


def with_least_waves(explanations: Sequence[Explanation]) -> Explanation:
    """The best, with the least waves that the evidence hardly distinguishes from its own."""
    best = explanations[0]
    least = best.evidence - NATS
    alike = [
        other
        for other in explanations
        if other.causes == best.causes and other.evidence > least
    ]
    return min(alike, key=attrgetter("wave_size"))


@dataclass(frozen=True)
class PosteriorSettings:
    """What a posterior keeps, and how it is judged."""

    # contiguous blocks of rows that are held out in turn, each of which gives a gain
    blocks: int = 5
    # inflation of the bound of an arm that was only simulated: nothing has shown yet how it holds;
    # of 30 rows with waves of 2 mrad it covered 94.4 % without
    simulated_kappa: float = 1.2


POSTERIOR = PosteriorSettings()


@dataclass(frozen=True, eq=False)
class PlaceOfRows(Place):
    """Normals (u, w), and the rows as they are linear about them: y = A (u, w) + e."""

    columns: Array  # (n m, k), A = (dh/dbeta R, W) over the scale of e
    rest: Array  # (n m,), (z - h(beta) - W w) over the scale of e


class Posterior:
    """The posterior of u and w after a log.

    residual : (m,), standard deviation of the log's own smooth residual [unit]
    system : the rows against the reference
    scale : standard deviation of e, of rows that err together, in `Reference.sizes`
    active : (p,), parameters that u changes
    r : (p, number of u), R
    w_columns : (n m, number of w), W over `Reference.sizes`
    place : where the posterior is greatest
    """

    def __init__(
        self,
        explanation: Explanation,
        observations: LogRows,
        residual_scale: float,
    ) -> None:
        reference = explanation.reference
        self.residual = residual_scale * reference.residual_sd
        self.explanation = explanation
        self.reference = reference
        self.system = System(reference, observations)
        time = observations.correlation_time
        self.scale = math.sqrt(time) * explanation.noise
        self.active, self.r = prior_columns(
            reference,
            # what was simulated stands for an arm that is built
            wave_size=max(explanation.wave_size, CREEP_WAVES),
            change_sd=explanation.sd,
        )
        # without kappa, by which the bound inflates the residual as well
        self.w_columns = self.system.log_columns(self.residual)

        # from the explanation: R u = its change
        self.size = self.r.shape[1]
        start = np.zeros(self.size + self.w_columns.shape[1])
        change = (explanation.beta - reference.beta)[self.active]
        start[: self.size] = np.linalg.pinv(self.r, rcond=1e-12) @ change
        self.place = climb(self._place, start)

    def _place(self, normals: Array) -> PlaceOfRows | None:
        """Compare the rows with (u, w), None without a prediction.

        log p(u, w | z) = -(|rest|^2 + |u|^2 + |w|^2) / 2
        """
        u = normals[: self.size]
        w = normals[self.size :]
        beta, residual, moves = self.system.after_step(self.active, self.r @ u)
        if not np.isfinite(residual).all():
            return None
        columns = np.concatenate([moves @ self.r, self.w_columns], axis=1)
        columns /= self.scale
        rest = self.system.whiten(residual) / self.scale
        rest -= columns[:, self.size :] @ w
        return PlaceOfRows(
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
            kappa = max(kappa, POSTERIOR.simulated_kappa)
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

        Of w the places of sockets count.
        """
        count = self.size + self.system.sockets.shape[2]
        place = self.place
        y = place.rest + place.columns @ place.normals
        vector = place.columns.T @ y
        residual = np.empty_like(self.system.observations.x)
        outputs = residual.shape[1]
        for block in np.array_split(np.arange(len(residual)), POSTERIOR.blocks):
            rows = slice(block[0] * outputs, (block[-1] + 1) * outputs)
            a_block = place.columns[rows]
            y_block = y[rows]
            others = Factor(place.precision - a_block.T @ a_block)
            normals = others.solve(vector - a_block.T @ y_block)
            rest = y_block - a_block[:, :count] @ normals[:count]
            residual[block] = rest.reshape(-1, outputs)
        return residual * self.scale * self.reference.sizes
