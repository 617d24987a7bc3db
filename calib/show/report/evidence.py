"""Evidence: what a report is drawn from, gathered once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...common.arrays import Array
from ...model.model import Model
from ...samples.samples import Samples
from ...training.evaluate import (
    Residuals,
    evaluate_residuals,
    fresh_residuals,
    simulation_of,
    summarise,
)
from ..workspace import extent, training_rows


@dataclass(frozen=True, eq=False)
class Evidence:
    """A model and how it did."""

    model: Model
    errors: dict[str, Any]  # error table, as `calib evaluate --json` has it
    source: str  # what the errors are measured on
    residuals: Residuals | None  # the errors themselves; None for a model of a log without that log
    left_out: int  # rows outside of what was learned
    # (n, dof), (n, 2), training samples in the unit boxes of both maps, as far as they can be had
    u: Array
    v: Array
    # [unit], standard deviation of the sensor along each axis, where it is known
    noise: float | None

    @property
    def extent(self) -> float:
        """Longer side of the workspace [unit]."""
        return extent(self.model)

    @property
    def unit(self) -> str:
        """Unit of the positions."""
        return self.model.about.unit


def gather(model: Model, samples: Samples | None = None) -> Evidence:
    """Evaluate a model, on a log or on fresh samples of the simulated arm."""
    simulation = simulation_of(model)
    q, x, _ = training_rows(model, samples)
    residuals, source = None, "rows held out in contiguous blocks while it was trained"
    errors, left_out = dict(model.about.errors), 0
    if samples is None and simulation is not None:
        residuals = fresh_residuals(model, simulation)
        source = f"{len(residuals.q):,} fresh exact samples"
    elif len(q):
        residuals = evaluate_residuals(model, q, x, None)
    if samples is not None and residuals is not None:
        left_out, source = (
            residuals.left_out,
            f"{len(residuals.q):,} rows of the log that was given",
        )
    # kept rows are good for heat maps, but the model learned from them: their errors are too small
    learned = samples is None and simulation is None
    if residuals is not None and len(residuals.q) and not learned:
        errors = summarise(residuals)
    noise = None if simulation is None else simulation.noise
    u = model.motor.scale.to_unit(np.array(q))
    v = model.sensory.scale.to_unit(np.array(x))
    return Evidence(model, errors, source, residuals, left_out, u, v, noise)
