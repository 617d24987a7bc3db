"""What becomes of a model: its adaptation to a log, or the maps that followed a stream."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..body.belief import Body
from ..body.fitting import fit
from ..body.rows import Rows as Measured
from ..common.arrays import Array
from ..common.rows import thinned
from ..common.scale import Scale
from ..errors import CalibError
from ..maps import local_models
from ..maps.association import Association
from ..maps.links import Compressed
from ..maps.local_models import NO_MODELS, exponents
from ..maps.map import Map
from ..maps.model_selection import blocks, select
from ..maps.predictor import BodyInBox, Predictor
from ..model.about import Rows
from ..model.alignment import Alignment
from ..model.baseline import learn_baseline
from ..model.model import Model
from ..training.bounds import node_bounds
from ..training.evaluate import error_sizes, evaluate_residuals, summarise
from .causes import Cause
from .comparison import Comparison
from .frame import carried_offset

_PER_NODE = 5
_DEGREE, _SAMPLES = 2, 20  # of local models where there were none
_NOTHING = 1e-9  # of the extent: less is nothing to keep
_BASELINE = 6000  # imagined samples that tell what is usual after an adaptation
_EVALUATED = 500  # rows that the readouts are evaluated on
_IMAGINED = 20_000  # samples that links are learned from where the stream is short
_ROWS = 3000  # rows that a body is refitted to: more would tell it hardly more
_FEW_ROWS = 1000  # fewer have no links of their own


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

    def __repr__(self) -> str:
        """Say in two lines whether it helped, and what was corrected."""
        verdict = "improved" if self.improved else "not improved, the old model stays"
        head = f"Adaptation: {verdict}, {self.samples} samples, {self.correction}"
        before, after = self.before["mean"], self.after["mean"]
        return f"{head}\n  mean error {before:.3g} -> {after:.3g} {self.model.about.unit}"


def finished(
    found: Comparison, made: Adaptation, fresh: Model, held: Array, residual: Array, method: str,
    frame: Alignment | None = None,
) -> Adaptation:  # fmt: skip
    """The adaptation with the new model, its facts, its baseline and the history of the old one.

    held, residual : (k, dof) and (k, m) [unit], joints and residuals of held-out rows
    """
    old, readout, after = found.model, fresh.default_readout, np.linalg.norm(residual, axis=1)
    some = thinned(len(found.q), _EVALUATED)
    errors = summarise(evaluate_residuals(fresh, found.q[some], found.x[some], None))
    # rows that were held out tell the error of the default readout, and how it keeps its bound
    errors = {name: each for name, each in errors.items() if name != "body" or name == readout}
    parts = dict(zip("xyz", residual.T, strict=False)) | {"distance": after}
    errors[readout]["forward"].update({axis: error_sizes(part) for axis, part in parts.items()})
    covered = np.mean(after <= np.nan_to_num(fresh.expected_error(held)) + 1e-12)
    usual = old.about.errors.get(readout, {}).get("forward", {}).get("distance", {})
    told = ("samples", "outliers", "before", "after", "correction", "coverage")
    event: dict[str, Any] = {
        "event": "adapted",
        "method": method,
        **{name: getattr(made, name) for name in told},
        "changed": [c.to_json() for c in made.changed],
        "kept": list(made.kept),
        "frame": None if frame is None else frame.to_json(),
        "from": {
            **{name: getattr(old.about, name) for name in ("source", "samples", "simulation")},
            "mean": usual.get("mean"),
        },
    }
    about = old.about.measured(
        samples=made.samples, unit=found.unit_seen, errors=errors, notes=made.notes,
        tested=len(after), left_out=made.left_out,
        within={"p95": float(np.quantile(after, 0.95)), "covered": float(covered)},
    )  # fmt: skip
    points = np.random.default_rng(0).random((_BASELINE, found.q.shape[1]))
    baseline = learn_baseline(fresh.association, points, fresh.predictor.value(points), after)
    if old.baseline is not None and old.motor.size == fresh.motor.size:
        baseline = replace(baseline, paths=old.baseline.paths)
    # a camera that was moved sees another picture
    photo = old.photo if method == "few-shot" and frame is None else None
    rows = Rows.of(found.q[found.kept], found.x[found.kept])
    facts: dict[str, Any] = {"about": about, "baseline": baseline, "rows": rows, "photo": photo}
    return replace(made, model=replace(fresh, **facts, history=(*old.history, event)))


def rebuilt(found: Comparison, body: Body) -> Model:
    """The model with the updated body, maps that follow it, and new bounds."""
    model, motor, old = found.model, found.model.motor, found.model.association
    nodes = np.clip(motor.units, 0.0, 1.0)
    drawn = np.random.default_rng(0).random((_PER_NODE * motor.size, nodes.shape[1]))
    u = np.concatenate([nodes, drawn])
    q, before = motor.scale.from_unit(u), model.predictor.value(u)
    added, models = before - found.body.predict(q), NO_MODELS
    if float(np.abs(added).max()) > _NOTHING * float(np.linalg.norm(np.ptp(before, axis=0))):
        added = carried_offset(found.body, body, body.beta, q, added)
        degree = max(model.predictor.models.degree, _DEGREE)
        samples = max(_SAMPLES, 2 * len(exponents(u.shape[1], degree)))
        models = local_models.fit(motor, np.arange(motor.size), u, added, (degree, samples))
    after = Predictor(motor, BodyInBox(body, motor.scale), models).value(nodes)
    sensory = _moved(model, before[: len(nodes)], after)
    reading, position = (body.bound(q[: len(nodes)], noise=noise) for noise in (True, False))
    winners = motor.nearest(found.u)[1][:, 0]
    return replace(
        model,
        association=replace(old, motor=motor, sensory=sensory),
        local=models,
        body=body,
        rows=None,
        seconds={},
        bounds=reading,
        model_bounds=position,
        visited=model.visited | (np.bincount(winners, minlength=motor.size) > 0),
    )


def _moved(model: Model, before: Array, after: Array) -> Map:
    """The sensory map, each node moved by the mean of the motor nodes that it is linked with.

    before, after : (motor nodes, m) [unit], what was and what is predicted at the motor nodes
    """
    old, links = model.sensory, model.links
    total = np.asarray(links.sum(axis=0)).ravel()
    here, there = (links.T @ x / np.maximum(total, 1e-300)[:, None] for x in (before, after))
    # an affine map of the means, so that what a node differs from its partners is mapped too
    frame, known = Alignment.between(before, after), total > 0
    moved = frame.apply(old.weights)
    moved[known] += (there - frame.apply(here))[known]
    scale = Scale.of_data(np.concatenate([moved, after]))
    return Map(scale.to_unit(moved), old.lattice, scale, old.history)


def settled_model(
    model: Model, motor: Map, sensory: Map, q: Array, x: Array, links: Compressed | None = None
) -> Model:
    """A model with maps as they are now, which have followed some samples.

    q, x : (n, dof), (n, m) [unit], samples since the change
    links : (motor, sensory), links as they are; by default those at which eq. 11 comes to rest for
        the samples.
    """
    scale, wiring, body, found = motor.scale, model.association.wiring, model.body, None
    # a short stream may have been shown again and again
    first = np.sort(np.unique(np.hstack([q, x]), axis=0, return_index=True)[1])
    u, x = scale.to_unit(q[first]), x[first]
    some = slice(None, None, -(-len(u) // _ROWS))
    if body is not None:
        with suppress(CalibError):  # too few rows, or too close to each other
            found = fit(
                body.structure, [Measured(scale.from_unit(u[some]), x[some])],
                simulated=body.simulated, seed=model.about.seed,
            )  # fmt: skip

    def linked(u: Array, x: Array) -> Association:
        return Association.learn(motor, u, sensory, sensory.scale.to_unit(x), wiring)

    seen, predictor = (u, x), None
    if found is not None:
        smooth = BodyInBox(found.body, scale)
        predictor, left = select(motor, u[some], x[some], smooth, found.held_out)
        rows, errors = np.arange(len(u))[some], np.linalg.norm(left, axis=1)
        if len(u) < _FEW_ROWS:
            drawn = np.random.default_rng(model.about.seed).random((_IMAGINED, u.shape[1]))
            seen = drawn, predictor.value(drawn)
    association = linked(*seen) if links is None else Association(motor, sensory, links, wiring)
    if predictor is None:  # maps and links alone, their errors from every other block
        folds, rows, errors = blocks(len(u)), np.arange(len(u)), np.empty(len(u))
        for half in (0, 1):
            held, shown = (np.concatenate(folds[k::2]) for k in (half, 1 - half))
            away = linked(u[shown], x[shown]).linear.value(u[held]) - x[held]
            errors[held] = np.linalg.norm(away, axis=1)
    made = replace(
        model,
        association=association,
        local=NO_MODELS if predictor is None else predictor.models,
        body=None if found is None else found.body,
        visited=np.bincount(motor.nearest(u)[1][:, 0], minlength=motor.size) > 0,
        rows=Rows.of(scale.from_unit(u), x) if model.rows is not None else None,
    )
    reading, position = node_bounds(made, u[rows], errors)
    true = model.about.bound_of == "true position"
    return replace(made, bounds=position if true else reading, model_bounds=position)
