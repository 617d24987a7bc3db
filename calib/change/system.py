"""System: the observations of a log, linear in all that may have changed.

    y = X d + e,    e ~ N(0, K + s^2 I),    K = U diag(v) U'

A `System` has y and X, whitened by the sensor's expected noise.  A `Nuisance` has the axes U and
the variances v of what an arm that has not changed may show: the posterior of the belief, a creep,
a smooth residual of this log, and errors that all rows share.  `Statistics` are the sufficient
statistics of both: X'X, X'y, U'X and so on, from which likelihood and information follow.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial

import numpy as np

from ..body.belief import Body
from ..body.information import lengths_of, matern
from ..body.parameters import Indices
from ..common.arrays import Array, Mask
from ..common.rows import spread_rows
from .causes import AS_SIMULATED, CREEP_WAVES, sd_of_creep, single_causes
from .frame import Reference
from .rows import LogRows

PSEUDO = 4.0  # observations that the old noise counts for
CREEP_SHARE = 0.25
"""Share of an unchanged arm's usual creep that the tests allow for.  Without it the last rows of
series A, .4 mm off, are an alarm; all of it hid a sensor that was moved by .1 mm."""


@dataclass(frozen=True)
class SystemSettings:
    """How large the system of a log is."""

    # most observations of a system: power and work grow with them
    rows: int = 300
    # nodes of the log's smooth residual; more did not change a verdict on A and C
    nodes: int = 40
    # sizes of the noise that are compared
    noises: int = 64
    # least of these sizes, in `Reference.expected_noise`
    least_noise: float = 1e-2
    # usual noise of an exact model, in `Reference.expected_noise`
    exact_noise: float = 1e-3
    # least variance of a nuisance axis that counts, over that of the noise
    least_variance: float = 1e-10


SYSTEM = SystemSettings()


NoisyJoint = tuple[int, float]
"""A joint whose encoder is noisy, and the size of its noise."""


class System:
    """Observations minus a reference, in noises: N numbers, of n rows and m outputs.

    y : (N,), residuals
    columns : (N, d), derivatives of the predictions by all parameters
    noisy_joint : a joint whose encoder is noisy, and its noise [rad or m] over that of the sensor
    log_determinant : log |C| of the rows' noise, over the usual one
    nuisance : the `Nuisance` with waves of a size, one of `Reference.wave_sizes`
    """

    def __init__(
        self,
        reference: Reference,
        observations: LogRows,
        noisy_joint: NoisyJoint | None = None,
    ) -> None:
        structure = reference.structure
        self.reference = reference
        self.observations = observations
        self.noisy_joint = noisy_joint
        self.slope = structure.slope(observations.q, reference.beta)
        self.roots, self.log_determinant = self._roots()
        residual, self.columns = self.residual(reference.beta)
        self.y = self.whiten(residual)
        self.nuisance = cache(partial(Nuisance, self))

    def _roots(self) -> tuple[Array, float]:
        """Roots (n, m, m) of the precision of each row, and log |C| of their covariances C.

        The noise of a joint adds r^2 g g' to the covariance I of a row, g = slope / size: along g
        the variance is 1 + r^2 g'g, and the root of the precision 1 / sqrt of that.
        """
        sizes = self.reference.expected_noise
        rows = len(self.observations)
        white = np.tile(np.diag(1.0 / sizes), (rows, 1, 1))
        if self.noisy_joint is None:
            return white, 0.0
        joint, ratio = self.noisy_joint
        g = self.slope[..., joint] / sizes
        square = (g**2).sum(axis=1)
        length = np.sqrt(np.maximum(square, 1e-300))
        g /= length[:, None]
        variance = 1.0 + ratio**2 * square
        reduction = 1.0 - 1.0 / np.sqrt(variance)
        along = g[:, None] @ white
        white -= reduction[:, None, None] * g[:, :, None] * along
        return white, float(np.log(variance).sum())

    def whiten(self, x: Array) -> Array:
        """Return residuals (n, m) or columns (n, m, k) [unit] in noises: (N,) or (N, k)."""
        n, m, *columns = x.shape
        flat: Array = self.roots @ x.reshape(n, m, -1)
        return flat.reshape(n * m, *columns)

    def residual(
        self, beta: Array, free: Indices | None = None
    ) -> tuple[Array, Array]:
        """Residuals (n, m) [unit] at parameters (d,), and columns (N, k) of some or all."""
        structure = self.reference.structure
        with np.errstate(all="ignore"):
            predicted, columns = structure.linearise(
                self.observations.q, beta, free
            )
            residual = structure.residual(self.observations.x, predicted)
        return residual, self.whiten(columns)

    def after_step(
        self, free: Indices, step: Array
    ) -> tuple[Array, Array, Array]:
        """Parameters (d,) after a step (k,) of some, with their `residual`."""
        reference = self.reference
        beta = reference.structure.after_step(reference.beta, free, step)
        return beta, *self.residual(beta, free)

    def single_causes(self, cause: str | None = None) -> dict[str, Indices]:
        """Parameters of each cause that these observations may show alone.

        cause : see `causes.single_causes`
        """
        return single_causes(
            self.reference.structure,
            cause,
            self.reference.waves,
            by_touch=self.observations.are_touches,
        )

    def play_columns(self) -> Array:
        """Derivatives (N, dof) of the observations by half the play of each joint, in noises."""
        return self.whiten(-self.slope * self.observations.side[:, None])

    def log_columns(self, sd: Array) -> Array:
        """Columns (N, r) of a log's own deviations.

        In turn: where its sockets are, a smooth residual, a frame, and a late clock.

        sd : (m,), standard deviation of the smooth residual [unit]
        """
        q = self.observations.q
        nodes = q[spread_rows(len(q), SYSTEM.nodes)]
        smooth = smooth_columns(self.reference.body, sd, q, nodes)
        late = self.slope @ self.observations.clock_sd[:, :, None]
        columns = [self.sockets, smooth, self._frame_columns(), late]
        return self.whiten(np.concatenate(columns, axis=2))

    def _frame_columns(self) -> Array:
        """How readings (n, m, r) move with the error of a frame that all rows share."""
        n, outputs = self.observations.x.shape
        # of the model's own log and of this one
        shared = math.sqrt(2.0) * self.observations.shared
        if not shared:
            return np.zeros((n, outputs, 0))
        structure = self.reference.structure
        reference = self.reference
        predicted = structure.predict(self.observations.q, reference.beta)
        positions = predicted[:, structure.position]
        positions = positions / structure.extents[0]
        features = np.hstack([np.ones((n, 1)), positions])
        return shared * along_axes(features, np.eye(outputs))

    @cached_property
    def sockets(self) -> Array:
        """How readings (n, m, 3 p) move with the places of p sockets, which may be anywhere."""
        touch = self.observations.log.touch
        n, outputs = self.observations.x.shape
        if touch is None:
            return np.zeros((n, outputs, 0))
        number = touch.number[:, None]
        is_in: Mask = number == np.unique(number[touch.is_touch])
        anywhere = self.reference.structure.extents[0] * np.eye(outputs)
        return along_axes(is_in, anywhere)


def system_of(reference: Reference, observations: LogRows) -> System:
    """The system of at most `SYSTEM.rows` of the observations."""
    return System(reference, observations.at_most(SYSTEM.rows))


@dataclass(frozen=True)
class Statistics:
    """Sufficient statistics of residuals y (N,), columns X (N, k) and K = U diag(v) U'.

    They follow from rows (`Nuisance.statistics`), or from sums over a stream (`of_gram`).
    """

    count: float  # N
    gram: Array  # (k + 1, k + 1), [X y]'[X y]
    variances: Array  # (r,), v
    on_axes: Array  # (r, k + 1), U'[X y]
    log_determinant: float = 0.0  # of the rows' noise, over the usual one

    @staticmethod
    def of_gram(count: float, gram: Array, nuisances: int) -> Statistics:
        """Statistics of the gram (r + k + 1)^2 of nuisance columns (r), columns and residuals.

        Nuisance columns B, of K = B B', have the principal axes of B'B.
        """
        variances, vectors = np.linalg.eigh(gram[:nuisances, :nuisances])
        counts = variances > SYSTEM.least_variance
        variances = variances[counts]
        on_axes = vectors[:, counts].T @ gram[:nuisances, nuisances:]
        on_axes /= np.sqrt(variances)[:, None]
        rest = gram[nuisances:, nuisances:]
        return Statistics(count, rest, variances, on_axes)

    def likelihood(self, noise: Array | float) -> Array:
        """Log likelihood (l,) [nats] of y ~ N(0, K + s^2 I), without columns, for sizes s (l,).

        -2 log p = sum log(1 + v / s^2) + N log s^2 + (y'y - sum v / (s^2 + v) (U'y)^2) / s^2
        """
        variance = np.atleast_1d(noise) ** 2
        column = variance[:, None]
        size = np.log1p(self.variances / column).sum(axis=1)
        size += self.count * np.log(variance)
        share = self.variances / (column + self.variances)
        square = self.gram[-1, -1] - share @ self.on_axes[:, -1] ** 2
        rest = square / variance
        likelihood: Array = -0.5 * (size + rest + self.log_determinant)
        return likelihood

    def information(self, noise: float) -> tuple[Array, Array]:
        """Information matrix X' C^-1 X (k, k) and vector X' C^-1 y (k,), C = K + s^2 I.

        C^-1 = (I - U diag(v / (s^2 + v)) U') / s^2
        """
        share = self.variances / (noise**2 + self.variances)
        left_over = self.gram - (self.on_axes.T * share) @ self.on_axes
        left_over /= noise**2
        return left_over[:-1, :-1], left_over[:-1, -1]

    def noises(self, least: float | None = None) -> tuple[Array, Array]:
        """Sizes (l,) of the noise, and the log likelihood of each.

        least : smallest size; where it is not given, the usual noise counts for `PSEUDO` rows
        """
        rms = math.sqrt(self.gram[-1, -1] / self.count)
        high = 2.0 * max(rms, least or 1.0)
        low = least or SYSTEM.least_noise
        sizes = np.geomspace(low, high, SYSTEM.noises)
        likelihood = self.likelihood(sizes)
        if least is None:
            likelihood -= PSEUDO * (np.log(sizes) + 0.5 / sizes**2)
        return sizes, likelihood

    def most_likely_noise(self, least: float | None = None) -> float:
        """Size of the noise of the greatest likelihood."""
        sizes, likelihood = self.noises(least)
        best = np.argmax(likelihood)
        return float(sizes[best])

    def noise_freedom(self, noise: float) -> float:
        """Degrees of freedom that the rows leave to the noise, tr (s^2 C^-1)^2."""
        share = self.variances / (noise**2 + self.variances)
        spent = share * (2.0 - share)
        return self.count - float(spent.sum())


class Nuisance:
    """K = U diag(v) U' of a system: `axes` U (N, r) and `variances` v (r,), in noises.

    wave_size : one of `Reference.wave_sizes`
    creep_share : factor on the usual creep of the parameters
    change_sd : (d,), standard deviation by which parameters may have changed
    residual_sd : (m,), of the log's own smooth residual, by default the belief's [unit]
    """

    def __init__(
        self,
        system: System,
        wave_size: float = CREEP_WAVES,
        creep_share: float = 1.0,
        change_sd: Array | None = None,
        residual_sd: Array | None = None,
    ) -> None:
        reference = system.reference
        if residual_sd is None:
            residual_sd = reference.body.kappa * reference.residual_sd
        active, root = prior_columns(
            reference, wave_size, creep_share, change_sd
        )
        of_arm = system.columns[:, active] @ root
        of_log = system.log_columns(residual_sd)
        columns = np.concatenate([of_log, of_arm], axis=1)
        self.system = system
        self.axes, self.variances = principal_axes(columns)

    def statistics(self, y: Array, x: Array | None = None) -> Statistics:
        """Statistics of residuals (N,) and columns (N, k), by default none."""
        columns = y[:, None] if x is None else np.column_stack([x, y])
        return Statistics(
            count=len(y),
            gram=columns.T @ columns,
            variances=self.variances,
            on_axes=self.axes.T @ columns,
            log_determinant=self.system.log_determinant,
        )

    def unexplained_part(self, x: Array, noise: float) -> Array:
        """The part of residuals (N,) or columns (N, k) that K does not explain, s C^-1 x.

        Returns (n, m) or (n, m, k), in units of the noise s.
        """
        share = self.variances / (noise**2 + self.variances)
        explained = (self.axes.T @ x).T * share
        part: Array = (x - self.axes @ explained.T) / noise
        rows = len(self.system.observations)
        return part.reshape(rows, -1, *x.shape[1:])


def principal_axes(columns: Array) -> tuple[Array, Array]:
    """Axes (N, r) and variances (r,) of `columns` (N, k) times independent standard normals.

    They are eigenvectors of the smaller one of both products.
    """
    rows, nuisance = columns.shape
    if rows <= nuisance:
        values, axes = np.linalg.eigh(columns @ columns.T)
        return axes, np.maximum(values, 0.0)
    values, vectors = np.linalg.eigh(columns.T @ columns)
    counts = values > SYSTEM.least_variance
    values = values[counts]
    axes = columns @ vectors[:, counts]
    return axes / np.sqrt(values), values


def smooth_columns(body: Body, sd: Array, q: Array, nodes: Array) -> Array:
    """A smooth residual (a Gaussian process): (n, m, p m) by its values at joints (p, dof).

    sd : (m,), its standard deviation [unit]
    """
    lengths = lengths_of(body, nodes)
    correlation = matern(nodes, nodes, lengths)
    correlation[np.diag_indices(len(correlation))] += 1e-6
    root = np.linalg.cholesky(correlation)
    features = np.linalg.solve(root, matern(nodes, q, lengths))
    return along_axes(features.T, np.diag(sd))


def along_axes(features: Array | Mask, axes: Array) -> Array:
    """Columns (n, m, k m) of features (n, k), each of which moves outputs along axes (m, m)."""
    columns = np.kron(features, axes)
    return np.asarray(columns.reshape(len(features), len(axes), -1), float)


def prior_columns(
    reference: Reference,
    wave_size: float = CREEP_WAVES,
    creep_share: float = 1.0,
    change_sd: Array | None = None,
) -> tuple[Indices, Array]:
    """The uncertain parameters (k,) before the log, and the root (k, r) of their covariance.

    wave_size, creep_share, change_sd : see `Nuisance`
    """
    body = reference.body
    if wave_size == AS_SIMULATED and reference.simulated is not None:
        active = reference.simulated.active
        body = replace(body, active=active, root=reference.simulated.root)
    sd = creep_share * sd_of_creep(body, wave_size)
    refitted = reference.refitted
    if change_sd is not None:
        sd = np.hypot(sd, change_sd)
        # where the frame may not change, its old posterior stays
        refitted = np.intersect1d(refitted, np.flatnonzero(change_sd))
    root = body.kappa * body.root
    root[np.isin(body.active, refitted)] = 0.0
    changed = np.flatnonzero(sd)
    belief = replace(body, root=root)
    belief = belief.with_covariance(changed, np.diag(sd[changed] ** 2))
    return belief.active, belief.root
