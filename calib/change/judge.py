"""Judge: what happened to an arm between a model and a log, in the order of its equations.

The residuals of a log, whitened, are linear in all that may have changed and Gaussian in all that
is not known::

    y = X d + e,    e ~ N(0, K + s^2),    d ~ N(0, diag(sd^2)) of a cause that is freed, else 0

X has a column for each parameter of the arm and its sensor; K is the model's own posterior, a
creep, and a smooth residual of this log alone.  Tests, evidences and estimates are sub-blocks of
the same equations.  `check`, `adapt`, `recognise` and the command line show the verdict.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from ..common.choices import CAUSES, FREED
from ..common.parallel import one_blas_thread
from ..errors import ModelError, OptionError, require
from ..model.model import Model
from ..samples.samples import Samples
from .causes import Cause, as_built, as_drawn
from .evidence import BoundTest, Evidence, bound_test
from .explain import explain
from .frame import (
    Reference,
    carried_offset,
    reference_of,
    turned_tool,
)
from .rows import LogRows, rows_of
from .settings import BEYOND, MARGIN, OUTLIER
from .significance import (
    FreeNoise,
    Tested,
    find_play,
    group_tests,
)
from .system import Log, System, shared_columns, sound_rows
from .update import update
from .verdict import Verdict
from .words import causes_of

# Times the bound of maps: a corner's rows share the errors of a few nodes
SHARED_ERRORS = 2.0
# Of the play that a model knows, by which that may be wrong: 20 mrad were learned as 19.1
_PLAY_SHARE = 0.1
_TOOL = "tool"  # the group of where it is


def judge(
    model: Model,
    log: Samples,
    *,
    cause: str | None = None,
    free: str = "all",
    learn: bool = True,
) -> Verdict:
    """Tell what a log says of a model.

    Parameters
    ----------
    model : Model
    log : Samples
        At least ten different rows of the same arm.
    cause : {"sensor", "joints"}, optional
        What is known about the change.
    free : {"all", "offsets"}
        With "offsets" the geometry is as the model has it, the joints' zeros and the sensor's frame
        are not.
    learn : bool
        Whether rows of an arm that did not change are learned from, too.

    Raises
    ------
    LogError
        If the log is not of this arm, too short, or looks wrong.

    Examples
    --------
    >>> import calib
    >>> arm = calib.load_arm("two_link")
    >>> model = calib.train(calib.babble(arm, 500, noise=1e-3), size=10)
    >>> log = calib.babble(arm, 60, seed=1, noise=1e-3, changes=["elbow.offset=0.02"])
    >>> [cause.cause for cause in calib.judge(model, log).causes]
    ['offset:elbow']
    """
    require("model", model, Model)
    require("log", log, Samples)
    check_choice("cause", cause, CAUSES)
    check_choice("free", free, FREED)
    if free == "offsets":
        cause = free
    with plain_numbers():
        model = model.by(log.sensor)
        if "board" in model.about.options:
            from ..recording.board_pictures import with_lens_of

            log = with_lens_of(model, log)
        rows = rows_of(model, log)
        if model.body is None:
            return _of_maps(rows)
        return _of_body(rows, cause or rows.cause, learn)


def _of_body(rows: LogRows, cause: str | None, learn: bool) -> Verdict:
    body = rows.body

    # The belief that a changed arm starts from, in the frame of the log.
    prior = as_drawn(body) if cause == "offsets" else as_built(body)
    reference = reference_of(prior, rows.q, rows.x - rows.added, rows.unit)
    added = rows.added
    if reference.new:
        added = carried_offset(
            body, reference.body, reference.beta, rows.q, added
        )
    z = rows.x - added
    sound = sound_rows(reference, rows.q, z, cause)
    rows = rows.sound(sound)
    # that of the model's own log and of this one
    common = math.sqrt(2.0) * rows.shared
    data = Log(rows.q, z[sound], common)

    # Is anything wrong, and could these rows say so?
    old = reference if reference.new else Reference(body, body.beta)
    is_moved = len(reference.forgotten) > 0
    near = reference if is_moved else old
    noise = FreeNoise(System(near, data))
    play = find_play(noise, rows.side)
    if play is not None:
        data = replace(data, q=data.q - play.half * rows.side)
        noise = FreeNoise(System(near, data))
    temper = max(body.kappa**2, 1.0, noise.temper)
    if near is not old:
        noise = FreeNoise(System(old, data))
    tests = group_tests(noise, rows.probes)
    limit = np.maximum(rows.bound, prior.bound(rows.q))
    shared = shared_columns(reference, data, data.z)
    variance = (shared**2).mean(axis=1)
    bound = bound_test(rows, limit, variance.sum(axis=1), tests)
    suspicious = max(tests.score, bound.test.score) > 1.0
    calm = not (suspicious or bound.beyond > BEYOND or reference.new)

    # Which causes explain it?
    if (
        not learn
    ):  # the wider belief is for the bound of a model that is written
        reference = replace(
            reference, body=replace(reference.body, second=None)
        )
    systems = [System(reference, data)]
    if is_moved and not reference.new:  # the frame may be where it was
        there = Reference(reference.body, body.beta)
        systems.insert(0, System(there, data))
    evidence = Evidence(
        rows=rows,
        cause=cause,
        prior=prior,
        reference=reference,
        data=data,
        tests=tests,
        bound=bound,
        explanations=explain(systems, cause, temper=temper, calm=calm),
    )
    if _is_turned_otherwise(evidence):
        explanations = explain(
            systems, cause, temper=temper, calm=False, turned=(_TOOL,)
        )
        evidence = replace(evidence, explanations=explanations)
    elif evidence.score > 1.0 and not evidence.attributed:
        evidence = _by_orientations(evidence)

    # The winner fitted to the rows, and held-out rows as they are and as explained.
    better = None
    if learn or evidence.score > 1.0:
        better = update(evidence)

    # Words.
    score = max(evidence.score, evidence.tool.score)
    if play is not None:
        approach = rows.model.approach
        usual = 0.0
        if approach is not None:
            usual = _PLAY_SHARE * float(approach.play[play.joint])
        if not evidence.explained or play.half[play.joint] <= usual:
            play = None
    if play is not None:
        score = max(score, play.score)
    causes, notes = causes_of(evidence, play)
    changed: bool | None = score > 1.0
    if not changed and tests.too_few:
        changed = None
    return Verdict(
        changed=changed,
        causes=causes,
        score=score,
        notes=(*_notes(rows, bound, score), *notes),
        rows=rows,
        tests=tests,
        bound=bound,
        update=better,
        evidence=evidence,
    )


def _of_maps(rows: LogRows) -> Verdict:
    """The verdict on a model without a body: its rows beside its bound."""
    noise = rows.model.baseline.noise if rows.model.baseline else 0.0
    limit = SHARED_ERRORS * rows.bound
    usual = float(np.median(rows.missed))
    most = max(OUTLIER * usual, float(limit.max()))
    sound = np.asarray(rows.missed <= most)
    rows = rows.sound(sound)
    tests = Tested((), noise, noise)
    bound = bound_test(rows, limit[sound], rows.shared**2, tests)
    score = bound.test.score
    causes: tuple[Cause, ...] = ()
    if score > 1.0:
        words = (
            f"{100 * bound.beyond:.0f} % of the rows are beyond the maps' bound"
        )
        causes = (Cause("unknown", "maps", words),)
    note = "the model has no body: its rows are compared with its bound alone"
    return Verdict(
        changed=score > 1.0,
        causes=causes,
        score=score,
        notes=(*_notes(rows, bound, score), note),
        rows=rows,
        tests=tests,
        bound=bound,
    )


def _notes(rows: LogRows, bound: BoundTest, score: float) -> list[str]:
    """Return the notes on the rows, and that the bound does not hold."""
    notes = list(rows.notes)
    if not bound.holds:
        notes.append(bound.words(noisier=score <= 1.0))
    return notes


def _is_turned_otherwise(evidence: Evidence) -> bool:
    """Whether orientations contradict the best explanation, which leaves the tool in its place.

    A camera that is turned moves what it sees: positions alone may call that a joint's offset,
    which the tool would have to be turned back by.
    """
    if not evidence.attributed or evidence.cause not in (None, "joints"):
        return False
    moved = _TOOL in evidence.explanations[0].groups
    return not moved and evidence.tool.score > 1.0


def _by_orientations(evidence: Evidence) -> Evidence:
    """The evidence where orientations tell a change from none, which positions alone do not.

    An offset of the last joint turns the tool, and hardly moves it.
    """
    if evidence.tool.score <= 1.0:
        return evidence
    structure = evidence.reference.structure
    changes = [some for some in evidence.explanations if some.causes]
    least = evidence.explanations[0].evidence - MARGIN
    for best in changes:
        tool = turned_tool(evidence.rows, structure, best.beta, best.deviation)
        if best.evidence > least and tool.score <= 1.0:
            others = [some for some in changes if some is not best]
            return replace(evidence, explanations=(best, *others))
    return evidence


def check_choice(name: str, value: str | None, choices: Sequence[str]) -> None:
    """Refuse what cannot be chosen."""
    if value is not None and value not in choices:
        raise OptionError(
            f"{name} {value!r} is unknown",
            hint=f"choose one of {', '.join(choices)}",
            parameter=name,
            value=value,
        )


@contextmanager
def plain_numbers() -> Iterator[None]:
    """One BLAS thread; a forged file, whose numbers no equation holds, is told."""
    try:
        with one_blas_thread():
            yield
    except np.linalg.LinAlgError:
        raise ModelError(
            "no equation holds the model's numbers: train it again"
        ) from None


def check(
    model: Model,
    log: Samples,
    *,
    cause: str | None = None,
    tolerance: float | None = None,
) -> Verdict:
    """Compare new samples with a model.

    Parameters
    ----------
    model : Model
    log : Samples
        At least ten different rows of the same arm.
    cause : {"sensor", "joints"}, optional
        What is known about a change.
    tolerance : float, optional [unit]
        Where nothing fired and the rows could not have shown a change of this size, `drifted` is
        None.

    Returns
    -------
    Verdict

    Raises
    ------
    LogError
        If the log is not of this arm, too short, or looks wrong.
    """
    verdict = judge(model, log, cause=cause, learn=False)
    return replace(verdict, tolerance=tolerance)
