"""Adapting: a model and a log in, a re-calibrated model out, or the word that it did not help."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..body.belief import Body
from ..body.structure import Array
from ..common.parallel import one_blas_thread
from ..errors import OptionError
from ..maps.model_selection import better, blocks
from ..maps.node_bounds import learn_bounds
from ..model.model import Model
from ..model.rows import Rows
from ..training.evaluate import evaluate_residuals, figures, summarise
from ..training.learn import Progress
from .alignment import Alignment
from .baseline import learn_baseline
from .carry import carry
from .causes import Cause, find_causes, frame_between
from .check import outlier_note
from .comparison import UNEXPLAINED, Comparison, carried, compare
from .explain import Explanation
from .follow import BLOCK, HORIZON, OnlineAdapter
from .members import NOTHING
from .own_residual import OwnResidual, own_residual
from .rows import thinned
from .update import MOST_ROWS, settled, updated
from .whitening import kernel, lengths_of

if TYPE_CHECKING:
    from ..samples.samples import Samples

METHODS = ("few-shot", "online")

_CLEAR = 0.95  # of the held-out error that a change may leave at most
_REFINED = 0.85  # the same where nothing changed and rows are only added
_SURE = 2.0  # standard errors by which held-out blocks must gain where nothing changed
_UNSURE = 0.9  # share of the expected error that added rows may leave at most
_LOUD = ("mirror", "scale", "sign", "lost")
_CELLS = 5  # along each joint, for the share of the range that a log measured
_RADIUS_95 = 2.448  # radius that holds 95 % of a 2-D Gaussian of standard deviation 1
_BASELINE = 6000  # imagined samples that tell what is usual after an adaptation


@dataclass(frozen=True, eq=False)
class Adaptation:
    """The result of adapting a model to a log.

    Attributes
    ----------
    model : Model
        The adapted model; where nothing improved, the old one.
    improved : bool
        Whether held-out rows are predicted better than before.
    samples : int
        Rows that it rests on.
    outliers : int
        Rows that were left out as wrong detections.
    before, after : dict
        "mean", "max" and "p99" of the distance from measured to predicted position, on
        the same rows, which neither prediction has seen [unit].
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
    notes: tuple[str, ...] = field(default=())


