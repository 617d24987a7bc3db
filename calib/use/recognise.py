"""Recognising: which of several models a log fits."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..change.judge import judge
from ..common.rows import rms
from ..errors import LogError, OptionError, require
from ..model.model import Model
from ..samples.samples import Samples


@dataclass(frozen=True)
class ModelFit:
    """How a log fits one model."""

    index: int  # of the model in the list
    fits: bool  # whether `check` finds it still calibrated
    score: float  # that of `check`; infinite where it cannot be compared
    # [unit], root mean square distance from predicted to measured position
    distance: float


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
    """Find which of several models fits a log; ten to thirty rows are enough.

    A model fits where `check` calls it still calibrated; of those the nearest to the rows answers.

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
    require("models", models, Sequence)
    if not len(models):
        raise OptionError(
            "no models: give one or more, one for each state of the arm"
        )
    fits: list[ModelFit] = []
    why = None
    for index, model in enumerate(models):
        try:
            verdict = judge(model, log, learn=False)
        except LogError as error:  # outside of what this one has learned
            why = error
            fits.append(ModelFit(index, False, np.inf, np.inf))
            continue
        distance = rms(verdict.rows.distance)
        fits.append(
            ModelFit(index, verdict.changed is False, verdict.score, distance)
        )
    fits.sort(key=lambda fit: (not fit.fits, fit.distance))
    if why is not None and fits[0].distance == np.inf:
        raise why
    return Recognition(
        fits[0].index if fits[0].fits else None, len(log), tuple(fits)
    )
