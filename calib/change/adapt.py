"""Adapting: a model and a log in, a re-calibrated model out, or the word that it did not help."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..common.arrays import Array
from ..common.choices import METHODS
from ..common.parallel import one_blas_thread
from ..common.wording import for_people
from ..errors import OptionError
from ..maps.model_selection import better, blocks
from ..maps.node_bounds import learn_bounds
from ..model.model import Model
from ..samples.samples import Samples
from ..training.evaluate import error_sizes
from ..training.learn import Progress
from .adaptation import Adaptation, finished, rebuilt
from .causes import WORDS, Cause, find_causes, frame_between
from .comparison import Comparison, compare
from .decision import Decision, decide
from .explain import called, likely
from .follow import BLOCK, HORIZON, OnlineAdapter

_TAIL = 3.0  # 95 % quantile over median; of Gaussian noise in the plane it is 2.1
_LOUD = ("mirror", "scale", "sign", "lost")


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
            return _adaptation(
                found, found.missed, found.missed, "nothing", find_causes(found)[0], told
            )
        return _few_shot(found, report)


def _adaptation(
    found: Comparison, before: Array, after: Array, correction: str, causes: tuple[Cause, ...],
    *notes: str,
) -> Adaptation:  # fmt: skip
    """An adaptation that keeps the old model, of distances (k,) from held-out rows [unit]."""
    return Adaptation(
        found.model, False, int(np.count_nonzero(found.kept)), found.outliers,
        error_sizes(before), error_sizes(after), correction,
        tuple(c for c in causes if c.group != "noise"), ("the arm and the sensor",),
        found.coverage, (*found.notes, *notes), found.spans, found.left_out,
    )  # fmt: skip


def _few_shot(found: Comparison, report: Progress) -> Adaptation:
    """Explain the log, update the body by it, and judge by rows that were held out."""
    report(0.0, "hypotheses", float("nan"))
    made_of = decide(found)
    best, causes = made_of.best.hypothesis, made_of.causes
    # what nobody may miss: another unit, a mirror, a joint that turns round or not at all
    loud = [c.words for c in causes if c.cause.split(":")[0] in _LOUD]
    made = _adaptation(
        found, made_of.before, made_of.after, made_of.correction, causes,
        *loud, *made_of.notes, *_of_explanations(found, made_of),
    )  # fmt: skip
    if made_of.changed:
        structure = found.reference.structure
        held = {g for g, ix in structure.groups.items() if len(ix)} - {*best.groups}
        if structure.outputs >= 3:  # a tracker has no lens
            held.discard("lens")
        made = replace(made, kept=tuple(w.kept for g, w in WORDS.items() if g in held and w.kept))
    if not found.explained and not made_of.improved:
        return made
    report(0.8, "maps", float("nan"))
    fresh = rebuilt(found, made_of.body)
    if not made_of.improved:
        # noise alone is no error of the model: then rows miss evenly
        missed, bound = found.missed[found.kept], found.model.expected_error(found.q[found.kept])
        uneven = float(np.quantile(missed, 0.95)) > _TAIL * float(np.median(missed))
        beyond = uneven and np.mean(missed > bound) > 0.5
        return _doubted(found, made, fresh) if beyond or found.score > 1.0 else made
    if not np.isfinite(fresh.expected_error(found.q)).any():
        told = (
            "the new bound is a tenth of the reach or more at every row: measure more of the range"
        )
        return replace(made, notes=(*made.notes, told))
    if not found.spans:
        factor, name = for_people(found.unit)
        before, after = (factor * e["mean"] for e in (made.before, made.after))
        told = (
            f"improved at the rows ({before:.3g} to {after:.3g} {name}), which measured "
            f"{100 * made.coverage:.0f} % of the learned range: unknown elsewhere, where the "
            f"position is known to {factor * float(np.median(fresh.model_bounds)):.3g} {name} "
            "(median of the 95 % bound)"
        )
        made = replace(made, notes=(*made.notes, told))
    frame = frame_between(found, made_of.body.beta) if best.framed else None
    report(1.0, "done", made.after["mean"])
    made = replace(made, improved=True)
    return finished(found, made, fresh, *made_of.held_out, "few-shot", frame)


def _of_explanations(found: Comparison, made_of: Decision) -> list[str]:
    """What is told where nothing explains the log, or more than one change does."""
    if not found.explained:
        return [found.why_not()]
    if not (made_of.improved and found.changed):
        return []
    best, *others = (e for _, e in likely(found.explanations))
    # a richer one that frees the same and more is no other cause
    others = [e for e in others if not set(best.hypothesis.groups) <= {*e.hypothesis.groups}]
    names = list(dict.fromkeys(called(e) for e in (best, *others)))
    if len(names) < 2:
        return []
    rivals = " or ".join(f"({name.replace(', ', ' + ')})" for name in names)
    return [f"more than one change explains the log: {rivals}; poses of calib plan tell which"]


def _doubted(found: Comparison, made: Adaptation, fresh: Model) -> Adaptation:
    """The old model with wider bounds, where the rows contradict its own and nothing mends it.

    fresh : what the rows made of the model, although it is no better at them
    """
    model, missed = found.model, found.missed[found.kept]
    u = np.clip(model.motor.units, 0.0, 1.0)
    apart = np.linalg.norm(fresh.predictor.value(u) - model.predictor.value(u), axis=1)
    apart = np.maximum(apart + fresh.model_bounds, float(np.quantile(missed, 0.95)))
    wider = replace(
        model,
        bounds=np.maximum(model.bounds, apart),
        model_bounds=np.maximum(model.model_bounds, apart),
    )
    factor, name = for_people(found.unit)
    told = (
        f"the rows are missed by {factor * float(missed.mean()):.3g} {name} on average, which is "
        "more than noise, but they do not show what changed: the prediction stays, known to "
        f"{factor * float(apart.mean()):.3g} {name} only (mean of the 95 % bound)"
    )
    return replace(made, model=wider, notes=(*made.notes, told))


def _online(found: Comparison, report: Progress) -> Adaptation:
    """Show a log to the online rule, again and again where it is short."""
    model, kept = found.model, found.kept
    u, q, x = found.u[kept], found.q[kept], found.x[kept]
    # every tenth block is kept apart to judge by
    held = np.concatenate(blocks(len(u), max(10, len(u) // BLOCK))[4::10])
    learned = np.setdiff1d(np.arange(len(u)), held)
    adapter = OnlineAdapter(model, max(HORIZON, len(learned)), force=True)
    shown = 0
    while shown < HORIZON:  # a short stream is shown again
        step = adapter.feed(q[learned], x[learned])
        shown += len(learned)
        report(0.9 * min(1.0, shown / HORIZON), "online", step.error)
    fresh = adapter.model()
    before = found.missed[kept][held]
    residual = x[held] - fresh.predictor.value(u[held])
    after = np.linalg.norm(residual, axis=1)
    causes, notes = find_causes(found)
    if shown > len(learned):
        notes = (f"{len(learned)} samples were shown {shown // len(learned)} times", *notes)
    done = "maps and Hebbian links trained online"
    made = replace(_adaptation(found, before, after, done, causes, *notes), kept=())
    known = float(np.isfinite(fresh.expected_error(q[held])).mean())
    if not better(after, before) or known <= 0.5:
        return made
    bounds = learn_bounds(fresh.motor, u[held], after)
    fresh = replace(fresh, bounds=bounds, model_bounds=bounds)
    return finished(found, replace(made, improved=True), fresh, q[held], residual, "online")
