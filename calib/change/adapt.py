"""Adapting: a model and a log in, a re-calibrated model out, or the word that it did not help."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..common.choices import METHODS
from ..common.parallel import one_blas_thread
from ..common.wording import for_people
from ..errors import OptionError
from ..maps.model_selection import better, blocks
from ..maps.node_bounds import learn_bounds
from ..model.model import Model
from ..samples.samples import Samples
from ..training.learn import Progress
from .adaptation import Adaptation, finished, rebuilt
from .causes import find_causes, frame_between
from .comparison import Comparison, compare
from .decision import decide, kept_model
from .follow import BLOCK, HORIZON, OnlineAdapter
from .settings import TAIL


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
    with one_blas_thread():
        found = compare(model, log, cause)
        if method == "online":
            return _online(found, report)
        if model.body is None:
            told = "maps without a body learn from a stream alone: give method 'online'"
            missed, causes = found.missed, find_causes(found)[0]
            return kept_model(found, missed, missed, "nothing", causes, told)
        return _few_shot(found, report)


def _few_shot(found: Comparison, report: Progress) -> Adaptation:
    report(0.0, "hypotheses", float("nan"))
    made, body, held_out, framed = decide(found)
    if not found.explained and not made.improved:
        return replace(made, notes=(*made.notes, found.why_not()))
    report(0.8, "maps", float("nan"))
    fresh, (factor, name) = rebuilt(found, body), for_people(found.unit)
    if not made.improved:
        # noise alone is no error of the model: then rows miss evenly
        missed, bound = found.missed[found.kept], found.model.expected_error(found.q[found.kept])
        uneven = float(np.quantile(missed, 0.95)) > TAIL * float(np.median(missed))
        beyond = uneven and np.mean(missed > bound) > 0.5
        return _doubted(found, made, fresh) if beyond or found.score > 1.0 else made
    if not np.isfinite(fresh.expected_error(found.q)).any():
        told = "the new bound is a tenth of the reach or more at every row"
        return replace(made, improved=False, notes=(*made.notes, f"{told}: measure more"))
    if not found.spans:
        known = factor * float(np.median(fresh.model_bounds))
        told = (
            f"improved at the rows, {100 * made.coverage:.0f} % of the learned range: unknown "
            f"elsewhere, where the position is known to {known:.3g} {name} (median of the bound)"
        )
        made = replace(made, notes=(*made.notes, told))
    frame = frame_between(found, body.beta) if framed else None
    report(1.0, "done", made.after["mean"])
    return finished(found, made, fresh, *held_out, "few-shot", frame)


def _doubted(found: Comparison, made: Adaptation, fresh: Model) -> Adaptation:
    """The old model with wider bounds, where the rows contradict its own and nothing mends it.

    fresh : what the rows made of the model, although it is no better at them
    """
    model, missed = found.model, found.missed[found.kept]
    u, (factor, name) = np.clip(model.motor.units, 0.0, 1.0), for_people(found.unit)
    apart = np.linalg.norm(fresh.predictor.value(u) - model.predictor.value(u), axis=1)
    apart = np.maximum(apart + fresh.model_bounds, float(np.quantile(missed, 0.95)))
    bounds, model_bounds = (np.maximum(b, apart) for b in (model.bounds, model.model_bounds))
    told = (
        f"the rows are missed by {factor * float(missed.mean()):.3g} {name} on average but do not "
        f"show why: the prediction stays, known to {factor * float(apart.mean()):.3g} {name} only"
    )
    wider = replace(model, bounds=bounds, model_bounds=model_bounds)
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
    causes, notes = find_causes(found)
    if shown > len(learned):
        notes = (f"{len(learned)} samples were shown {shown // len(learned)} times", *notes)
    done = "maps and Hebbian links trained online"
    made = replace(kept_model(found, before, after, done, causes, *notes), kept=())
    known = float(np.isfinite(fresh.expected_error(q[held])).mean())
    if not better(after, before) or known <= 0.5:
        return made
    bounds = learn_bounds(fresh.motor, u[held], after)
    fresh = replace(fresh, bounds=bounds, model_bounds=bounds)
    return finished(found, replace(made, improved=True), fresh, q[held], residual, "online")
