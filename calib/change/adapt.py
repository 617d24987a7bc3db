"""Adapting: a model and a log in, a re-calibrated model out, or the word that it did not help."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..body.belief import Body
from ..body.most_telling import most_telling
from ..common.choices import METHODS
from ..common.parallel import one_blas_thread
from ..errors import OptionError
from ..model.model import Model
from ..samples.samples import Samples
from ..training.evaluate import error_sizes
from ..training.learn import Progress
from .adaptation import Adaptation, adapt_online, finished
from .cause import KEPT
from .causes import frame_between
from .comparison import Comparison, compare
from .decision import Decision, decide
from .explain import Explanation, called, likely
from .maps_alone import adapt_maps
from .rebuilding import doubts, elsewhere, rebuilt

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
            return adapt_online(found, report)
        if model.body is None:
            return adapt_maps(found)
        return _few_shot(found, log.simulation is None, report)


def _few_shot(found: Comparison, real: bool, report: Progress) -> Adaptation:
    """Explain the log, update the body by it, and judge by rows that were held out."""
    model = found.model
    report(0.0, "hypotheses", float("nan"))
    made_of = decide(found)
    best, causes = made_of.best, made_of.causes
    notes = _notes(found, made_of)
    made = Adaptation(
        model,
        made_of.improved,
        int(np.count_nonzero(found.log.kept)),
        found.outliers,
        error_sizes(made_of.before),
        error_sizes(made_of.after),
        made_of.correction,
        tuple(c for c in causes if c.group != "noise"),
        _left(found, best) if made_of.changed else ("the arm and the sensor",),
        found.coverage,
        tuple(notes),
        found.spans,
        found.left_out,
    )
    if not found.explained and not made.improved:
        return made
    report(0.8, "maps", float("nan"))
    fresh = rebuilt(found, made_of.body)
    if not made.improved:
        doubted = doubts(found, fresh, real=real)
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
    frame = frame_between(found, made_of.body.beta) if best.hypothesis.framed else None
    report(1.0, "done", made.after["mean"])
    return replace(made, model=finished(found, made, fresh, *made_of.held_out, "few-shot", frame))


def _left(found: Comparison, best: Explanation) -> tuple[str, ...]:
    """Groups that the explanation did not free, in words."""
    structure = found.reference.structure
    known = {g for g, ix in structure.groups.items() if len(ix)} - set(best.hypothesis.groups)
    if structure.outputs >= 3:  # a tracker has no lens
        known.discard("lens")
    return tuple(words for group, words in KEPT.items() if group in known)


def _notes(found: Comparison, made_of: Decision) -> list[str]:
    # what nobody may miss: another unit, a mirror, a joint that turns round or not at all
    loud = [c.words for c in made_of.causes if c.cause.split(":")[0] in _LOUD]
    notes = [*found.notes, *loud, *made_of.notes]
    if not found.explained:
        notes.append(found.why_not())
    elif made_of.improved and found.changed:
        best, *others = (e for _, e in likely(found.explanations))
        # a richer one that frees the same and more is no other cause
        others = [e for e in others if not set(best.hypothesis.groups) <= {*e.hypothesis.groups}]
        names = list(dict.fromkeys(called(e) for e in (best, *others)))
        if len(names) > 1:
            rivals = " or ".join(f"({name.replace(', ', ' + ')})" for name in names)
            notes.append(
                f"more than one change explains the log: {rivals}; three more poses tell which, "
                f"such as {_poses(found, made_of.body)}, or those that calib plan proposes"
            )
    return notes


def _poses(found: Comparison, body: Body) -> str:
    """Three poses that tell most of what the hypotheses disagree about, in words."""
    about = found.model.about
    poses = []
    for q in found.probes[most_telling(body, found.probes, 3, found.q)]:
        parts = [
            f"{name} {np.degrees(v):.0f} deg" if turns else f"{name} {v:.3f} m"
            for name, v, turns in zip(about.joint_names, q, about.revolute, strict=True)
        ]
        poses.append(", ".join(parts))
    return "; ".join(poses)
