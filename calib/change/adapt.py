"""Adapting: a model and a log in, a re-calibrated model out, or the old one if that is better."""

from __future__ import annotations

import math
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
from ..model.prediction import Prediction
from ..samples.samples import Samples
from ..stream.follow import BLOCK, HORIZON, OnlineAdapter
from ..training.options import Progress
from ..training.residuals import error_sizes
from .adaptation import (
    ADAPTATION,
    ARM_AND_SENSOR,
    Adaptation,
    adaptation_with,
    model_around,
    unchanged_adaptation,
)
from .causes import FRAME, GROUPS
from .evidence import Evidence, frame_between
from .frame import LEAST_RESIDUAL
from .judge import guarded_algebra, judge
from .significance import LEAST_CONTRADICTED
from .update import Update
from .verdict import Verdict

TOO_WIDE = (
    "the new bound is a tenth of the reach or more at every row: measure more"
)
PROMISE_BROKEN = (
    "the model that would be written misses these rows by more than promised"
)


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
        New samples of the same arm, at least ten, of `log.sensor` (the first one if "").
    method : {"few-shot", "online"}
        A Bayesian update of the body, for tens to thousands of samples; or the paper's rule
        (eq. 10 to 12), which needs thousands.
    cause : {"sensor", "joints"}, optional
        What is known about the change.
    free : {"all", "offsets"}
        With "offsets" only the joints' zeros and the sensor's frame are fitted.
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
    report(0.0, "causes", math.nan)
    is_few_shot = method == "few-shot"
    verdict = judge(
        of_sensor,
        log,
        cause=cause,
        free=free,
        learn=is_few_shot,
        progress=progress if is_few_shot else None,
    )
    with guarded_algebra():
        adapt_by = _few_shot if is_few_shot else _online
        adaptation = adapt_by(verdict, report)
    if not model.others:
        return adaptation
    if adaptation.model is of_sensor:
        return replace(adaptation, model=model)
    return replace(adaptation, model=model.with_sensor(adaptation.model))


def _few_shot(verdict: Verdict, report: Progress) -> Adaptation:
    """Adapt the model to the verdict's belief, where held-out rows show that this is better."""
    update = verdict.update
    evidence = verdict.evidence
    if update is None or evidence is None:
        why = "maps without a body learn from a stream alone: give `method=online`"
        distance = verdict.rows.distance
        unchanged = unchanged_adaptation(verdict, distance, distance, "nothing")
        return unchanged.with_note(why)
    unchanged = _not_adapted(verdict, evidence, update)
    if not (update.improved or evidence.is_explained):
        return unchanged.with_note(evidence.why_not())

    report(0.8, "maps", math.nan)
    rows = verdict.rows
    model = model_around(
        rows.model, update.body, rows.u, at_rows=update.at_rows
    )
    answers = np.isfinite(model.expected_error(rows.log.q)).any()
    if not answers:
        unchanged = unchanged.with_note(TOO_WIDE)
    if not update.improved or not answers:
        bound = verdict.bound
        # noise is no error of the model
        is_wrong = bound.beyond > LEAST_CONTRADICTED and not bound.may_be_noise
        if verdict.changed or is_wrong:
            return _with_wider_bound(verdict, unchanged, model)
        return unchanged

    # the update's equations are linear: the model itself has to keep their promise
    measured = rows.in_sockets_of(model).log
    distance = row_lengths(measured.x - Prediction(model, measured).value)
    held_out_distance = distance[update.rows]
    error = held_out_distance.mean()
    if error >= _promise(evidence, update):
        unchanged = replace(unchanged, after=error_sizes(held_out_distance))
        if error >= ADAPTATION.clearly_better * update.before.mean():
            return unchanged.with_note(PROMISE_BROKEN)
    improved = replace(unchanged, improved=True)
    if not improved.everywhere:
        improved = improved.with_note(_improved_region(improved, model))
    frame = None
    if evidence.is_attributed and FRAME[0] in update.explanation.groups:
        frame = frame_between(evidence, update.body.beta)
    report(1.0, "done", improved.after["mean"])
    held_out_q = rows.log.q[update.rows]
    return adaptation_with(
        improved, model, held_out_q, update.residual, "few-shot", frame
    )


