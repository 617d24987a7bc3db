"""A body: structure, parameters at their maximum and their covariance; what ``model.body`` is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from .structure import Array, Indices, Structure


@dataclass(frozen=True)
class Second:
    """A second fit with a wider hyperprior of the curves; the bound takes the worse of both.

    Attributes
    ----------
    beta : (d,) array
    covariance : (k, k) array
        Over the same active parameters as the first fit.
    noise : (m,) array
    """

    beta: Array
    covariance: Array
    noise: Array


@dataclass(frozen=True)
class Body:
    """A Gaussian belief over the parameters of an arm and its sensor.

    Attributes
    ----------
    structure : Structure
    beta : (d,) array
        Parameters at the maximum of the posterior.
    active : (k,) int array
        The parameters that were fitted.
    covariance : (k, k) array
        Posterior covariance of the active parameters.
    noise : (m,) array
        Noise sd of each output [unit; rad for rotations].
    kappa : float
        Inflation of the bound by leave-block-out errors, at least 1.
    tau : (m,) array
        Residual sd of the body itself, from leave-block-out errors beyond the noise [unit].
    residual : (m,) array
        Sd of a residual that an adaptation could not settle; added to the bound [unit].
    nu : float
        Degrees of freedom of the Student noise; infinite for Gaussian.
    autocorrelation : float
        Integrated autocorrelation time of the residuals [rows].
    scales : mapping of str to float
        Prior scales that the evidence chose, by the name of their `Hyper`.
    rows : int
        Rows of the fit.
    simulated : bool
        Whether the rows were exact samples of a simulation.
    second : Second or None
    """

    structure: Structure
    beta: Array
    active: Indices
    covariance: Array
    noise: Array
    kappa: float
    tau: Array
    residual: Array
    nu: float
    autocorrelation: float
    scales: Mapping[str, float]
    rows: int
    simulated: bool
    second: Second | None = None
