"""Advice: what was found, what limits a model's accuracy now, and what would help most."""

from __future__ import annotations

from typing import TYPE_CHECKING

from calib.common.wording import for_people, printable
from calib.model.facts import Errors

from .output import number
from .summary import best_readout

if TYPE_CHECKING:
    from calib import Model

_EXACT = 1e-9  # share of the extent below which an error is rounding
_ASKED = 200  # points of the learned range at which the bound is asked
_UNEVEN = 2.0  # so many times wider in its worst tenth than in its best, a bound tells of few rows
_MOST = 3  # findings that are printed; `calib info` has all


def found_by_body(model: Model) -> list[str]:
    """Return in one line what differs from the drawing, or what was found without one."""
    if model.about.source != "log":
        return []
    if model.body is None:
        return ["found: no kinematic body under the maps"]
    lines = [printable(" ".join(line.split())) for line in model.body.describe()]
    if not lines:
        return ["found: nothing that differs from the drawing by more than these rows can show"]
    more = f"; {len(lines) - _MOST} more in calib info" if len(lines) > _MOST else ""
    return [f"found: {'; '.join(lines[:_MOST])}{more}"]


def advice(model: Model, errors: Errors) -> list[str]:
    """Return in one line what limits the accuracy, and the one thing that would help most."""
    import numpy as np

    about = model.about
    mean = errors[best_readout(errors)]["forward"]["distance"]["mean"]
    extent = float(np.linalg.norm(model.sensory.scale.span))
    if about.source == "simulation" and model.body is not None and mean < _EXACT * extent:
        return ["limited by rounding alone: nothing was simulated that the model does not hold"]
    more = "more samples (-n)" if about.source == "simulation" else "more rows"
    if model.body is None:
        return [f"limited by maps that stand alone; {more} and a larger --size help most"]
    q = np.random.default_rng(0).uniform(about.lower, about.upper, (_ASKED, len(about.lower)))
    bound = model.expected_error(q)
    known = np.isfinite(bound)
    factor, unit = for_people(about.unit)
    plan = "calib plan MODEL lists where more rows help most"
    if known.mean() < 0.9:
        share = f"{100 * known.mean():.0f} % of the learned range"
        return [f"limited by coverage: only {share} have an answer; {plan}"]
    low, high = np.quantile(bound[known], (0.1, 0.9))
    if high > _UNEVEN * low:
        span = f"{number(factor * low)} to {number(factor * high)} {unit}"
        return [f"limited by few rows in parts of the range (bound {span}); {plan}"]
    if about.source == "simulation":
        return [f"limited by the simulated noise and changes; {more} help most"]
    return [
        f"limited by what rows leave unexplained ({number(factor * mean)} {unit}), noise of the "
        "readings or more; poses measured twice tell which, rows at rest (--still) help most"
    ]
