"""Facts: what a model is and what it was learned from, in words, for `info` and the report."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from ..common.choices import READOUTS
from ..common.wording import for_people, length_in_words, unit_of_joint, vector

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
    found = {"robot": about.robot or "none, learned from a log alone"}
    for k, name in enumerate(about.joint_names):
        found[f"joint {name}"] = learned_range(about, k, degrees=degrees)
    if about.tip:
        found["tip"] = about.tip
    if about.locked:
        found["locked"] = ", ".join(
            f"{name}={value:.6g}" for name, value in about.locked.items()
        )
    if about.plane:
        axes = ("origin", "x", "y")
        found["plane"] = ", ".join(
            f"{name} {vector(about.plane[name])}" for name in axes
        )
    found["positions in"] = about.unit
    found["learned from"] = _source(about)
    options = about.options
    found["maps"] = f"{options['map']}, {options['rule']} rule, {model.size_in_words}"
    found["expected error"] = f"95 % bound on the distance to the {about.bound_of}"
    found["model error"] = (
        "95 % bound on the distance to the true position in the sensor's frame"
    )
    if about.source == "log":
        found["bounds hold"] = (
            "in the session of the log: see an evaluation with `frame='free'`"
        )
    return found


def learned_range(about: About | Arm, k: int, *, degrees: bool) -> str:
    """Return the learned range of joint `k` in words."""
    factor, unit = unit_of_joint(about.revolute[k], degrees)
    return f"{about.lower[k] * factor:.6g} to {about.upper[k] * factor:.6g} {unit}"


def shown_errors(
    about: About, errors: Errors
) -> Iterator[tuple[str, str, str, _ErrorRow]]:
    """Yield direction, name and unit of each error with its statistics in that unit, by readout.

    The best readout comes first; NaN stands for what could not be measured.
    """
    readouts = [readout for readout in READOUTS if readout in errors]
    joints = dict(zip(about.joint_names, about.units_of_joints, strict=True))
    for direction, units in (("forward", {"orientation": "rad"}), ("inverse", joints)):
        for name in errors[readouts[0]][direction]:
            factor, unit = for_people(units.get(name, about.unit))
            statistics = {
                r: {k: math.nan if e[k] is None else factor * e[k] for k in STATISTICS}
                for r in readouts
                if (e := errors[r][direction].get(name)) is not None
            }
            yield direction, name, unit, statistics


def _source(about: About) -> str:
    words = [
        f"{about.samples} {'simulated samples' if about.simulation else 'rows of a log'}"
    ]
    words.append(f"seed {about.seed}")
    if about.simulation:
        noise = about.simulation.get("noise") or 0.0
        words.append(
            f"sensor noise {length_in_words(noise, about.unit)}"
            if noise
            else "no noise"
        )
        words += map(str, about.simulation.get("changes", ()))
    return ", ".join(words)
