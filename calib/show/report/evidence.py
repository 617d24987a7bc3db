"""Evidence: what a report is drawn from, gathered once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ...common.arrays import Array
from ...model.model import Model
from ...samples.samples import Samples
from ...training.evaluate import (
    Residuals,
    evaluate_residuals,
    fresh_residuals,
    in_sockets,
    simulation_of,
    summarise,
)
from ..workspace import training_rows


@dataclass(frozen=True, eq=False)
class Evidence:
    """A model and how it did."""

    model: Model
    errors: dict[str, Any]  # error table, as `calib evaluate --json` has it
    source: str  # what the errors are measured on
    residuals: Residuals | None  # the errors themselves; None for a model of a log without that log
    # (n, dof), (n, m), training samples in the unit boxes of both maps, as far as they can be had
    u: Array
    v: Array
    noise: float | None  # [unit], the sensor's along each axis, where it is known
    touches: Samples | None  # a log of touches as it is: its sockets' places are unknown

    @property
    def unit(self) -> str:
        """Unit of the positions."""
        return self.model.about.unit


def gather(model: Model, log: Samples | None = None) -> Evidence:
    """Evaluate a model, on a log or on fresh samples of the simulated arm."""
    simulation = simulation_of(model)
    touches = log if log is not None and log.touch is not None else None
    if touches is not None and touches.touch is not None:
        log = in_sockets(model, touches, touches.touch)[0]
    q, x, _ = training_rows(model, log)
    errors, residuals = dict(model.about.errors), None
    source = "rows held out in contiguous blocks while it was trained"
    if log is None and simulation is not None:
        residuals = fresh_residuals(model, simulation)
        source = f"{len(residuals.q):,} fresh exact samples"
        errors = summarise(residuals)
    elif len(q):  # of kept rows heat maps tell something; the model learned from them
        residuals = evaluate_residuals(model, q, x, None)
    if log is not None and residuals is not None:
        errors, source = summarise(residuals), f"{len(residuals.q):,} rows of the log"
        if residuals.left_out:
            source += f"; {residuals.left_out:,} outside of what was learned are left out"
    u, v = model.motor.scale.to_unit(q), model.sensory.scale.to_unit(x)
    noise = None if simulation is None else simulation.noise
    return Evidence(model, errors, source, residuals, u, v, noise, touches)
