"""Judged rows: how far predictions are off, as delivered, as calibrated and on rows held out."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..common.arrays import Array, Index
from ..errors import CalibError
from ..model.model import Model
from ..model.nominal import nominal_arm, nominal_behind, nominal_in_plane
from ..samples.samples import Samples
from ..training.evaluate import evaluate, simulation_of
from .settings import AMOUNTS

_BLOCKS = 10
_STUDENT_95 = (
    2.26  # half-width of a 95 % interval of the mean of ten blocks, in standard errors
)


@dataclass(frozen=True, eq=False)
class JudgedRows:
    """Rows that a model is judged by, in the order of their log.

    Errors are measured less predicted positions, (n, m) [unit].
    """

    q: Array  # (n, dof) [rad or m]
    x: Array  # (n, m) [unit], measured positions
    held_out: Array  # of predictions that have not seen the row
    learned: Array  # of the model, which may have learned from the row
    source: str  # what the rows are
    delivered: Array | None = None  # of the arm as its URDF describes it
    left_out: Array | None = None  # (k, m) [unit], positions of rows that take no part
    fresh: bool = False  # whether the model has seen none of them

    @property
    def distance(self) -> Array:
        """Distance (n,) [unit] between measured and held-out predicted positions."""
        return np.asarray(np.linalg.norm(self.held_out, axis=1))


class Bar(NamedTuple):
    """A mean error with its 95 % interval [unit]."""

    name: str
    mean: float
    low: float
    high: float


def rows_of(model: Model, log: Samples | None = None) -> JudgedRows | None:
    """Return the rows of a log, else those of the training, else fresh ones of a simulation."""
    rows = None
    if log is not None:
        rows = _rows_of_log(model, log)
    if rows is None:
        rows = _rows_of_training(model)
    if rows is None:
        return None
    answered = np.isfinite(rows.learned).all(axis=1)
    if not answered.any():
        return None
    rows = replace(
        rows,
        q=rows.q[answered],
        x=rows.x[answered],
        held_out=rows.held_out[answered],
        learned=rows.learned[answered],
    )
    return replace(rows, delivered=_as_delivered(model, rows.q, rows.x))


def _rows_of_training(model: Model) -> JudgedRows | None:
    """Fresh samples of a simulation, or the rows that are kept of a log; None without any."""
    simulation = simulation_of(model)
    if simulation is not None:
        rng = np.random.default_rng(model.about.seed)
        q = simulation.draw(AMOUNTS.fresh, rng)
        x = simulation.true(q, rng)
        predicted = model.forward(q)
        noise = simulation.noise * rng.standard_normal(x.shape)
        return JudgedRows(
            q, x, x - predicted, x + noise - predicted, "fresh exact samples"
        )
    if model.rows is None:
        return None
    learned = model.rows.x - model.forward(model.rows.q)
    held_out = learned if model.rows.held_out is None else model.rows.held_out
    return JudgedRows(model.rows.q, model.rows.x, held_out, learned, "rows held out")


def _rows_of_log(model: Model, log: Samples) -> JudgedRows | None:
    """The rows of a log that are sound and answered; None where the model learned from them."""
    residuals = evaluate(model, log).residuals
    if residuals is None:
        return None
    errors = -residuals.forward[model.default_readout]
    part = {tuple(q) for q in residuals.q.tolist()}
    out = np.array([tuple(q) not in part for q in model.about.joints_of(log).tolist()])
    return JudgedRows(
        residuals.q,
        residuals.x,
        errors,
        errors,
        "rows of the log",
        left_out=log.x[out],
        fresh=True,
    )


def _as_delivered(model: Model, q: Array, x: Array) -> Array | None:
    """Errors (n, m) [unit] of the URDF's arm, with the frame and the tool that suit it best."""
    about = model.about
    body = model.body
    try:
        if about.simulation:
            return np.asarray(x - nominal_arm(model).forward(q))
        if body is None or not about.urdf:
            return None
        structure = body.structure
        if structure.kind == "planar":
            structure, beta = nominal_in_plane(model)
        else:
            beta = nominal_behind(structure, body.beta)
    except CalibError:
        return None
    outputs = structure.blocks[0]
    predicted, slope = structure.linearise(q, beta, frame_of(model))
    error = x - predicted[:, :outputs]
    columns = slope[:, :outputs].reshape(error.size, -1)
    step = np.linalg.lstsq(columns, error.ravel(), rcond=1e-9)[0]
    return np.asarray(error - (columns @ step).reshape(error.shape))


def frame_of(model: Model) -> Index:
    """Indices of the parameters of a model's body that are not the arm's: sensor and tool."""
    assert model.body is not None  # noqa: S101 - who asks has one
    labels = model.body.structure.labels
    frame = [
        k for k in model.body.active if labels[k].group.startswith(("view.", "tool"))
    ]
    return np.array(frame, dtype=np.intp)


def bars_of(model: Model, rows: JudgedRows) -> list[Bar]:
    """Return the mean errors as delivered, before and after, and on rows held out."""
    bars = []
    if rows.delivered is not None:
        bars.append(_bar("as delivered", rows.delivered))
    if model.history and "before" in model.history[-1]:
        mean = float(model.history[-1]["before"]["mean"])
        bars.append(Bar("before this log", mean, mean, mean))
    if not rows.fresh:
        simulated = model.about.simulation is not None
        name = "as calibrated, noise included" if simulated else "as calibrated"
        bars.append(_bar(name, rows.learned))
    bars.append(_bar(f"on {rows.source}", rows.held_out))
    return bars


def _bar(name: str, errors: Array) -> Bar:
    """The mean distance of errors (n, m), its interval from contiguous blocks of rows."""
    distance = np.linalg.norm(errors, axis=1)
    mean = float(distance.mean())
    blocks = [
        block.mean() for block in np.array_split(distance, min(_BLOCKS, len(distance)))
    ]
    half = 0.0
    if len(blocks) > 1:
        half = _STUDENT_95 * float(np.std(blocks, ddof=1)) / len(blocks) ** 0.5
    return Bar(name, mean, max(mean - half, 0.0), mean + half)
