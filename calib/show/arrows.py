"""Arrows: from where the tip was seen to where a model has it, drawn long enough to be seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array
from ..common.rows import thinned
from ..model.model import Model
from .error_scale import length_in_words

_LONG = 0.06  # of the picture's width: the longest arrows, about
_MOST = 300


@dataclass(frozen=True, eq=False)
class Arrows:
    """Arrows of some measured rows."""

    # (n, 2) [unit], where they start and end
    seen: Array
    ends: Array
    words: str  # what they mean

    @staticmethod
    def of(model: Model, q: Array, x: Array, width: float) -> Arrows | None:
        """Return at most 300 arrows over a picture of a width [unit]; None where no row counts."""
        some = thinned(len(q), _MOST)
        seen = np.asarray(x[some])
        miss = model.forward(q[some]) - seen if len(seen) else seen
        known = np.isfinite(miss).all(axis=1)
        seen, miss = seen[known], miss[known]
        if not len(seen):
            return None
        away = np.linalg.norm(miss, axis=1)
        times = magnification(float(np.quantile(away, 0.95)), width)
        mean = length_in_words(float(away.mean()), model.about.unit)
        longer = f", drawn {times:,} times as long" if times > 1 else ""
        words = f"from a seen tip to the predicted one: {mean} on average{longer}"
        return Arrows(seen, seen + times * miss, words)


def magnification(away: float, width: float) -> int:
    """How many times as long arrows are drawn: 1, 2 or 5 times a power of ten; 1 at least.

    Examples
    --------
    >>> magnification(0.05, 1280.0), magnification(2.0, 1280.0), magnification(200.0, 1280.0)
    (1000, 20, 1)
    """
    wanted = max(_LONG * width / away, 1.0) if away > 0 else 1.0
    power = 10 ** int(np.floor(np.log10(wanted)))
    return int(power * max(step for step in (1, 2, 5) if step * power <= wanted))