def adapt(
    model: Model,
    log: Samples,
    *,
    method: str = "few-shot",
    cause: str | None = None,
    seed: int | None = None,
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
    seed : int, optional
        Kept for callers of the first release; nothing is drawn.
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
    del seed
    if method not in METHODS:
        raise OptionError(f"method {method!r} is unknown, choose one of {', '.join(METHODS)}")
    with one_blas_thread():
        found = compare(model, log, cause)
        if method == "online":
            return _online(found, log, progress or (lambda *_: None))
        return _few_shot(found, log, progress or (lambda *_: None))


def _few_shot(found: Comparison, log: Samples, report: Progress) -> Adaptation:
    model, reference = found.model, found.reference
    report(0.0, "members", float("nan"))
    changed = found.changed and found.explained
    chosen = found.likely if changed else _unchanged(found)
    report(0.5, "update", float("nan"))
    rows = found.log.some(MOST_ROWS)
    body, held = updated(reference, chosen, found.log, found.probes)
    residual = rows.z - body.predict(rows.q)
    own = own_residual(rows.q, residual, held, rows.weight, lengths_of(body, rows.q))
    after = np.linalg.norm(held, axis=1)
    if own is not None:
        after = after.copy()
        after[own.rows] = own.held_out
    some = thinned(len(found.q), MOST_ROWS)
    kept = found.kept[some]
    predicted = model.predictor.value(model.motor.scale.to_unit(found.q))
    before = np.linalg.norm(found.x - predicted, axis=1)[some][kept]
    after = after[kept]
    explained = found.explained or _followed(found, own)
    improved = explained and _improves(found, body, own, changed, before, after)
    causes, said = find_causes(found, changed or not found.explained)
    made = Adaptation(
        model,
        improved,
        int(np.count_nonzero(found.kept)),
        found.outliers,
        figures(before),
        figures(after),
        _named(chosen[0][1], own, changed),
        tuple(c for c in causes if c.cause != "noise"),
        _left(found, chosen[0][1]) if changed else ("the arm and the sensor",),
        measured_share(model, found.q),
        tuple(_notes(found, causes, said, improved)),
    )
    if not improved:
        return made
    report(0.8, "maps", float("nan"))
    fresh = _carried(found, body, own)
    frame = frame_between(found, body.beta) if chosen[0][1].member.framed else None
    report(1.0, "done", float(after.mean()))
    return replace(made, model=_finished(found, log, made, fresh, after, "few-shot", frame))


def _followed(found: Comparison, own: OwnResidual | None) -> bool:
    """Whether the log of a model without a body is followed by a smooth residual at least."""
    if found.model.body is not None or own is None:
        return False
    spread = np.linalg.norm(found.x - np.median(found.x, axis=0), axis=1)
    return float(np.median(own.held_out)) < UNEXPLAINED * float(np.median(spread))


def _unchanged(found: Comparison) -> list[tuple[float, Explanation]]:
    """Nothing changed: the rows are added to what was known."""
    some = [e for e in found.explanations if e.member == NOTHING]
    if not some:
        return found.likely
    weight = np.exp(np.array([e.evidence for e in some]) - some[0].evidence)
    return list(zip((weight / weight.sum()).tolist(), some, strict=True))


def _improves(
    found: Comparison,
    body: Body,
    own: OwnResidual | None,
    changed: bool,
    before: Array,
    after: Array,
) -> bool:
    """Whether the update is worth taking."""
    ratio, sure = settled(before, after)
    if changed:
        return ratio < _CLEAR
    if ratio > _REFINED or sure < _SURE:
        return False
    if own is not None and found.model.body is None:
        return True
    return _expected(found, body) < _UNSURE * _expected(found, found.belief)


def _expected(found: Comparison, body: Body) -> float:
    """Root mean square error [unit] that a belief expects of itself over the learned range."""
    spread = np.trace(body.spread(found.probes), axis1=1, axis2=2).mean() * body.kappa**2
    own = found.belief.tau**2 + found.belief.noise**2
    return float(np.sqrt(spread + own.sum()))


def _carried(found: Comparison, body: Body, own: OwnResidual | None) -> Model:
    """The model with the updated body, maps that follow it, and new bounds."""
    model, scale = found.model, found.model.motor.scale

    def value(u: Array) -> Array:
        q = scale.from_unit(u)
        added = model.predictor.value(u) - found.body.predict(q)
        if np.any(added):
            added = carried(found.body, body, body.beta, q, added)
        said = body.predict(q) + added
        return said if own is None else said + own.value(q)

    fresh = carry(model, body if model.body is not None else None, value)
    nodes = scale.from_unit(np.clip(fresh.motor.units, 0.0, 1.0))
    bounds = [body.bound(nodes, noise=noise) for noise in (True, False)]
    if model.body is None:
        growth = np.zeros(len(nodes)) if own is None else _growth(found, fresh, own, nodes)
        noise = _RADIUS_95 * float(body.noise[0])
        bounds = [np.hypot(model.bounds, growth), np.hypot(model.model_bounds, growth)]
        bounds[0] = np.maximum(bounds[0], noise)
    winners = fresh.motor.nearest(scale.to_unit(found.q))[1][:, 0]
    visited = model.visited | (np.bincount(winners, minlength=fresh.motor.size) > 0)
    return replace(fresh, bounds=bounds[0], model_bounds=bounds[1], visited=visited)


def _growth(found: Comparison, fresh: Model, own: OwnResidual, nodes: Array) -> Array:
    """What a model without a body does not know away from the rows, (nodes,) [unit].

    Where no view explains the log alone, the old prediction may be right there as well.
    """
    u = np.clip(fresh.motor.units, 0.0, 1.0)
    change = np.linalg.norm(fresh.predictor.value(u) - found.model.predictor.value(u), axis=1)
    near = kernel(nodes, own.q, own.lengths).max(axis=1)
    return np.hypot(_RADIUS_95 * own.deviation(nodes), (1.0 - near) * change)


def _finished(
    found: Comparison,
    log: Samples,
    made: Adaptation,
    fresh: Model,
    after: Array,
    method: str,
    frame: Alignment | None,
) -> Model:
    """The new model with its facts, its baseline and the history of the old one."""
    old = found.model
    some = thinned(len(found.q), 500)
    errors = summarise(evaluate_residuals(fresh, found.q[some], found.x[some], None))
    # rows that were held out tell the error of the default readout
    errors["local"]["forward"]["distance"] = dict(made.after)
    usual = old.about.errors.get("local", {}).get("forward", {}).get("distance", {})
    event: dict[str, Any] = {
        "event": "adapted",
        "method": method,
        "samples": made.samples,
        "outliers": made.outliers,
        "before": made.before,
        "after": made.after,
        "correction": made.correction,
        "changed": [c.to_json() for c in made.changed],
        "kept": list(made.kept),
        "coverage": made.coverage,
        "frame": None if frame is None else frame.to_json(),
        "from": {
            "source": old.about.source,
            "samples": old.about.samples,
            "simulation": old.about.simulation,
            "mean": usual.get("mean"),
        },
    }
    unit = log.unit
    if log.unit == old.about.unit and found.reference.scale != 1.0:
        unit = "sensor"
    about = replace(
        old.about,
        source="log",
        bound_of="sensor reading",
        simulation=None,
        samples=made.samples,
        taught=False,
        unit=unit,
        errors=errors,
        notes=made.notes,
    )
    points = np.random.default_rng(0).random((_BASELINE, found.q.shape[1]))
    baseline = learn_baseline(fresh.association, points, fresh.predictor.value(points), after)
    return replace(
        fresh,
        about=about,
        baseline=baseline,
        rows=Rows.of(found.q[found.kept], found.x[found.kept]),
        history=(*old.history, event),
    )


def _online(found: Comparison, log: Samples, report: Progress) -> Adaptation:
    model, kept = found.model, found.kept
    u, q, x = found.rows.u[kept], found.q[kept], found.x[kept]
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
    before = np.linalg.norm(x[held] - model.predictor.value(u[held]), axis=1)
    after = np.linalg.norm(x[held] - fresh.predictor.value(u[held]), axis=1)
    known = np.isfinite(fresh.expected_error(q[held]))
    notes = [*found.rows.notes, *outlier_note(found.outliers)]
    if shown > len(learned):
        notes.append(f"{len(learned)} samples were shown {shown // len(learned)} times")
    causes, said = find_causes(found, found.changed or not found.explained)
    made = Adaptation(
        model,
        better(after, before) and bool(known.mean() > 0.5),
        len(u),
        found.outliers,
        figures(before),
        figures(after),
        "maps and links re-formed online",
        tuple(c for c in causes if c.cause != "noise"),
        (),
        measured_share(model, found.q),
        (*notes, *said),
    )
    if not made.improved:
        return made
    bounds = learn_bounds(fresh.motor, u[held], after)
    fresh = replace(fresh, bounds=bounds, model_bounds=bounds)
    return replace(made, model=_finished(found, log, made, fresh, after, "online", None))


def measured_share(model: Model, q: Array) -> float:
    """Share of the learned range, in cells of a fifth of each joint's range, that rows visit."""
    u = np.clip(model.motor.scale.to_unit(q), 0.0, 1.0 - 1e-12)
    dof = u.shape[1]
    cells = np.unique((u * _CELLS).astype(int), axis=0)
    return float(min(1.0, len(cells) / _CELLS**dof))


def _named(best: Explanation, own: OwnResidual | None, changed: bool) -> str:
    name = best.member.name if changed else "nothing new, rows added"
    return name if own is None else f"{name}, and a smooth residual near the rows"


def _left(found: Comparison, best: Explanation) -> tuple[str, ...]:
    """Groups that the explanation did not free, in words."""
    words = {
        "view.rotation": "the sensor's frame",
        "view.scale": "the sensor's scale",
        "view.tilt": "the camera's tilt",
        "lens": "the lens",
        "length": "the links' lengths",
        "offset": "the joints' offsets",
        "gain": "the joints' gains",
        "elastic": "elasticity",
        "placement": "the joints' placements",
        "tool": "the tool",
    }
    known = found.reference.structure.groups
    freed = set(best.member.groups)
    return tuple(w for g, w in words.items() if g in known and len(known[g]) and g not in freed)


def _notes(
    found: Comparison, causes: tuple[Cause, ...], said: tuple[str, ...], improved: bool
) -> list[str]:
    notes = [*found.rows.notes, *outlier_note(found.outliers)]
    # what nobody may miss: another unit, a mirror, a joint that turns round or not at all
    notes += [c.words for c in causes if c.cause.split(":")[0] in _LOUD]
    notes += said
    if not found.explained:
        notes.append(found.why_not())
    elif improved:
        second = [e for _, e in found.likely[1:] if e.member.name != found.likely[0][1].member.name]
        if found.changed and second:
            names = " or ".join(
                dict.fromkeys([found.likely[0][1].member.name, *(e.member.name for e in second)])
            )
            notes.append(
                f"the log does not settle what changed ({names}): measure three more poses that "
                "calib plan proposes"
            )
    return notes
