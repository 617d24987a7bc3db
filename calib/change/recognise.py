"""Recognising: which of several models the arm is in, such as with a tool and without it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..common.arrays import Array
from ..common.parallel import one_blas_thread
from ..errors import LogError, OptionError
from ..model.model import Model
from ..samples.samples import Samples
from .comparison import compare

_FREEDOM = 6.0  # of the Student distribution of a row: one wrong detection decides nothing
_GRAIN = 1e-6  # share of the reach below which a bound is none: exact simulations have none


@dataclass(frozen=True)
class ModelFit:
    """How a log fits one model."""

    index: int  # of the model in the list
    fits: bool  # whether `check` finds it still calibrated
    score: float  # that of `check`; infinite where it cannot be compared
    distance: float  # [unit], median distance from predicted to measured position
    likelihood: float  # mean log density of a row [1 / unit^m]; the larger one fits better

    def to_json(self) -> dict[str, Any]:
        """By name; infinite numbers are none."""
        return {k: None if v in (np.inf, -np.inf) else v for k, v in vars(self).items()}


@dataclass(frozen=True)
class Recognition:
    """Which model a log fits.

    Attributes
    ----------
    index : int or None
        The model that fits best, None where each is contradicted.
    samples : int
        Rows of the log.
    fits : tuple of ModelFit
        All models, the most likely first.
    """

    index: int | None
    samples: int
    fits: tuple[ModelFit, ...]


def recognise(models: Sequence[Model], log: Samples) -> Recognition:
    """Tell which of some models a log fits; ten to thirty rows do.

    A model fits where `check` calls it still calibrated.  Of those that fit the one under which
    the rows are most likely answers.

    Parameters
    ----------
    models : sequence of Model
        One for each state of the arm.
    log : Samples
        Rows of the same arm.

    Raises
    ------
    OptionError
        If there is no model.
    LogError
        If the log can be compared with none of them.

    Examples
    --------
    >>> import calib
    >>> arm = calib.load_arm("two_link")
    >>> plain = calib.train(calib.babble(arm, 500, noise=1e-3), size=10)
    >>> log = calib.babble(arm, 60, seed=1, noise=1e-3, changes=["tip.offset=0.05,0"])
    >>> tool = calib.adapt(plain, log).model
    >>> calib.recognise([plain, tool], log.take(slice(30))).index
    1
    """
    if not len(models):
        raise OptionError("no models: give one or more, one for each state of the arm")
    found, why = [], None
    with one_blas_thread():
        for index, model in enumerate(models):
            try:
                found.append(_fit_of(index, model, log))
            except LogError as error:  # outside of what this one has learned
                why = error
                found.append(ModelFit(index, False, np.inf, np.inf, -np.inf))
    if why is not None and all(f.score == np.inf for f in found):
        raise why
    found.sort(key=lambda f: -f.likelihood)
    return Recognition(next((f.index for f in found if f.fits), None), len(log), tuple(found))


def _fit_of(index: int, model: Model, log: Samples) -> ModelFit:
    """How a log fits one model."""
    compared = compare(model, log)
    miss: Array = compared.missed
    axes = compared.x.shape[1]
    sigma = np.maximum(model.expected_error(compared.q), _GRAIN * model.reach) / np.sqrt(2 * axes)
    density = -axes * np.log(sigma)
    density -= (_FREEDOM + axes) / 2 * np.log1p((miss / sigma) ** 2 / _FREEDOM)
    score = compared.score
    return ModelFit(index, score <= 1.0, score, float(np.median(miss)), float(density.mean()))
