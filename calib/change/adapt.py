"""Adapting: a model and a log in, a re-calibrated model out, or the word that it did not help."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..body.covariance import RADIUS_95
from ..common.choices import METHODS, check_choice
from ..common.rows import row_lengths
from ..common.wording import quantity
from ..errors import require
from ..maps.model_selection import better, blocks
from ..maps.node_bounds import learn_bounds
from ..model.model import Model
from ..model.prediction import predict
from ..samples.samples import Samples
from ..stream.follow import BLOCK, HORIZON, OnlineAdapter
from ..training.options import Progress
from ..training.residuals import error_sizes
from .adaptation import (
    ADAPTING,
    Adaptation,
    old_model,
    rebuilt,
    with_model,
)
from .causes import FRAME, GROUPS
from .evidence import Evidence
from .judge import guarded_algebra, judge
from .settings import LEAST_OWN
from .update import Update
from .verdict import Verdict
from .words import frame_between


def adapt(
    model: Model,
    log: Samples,
    *,
    method: str = "few-shot",
    cause: str | None = None,
    free: str = "all",
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
    free : {"all", "offsets"}
        With "offsets" the geometry is as the model has it; the joints' zeros and the sensor's
        frame are fitted.
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
    require("model", model, Model)
    require("log", log, Samples)
    check_choice("method", method, METHODS)
    of_sensor = model.by(log.sensor)
    report = progress or (lambda *_: None)
    if method == "online":
        verdict = judge(of_sensor, log, cause=cause, learn=False)
        with guarded_algebra():
            adaptation = _online(verdict, report)
    else:
        report(0.0, "causes", float("nan"))
        verdict = judge(of_sensor, log, cause=cause, free=free)
        with guarded_algebra():
            adaptation = _few_shot(verdict, report)
    if not model.others:
        return adaptation
    if adaptation.model is of_sensor:
        return replace(adaptation, model=model)
    return replace(adaptation, model=model.with_sensor(adaptation.model))


def _few_shot(verdict: Verdict, report: Progress) -> Adaptation:
    """The belief of the verdict as a model, where held-out rows say that it is better."""
    rows = verdict.rows
    learned = verdict.update
    evidence = verdict.evidence
    if learned is None or evidence is None:
        missed = rows.distance
        why = "maps without a body learn from a stream alone: give `method=online`"
        return old_model(verdict, missed, missed, "nothing", why)
    after = learned.after
    old = old_model(
        verdict, learned.before, after, _correction(verdict, evidence, learned)
    )
    if evidence.is_attributed:
        old = replace(
            old, kept=_other_parts(evidence, learned.explanation.groups)
        )
    elif verdict.changed:  # by no one part
        old = replace(old, kept=())
    if not learned.improved and not evidence.is_explained:
        return old.with_note(evidence.why_not())
    report(0.8, "maps", float("nan"))
    fresh = rebuilt(rows.model, rows.body, learned.body, rows.u)
    if not learned.improved:
        # noise alone is no error of the model: rows miss evenly
        missed = rows.distance
        usual = float(np.median(missed))
        uneven = float(np.quantile(missed, 0.95)) > ADAPTING.tail * usual
        beyond = float(np.mean(missed > rows.bound))
        if verdict.changed or (uneven and beyond > 0.5):
            return _wider(verdict, old, fresh)
        return old
    if not np.isfinite(fresh.expected_error(rows.log.q)).any():
        why = "the new bound is a tenth of the reach or more at every row: measure more"
        return old.with_note(why)
    # the equations are linear and the model is not: what is written has to keep the promise
    predicted = predict(fresh, rows.log).value
    error = row_lengths(rows.x - predicted)[learned.rows]
    rounding = LEAST_OWN * float(evidence.reference.structure.extents[0])
    promise = ADAPTING.consistent * after.mean() + rounding
    if error.mean() >= promise:
        old = replace(old, after=error_sizes(error))
        if error.mean() >= ADAPTING.clearly_better * learned.before.mean():
            why = "the model that would be written misses these rows by more than promised"
            return old.with_note(why)
    made = replace(old, improved=True)
    if not made.everywhere:
        bound = quantity(float(np.median(fresh.model_bounds)), rows.unit)
        where = (
            f"improved at the rows, {100 * made.coverage:.0f} % of the learned range: unknown "
            f"elsewhere, where the position is known to {bound} (median of the bound)"
        )
        made = made.with_note(where)
    frame = None
    if evidence.is_attributed and FRAME[0] in learned.explanation.groups:
        frame = frame_between(evidence, learned.body.beta)
    report(1.0, "done", made.after["mean"])
    residual = learned.residual
    judged = rows.log.q[learned.rows]
    return with_model(verdict, made, fresh, judged, residual, "few-shot", frame)


def _correction(verdict: Verdict, evidence: Evidence, learned: Update) -> str:
    """What is corrected, in words."""
    if evidence.is_attributed:
        return learned.explanation.name
    why = "nothing changed"
    if verdict.changed:
        why = "no single change stands out"
    return f"{why}, rows added" if learned.improved else why


def _other_parts(
    evidence: Evidence, changed: tuple[str, ...]
) -> tuple[str, ...]:
    """What an adaptation leaves as it was, in words."""
    structure = evidence.reference.structure
    names = []
    for name, group in GROUPS.items():
        has_lens = name != "lens" or structure.outputs < 3  # a tracker has none
        there = has_lens and len(structure.groups.get(name, ())) > 0
        if group.kept and there and name not in changed:
            names.append(group.kept)
    return tuple(names)


def _wider(verdict: Verdict, old: Adaptation, fresh: Model) -> Adaptation:
    """The old model with wider bounds, where the rows contradict its own and nothing mends it.

    fresh : what the rows made of the model, although it is no better at them
    """
    rows = verdict.rows
    model = rows.model
    u = np.clip(model.motor.units, 0.0, 1.0)
    apart = fresh.predictor.value(u) - model.predictor.value(u)
    missed = float(np.quantile(rows.distance, 0.95))
    bound = row_lengths(apart) + fresh.model_bounds
    bound = np.maximum(bound, missed)
    # bounds at more than three joints are the body's own
    residual = float(np.median(bound)) / RADIUS_95
    wider = replace(
        model,
        body=replace(
            rows.body, residual=np.maximum(rows.body.residual, residual)
        ),
        bounds=np.maximum(model.bounds, bound),
        model_bounds=np.maximum(model.model_bounds, bound),
    )
    size = quantity(missed, rows.unit)
    words = (
        f"the rows are missed by {size} (95 %), and no correction is clearly better than none: "
        "the prediction stays, with a wider bound"
    )
    return replace(old, model=wider).with_note(words)


def _online(verdict: Verdict, report: Progress) -> Adaptation:
    """Show a log to the online rule, again and again where it is short."""
    rows = verdict.rows
    u = rows.u
    q = rows.q
    x = rows.x
    # every tenth block is kept apart to judge by
    count = max(10, len(u) // BLOCK)
    apart = np.concatenate(blocks(len(u), count)[4::10])
    shown = np.setdiff1d(np.arange(len(u)), apart)
    adapter = OnlineAdapter(rows.model, max(HORIZON, len(shown)), force=True)
    times = -(-HORIZON // len(shown))  # a short stream is shown again
    for k in range(times):
        step = adapter.feed(q[shown], x[shown])
        share = min(1.0, (k + 1) * len(shown) / HORIZON)
        report(0.9 * share, "online", step.error)
    fresh = adapter.model()
    residual = x[apart] - fresh.predictor.value(u[apart])
    before = rows.distance[apart]
    after = row_lengths(residual)
    correction = "maps and Hebbian links trained online"
    old = replace(old_model(verdict, before, after, correction), kept=())
    if times > 1:
        old = old.with_note(f"{len(shown)} samples were shown {times} times")
    answered = np.isfinite(fresh.expected_error(q[apart]))
    if not better(after, before) or answered.mean() <= 0.5:
        return old
    bounds = learn_bounds(fresh.motor, u[apart], after)
    fresh = replace(fresh, bounds=bounds, model_bounds=bounds)
    made = replace(old, improved=True)
    return with_model(verdict, made, fresh, q[apart], residual, "online")
