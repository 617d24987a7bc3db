"""Adapting: a model and a log in, a re-calibrated model out, or the word that it did not help."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..common.parallel import one_blas_thread
from ..common.robust import solve
from ..errors import OptionError
from ..maps.model_selection import better, blocks
from ..maps.node_bounds import learn_bounds
from ..model.model import Model
from ..training.evaluate import evaluate_residuals, figures, summarise
from ..training.learn import STREAMS, Progress
from .alignment import Alignment
from .baseline import learn_baseline
from .correction import Correction, choose_correction
from .features import Frame, find_chain
from .follow import BLOCK, HORIZON, OnlineAdapter
from .outliers import find_outliers, spread_points
from .rehearsal import rehearse
from .sanity import Comparable, comparable
from .smooth_correction import fit_smooth

if TYPE_CHECKING:
    from ..samples.samples import Samples

Array = NDArray[np.float64]

METHODS = ("few-shot", "online")

_EXPLAINED = 0.1  # a frame explains a change if so little of it is left
_LOST = 0.02  # a joint is lost if the tip moves so little of what it did


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
    notes: tuple[str, ...]


def adapt(
    model: Model,
    log: Samples,
    *,
    method: str = "few-shot",
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
        A correction of the old map and a rehearsal of it, for tens to thousands of
        samples; or the paper's rule (eq. 10 to 12), which needs thousands.
    seed : int, optional
        Seed of what is imagined; the model's own where not given.
    progress : callable, optional
        Called with the share of the work done, the stage and the current error.

    Returns
    -------
    Adaptation
        The new model, what was corrected, and the errors on held-out rows before and after.

    Raises
    ------
    LogError
        If the log is not of this arm or too short.
    """
    if method not in METHODS:
        raise OptionError(f"method {method!r} is unknown, choose one of {', '.join(METHODS)}")
    rows = comparable(model, log)
    stream = np.random.SeedSequence(
        model.about.seed if seed is None else seed, spawn_key=(STREAMS["adapt"],)
    )
    with one_blas_thread():
        if method == "online":
            return _online(model, log, rows, progress)
        return _few_shot(model, log, rows, np.random.default_rng(stream), progress)


def _few_shot(
    model: Model,
    log: Samples,
    rows: Comparable,
    rng: np.random.Generator,
    progress: Progress | None,
) -> Adaptation:
    report = progress or (lambda *_: None)
    report(0.0, "correction", float("nan"))
    old = model.predictor.value
    correction = choose_correction(old, model.motor, model.about.revolute, rows.u, rows.x, rng)
    u, x = rows.u[correction.kept], rows.x[correction.kept]
    tested = np.isfinite(correction.errors)
    before = np.linalg.norm(x - old(u), axis=1)[tested]
    after = correction.errors[tested]
    outliers = int(np.count_nonzero(~correction.kept))
    extent = float(np.linalg.norm(model.sensory.scale.span))
    improved = better(after, before, 1e-9 * extent)
    frame = _frame(model, correction, u, x)
    notes = [*rows.notes, *_notes(model, correction, u, x, outliers)]
    made = Adaptation(
        model,
        improved,
        len(u),
        outliers,
        figures(before),
        figures(after),
        correction.name,
        tuple(notes),
    )
    if not improved:
        return made
    learned = rehearse(
        model,
        correction.value,
        u,
        rng,
        lambda share, stage, error: report(0.3 + 0.6 * share, stage, error),
    )
    report(0.9, "evaluation", float("nan"))
    motor = learned.association.motor
    doubt = correction.doubt(np.concatenate([np.clip(motor.units, 0, 1), u[tested]]))
    # what the maps make of the correction comes on top of its own error
    made_of_it = np.linalg.norm(learned.predictor.value(u) - correction.value(u), axis=1)
    bounds = learn_bounds(motor, u[tested], after + made_of_it[tested], doubt)
    fresh = replace(
        model,
        association=learned.association,
        predictor=learned.predictor,
        bounds=bounds,
        visited=learned.visited,
        seconds={},
    )
    return replace(made, model=_finished(model, fresh, log, made, after, u, x, "few-shot", frame))


def _online(model: Model, log: Samples, rows: Comparable, progress: Progress | None) -> Adaptation:
    report = progress or (lambda *_: None)
    kept = find_outliers(
        model.predictor.value, model.motor.scale, model.about.revolute, rows.u, rows.x
    )
    u, x = rows.u[kept], rows.x[kept]
    q = model.motor.scale.from_unit(u)
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
    outliers = int(np.count_nonzero(~kept))
    notes = list(rows.notes) + _outlier_note(outliers)
    if shown > len(learned):
        notes.append(f"{len(learned)} samples were shown {shown // len(learned)} times")
    made = Adaptation(
        model,
        better(after, before) and bool(known.mean() > 0.5),
        len(u),
        outliers,
        figures(before),
        figures(after),
        "maps and links re-formed online",
        tuple(notes),
    )
    if not made.improved:
        return made
    fresh = replace(fresh, bounds=learn_bounds(fresh.motor, u[held], after))
    return replace(made, model=_finished(model, fresh, log, made, after, u, x, "online", None))


