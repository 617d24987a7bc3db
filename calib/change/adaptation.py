"""Adaptation: a model round another body, with its facts and its history."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from ..body.belief import Body
from ..common.arrays import Array
from ..common.rows import row_lengths, spread_rows
from ..common.scale import Scale
from ..maps import local_models
from ..maps.local_models import NO_MODELS, exponents
from ..maps.map import Map
from ..maps.predictor import BodyInBox, Predictor
from ..model.about import MeasuredRows
from ..model.alignment import Alignment
from ..model.baseline import RowPlaces, learn_baseline
from ..model.model import Model
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
    """When an adaptation is written."""

    # of the held-out error that the rows of an adaptation may be missed by
    consistent: float = 1.2
    # Of the error before: a model that misses rows by less is written although the linear equations
    # promised more.  Exact rows after a lens: 1e-5 mm promised, 20 mm before.
    clearly_better: float = 0.01
    # 95 % quantile over median of the distances that is no noise (in the plane that of noise is
    # 2.1): a bump of 5 mm that 3 of 30 rows saw
    tail: float = 3.0
    # least spread of rows in any direction, over that of the learned range
    wide: float = 0.5
    # along each joint, for the share of the range that a log measured
    cells: int = 5
    # imagined samples that tell what is usual after an adaptation
    baseline: int = 6000
    # rows that the readouts are evaluated on
    evaluated: int = 500
    # drawn joints, beside each node, that what maps add to a body is learned from
    per_node: int = 5
    # of local models where there were none, and the least samples of one
    degree: int = 2
    samples: int = 20
    # of the extent: less is nothing to keep
    nothing: float = 1e-9


ADAPTING = AdaptationSettings()


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
        Rows that it rests on.
    outliers : int
        Rows that were left out as wrong detections.
    before, after : dict
        "mean", "max" and "p99" [unit] of the distance from measured to predicted position, on
        rows that neither prediction has seen.
    correction : str
        What was corrected, in words.
    changed : tuple of Cause
        What changed, as `check` says of the same log.
    kept : tuple of str
        What was left as it was.
    coverage : float
        Share of the learned range that the log measured.
    notes : tuple of str
        What the user should be told.
    everywhere : bool
        Whether the rows span the learned range; otherwise `improved` speaks of their own region.
    left_out : int
        Rows of the log that are wrong, or outside of what the model has learned.
    verdict : Verdict or None
        What the log says of the old model.
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
    notes: tuple[str, ...] = ()
    everywhere: bool = True
    left_out: int = 0
    verdict: Verdict | None = None

    def with_note(self, note: str) -> Adaptation:
        """The same with one more note."""
        return replace(self, notes=(*self.notes, note))

    def __repr__(self) -> str:
        """Say in two lines whether it helped, and what was corrected."""
        verdict = (
            "improved" if self.improved else "not improved, the old model stays"
        )
        head = (
            f"Adaptation: {verdict}, {self.samples} samples, {self.correction}"
        )
        before = self.before["mean"]
        after = self.after["mean"]
        return f"{head}\n  mean error {before:.3g} -> {after:.3g} {self.model.about.unit}"


def old_model(
    verdict: Verdict, before: Array, after: Array, correction: str, *notes: str
) -> Adaptation:
    """An adaptation that keeps the old model, of distances (k,) from held-out rows [unit]."""
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
        kept=("the arm and the sensor",),
        coverage=_coverage(rows.u),
        notes=(*verdict.notes, *notes),
        everywhere=rows.across > ADAPTING.wide,
        left_out=verdict.left_out,
        verdict=verdict,
    )


def _coverage(u: Array) -> float:
    """Share of the learned range that rows visit: of cells of a fifth, over pairs of joints."""
    inside = np.clip(u, 0.0, 1.0 - 1e-12)
    cells = (inside * ADAPTING.cells).astype(int)
    joints = cells.shape[1]
    shares = []
    for pair in combinations(range(joints), min(joints, 2)):
        visited = np.unique(cells[:, pair], axis=0)
        shares.append(len(visited) / ADAPTING.cells ** len(pair))
    return float(np.mean(shares))


def with_model(
    verdict: Verdict,
    made: Adaptation,
    fresh: Model,
    judged: Array,
    residual: Array,
    method: str,
    frame: Alignment | None = None,
) -> Adaptation:
    """The adaptation with the new model, its facts, its baseline and the history of the old one.

    judged, residual : (k, dof) and (k, m) [unit], joints and residuals of held-out rows
    """
    rows = verdict.rows
    about = rows.model.about
    after = row_lengths(residual)
    bound = np.nan_to_num(fresh.expected_error(judged)) + 1e-12
    usual = about.errors.get(rows.model.default_readout)
    event = {
        "event": "adapted",
        "method": method,
        "samples": made.samples,
        "outliers": made.outliers,
        "before": made.before,
        "after": made.after,
        "correction": made.correction,
        "coverage": made.coverage,
        "changed": [cause.to_json() for cause in made.changed],
        "kept": list(made.kept),
        "frame": None if frame is None else frame.to_json(),
        "from": {
            "source": about.source,
            "samples": about.samples,
            "simulation": about.simulation,
            "mean": usual and usual["forward"]["distance"]["mean"],
        },
    }
    facts = about.by_readings(
        samples=made.samples,
        unit=verdict.unit,
        errors=_errors(fresh, rows, residual),
        notes=made.notes,
        tested=len(after),
        left_out=made.left_out,
        within={
            "p95": float(np.quantile(after, 0.95)),
            "covered": float(np.mean(after <= bound)),
        },
    )
    shape = (ADAPTING.baseline, rows.q.shape[1])
    points = np.random.default_rng(0).random(shape)
    baseline = learn_baseline(
        fresh.association, points, fresh.predictor.value(points), after
    )
    learned = MeasuredRows.of(rows.log.q, rows.x)
    if len(residual) == len(learned):  # of all rows that are kept
        learned = replace(learned, held_out=residual)
    if fresh.body is None:  # maps that followed these rows know no others
        scale = fresh.motor.scale
        places = RowPlaces.of(scale, scale.to_unit(learned.q))
        baseline = replace(baseline, seen=places)
    # a camera that was moved sees another picture
    photo = rows.model.photo if method == "few-shot" and frame is None else None
    model = replace(
        fresh,
        about=facts,
        baseline=baseline,
        rows=learned,
        photo=photo,
        history=(*rows.model.history, event),
    )
    return replace(made, model=model)


def _errors(fresh: Model, rows: LogRows, residual: Array) -> ErrorTable:
    """Errors of all readouts; held-out residuals (k, m) tell those of the default one."""
    readout = fresh.default_readout
    some = spread_rows(len(rows), ADAPTING.evaluated)
    motion = Motion(rows.q[some])
    errors = summarise(evaluate_residuals(fresh, motion, rows.x[some]))
    if readout != "body":
        errors.pop("body", None)
    forward = errors[readout]["forward"]
    for axis, error in zip("xyz", residual.T, strict=False):
        forward[axis] = error_sizes(error)
    forward["distance"] = error_sizes(row_lengths(residual))
    return errors


def rebuilt(model: Model, old: Body, body: Body, u: Array) -> Model:
    """The model with an updated body, maps that follow it, and new bounds.

    old : the body that maps were learned beside
    u : (n, dof), joints in the unit box of the rows of the update
    """
    motor = model.motor
    nodes = np.clip(model.motor.units, 0.0, 1.0)
    drawn = np.random.default_rng(0).random(
        (ADAPTING.per_node * motor.size, nodes.shape[1])
    )
    asked = np.concatenate([nodes, drawn])
    q = motor.scale.from_unit(asked)
    before = model.predictor.value(asked)
    added = before - old.predict(q)
    models = NO_MODELS
    if float(np.abs(added).max()) > ADAPTING.nothing * float(
        np.linalg.norm(np.ptp(before, axis=0))
    ):
        added = offset_after(old, body, body.beta, q, added)
        degree = max(model.predictor.models.degree, ADAPTING.degree)
        samples = max(
            ADAPTING.samples, 2 * len(exponents(asked.shape[1], degree))
        )
        models = local_models.fit(
            motor, np.arange(motor.size), asked, added, (degree, samples)
        )
    after = Predictor(motor, BodyInBox(body, motor.scale), models).value(nodes)
    sensory = _sensory_map(model, before[: len(nodes)], after)
    reading, position = (
        body.bound(q[: len(nodes)], noise=noise) for noise in (True, False)
    )
    winners = motor.nearest(u)[1][:, 0]
    return replace(
        model,
        association=replace(model.association, motor=motor, sensory=sensory),
        local=models,
        body=body,
        rows=None,
        seconds={},
        bounds=reading,
        model_bounds=position,
        visited=model.visited
        | (np.bincount(winners, minlength=motor.size) > 0),
    )


def _sensory_map(model: Model, before: Array, after: Array) -> Map:
    """The sensory map, each node moved by the mean of the motor nodes that it is linked with.

    before, after : (motor nodes, m) [unit], what was and what is predicted at the motor nodes
    """
    old = model.sensory
    links = model.links
    total = np.asarray(links.sum(axis=0)).ravel()
    here, there = (
        links.T @ x / np.maximum(total, 1e-300)[:, None]
        for x in (before, after)
    )
    # an affine map of the means, so that what a node differs from its partners is mapped too
    frame = Alignment.between(before, after)
    known = total > 0
    moved = frame.apply(old.weights)
    moved[known] += (there - frame.apply(here))[known]
    scale = Scale.of_data(np.concatenate([moved, after]))
    return Map(scale.to_unit(moved), old.lattice, scale, old.history)