def _not_adapted(
    verdict: Verdict, evidence: Evidence, update: Update
) -> Adaptation:
    """The adaptation that keeps the old model, with the errors of the update."""
    if evidence.is_attributed:
        correction = update.explanation.name
        kept = _groups_kept(evidence, update.explanation.groups)
    elif verdict.changed:
        correction = "no single change stands out"
        kept = ()
    else:
        correction = "nothing changed"
        kept = ARM_AND_SENSOR
    if update.improved and not evidence.is_attributed:
        correction += ", rows added"
    return unchanged_adaptation(
        verdict, update.before, update.after, correction, kept
    )


def _groups_kept(
    evidence: Evidence, changed: tuple[str, ...]
) -> tuple[str, ...]:
    """Names of the groups that an adaptation leaves as they were."""
    structure = evidence.reference.structure
    names = []
    for name, group in GROUPS.items():
        if name == "lens" and structure.outputs >= 3:
            continue  # a tracker has none
        exists = len(structure.groups.get(name, ())) > 0
        if group.name and exists and name not in changed:
            names.append(group.name)
    return tuple(names)


def _promise(evidence: Evidence, update: Update) -> float:
    """Largest mean distance of held-out rows that agrees with the linear update [unit]."""
    rounding = LEAST_RESIDUAL * float(evidence.reference.structure.extents[0])
    return ADAPTATION.consistent * float(update.after.mean()) + rounding


def _improved_region(improved: Adaptation, model: Model) -> str:
    """The note that the model improved at the rows only: elsewhere it may have changed further."""
    median = float(np.median(model.model_bounds))
    bound = quantity(median, model.about.unit)
    return (
        f"improved at the rows, {100 * improved.coverage:.0f} % of the learned range: unknown "
        f"elsewhere, where the position is known to {bound} (median of the bound) if nothing "
        "else changed"
    )


def _with_wider_bound(
    verdict: Verdict, unchanged: Adaptation, updated: Model
) -> Adaptation:
    """The old model with wider bounds, where the rows contradict them and no update is better.

    updated : the model after the update, which is not better
    """
    rows = verdict.rows
    model = rows.model
    u = model.motor.units_in_box
    difference = updated.predictor.value(u) - model.predictor.value(u)
    error = float(np.quantile(rows.distance, 0.95))
    bound = row_lengths(difference) + updated.model_bounds
    bound = np.maximum(bound, error)
    # with more than three joints the bound is computed from the body
    residual = float(np.median(bound)) / RADIUS_95
    body = replace(rows.body, residual=np.maximum(rows.body.residual, residual))
    wider = replace(
        model,
        body=body,
        bounds=np.maximum(model.bounds, bound),
        model_bounds=np.maximum(model.model_bounds, bound),
    )
    size = quantity(error, rows.unit)
    words = (
        f"the rows are missed by {size} (95 %), and no correction is clearly better than none: "
        "the prediction stays, with a wider bound"
    )
    return replace(unchanged, model=wider).with_note(words)


def _online(verdict: Verdict, report: Progress) -> Adaptation:
    """Adapt the maps by the online rule; a short log is repeated."""
    rows = verdict.rows
    u = rows.u
    q = rows.q
    x = rows.x
    # every tenth block is held out
    count = max(10, len(u) // BLOCK)
    held_out = np.concatenate(blocks(len(u), count)[4::10])
    learned = np.setdiff1d(np.arange(len(u)), held_out)
    adapter = OnlineAdapter(rows.model, max(HORIZON, len(learned)), force=True)
    times = -(-HORIZON // len(learned))
    for k in range(times):
        step = adapter.feed(q[learned], x[learned])
        share = min(1.0, (k + 1) * len(learned) / HORIZON)
        report(0.9 * share, "online", step.error)
    model = adapter.model()
    residual = x[held_out] - model.predictor.value(u[held_out])
    before = rows.distance[held_out]
    after = row_lengths(residual)
    correction = "maps and Hebbian links trained online"
    unchanged = unchanged_adaptation(verdict, before, after, correction, ())
    if times > 1:
        note = f"{len(learned)} samples were shown {times} times"
        unchanged = unchanged.with_note(note)
    answered = np.isfinite(model.expected_error(q[held_out]))
    if not better(after, before) or answered.mean() <= 0.5:
        return unchanged
    bounds = learn_bounds(model.motor, u[held_out], after)
    model = replace(model, bounds=bounds, model_bounds=bounds)
    improved = replace(unchanged, improved=True)
    return adaptation_with(improved, model, q[held_out], residual, "online")
