"""Adaptation: a link is lengthened, or shortened, and the maps follow (eq. 9 to 12)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from ..common.arrays import Array
from ..common.rows import row_lengths
from ..maps.vdsom import zeta
from ..stream.follow import Step, follow
from ..training.train import train
from .setting import Setting
from .tables import READOUTS, Cells, Result, Table

if TYPE_CHECKING:
    from ..model.model import Model
    from ..samples.samples import Samples

_CHANGES = {"lengthened": "+20%", "shortened": "-20%"}
"""A tool that is mounted and one that is removed: the paper does not state how long."""

_STREAM = 91  # of the samples that come after the change
_RULE = "activity, eq. 11 alone"  # the links as the rule has made them, step by step


@dataclass(frozen=True, eq=False)
class FollowedChange:
    """One change and what came of it."""

    before: Model  # as it was trained
    after: Model  # at the end of the stream
    steps: tuple[Step, ...]  # distortion, error and schedules along the stream
    q: Array  # (n, dof), joints of exact test points of the changed arm
    x: Array  # (n, 2) [m]
    # {readout: {"trained", "changed", "adapted"}}: mean and largest forward error [m].  The readout
    # "rule" is ``activity`` with the links that eq. 11 made on the way, which the delivered model
    # replaces by those at which it comes to rest.
    errors: dict[str, dict[str, dict[str, float]]]
    # in these states, of the sensory map in the unit box (eq. 9)
    distortion: dict[str, float]


def _followed_change(
    setting: Setting, samples: Samples, before: Model, change: str
) -> FollowedChange:
    """Change the arm that a model was trained on, and let the model follow as many samples."""
    seed = setting.seeds[0]
    n = len(samples)
    stream = setting.babble(seed + _STREAM, n, changes=(change,))
    steps = []
    after = rule = before
    for step, adapter in follow(before, stream.q, stream.x, horizon=n // 2):
        steps.append(step)
        setting.report(step.samples / n, f"{change}: sigma {step.sigma:.2f}")
        if step.samples == n:
            after = adapter.model()
            rule = adapter.model("rule")
    q, old = setting.validation(samples, seed, 40_000)
    _, x = setting.validation(stream, seed, 40_000)
    # a model and joints of its change: before it, after it, and once the model has followed
    states = {
        "trained": (before, old),
        "changed": (before, x),
        "adapted": (after, x),
    }
    errors = {
        readout: {
            state: _error(model, q, at, readout)
            for state, (model, at) in states.items()
        }
        for readout in READOUTS
    }
    adapted = _error(rule, q, x, "activity")
    errors["rule"] = {**errors["activity"], "adapted": adapted}
    distortion = {
        state: zeta(model.sensory.units, model.sensory.scale.to_unit(at))
        for state, (model, at) in states.items()
    }
    return FollowedChange(before, after, tuple(steps), q, x, errors, distortion)


def _error(model: Model, q: Array, x: Array, readout: str) -> dict[str, float]:
    gap = row_lengths(model.forward(q, readout) - x)
    gap = gap[np.isfinite(gap)]
    return {"mean": float(gap.mean()), "max": float(gap.max())}


@lru_cache(maxsize=2)
def adaptation(setting: Setting) -> tuple[Result, dict[str, FollowedChange]]:
    """Both changes: figures, and the curves along the stream."""
    seed = setting.seeds[0]
    # 20,000, as calib train has them
    samples = setting.babble(seed, min(setting.samples, 20_000))
    before = train(
        samples, size=setting.side, map="vdsom", body="none", seed=seed
    )
    changes = {name: f"elbow.length={by}" for name, by in _CHANGES.items()}
    followed = {
        name: _followed_change(setting, samples, before, change)
        for name, change in changes.items()
    }
    data: dict[str, object] = {}
    for name, change in followed.items():
        noticed = [step.samples for step in change.steps if step.adapting]
        data[name] = {
            "change": changes[name],
            "errors": change.errors,
            "distortion": change.distortion,
            "samples_to_notice": noticed[0] if noticed else None,
            "samples": change.steps[-1].samples,
        }
    words = " and ".join(f"{name}: {by}" for name, by in changes.items())
    title = f"distortion and forward error, {words}"
    tables = (_summary(title, followed), _curves(followed))
    return Result(data, tables), followed


def _summary(title: str, followed: Mapping[str, FollowedChange]) -> Table:
    """Distortion and errors of each readout, before a change, after it, and once adapted."""
    rows: list[Cells] = []
    for name, change in followed.items():
        for state, distortion in change.distortion.items():
            for readout, errors in change.errors.items():
                error = errors[state]
                words = _RULE if readout == "rule" else readout
                millimetres = [1e3 * error["mean"], 1e3 * error["max"]]
                rows.append([name, state, words, distortion, *millimetres])
    header = ("change", "state", "readout", "zeta", "mean [mm]", "max [mm]")
    return Table("adaptation", title, header, rows)


def _curves(followed: Mapping[str, FollowedChange]) -> Table:
    """Distortion, error and schedules along the stream of each change."""
    rows: list[Cells] = [
        [
            name,
            step.samples,
            step.zeta_motor,
            step.zeta_sensory,
            step.threshold if np.isfinite(step.threshold) else None,
            1e3 * step.error,
            step.sigma,
            step.eta,
            step.beta,
            float(step.adapting),
        ]
        for name, change in followed.items()
        for step in change.steps
    ]
    header = (
        "change",
        "samples",
        "zeta motor",
        "zeta sensory",
        "threshold",
        "error [mm]",
        "sigma [nodes]",
        "eta",
        "beta",
        "adapting",
    )
    title = "along the stream of samples"
    return Table("adaptation_curves", title, header, rows)
