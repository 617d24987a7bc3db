"""Honesty of `adapt` in space: the real UR10's six joints, unchanged and mounted anew."""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

from honest_change import Trial, adapted, judged_trials
from honest_real import SERIES, halves, nominal_urdf
from honest_worlds import Row

import calib

SPARSE = 373
"""Rows of a sparse model, nearly: much of the joints' waves is then left to learn."""


@cache
def space(folder: Path, name: str) -> calib.Samples:
    """One series with orientations, for the UR10's URDF."""
    return calib.read_log(folder / f"full_{name}.csv", calib.load_arm(nominal_urdf()))


def adaptations(folder: Path, quick: bool) -> Iterator[Row]:
    """Odd blocks after even ones, and A after C: 40, 150 and 400 contiguous rows, ten places.

    Of each series a model of all rows and one of few, each with positions alone and with
    orientations.
    """
    trials: list[Trial] = []
    for name in SERIES[: 1 if quick else None]:
        log = space(folder, name)
        other = space(folder, SERIES[1 - SERIES.index(name)])
        even, odd = halves(len(log), 10)[0]
        few = even[:: max(1, len(even) // SPARSE)]
        for posed in (False, True):
            for learned in (few,) if quick else (even, few):
                model = calib.train(_seen(log.take(learned), posed))
                trials += _trials(model, _seen(log.take(odd), posed), True, quick)
                if len(learned) == len(even) and not posed:
                    trials += _trials(model, _seen(other, posed), False, quick)
    yield from judged_trials("in space", trials)


def _seen(log: calib.Samples, posed: bool) -> calib.Samples:
    return log if posed else replace(log, orientation=None)


def _trials(model: calib.Model, log: calib.Samples, same: bool, quick: bool) -> Iterator[Trial]:
    """Every size at ten places of a log."""
    for n in (150,) if quick else (40, 150, 400):
        for place in range(0, 10, 9 if quick else 1):
            yield adapted(model, log, n, place, same, every=10)
