"""Adaptation: a model round another body, with its facts and its history."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from ..body.belief import Body
from ..common.arrays import Array, Document, Index
from ..common.rows import row_lengths, spread_rows
from ..common.scale import Scale
from ..maps.local_models import NO_MODELS, LocalModels
from ..maps.map import Map
from ..maps.predictor import BodyInBox, Predictor
from ..model.about import About, MeasuredRows
from ..model.alignment import Alignment
from ..model.baseline import Baseline, RowPlaces, learn_baseline
from ..model.model import Model
from ..model.parts import MOST_BLENDED, bounds_of_nodes
from ..samples.motion import Motion
from ..training.residuals import (
    ErrorTable,
    error_sizes,
    evaluate_residuals,
    summarise,
)
from .causes import Cause
from .frame import offset_after
from .rows import LogRows
from .verdict import Verdict


@dataclass(frozen=True)
class AdaptationSettings:
    """When an adaptation is written, and what it is evaluated on."""

    # largest error of a model at the rows, over the one that the linear update promised
    consistent: float = 1.2
    # largest error over the one before that is enough although the linear update promised less:
    # exact rows after a lens, 1e-5 mm promised, 20 mm before
    clearly_better: float = 0.01
    # `LogRows.least_relative_spread` of rows that span the learned range
    wide: float = 0.5
    # cells along each joint, for the share of the range that a log measured
    cells: int = 5
    # random joint values that the new baseline is computed at
    baseline: int = 6000
    # rows that the readouts are evaluated on
    evaluated: int = 500


ADAPTATION = AdaptationSettings()
ARM_AND_SENSOR = ("the arm and the sensor",)
"""`Adaptation.kept` where nothing changed."""


@dataclass(frozen=True, eq=False, repr=False)
class Adaptation:
    """The result of adapting a model to a log.

    Attributes
    ----------
    model : Model
        The adapted model, or the old one, with wider bounds where the rows contradict its own.
    improved : bool
        Whether held-out rows are predicted better than before.
    samples : int
        Rows of the log that count.
    outliers : int
        Rows that were left out as wrong detections.
    before, after : dict
        "mean", "max" and "p99" [unit] of the distance from measured to predicted position, on
        rows that neither prediction has seen.
    correction : str
        What was corrected, in words.
    changed : tuple of Cause
        What changed, as `check` reports of the same log.
    kept : tuple of str
        What was kept as it was.
    coverage : float
        Share of the learned range that the log measured.
    notes : tuple of str
        Notes for the user.
    everywhere : bool
        Whether the rows span the learned range; otherwise `improved` concerns their own region.
    left_out : int
        Outliers, and rows of the log outside of what the model has learned.
    verdict : Verdict
        The verdict of the log on the old model.
    """

    model: Model
    improved: bool
    samples: int
    outliers: int
    before: dict[str, float]
    after: dict[str, float]
    correction: str
    changed: tuple[Cause, ...]
    kept: tuple[str, ...]
    coverage: float
    notes: tuple[str, ...]
    everywhere: bool
    left_out: int
    verdict: Verdict

    def with_note(self, note: str) -> Adaptation:
        """The adaptation with one more note."""
        return replace(self, notes=(*self.notes, note))

    def __repr__(self) -> str:
        """Summarise in two lines whether it helped, and what was corrected."""
        verdict = (
            "improved" if self.improved else "not improved, the old model stays"
        )
        head = (
            f"Adaptation: {verdict}, {self.samples} samples, {self.correction}"
        )
        before = self.before["mean"]
        after = self.after["mean"]
        return f"{head}\n  mean error {before:.3g} -> {after:.3g} {self.model.about.unit}"


def unchanged_adaptation(
    verdict: Verdict,
    before: Array,
    after: Array,
    correction: str,
    kept: tuple[str, ...] = ARM_AND_SENSOR,
) -> Adaptation:
    """An adaptation that keeps the old model.

    before, after : distances (k,) of held-out rows from the old model, and from the update [unit]
    kept : what was kept as it was, in words
    """
    rows = verdict.rows
    changed = [cause for cause in verdict.causes if cause.group != "noise"]
    return Adaptation(
        model=rows.model,
        improved=False,
        samples=len(rows),
        outliers=verdict.outliers,
        before=error_sizes(before),
        after=error_sizes(after),
        correction=correction,
        changed=tuple(changed),
        kept=kept,
        coverage=_coverage(rows),
        notes=verdict.notes,
        everywhere=rows.least_relative_spread > ADAPTATION.wide,
        left_out=verdict.left_out,
        verdict=verdict,
    )


def _coverage(rows: LogRows) -> float:
    """Share of the learned range that rows visit: mean share of cells, over pairs of joints."""
    visited = _cells(rows.u)
    learned = None if rows.learned_u is None else _cells(rows.learned_u)
    joints = visited.shape[1]
    shares = []
    for pair in combinations(range(joints), min(joints, 2)):
        cells = {*map(tuple, visited[:, pair].tolist())}
        count = ADAPTATION.cells ** len(pair)
        if learned is not None:
            cells_of_model = {*map(tuple, learned[:, pair].tolist())}
            cells &= cells_of_model
            count = len(cells_of_model)
        shares.append(len(cells) / count)
    return float(np.mean(shares))


def _cells(u: Array) -> Index:
    """Number of the cell (n, dof) along each joint of points of the unit box (n, dof)."""
    inside = np.clip(u, 0.0, 1.0 - 1e-12)
    return (inside * ADAPTATION.cells).astype(int)


def adaptation_with(
    improved: Adaptation,
    model: Model,
    held_out_q: Array,
    held_out_residual: Array,
    method: str,
    frame: Alignment | None = None,
) -> Adaptation:
    """The adaptation with the new model, its facts, its baseline and its history.

    held_out_q, held_out_residual : (k, dof), (k, m) [unit], of held-out rows
    frame : new frame of a sensor that was moved, in the old one
    """
    rows = improved.verdict.rows.in_sockets_of(model)
    old = rows.model
    learned = MeasuredRows.of(rows.log.q, rows.x)
    if len(held_out_residual) == len(learned):
        learned = replace(learned, held_out=held_out_residual)
    # a moved camera sees another picture
    photo = old.photo if method == "few-shot" and frame is None else None
    event = _event(improved, method, frame)
    model = replace(
        model,
        about=_facts(improved, model, held_out_q, held_out_residual),
        baseline=_baseline(model, learned, row_lengths(held_out_residual)),
        rows=learned,
        photo=photo,
        history=(*old.history, event),
    )
    return replace(improved, model=model)


def _facts(
    improved: Adaptation,
    model: Model,
    held_out_q: Array,
    held_out_residual: Array,
) -> About:
    """The facts of the new model, by joints and residuals of held-out rows (k, dof), (k, m)."""
    verdict = improved.verdict
    rows = verdict.rows
    distance = row_lengths(held_out_residual)
    note_on_old_bound = verdict.bound.words(changed=verdict.score > 1.0)
    facts = rows.model.about.by_readings(
        samples=improved.samples,
        unit=verdict.unit,
        errors=_errors(model, rows.in_sockets_of(model), held_out_residual),
        notes=tuple(n for n in improved.notes if n != note_on_old_bound),
        tested=len(distance),
        left_out=improved.left_out,
        within={},
    )
    # by the new facts: the bound of a simulated arm was on the true position
    bound = replace(model, about=facts).expected_error(held_out_q)
    is_within = distance <= np.nan_to_num(bound) + 1e-12
    within = {
        "p95": float(np.quantile(distance, 0.95)),
        "covered": float(is_within.mean()),
    }
    return replace(facts, within=within)


def _baseline(model: Model, learned: MeasuredRows, distance: Array) -> Baseline:
    """The baseline of the new model, by distances (k,) of held-out rows [unit]."""
    shape = (ADAPTATION.baseline, learned.q.shape[1])
    points = np.random.default_rng(0).random(shape)
    baseline = learn_baseline(
        model.association, points, model.predictor.value(points), distance
    )
    if model.body is None:  # maps alone are valid at these rows only
        scale = model.motor.scale
        places = RowPlaces.of(scale, scale.to_unit(learned.q))
        baseline = replace(baseline, seen=places)
    return baseline


def _event(
    improved: Adaptation, method: str, frame: Alignment | None
) -> Document:
    """The record of an adaptation in a model's history, with facts of the old model."""
    old = improved.model  # not replaced yet
    about = old.about
    usual = about.errors.get(old.default_readout)
    return {
        "event": "adapted",
        "sensor": about.sensor,
        "method": method,
        "samples": improved.samples,
        "outliers": improved.outliers,
        "before": improved.before,
        "after": improved.after,
        "correction": improved.correction,
        "coverage": improved.coverage,
        "changed": [cause.to_json() for cause in improved.changed],
        "kept": list(improved.kept),
        "frame": None if frame is None else frame.to_json(),
        "from": {
            "source": about.source,
            "samples": about.samples,
            "simulation": about.simulation,
            "mean": usual and usual["forward"]["distance"]["mean"],
        },
    }


