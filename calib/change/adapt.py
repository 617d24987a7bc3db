"""Adapting: a model and a log in, a re-calibrated model out, or the word that it did not help."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..body.belief import Body
from ..body.likeness import lengths_of
from ..body.most_telling import most_telling
from ..common.arrays import Array
from ..common.choices import METHODS
from ..common.parallel import one_blas_thread
from ..common.rows import thinned
from ..errors import OptionError
from ..model.model import Model
from ..samples.samples import Samples
from ..training.evaluate import error_sizes
from ..training.learn import Progress
from .adaptation import Adaptation, adapt_online, finished
from .cause import KEPT, Cause
from .causes import find_causes, frame_between
from .comparison import UNEXPLAINED, Comparison, compare
from .explain import Explanation, likely, weighed
from .members import CREEP, NOTHING
from .orientation import turned_tool, with_orientations
from .own_residual import OwnResidual, own_residual
from .rebuilding import doubts, elsewhere, rebuilt
from .rows import UPDATED_ROWS
from .update import fit_from_drawing, gain_on_held_out, updated

_CLEAR = 0.95  # of the held-out error that a change may leave at most
_REFINED = 0.85  # the same where nothing changed and rows are only added
_SURE = 2.0  # standard errors by which held-out blocks must gain where nothing changed
_SURER = 4.0  # the same where rows lie beyond the old belief's bound on average
_UNSURE = 0.9  # share of the expected error that added rows may leave at most
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
        return adapt_online(found, report) if method == "online" else _few_shot(found, log, report)


def _few_shot(found: Comparison, log: Samples, report: Progress) -> Adaptation:
    """Explain the log, update the body by it, and judge by rows that were held out."""
    model = found.model
    report(0.0, "members", float("nan"))
    changed = found.changed and found.explained
    chosen = likely(found.explanations) if changed else _unchanged(found)
    best = chosen[0][1]
    report(0.5, "update", float("nan"))
    rows = found.log.some(UPDATED_ROWS)
    moved, held = updated(found.reference, chosen, found.log, found.probes)
    residual, lengths = rows.z - moved.predict(rows.q), lengths_of(moved, rows.q)
    own = own_residual(rows.q, residual, held, rows.weight, lengths)
    after = np.linalg.norm(held, axis=1)
    if own is not None:
        after[own.rows] = own.held_out
    some = thinned(len(found.q), UPDATED_ROWS)[rows.kept]
    before, after = found.missed[some], after[rows.kept]
    fit = fit_from_drawing(found, float(after.mean())) if found.explained else None
    body = moved
    if fit is not None:
        place = np.cumsum(found.log.kept) - 1  # of each row among those that were fitted
        body, own = fit.body, None
        after = np.linalg.norm(fit.held_out, axis=1)[place[some]]
    explained = found.explained
    if model.body is None and own is not None:  # a smooth residual may follow what no member does
        explained |= float(np.median(own.held_out)) < UNEXPLAINED * found.spread
    improved = explained and _improves(found, body, own, changed, before, after)
    causes, unsettled = find_causes(found, changed or not found.explained or found.unexpected)
    _, bent, untold = turned_tool(found, log)
    if bent and not improved:  # the tool alone
        body, own, after = found.belief, None, before
    if log.orientation is not None and not untold and (improved or bent):
        q = model.about.joints_of(log)
        body = with_orientations(body, q, log.orientation, bool(bent))
    notes = (*_notes(found, body, causes, unsettled, improved), *untold)
    improved = improved or bool(bent)
    known = "no single change explains the log" if found.unexpected else "nothing changed"
    correction = _called(best) if changed else f"{known}, rows added"
    if own is not None:
        correction += ", and a smooth residual near the rows"
    made = Adaptation(
        model,
        improved,
        int(np.count_nonzero(found.log.kept)),
        found.outliers,
        error_sizes(before),
        error_sizes(after),
        correction,
        tuple(c for c in (*causes, *bent) if c.cause != "noise"),
        _left(found, best) if changed else ("the arm and the sensor",),
        found.coverage,
        notes,
        found.spans,
    )
    if not found.explained and not improved:
        return made
    report(0.8, "maps", float("nan"))
    fresh = rebuilt(found, body, own, anew=fit is not None)
    if not improved:
        doubted = doubts(found, fresh, real=log.simulation is None)
        if doubted is None:
            return made
        return replace(made, model=doubted[0], notes=(*made.notes, doubted[1]))
    if not np.isfinite(fresh.expected_error(found.q)).any():
        told = (
            "the new bound is a tenth of the reach or more at every row: measure more of the range"
        )
        return replace(made, improved=False, notes=(*made.notes, told))
    if not found.spans:
        made = replace(made, notes=(*made.notes, elsewhere(found, made, fresh)))
    frame = frame_between(found, moved.beta) if best.member.framed else None
    report(1.0, "done", float(after.mean()))
    return replace(made, model=finished(found, made, fresh, after, "few-shot", frame))


def _unchanged(found: Comparison) -> list[tuple[float, Explanation]]:
    """Nothing changed: the rows are added to what was known."""
    # What waves the rows show belongs to the arm as it was: with free ones 40 rows of another
    # mounting made an error 1.2 times as large elsewhere. A drawing has no waves to start from.
    simulated = found.belief.simulated
    some = [e for e in found.explanations if not e.margin and (simulated or e.waves <= CREEP)]
    return weighed(some) if some else likely(found.explanations)


def _improves(
    found: Comparison,
    body: Body,
    own: OwnResidual | None,
    changed: bool,
    before: Array,
    after: Array,
) -> bool:
    """Whether the update is worth taking."""
    ratio, sure = gain_on_held_out(before, after)
    if changed:
        return ratio < _CLEAR
    if ratio > _REFINED or sure < _SURE:
        return False
    if own is not None and found.model.body is None:
        return True
    old = found.belief
    if float(before.mean()) > float(replace(old, second=None).bound(found.q).mean()):
        return sure > _SURER  # rows that the old belief had not thought possible
    # root mean square error [unit] that each belief expects of itself over the learned range
    own_part = (old.tau**2 + old.noise**2).sum()
    new_error, old_error = (
        np.trace(b.spread(found.probes), axis1=1, axis2=2).mean() * b.kappa**2 + own_part
        for b in (body, old)
    )
    return bool(np.sqrt(new_error) < _UNSURE * np.sqrt(old_error))


def _called(e: Explanation) -> str:
    """An explanation in words: its member, or the shape that no member has."""
    shape = "waves of the joints" if e.waves > CREEP else "a smooth residual"
    return shape if e.member == NOTHING else e.member.name.removesuffix(", small")


def _left(found: Comparison, best: Explanation) -> tuple[str, ...]:
    """Groups that the explanation did not free, in words."""
    structure = found.reference.structure
    known = {g for g, ix in structure.groups.items() if len(ix)} - set(best.member.groups)
    if structure.outputs >= 3:  # a tracker has no lens
        known.discard("lens")
    return tuple(words for group, words in KEPT.items() if group in known)


def _notes(
    found: Comparison,
    body: Body,
    causes: tuple[Cause, ...],
    unsettled: tuple[str, ...],
    improved: bool,
) -> list[str]:
    # what nobody may miss: another unit, a mirror, a joint that turns round or not at all
    loud = [c.words for c in causes if c.cause.split(":")[0] in _LOUD]
    notes = [*found.notes, *loud, *unsettled]
    if not found.explained:
        notes.append(found.why_not())
    elif improved and found.changed:
        best, *others = (e for _, e in likely(found.explanations))
        # a richer member that frees the same and more is no other cause
        others = [e for e in others if not set(best.member.groups) <= {*e.member.groups}]
        names = list(dict.fromkeys(_called(e) for e in (best, *others)))
        if len(names) > 1:
            rivals = " or ".join(f"({name.replace(', ', ' + ')})" for name in names)
            notes.append(
                f"more than one change explains the log: {rivals}; three more poses tell which, "
                f"such as {_poses(found, body)}, or those that calib plan proposes"
            )
    return notes


def _poses(found: Comparison, body: Body) -> str:
    """Three poses that tell most of what the members disagree about, in words."""
    about = found.model.about
    poses = []
    for q in found.probes[most_telling(body, found.probes, 3, found.q)]:
        parts = [
            f"{name} {np.degrees(v):.0f} deg" if turns else f"{name} {v:.3f} m"
            for name, v, turns in zip(about.joint_names, q, about.revolute, strict=True)
        ]
        poses.append(", ".join(parts))
    return "; ".join(poses)
