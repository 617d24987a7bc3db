"""Facts: what a model is and what it was learned from, in words, for `info` and the report."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from ..common.choices import READOUTS
from ..common.wording import for_people, sized, unit_of_joint, vector

if TYPE_CHECKING:
    from ..arm.arm import Arm
    from .about import About
    from .parts import Parts

STATISTICS = ("mean", "p99", "max")
Errors = Mapping[str, Mapping[str, Mapping[str, Mapping[str, Any]]]]
"""Statistics by readout, direction and quantity, as a model keeps them."""
_ErrorRow = dict[str, dict[str, float]]
"""Statistics of one quantity, by readout."""


def facts(model: Parts, *, degrees: bool = True) -> dict[str, str]:
    """Return names and values; ranges of joints that turn in degrees or in rad."""
    about = model.about
    options = about.options
    words = {"robot": about.robot or "none, learned from a log alone"}
    for k, name in enumerate(about.joint_names):
        words[f"joint {name}"] = learned_range(about, k, degrees=degrees)
    if about.tip:
        words["tip"] = about.tip
    if about.locked:
        places = [f"{name}={value:.6g}" for name, value in about.locked.items()]
        words["locked"] = ", ".join(places)
    if about.plane:
        axes = [
            f"{name} {vector(about.plane[name])}"
            for name in ("origin", "x", "y")
        ]
        words["plane"] = ", ".join(axes)
    words |= {
        "positions in": about.unit,
        "learned from": _source(about),
        "maps": f"{options['map']}, {options['rule']} rule, {model.size_in_words}",
        "expected error": f"95 % bound on the distance to the {about.bound_of}",
        "model error": (
            "95 % bound on the distance to the true position in the sensor's frame"
        ),
    }
    if about.source == "log":
        words["bounds hold"] = (
            "in the session of the log: see an evaluation with `frame='free'`"
        )
    return words


def learned_range(about: About | Arm, k: int, *, degrees: bool) -> str:
    """Return the learned range of joint `k` in words."""
    factor, unit = unit_of_joint(about.revolute[k], degrees)
    return (
        f"{about.lower[k] * factor:.6g} to {about.upper[k] * factor:.6g} {unit}"
    )


def shown_errors(
    about: About, errors: Errors
) -> Iterator[tuple[str, str, str, _ErrorRow]]:
    """Yield direction, name and unit of each error with its statistics in that unit, by readout.

    The best readout comes first; NaN stands for what could not be measured.
    """
    readouts = [readout for readout in READOUTS if readout in errors]
    joints = dict(zip(about.joint_names, about.units_of_joints, strict=True))
    for direction, units in (
        ("forward", {"orientation": "rad"}),
        ("inverse", joints),
    ):
        for name in errors[readouts[0]][direction]:
            factor, unit = for_people(units.get(name, about.unit))
            statistics: _ErrorRow = {}
            for readout in readouts:
                error = errors[readout][direction].get(name)
                if error is not None:
                    statistics[readout] = _in_unit(error, factor)
            yield direction, name, unit, statistics


def _in_unit(error: Mapping[str, Any], factor: float) -> dict[str, float]:
    """Return statistics in another unit, NaN for what could not be measured."""
    return {
        name: math.nan if error[name] is None else factor * error[name]
        for name in STATISTICS
    }


def _source(about: About) -> str:
    kind = "simulated samples" if about.simulation else "rows of a log"
    words = [f"{about.samples} {kind}", f"seed {about.seed}"]
    if about.simulation:
        noise = about.simulation.get("noise") or 0.0
        if noise:
            words.append(f"sensor noise {sized(noise, about.unit)}")
        else:
            words.append("no noise")
        words += map(str, about.simulation.get("changes", ()))
    return ", ".join(words)
