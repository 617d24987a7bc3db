"""Adapting: a model and a log in, a re-calibrated model out, or the word that it did not help."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from ..body.covariance import radius_95
from ..common.arrays import Array
from ..common.choices import METHODS
from ..common.rows import thinned
from ..common.wording import for_people
from ..errors import OptionError
from ..maps.model_selection import better, blocks
from ..maps.node_bounds import learn_bounds
from ..model.about import Rows
from ..model.alignment import Alignment
from ..model.baseline import Seen, learn_baseline
from ..model.model import Model
from ..samples.samples import Samples
from ..training.evaluate import error_sizes, evaluate_residuals, summarise
from ..training.learn import Progress
from .causes import find_causes, frame_between
from .comparison import Comparison, compare, comparing
from .follow import BLOCK, HORIZON, OnlineAdapter
from .hypotheses import GROUPS, Cause, is_framed
from .rebuild import rebuilt
from .settings import LEAST_OWN, TAIL
from .update import update

_CONSISTENT = 1.2  # of the held-out error that the rows of an adaptation may be missed by
_WIDE = 0.5  # least spread of rows in any direction, over that of the learned range
_CELLS = 5  # along each joint, for the share of the range that a log measured
_BASELINE = 6000  # imagined samples that tell what is usual after an adaptation
_EVALUATED = 500  # rows that the readouts are evaluated on


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


def adapt(
    model: Model,
    log: Samples,
    *,
    method: str = "few-shot",
    cause: str | None = None,
    progress: Progress | None = None,
) -> Adaptation:
    """Re-calibrate a model; it is left as it was.

    Parameters
    ----------
    model : Model
        The old model.
    log : Samples
        New samples of the same arm, at least ten.
    method : {"few-shot", "online"}
        A Bayesian update of the body, for tens to thousands of samples; or the paper's rule
        (eq. 10 to 12), which needs thousands.
    cause : {"sensor", "joints"}, optional
        What is known about the change.
    progress : callable, optional
        Called with the share of the work done, the stage and the current error.

    Returns
    -------
    Adaptation
        The new model, what changed and what did not, and the errors on held-out rows before
        and after.

    Raises
    ------
    LogError
        If the log is not of this arm or too short.
    """
    if method not in METHODS:
        raise OptionError(f"method {method!r} is unknown, choose one of {', '.join(METHODS)}")
    report = progress or (lambda *_: None)
    with comparing():
        found = compare(model, log, cause)
        if method == "online":
            return _online(found, report)
        if model.body is None:
            told = "maps without a body learn from a stream alone: give method 'online'"
            return _old_model(found, found.missed, found.missed, "nothing", told)
        report(0.0, "hypotheses", float("nan"))
        return _few_shot(found, report)


def _few_shot(found: Comparison, report: Progress) -> Adaptation:
    model, made, (factor, name) = found.model, update(found), for_people(found.unit)
    before, after = found.missed[made.rows], np.linalg.norm(made.residual, axis=1)
    best = made.explanation
    hypothesis = best.hypothesis if found.changed else ()
    # what nobody may miss: another unit, a mirror, a joint that turns round or not at all
    loud = [cause.words for cause in found.reference.causes] if found.explained else []
    why = "nothing changed" if found.score <= 1.0 else "no single change explains the log"
    added = ", rows added" * (made.improved or found.score > 1.0)
    correction = best.name if found.changed else why + added
    told = _old_model(found, before, after, correction, *loud)
    if found.changed:
        left = {g for g, ix in found.reference.structure.groups.items() if len(ix)}
        left -= {group.partition(":")[0] for group in hypothesis}
        if len(found.reference.sizes) >= 3:  # a tracker has no lens
            left.discard("lens")
        told = replace(told, kept=tuple(w.kept for g, w in GROUPS.items() if g in left and w.kept))
    if not found.explained and not made.improved:
        return replace(told, notes=(*told.notes, found.why_not()))
    report(0.8, "maps", float("nan"))
    fresh = rebuilt(model, found.body, made.body, found.u)
    if not made.improved:
        # noise alone is no error of the model: then rows miss evenly
        missed, bound = found.missed[found.kept], model.expected_error(found.q[found.kept])
        uneven = float(np.quantile(missed, 0.95)) > TAIL * float(np.median(missed))
        beyond = uneven and np.mean(missed > bound) > 0.5
        return _doubted(found, told, fresh) if beyond or found.score > 1.0 else told
    if not np.isfinite(fresh.expected_error(found.q)).any():
        wide = "the new bound is a tenth of the reach or more at every row: measure more"
        return replace(told, notes=(*told.notes, wide))
    learned = np.linalg.norm(found.x - fresh.predictor.value(found.u), axis=1)[made.rows]
    rounding = LEAST_OWN * float(found.reference.structure.extents[0])
    if float(learned.mean()) > _CONSISTENT * float(after.mean()) + rounding:
        # the equations are linear and the model is not: what is written has to keep the promise
        inconsistent = "the model that would be written misses these rows by more than it promises"
        return replace(told, notes=(*told.notes, inconsistent))
    told = replace(told, improved=True)
    if not told.everywhere:
        known = factor * float(np.median(fresh.model_bounds))
        where = (
            f"improved at the rows, {100 * told.coverage:.0f} % of the learned range: unknown "
            f"elsewhere, where the position is known to {known:.3g} {name} (median of the bound)"
        )
        told = replace(told, notes=(*told.notes, where))
    frame = frame_between(found, made.body.beta) if is_framed(hypothesis) else None
    report(1.0, "done", told.after["mean"])
    return _finished(found, told, fresh, found.q[made.rows], made.residual, "few-shot", frame)


def _old_model(
    found: Comparison, before: Array, after: Array, correction: str, *notes: str
) -> Adaptation:
    """An adaptation that keeps the old model, of distances (k,) from held-out rows [unit]."""
    causes, told = find_causes(found)
    # share of the learned range that rows visit: of cells of a fifth, over pairs of joints
    cells = (np.clip(found.u, 0.0, 1.0 - 1e-12) * _CELLS).astype(int)
    some = combinations(range(cells.shape[1]), min(cells.shape[1], 2))
    shares = [len(np.unique(cells[:, ix], axis=0)) / _CELLS ** len(ix) for ix in some]
    # whether they vary in every direction of the joints: of uniform rows the variance is 1 / 12
    least = float(np.linalg.eigvalsh(np.atleast_2d(np.cov(found.u.T)))[0])
    return Adaptation(
        found.model, False, int(np.count_nonzero(found.kept)), found.wrong + found.strays,
        error_sizes(before), error_sizes(after), correction,
        tuple(c for c in causes if c.group != "noise"), ("the arm and the sensor",),
        float(np.mean(shares)), (*found.notes, *notes, *told), least > _WIDE**2 / 12.0,
        found.lost + found.strays,
    )  # fmt: skip


def _doubted(found: Comparison, made: Adaptation, fresh: Model) -> Adaptation:
    """The old model with wider bounds, where the rows contradict its own and nothing mends it.

    fresh : what the rows made of the model, although it is no better at them
    """
    model, missed = found.model, found.missed[found.kept]
    u, (factor, name) = np.clip(model.motor.units, 0.0, 1.0), for_people(found.unit)
    apart = np.linalg.norm(fresh.predictor.value(u) - model.predictor.value(u), axis=1)
    apart = np.maximum(apart + fresh.model_bounds, float(np.quantile(missed, 0.95)))
    bounds, model_bounds = (np.maximum(b, apart) for b in (model.bounds, model.model_bounds))
    body = model.body
    if body is not None:  # bounds at more than three joints are the body's own
        size = float(np.median(apart)) / float(radius_95(np.eye(found.x.shape[1])[None])[0])
        body = replace(body, residual=np.maximum(body.residual, size))
    wider = replace(model, body=body, bounds=bounds, model_bounds=model_bounds)
    known = float(np.nanmedian(wider.model_error(found.q)))
    told = (
        f"the rows are missed by {factor * float(missed.mean()):.3g} {name} on average but do not "
        f"show why: the prediction stays, known to {factor * known:.3g} {name} only"
    )
    return replace(made, model=wider, notes=(*made.notes, told))


def _online(found: Comparison, report: Progress) -> Adaptation:
    """Show a log to the online rule, again and again where it is short."""
    model, kept = found.model, found.kept
    u, q, x = found.u[kept], found.q[kept], found.x[kept]
    # every tenth block is kept apart to judge by
    held = np.concatenate(blocks(len(u), max(10, len(u) // BLOCK))[4::10])
    learned = np.setdiff1d(np.arange(len(u)), held)
    adapter, shown = OnlineAdapter(model, max(HORIZON, len(learned)), force=True), 0
    while shown < HORIZON:  # a short stream is shown again
        step = adapter.feed(q[learned], x[learned])
        shown += len(learned)
        report(0.9 * min(1.0, shown / HORIZON), "online", step.error)
    fresh = adapter.model()
    residual = x[held] - fresh.predictor.value(u[held])
    before, after = found.missed[kept][held], np.linalg.norm(residual, axis=1)
    again = f"{len(learned)} samples were shown {shown // len(learned)} times"
    done = "maps and Hebbian links trained online"
    made = _old_model(found, before, after, done, *[again] * (shown > len(learned)))
    made = replace(made, kept=())
    known = float(np.isfinite(fresh.expected_error(q[held])).mean())
    if not better(after, before) or known <= 0.5:
        return made
    bounds = learn_bounds(fresh.motor, u[held], after)
    fresh = replace(fresh, bounds=bounds, model_bounds=bounds)
    return _finished(found, replace(made, improved=True), fresh, q[held], residual, "online")


def _finished(
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
    # a camera that was moved sees another picture
    photo = old.photo if method == "few-shot" and frame is None else None
    rows = Rows.of(found.q[found.kept], found.x[found.kept])
    if len(residual) == len(rows):  # of all rows that are kept
        rows = replace(rows, held_out=residual)
    if fresh.body is None:  # maps that followed these rows know no others
        scale = fresh.motor.scale
        baseline = replace(baseline, seen=Seen.of(scale, scale.to_unit(rows.q)))
    facts: dict[str, Any] = {"about": about, "baseline": baseline, "rows": rows, "photo": photo}
    return replace(made, model=replace(fresh, **facts, history=(*old.history, event)))
