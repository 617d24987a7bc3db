"""Search: each network's own best schedule, on points that no table sees."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

from .setting import Setting
from .trial import Schedule, Trial, activity_errors, association

SAME = Schedule(20, 2.0)
"""The schedule at which the paper's ratio of SOM to VDSOM appears."""

_EPOCHS = (20, 40)
_SIGMAS = (0.4, 0.7, 1.0, 1.5, 2.0)
_LINKS = ("reciprocal", "oja")


class Found(NamedTuple):
    """A schedule and its score: mean error of the four columns, as a share of the ranges."""

    schedule: Schedule
    score: float


def best_schedule(setting: Setting, network: str, side: int | None = None) -> list[Found]:
    """Schedules of one network by their validation error, the best first.

    The readout is ``activity``; samples and validation points are those of the first seed,
    on a stream of their own.
    """
    side = side or setting.side
    seed = setting.seeds[0]
    samples = setting.babble(seed)
    q, x = setting.validation(samples, seed)
    found = []
    for schedule in candidates(setting):
        pair = association(samples, network, schedule, side, seed)
        score = float(activity_errors(pair, q, x).mean(axis=0).mean())
        found.append(Found(schedule, score))
        setting.report(len(found) / len(candidates(setting)), f"{network}: {schedule}")
    return sorted(found, key=lambda f: f.score)


def candidates(setting: Setting) -> list[Schedule]:
    """The schedules that are compared, the same for every network."""
    if setting.quick:
        return [Schedule(), Schedule(10, 1.0)]
    radii = [Schedule(epochs, sigma) for epochs in _EPOCHS for sigma in _SIGMAS]
    plain = [Schedule(), *radii]
    # one bandwidth and one-sided links for the shortest of each: they are behind everywhere
    others = [Schedule(None, None, _LINKS[1])]
    others += [Schedule(_EPOCHS[0], sigma, _LINKS[1]) for sigma in _SIGMAS]
    return plain + others


@lru_cache(maxsize=8)
def best_trial(setting: Setting, network: str) -> tuple[Trial, list[Found]]:
    """The network at its own best schedule, and all that were compared."""
    found = best_schedule(setting, network)
    return Trial(network, found[0].schedule, setting.side), found