def _errors(model: Model, rows: LogRows, residual: Array) -> ErrorTable:
    """Errors of all readouts, of the default one by held-out residuals (k, m) [unit]."""
    readout = model.default_readout
    evaluated = spread_rows(len(rows), ADAPTATION.evaluated)
    motion = Motion(rows.q[evaluated])
    errors = summarise(evaluate_residuals(model, motion, rows.x[evaluated]))
    if readout != "body":
        errors.pop("body", None)
    forward = errors[readout]["forward"]
    for axis, error in zip("xyz", residual.T, strict=False):
        forward[axis] = error_sizes(error)
    forward["distance"] = error_sizes(row_lengths(residual))
    return errors


def model_around(
    old: Model, body: Body, u: Array, at_rows: Body | None
) -> Model:
    """The model with an updated body, maps that follow it, and new bounds.

    u : (n, dof), joints of the log's rows in the unit box
    at_rows : the body whose bound holds near the rows, where it is another one
    """
    motor = old.motor
    nodes = motor.units_in_box
    local = _local_models_around(old, body)
    after = Predictor(motor, BodyInBox(body, motor.scale), local).value(nodes)
    sensory = _sensory_map(old, old.predictor.value(nodes), after)
    reading, position = bounds_of_nodes(motor, body)
    if at_rows is not None and nodes.shape[1] <= MOST_BLENDED:
        # near the rows the error that no cause explains counts as noise, so that one bound holds
        # for readings and for true positions
        near, _ = bounds_of_nodes(motor, at_rows)
        share = _relative_distance(motor.scale, u, nodes)
        reading = np.minimum(reading, near + share * (reading - near))
        position = np.minimum(position, near + share * (position - near))
    return replace(
        old,
        association=replace(old.association, sensory=sensory),
        local=local,
        body=body,
        rows=None,
        seconds={},
        bounds=reading,
        model_bounds=position,
        visited=old.visited | motor.visited_by(u),
    )


