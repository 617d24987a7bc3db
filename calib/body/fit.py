"""One maximisation of a posterior by Gauss-Newton; noise and scales by evidence as it goes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..common.arrays import Array, Mask
from .covariance import Factor, autocorrelation_time
from .parameters import Hyper, Indices, Prior
from .rows import FitReadings, Rows
from .settings import FIT, SIMULATED_FLOOR, STUDENT
from .structure import Structure


class Fit:
    """Some parameters of a structure fitted to rows of one sensor or several.

    structure : of several sensors as `rows.with_measurements` makes it
    rows : what each sensor saw; `noise` is that of the first one
    beta : (d,), start
    prior : parameters with a zero sd stay at the prior's mean
    nu : degrees of freedom of the Student noise; infinite for Gaussian
    blocks : contiguous blocks of rows whose information is kept apart, at most

    Attributes
    ----------
    beta, active : (d,) and (k,)
        All parameters, and the indices of those that are fitted.
    sd : (k,)
        Prior sds, with the scales that the evidence chose.
    readings : list of FitReadings
        Residuals, weights and noise of each sensor.
    """

    # set by each step of `maximise` and `search`
    sensor_grams: list[Array]  # information (k, k) of each sensor's rows
    precision: Array  # (k, k), information of all rows, and prior
    # (k,), of the log posterior: not quite zero where the steps ended early
    gradient: Array
    # set at the end of `maximise`
    grams: Array  # (b, k, k), information of each block of rows
    moments: Array  # (b, k), what each block adds to the gradient
    # integrated time of the residuals [rows]; 1 for Gaussian noise
    autocorrelation: float
    log_evidence: float  # Laplace approximation

    def __init__(
        self,
        structure: Structure,
        rows: Sequence[Rows],
        beta: Array,
        prior: Prior,
        *,
        nu: float,
        blocks: int = FIT.blocks,
    ) -> None:
        self.structure = structure
        self.nu = nu
        self.active = prior.active
        self.mean = prior.mean
        self._precision = prior.precision
        self.sd = prior.sd[self.active].copy()
        self.beta = np.where(prior.sd > 0, beta, prior.mean)
        column = np.full(len(prior.sd), -1)  # of each parameter among `active`
        column[self.active] = np.arange(len(self.active))
        self.hypers: list[Hyper] = []  # their indices are columns
        for hyper in prior.hypers:
            index = column[hyper.indices]
            if (index >= 0).all():
                self.hypers.append(hyper._replace(indices=index))
        self.scales = {hyper.name: float(hyper.scale) for hyper in self.hypers}
        blocks = min(blocks, len(rows[0]))
        self.readings = [
            FitReadings(structure, rows_of_sensor, self.beta, nu, blocks)
            for rows_of_sensor in rows
        ]

    @property
    def noise(self) -> Array:
        """Noise sd (m,) of each output."""
        return self.readings[0].noise

    @property
    def residuals(self) -> list[Array]:
        """Residuals (n, m) of each sensor."""
        return [readings.residual for readings in self.readings]

    @property
    def prior_precision(self) -> Array:
        """Precision (k, k) of the prior, with the scales that the evidence chose."""
        if self._precision is not None:
            return self._precision
        return np.diag(self.sd**-2.0)

    def continued_on(self, rows: Sequence[Rows], prior: Prior) -> Fit:
        """A fit of rows of the same sensors under another prior, which starts at this one's end."""
        noisy = [
            replace(rows_of_sensor, noise=readings.noise)
            for rows_of_sensor, readings in zip(
                rows, self.readings, strict=True
            )
        ]
        return Fit(self.structure, noisy, self.beta, prior, nu=self.nu)

    # The posterior.

    @property
    def information_share(self) -> float:
        """Share of the rows' information that counts.

        Student noise reduces it, and so does correlation of the residuals along the log.
        """
        p = self.structure.output_sizes[0]
        share = 1.0 / self.autocorrelation
        if np.isfinite(self.nu):
            freedom = self.nu + p
            share *= freedom / (freedom + 2)
        return share

    @property
    def covariance(self) -> Array:
        """Posterior covariance (k, k)."""
        gram = self.grams.sum(axis=0)
        return self.posterior_precision(gram).inverse()

    def posterior_precision(self, gram: Array) -> Factor:
        """Factor of the posterior's precision, by the information `gram` (k, k) of rows."""
        information = self.information_share * gram
        return Factor(information + self.prior_precision)

    def without(self, blocks: slice) -> tuple[Array, Array]:
        """Information (k, k) of all other blocks, and the step (k,) from beta to their maximum."""
        others = np.ones(len(self.grams))
        others[blocks] = 0.0
        # the others are summed: by a difference, the prior of a parameter that only these blocks
        # determine, such as the place of a socket, would be lost in rounding
        gram = np.tensordot(others, self.grams, axes=1)
        gradient = others @ self.moments - self._prior_gradient(self.beta)
        return gram, Factor(gram + self.prior_precision).solve(gradient)

    # The search.

    def maximise(self, *, steps: int = 10, tolerance: float = 1e-2) -> Fit:
        """Go to the maximum of the posterior, noise and scales by evidence; returns itself.

        steps : most linearisations
        tolerance : a step below this share of the posterior sd ends the search
        """
        least = 3 if self.hypers else 1
        # A step that fails is damped: a shorter one would hardly move what the rows determine,
        # since directions that they do not determine, such as the gauge of a chain without a
        # drawing, are the long and curved part of it.
        dampings = (0.0, *FIT.first_damping * 8.0 ** np.arange(8))
        for step in range(steps):
            self._linearise()
            inverse = Factor(self.precision).inverse()
            variance = np.diag(inverse)
            gain, delta, damping = self.descend(dampings)
            self._learn_scales_and_noise(inverse)
            shares = np.abs(delta) / np.sqrt(variance)
            settled = shares.max(initial=0.0) <= tolerance
            if step >= least and settled:
                break
            # not even a damped step gains much
            if damping > 0 and gain <= FIT.least_gain:
                break
        self._linearise_blocks()
        self.autocorrelation = 1.0
        if np.isfinite(self.nu):
            # rows that err together count once
            self.autocorrelation = max(
                map(autocorrelation_time, self.residuals)
            )
        self.log_evidence = self._log_evidence()
        return self

    def _log_evidence(self) -> float:
        """Laplace approximation of the log evidence."""
        prior = -2 * float(np.log(self.sd).sum())
        if self._precision is not None:
            prior = Factor(self._precision).log_determinant()
        shrinkage = Factor(self.precision).log_determinant() - prior
        energy = self._energy(self.beta, self.residuals)
        return -energy - 0.5 * shrinkage

    def search(self, steps: int) -> tuple[Array, float, float]:
        """Take damped steps from anywhere, until one gains next to nothing.

        Returns beta : (d,)
        Returns cost : negative log posterior with Student noise, of which the scale was fitted
        Returns noise : share of the extents that the residuals have
        """
        linear = np.isin(self.active, self.structure.linear)
        damping = FIT.first_damping_of_search
        for _ in range(steps):
            self._learn_noise()
            self._linearise()
            dampings = damping * 8.0 ** np.arange(8)
            gain, _, damping = self.descend(dampings, linear)
            if gain < FIT.least_gain_of_search:
                break
            damping = max(damping / 10, 1e-12)
        self._learn_noise()
        shares = self.noise / self.structure.extents
        cost = self._energy(self.beta, self.residuals)
        return self.beta, cost, float(shares.max())

    def descend(
        self, dampings: Iterable[float], linear: Mask | None = None
    ) -> tuple[float, Array, float]:
        """Move by the first of ever more damped steps that gains (Levenberg 1944, Marquardt 1963).

        linear : (k,), parameters that the outputs are linear in: they are not damped but solved for
            again after each step of the others, whose valley bends with them (Golub and Pereyra
            1973)
        Returns the gain [nats], 0 where none gains, the step (k,) and its damping.
        """
        before = self._energy(self.beta, self.residuals)
        damped = self.precision.copy()
        diagonal = np.diag(self.precision)
        strength = diagonal.copy()
        if linear is not None:
            strength[linear] = 0.0
        delta = np.zeros(len(self.active))
        damping = np.inf
        for damping in dampings:
            np.fill_diagonal(damped, diagonal + damping * strength)
            try:
                delta = Factor(damped).solve(self.gradient)
                beta = self._after_step(self.beta, delta)
                if linear is not None and linear.any():
                    step = self._linear_step(beta, linear)
                    beta = self._after_step(beta, step)
            except np.linalg.LinAlgError:
                continue
            residuals = self._residuals(beta)
            gain = before - self._energy(beta, residuals)
            is_even = gain >= -1e-9 * abs(before)
            if gain > 0 or (damping == 0 and is_even):
                self.beta = beta
                for readings, residual in zip(
                    self.readings, residuals, strict=True
                ):
                    readings.residual = residual
                return gain, delta, damping
        return 0.0, delta, damping

    def _after_step(self, beta: Array, delta: Array) -> Array:
        """Parameters (d,) after a step (k,) of those that are fitted."""
        with np.errstate(all="ignore"):
            return self.structure.after_step(beta, self.active, delta)

    def _linear_step(self, beta: Array, linear: Mask) -> Array:
        """The step (k,) from parameters (d,) to the best values of those marked `linear` (k,)."""
        indices = self.active[linear]
        grams, moment = self._information(beta, indices)
        gram = np.sum(grams, axis=0)
        prior = self.prior_precision[np.ix_(linear, linear)]
        factor = Factor(gram + prior)
        gradient = moment - self._prior_gradient(beta)[linear]
        step = np.zeros(len(linear))
        step[linear] = factor.solve(gradient)
        return step

    def _residuals(self, beta: Array) -> list[Array]:
        """Residuals (n, m) of each sensor at parameters (d,)."""
        return [readings.residual_at(beta) for readings in self.readings]

    def _linearise(self) -> None:
        """Set the precision and the gradient."""
        self.sensor_grams, moment = self._information(self.beta, self.active)
        self._set_posterior(np.sum(self.sensor_grams, axis=0), moment)

    def _set_posterior(self, gram: Array, moment: Array) -> None:
        """Add the prior to information (k, k) and moments (k,)."""
        self.precision = gram + self.prior_precision
        self.gradient = moment - self._prior_gradient(self.beta)

    def _information(
        self, beta: Array, indices: Indices
    ) -> tuple[list[Array], Array]:
        """Information (k, k) of each sensor's rows about some parameters, and moments (k,)."""
        size = len(indices)
        grams = []
        moment = np.zeros(size)
        for readings in self.readings:
            root_weights = readings.root_weights()
            gram = np.zeros((size, size))
            for part in readings.in_parts(beta, indices):
                gram_of_part, moment_of_part = part.information(root_weights)
                gram += gram_of_part
                moment += moment_of_part
            grams.append(gram)
        return grams, moment

    def _linearise_blocks(self) -> None:
        """Set the information of each block of rows, the precision and the gradient."""
        size = len(self.active)
        blocks = len(self.readings[0].edges) - 1
        self.grams = np.zeros((blocks, size, size))
        self.moments = np.zeros((blocks, size))
        for readings in self.readings:
            root_weights = readings.root_weights()
            linearised = readings.by_blocks(self.beta, self.active)
            for block, rows in enumerate(linearised):
                gram, moment = rows.information(root_weights)
                self.grams[block] += gram
                self.moments[block] += moment
        self._set_posterior(self.grams.sum(axis=0), self.moments.sum(axis=0))

    def _learn_scales_and_noise(self, covariance: Array) -> None:
        """Take one step of EM: scales and noise; `covariance` (k, k) is that of the posterior."""
        deviation = (self.beta - self.mean)[self.active]
        variance = np.diag(covariance)
        prior_share = float((covariance * self.prior_precision).sum())
        # numbers that the rows determine
        determined = len(deviation) - prior_share
        for hyper in self.hypers:
            index = hyper.indices
            # MacKay's (1992) fixed point: that of EM, in a third of the steps
            shares = variance[index] / self.sd[index] ** 2
            count = len(index) - float(shares.sum())
            count += hyper.pseudo
            if count <= 0.0:  # the rows do not constrain it
                continue
            squares = deviation[index] ** 2 / hyper.shape
            total = float(squares.sum())
            total += hyper.pseudo * hyper.scale**2
            within = np.array(hyper.within)
            smallest, largest = hyper.scale * within
            scale = np.sqrt(total / count)
            scale = float(np.clip(scale, smallest, largest))
            self.scales[hyper.name] = scale
            self.sd[index] = scale * np.sqrt(hyper.shape)
        # a few precise rows determine more than many coarse ones
        by_sensor = np.array(
            [(covariance * gram).sum() for gram in self.sensor_grams]
        )
        determined_by = determined * by_sensor / by_sensor.sum()
        for readings, count in zip(self.readings, determined_by, strict=True):
            readings.learn_noise(float(count) / readings.z.size)

    def _learn_noise(self) -> None:
        """Find the noise of each sensor, as if the parameters had not been fitted to its rows."""
        for readings in self.readings:
            readings.learn_noise(0.0)

    def _prior_gradient(self, beta: Array) -> Array:
        """Gradient (k,) of the prior's energy."""
        deviation = (beta - self.mean)[self.active]
        if self._precision is None:
            return deviation / self.sd**2
        return self._precision @ deviation

    def _energy(self, beta: Array, residuals: list[Array]) -> float:
        """Negative log posterior of parameters and residuals, up to a constant, or infinite."""
        with np.errstate(all="ignore"):
            energy = 0.0
            for readings, residual in zip(
                self.readings, residuals, strict=True
            ):
                energy += readings.energy(residual)
            deviation = (beta - self.mean)[self.active]
            energy += 0.5 * float(deviation @ self._prior_gradient(beta))
        return energy if np.isfinite(energy) else np.inf


@dataclass(frozen=True)
class Start:
    """Parameters that damped steps carry on from."""

    structure: Structure  # with its signs and mirror
    beta: Array  # (d,)
    cost: float = 0.0  # negative log posterior at the start's own noise
    noise: float = 0.0  # share of the extents that the residuals have

    def run(self, rows: Rows, prior: Prior, steps: int) -> Start:
        """The start after further damped steps, with Student noise."""
        floor = SIMULATED_FLOOR * self.structure.extents
        rows = replace(rows, floor=floor)
        fit = Fit(
            self.structure, [rows], self.beta, prior, nu=STUDENT, blocks=1
        )
        return Start(self.structure, *fit.search(steps))
