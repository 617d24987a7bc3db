"""Search: each network's own best schedule, on points that no table sees."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from .setting import Setting
from .trial import NetworkTrial, Schedule, activity_errors, association

SAME_SCHEDULE = Schedule(20, 2.0)
"""The schedule at which the paper's ratio of SOM to VDSOM appears."""

_EPOCHS = (20, 40)
_SIGMAS = (0.4, 0.7, 1.0, 1.5, 2.0)
_LINKS = ("reciprocal", "oja")
_FINALISTS = 4
"""So many candidates are judged on every seed: one seed alone is one map's luck."""


class Found(NamedTuple):
    """A schedule and its score: mean error of the four columns, as a share of the ranges."""

    schedule: Schedule
    score: float


def best_schedule(setting: Setting, network: str, side: int | None = None) -> list[Found]:
    """Schedules of one network by their validation error, the best first.

    The readout is ``activity``.  Successive halving (Jamieson and Talwalkar, AISTATS 2016):
    each seed, with samples and validation points of its own, judges the better half of what
    the seeds before it left, down to a few finalists, which every seed judges.  A candidate
    that stayed longer comes before one that was dropped earlier.
    """
    side = side or setting.side
    kept, dropped = schedules(setting), list[Found]()
    scores: dict[Schedule, list[float]] = {schedule: [] for schedule in kept}
    for k, seed in enumerate(setting.seeds):
        samples = setting.babble(seed)
        q, x = setting.validation(samples, seed)
        for n, schedule in enumerate(kept):
            pair = association(samples, network, schedule, side, seed)
            scores[schedule].append(float(activity_errors(pair, q, x).mean()))
            share = (k + (n + 1) / len(kept)) / len(setting.seeds)
            setting.report(share, f"{network}: {schedule}")
        found = sorted((Found(s, float(np.mean(scores[s]))) for s in kept), key=lambda f: f.score)
        half = max(_FINALISTS, math.ceil(len(found) / 2)) if k + 1 < len(setting.seeds) else None
        kept = [f.schedule for f in found[:half]]
        dropped = found[half:] + dropped if half else dropped
    return found + dropped


def schedules(setting: Setting) -> list[Schedule]:
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
def best_trial(setting: Setting, network: str) -> tuple[NetworkTrial, list[Found]]:
    """The network at its own best schedule, and all that were compared."""
    found = best_schedule(setting, network)
    return NetworkTrial(network, found[0].schedule, setting.side), found
