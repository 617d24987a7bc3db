"""Adapting: a model and a log in, a re-calibrated model out, or the word that it did not help."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from ..body.covariance import RADIUS_95
from ..common.arrays import Array
from ..common.choices import METHODS
from ..common.rows import thinned
from ..common.wording import for_people
from ..errors import require
from ..maps.model_selection import better, blocks
from ..maps.node_bounds import learn_bounds
from ..model.about import MeasuredRows
from ..model.alignment import Alignment
from ..model.baseline import Seen, learn_baseline
from ..model.model import Model
from ..model.prediction import predict
from ..samples.samples import Samples
from ..stream.follow import BLOCK, HORIZON, OnlineAdapter
from ..training.learn import Progress
from ..training.residuals import (
    ErrorTable,
    error_sizes,
    evaluate_residuals,
    summarise,
)
from .causes import FRAME, GROUPS, Cause, check_choice
from .evidence import Evidence
from .judge import Verdict, judge, plain_numbers
from .rebuild import rebuilt
from .rows import LogRows
from .settings import LEAST_OWN
from .update import Update
from .words import frame_between


@dataclass(frozen=True)
class AdaptationSettings:
    """When an adaptation is written."""

    # of the held-out error that the rows of an adaptation may be missed by
    consistent: float = 1.2
    # Of the error before: a model that misses rows by less is written although the linear equations
    # promised more.  Exact rows after a lens: 1e-5 mm promised, 20 mm before.
    clearly_better: float = 0.01
    # 95 % quantile over median of the distances that is no noise (in the plane that of noise is
    # 2.1): a bump of 5 mm that 3 of 30 rows saw, as in tests/change/test_drawing.py
    tail: float = 3.0
    # least spread of rows in any direction, over that of the learned range
    wide: float = 0.5
    # along each joint, for the share of the range that a log measured
    cells: int = 5
    # imagined samples that tell what is usual after an adaptation
    baseline: int = 6000
    # rows that the readouts are evaluated on
    evaluated: int = 500


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
        with plain_numbers():
            adaptation = _online(verdict, report)
    else:
        report(0.0, "causes", float("nan"))
        verdict = judge(of_sensor, log, cause=cause, free=free)
        with plain_numbers():
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
        missed = rows.missed
        why = "maps without a body learn from a stream alone: give method 'online'"
        return _old_model(verdict, missed, missed, "nothing", why)
    after = learned.after
    old = _old_model(
        verdict, learned.before, after, _correction(evidence, learned)
    )
    if evidence.attributed:
        old = replace(old, kept=_kept(evidence, learned.explanation.groups))
    if not learned.improved and not evidence.explained:
        return _noted(old, evidence.why_not())
    report(0.8, "maps", float("nan"))
    fresh = rebuilt(rows.model, rows.body, learned.body, rows.u)
    if not learned.improved:
        # noise alone is no error of the model: rows miss evenly
        missed = rows.missed[verdict.sound]
        uneven = np.quantile(missed, 0.95) > ADAPTING.tail * np.median(missed)
        beyond = np.mean(missed > rows.bound[verdict.sound])
        if verdict.changed or (uneven and beyond > 0.5):
            return _wider(verdict, old, fresh)
        return old
    if not np.isfinite(fresh.expected_error(rows.logged)).any():
        why = "the new bound is a tenth of the reach or more at every row: measure more"
        return _noted(old, why)
    # the equations are linear and the model is not: what is written has to keep the promise
    error = np.linalg.norm(rows.x - predict(fresh, rows.motion).value, axis=1)
    error = error[learned.rows]
    rounding = LEAST_OWN * float(evidence.reference.structure.extents[0])
    promise = ADAPTING.consistent * after.mean() + rounding
    if error.mean() >= promise:
        if error.mean() >= ADAPTING.clearly_better * learned.before.mean():
            why = "the model that would be written misses these rows by more than promised"
            return _noted(old, why)
        old = replace(old, after=error_sizes(error))
    made = replace(old, improved=True)
    if not made.everywhere:
        bound = _shown(float(np.median(fresh.model_bounds)), rows.unit)
        where = (
            f"improved at the rows, {100 * made.coverage:.0f} % of the learned range: unknown "
            f"elsewhere, where the position is known to {bound} (median of the bound)"
        )
        made = _noted(made, where)
    frame = None
    if evidence.attributed and FRAME[0] in learned.explanation.groups:
        frame = frame_between(evidence, learned.body.beta)
    report(1.0, "done", made.after["mean"])
    residual = learned.residual
    judged = rows.logged[learned.rows]
    return _finished(verdict, made, fresh, judged, residual, "few-shot", frame)


def _noted(adaptation: Adaptation, note: str) -> Adaptation:
    return replace(adaptation, notes=(*adaptation.notes, note))


def _shown(size: float, unit: str) -> str:
    """A size [unit] for people."""
    factor, name = for_people(unit)
    return f"{factor * size:.3g} {name}"


def _correction(evidence: Evidence, learned: Update) -> str:
    """What is corrected, in words."""
    if evidence.attributed:
        return learned.explanation.name
    drifted = evidence.score > 1.0
    why = "no single change explains the log" if drifted else "nothing changed"
    return f"{why}, rows added" if drifted or learned.improved else why


def _kept(evidence: Evidence, changed: tuple[str, ...]) -> tuple[str, ...]:
    """What an adaptation leaves as it was, in words."""
    structure = evidence.reference.structure
    names = []
    for name, group in GROUPS.items():
        has_lens = name != "lens" or structure.outputs < 3  # a tracker has none
        there = has_lens and len(structure.groups.get(name, ())) > 0
        if group.kept and there and name not in changed:
            names.append(group.kept)
    return tuple(names)


def _old_model(
    verdict: Verdict, before: Array, after: Array, correction: str, *notes: str
) -> Adaptation:
    """An adaptation that keeps the old model, of distances (k,) from held-out rows [unit]."""
    rows = verdict.rows
    # rows of uniform joints have a variance of 1 / 12 in every direction
    least = float(np.linalg.eigvalsh(np.atleast_2d(np.cov(rows.u.T)))[0])
    changed = [cause for cause in verdict.causes if cause.group != "noise"]
    if verdict.evidence is not None and verdict.evidence.explained:
        # what nobody may miss: another unit, a mirror, a joint that turns round
        loud = verdict.evidence.reference.causes
        notes = (*notes, *(cause.words for cause in loud))
    return Adaptation(
        model=rows.model,
        improved=False,
        samples=len(rows) - verdict.outliers + rows.wrong,
        outliers=verdict.outliers,
        before=error_sizes(before),
        after=error_sizes(after),
        correction=correction,
        changed=tuple(changed),
        kept=("the arm and the sensor",),
        coverage=_coverage(rows.u),
        notes=(*verdict.notes, *notes),
        everywhere=least > ADAPTING.wide**2 / 12.0,
        left_out=verdict.left_out,
        verdict=verdict,
    )


def _coverage(u: Array) -> float:
    """Share of the learned range that rows visit: of cells of a fifth, over pairs of joints."""
    cells = (np.clip(u, 0.0, 1.0 - 1e-12) * ADAPTING.cells).astype(int)
    joints = cells.shape[1]
    shares = []
    for pair in combinations(range(joints), min(joints, 2)):
        visited = np.unique(cells[:, pair], axis=0)
        shares.append(len(visited) / ADAPTING.cells ** len(pair))
    return float(np.mean(shares))


def _wider(verdict: Verdict, old: Adaptation, fresh: Model) -> Adaptation:
    """The old model with wider bounds, where the rows contradict its own and nothing mends it.

    fresh : what the rows made of the model, although it is no better at them
    """
    rows = verdict.rows
    model = rows.model
    u = np.clip(model.motor.units, 0.0, 1.0)
    apart = fresh.predictor.value(u) - model.predictor.value(u)
    missed = float(np.quantile(rows.missed[verdict.sound], 0.95))
    bound = np.linalg.norm(apart, axis=1) + fresh.model_bounds
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
    words = (
        f"the rows are missed by {_shown(missed, rows.unit)} (95 %) but do not show why: the "
        "prediction stays, with a wider bound"
    )
    return _noted(replace(old, model=wider), words)


def _online(verdict: Verdict, report: Progress) -> Adaptation:
    """Show a log to the online rule, again and again where it is short."""
    rows = verdict.rows
    sound = verdict.sound
    u = rows.u[sound]
    q = rows.q[sound]
    x = rows.x[sound]
    # every tenth block is kept apart to judge by
    apart = np.concatenate(blocks(len(u), max(10, len(u) // BLOCK))[4::10])
    shown = np.setdiff1d(np.arange(len(u)), apart)
    adapter = OnlineAdapter(rows.model, max(HORIZON, len(shown)), force=True)
    times = -(-HORIZON // len(shown))  # a short stream is shown again
    for k in range(times):
        step = adapter.feed(q[shown], x[shown])
        share = min(1.0, (k + 1) * len(shown) / HORIZON)
        report(0.9 * share, "online", step.error)
    fresh = adapter.model()
    residual = x[apart] - fresh.predictor.value(u[apart])
    before = rows.missed[sound][apart]
    after = np.linalg.norm(residual, axis=1)
    correction = "maps and Hebbian links trained online"
    old = replace(_old_model(verdict, before, after, correction), kept=())
    if times > 1:
        old = _noted(old, f"{len(shown)} samples were shown {times} times")
    answered = np.isfinite(fresh.expected_error(q[apart]))
    if not better(after, before) or answered.mean() <= 0.5:
        return old
    bounds = learn_bounds(fresh.motor, u[apart], after)
    fresh = replace(fresh, bounds=bounds, model_bounds=bounds)
    made = replace(old, improved=True)
    return _finished(verdict, made, fresh, q[apart], residual, "online")


def _finished(
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
    after = np.linalg.norm(residual, axis=1)
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
    facts = about.measured(
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
    learned = MeasuredRows.of(rows.logged[verdict.sound], rows.x[verdict.sound])
    if len(residual) == len(learned):  # of all rows that are kept
        learned = replace(learned, held_out=residual)
    if fresh.body is None:  # maps that followed these rows know no others
        scale = fresh.motor.scale
        places = Seen.of(scale, scale.to_unit(learned.q))
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
    some = thinned(len(rows), ADAPTING.evaluated)
    errors = summarise(evaluate_residuals(fresh, rows.q[some], rows.x[some]))
    if readout != "body":
        errors.pop("body", None)
    forward = errors[readout]["forward"]
    for axis, error in zip("xyz", residual.T, strict=False):
        forward[axis] = error_sizes(error)
    forward["distance"] = error_sizes(np.linalg.norm(residual, axis=1))
    return errors