def _relative_distance(scale: Scale, u: Array, nodes: Array) -> Array:
    """Distance (k,) of nodes (k, dof) from rows (n, dof), over half the width of the rows' region.

    It is 0 among the rows, and at most 1: as far away, a change without a name says nothing.
    """
    half_width = 0.5 * float(np.ptp(u, axis=0).mean())
    distance = RowPlaces.of(scale, u).beside(scale, nodes)
    return np.minimum(distance / max(half_width, 1e-9), 1.0)


def _local_models_around(old: Model, body: Body) -> LocalModels:
    """The local models, their offsets carried over to an updated body by `offset_after`."""
    models = old.predictor.models
    if old.body is None or models.degree < 0:
        return NO_MODELS
    u = old.motor.units_in_box
    q = old.motor.scale.from_unit(u)
    coefficients = offset_after(
        old.body, body, body.beta, q, models.coefficients
    )
    return replace(models, coefficients=coefficients)


def _sensory_map(old: Model, before: Array, after: Array) -> Map:
    """The sensory map, each node moved by the mean move of its partners among the motor nodes.

    before, after : (motor nodes, m) [unit], old and new predictions at the motor nodes
    """
    sensory = old.sensory
    total = np.asarray(old.links.sum(axis=0)).ravel()

    def mean_of_partners(x: Array) -> Array:
        """Mean (sensory nodes, m) over the links of each sensory node."""
        return np.asarray(old.links.T @ x / np.maximum(total, 1e-300)[:, None])

    # by an affine map and the means' deviation from it, so that a node keeps its place among its
    # partners
    frame = Alignment.between(before, after)
    weights = frame.apply(sensory.weights)
    shift = mean_of_partners(after) - frame.apply(mean_of_partners(before))
    is_linked = total > 0
    weights[is_linked] += shift[is_linked]
    scale = Scale.of_data(np.concatenate([weights, after]))
    return Map(scale.to_unit(weights), sensory.lattice, scale, sensory.history)
