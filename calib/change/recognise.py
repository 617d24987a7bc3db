"""Recognising: which of several models the arm is in, such as with a tool and without it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ..common.parallel import one_blas_thread
from ..errors import LogError, OptionError
from ..model.model import Model
from ..samples.samples import Samples
from .comparison import compare


@dataclass(frozen=True)
class ModelFit:
    """How a log fits one model."""

    index: int  # of the model in the list
    fits: bool  # whether `check` finds it still calibrated
    score: float  # that of `check`; infinite where it cannot be compared
    distance: float  # [unit], median distance from predicted to measured position

    def to_json(self) -> dict[str, Any]:
        """By name; infinite numbers are none."""
        return {k: None if v == np.inf else v for k, v in asdict(self).items()}


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
        All models, those that fit first, the nearest before the others.
    """

    index: int | None
    samples: int
    fits: tuple[ModelFit, ...]


def recognise(models: Sequence[Model], log: Samples) -> Recognition:
    """Tell which of some models a log fits; ten to thirty rows do.

    A model fits where `check` calls it still calibrated.  Of those that fit the one nearest to the
    rows answers.

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
    for index, model in enumerate(models):
        try:
            with one_blas_thread():
                compared = compare(model, log)
                score, distance = compared.score, float(np.median(compared.missed))
        except LogError as error:  # outside of what this one has learned
            why, score, distance = error, np.inf, np.inf
        found.append(ModelFit(index, score <= 1.0, score, distance))
    if why is not None and all(f.score == np.inf for f in found):
        raise why
    found.sort(key=lambda f: (not f.fits, f.distance))
    return Recognition(found[0].index if found[0].fits else None, len(log), tuple(found))