def _finished(
    old: Model,
    fresh: Model,
    log: Samples,
    made: Adaptation,
    after: Array,
    u: Array,
    x: Array,
    method: str,
    frame: Alignment | None,
) -> Model:
    """The new model with its facts, its baseline and the history of the old one."""
    q = fresh.motor.scale.from_unit(u)
    tested = evaluate_residuals(fresh, q, x, None)
    errors = summarise(tested)
    # rows that were held out tell the error of the local readout
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
        "frame": None if frame is None else frame.to_json(),
        "from": {
            "source": old.about.source,
            "samples": old.about.samples,
            "simulation": old.about.simulation,
            "mean": usual.get("mean"),
        },
    }
    about = replace(
        old.about,
        source="log",
        bound_of="sensor reading",
        simulation=None,
        samples=made.samples,
        taught=False,
        unit=_unit(old, log, frame),
        errors=errors,
        notes=made.notes,
    )
    points = np.random.default_rng(0).random((6000, u.shape[1]))
    baseline = learn_baseline(fresh.association, points, fresh.predictor.value(points), after)
    return replace(fresh, about=about, baseline=baseline, history=(*old.history, event))


def _unit(old: Model, log: Samples, frame: Alignment | None) -> str:
    if log.unit != old.about.unit:
        return log.unit
    rescaled = frame is not None and not 0.5 < frame.scale < 2.0
    return "sensor" if rescaled else old.about.unit


def _frame(model: Model, correction: Correction, u: Array, x: Array) -> Alignment | None:
    """The sensor's new frame, where that alone explains most of the change."""
    old = model.predictor.value
    said = old(u)
    affine = fit_smooth(old, Frame.of(said, 1), None, u, x, blocks(len(u)))
    gap = np.linalg.norm(x - said, axis=1)
    if float(affine.errors.mean()) > _EXPLAINED * float(gap.mean()):
        return None
    frame = Alignment.between(said, correction.smooth.value(u))
    return None if _is_offset(model, frame, float(gap.mean())) else frame


def _is_offset(model: Model, frame: Alignment, moved: float) -> bool:
    """Whether a turn about the first joint, its encoder's offset, is the same as a frame."""
    if not model.about.revolute[0] or frame.mirrored:
        return False
    points, positions = spread_points(model.predictor.value, len(model.about.joint_names))
    chain = find_chain(model.motor.scale, model.about.revolute, points, positions)
    if chain is None:
        return False
    # the constant of the chain is where the first joint stands
    base = solve(chain.values(points), positions)[0]
    turn = np.array(
        [
            [np.cos(frame.angle), -np.sin(frame.angle)],
            [np.sin(frame.angle), np.cos(frame.angle)],
        ]
    )
    gap = (positions - base) @ turn.T + base - frame.apply(positions)
    return float(np.linalg.norm(gap, axis=1).mean()) < _EXPLAINED * moved


def _notes(model: Model, correction: Correction, u: Array, x: Array, outliers: int) -> list[str]:
    notes = _outlier_note(outliers)
    frame = _frame(model, correction, u, x)
    if frame is not None:
        notes += frame.loud()
        notes.append(f"the sensor's frame moved: {frame.words(model.about.unit)}")
    elif correction.name == "sensor frame":
        turned = Alignment.between(model.predictor.value(u), correction.smooth.value(u)).angle
        notes.append(
            f"{model.about.joint_names[0]} is off by {np.degrees(turned):.3g} deg, or the sensor "
            "was turned about its axis: the same to this log, taken as the former"
        )
    points = np.random.default_rng(0).random((300, u.shape[1]))
    for name in _lost(model, correction, points):
        notes.append(
            f"{name} no longer moves the tip: the arm has lost a degree of freedom, and what "
            f"only {name} could reach is out of reach"
        )
    return notes


def _outlier_note(outliers: int) -> list[str]:
    rows = "1 row contradicts" if outliers == 1 else f"{outliers} rows contradict"
    return [f"{rows} all others: left out"] if outliers else []


def _lost(model: Model, correction: Correction, points: Array) -> list[str]:
    """Joints that moved the tip and no longer do."""
    lost = []
    step = 0.05
    for k, name in enumerate(model.about.joint_names):
        ahead, back = points.copy(), points.copy()
        ahead[:, k] = np.minimum(ahead[:, k] + step, 1.0)
        back[:, k] = np.maximum(back[:, k] - step, 0.0)
        moved = [
            float(np.sqrt(np.mean((value(ahead) - value(back)) ** 2)))
            for value in (model.predictor.value, correction.value)
        ]
        if moved[1] < _LOST * moved[0]:
            lost.append(name)
    return lost
