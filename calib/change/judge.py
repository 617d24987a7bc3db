"""Judge: what happened to an arm between a model and a log, in the order of its equations.

The residuals of a log, whitened, are linear in all that may have changed and Gaussian in all that
is not known::

    y = X d + e,    e ~ N(0, K + s^2),    d ~ N(0, diag(sd^2)) of a hypothesis, else 0

X has a column for each parameter of the arm and its sensor; K is the model's own posterior, a
creep, and a smooth residual of this log alone.  Tests, evidences and estimates are sub-blocks of
the same equations.  `check`, `adapt`, `recognise` and the command line show the verdict.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from ..body.belief import Body
from ..common.arrays import Array, Mask
from ..common.parallel import one_blas_thread
from ..errors import ModelError
from ..model.model import Model
from ..samples.samples import Samples
from .causes import (
    Cause,
    as_built,
    as_drawn,
    check_cause,
    check_free,
    freedom,
    single_causes,
)
from .evidence import Evidence
from .explain import explain, is_changed
from .frame import Reference, carried_offset, reference_of
from .rows import LogRows, rows_of
from .settings import BEYOND, OUTLIER
from .system import Log, System, shared_variance, sound_rows
from .tests import BoundTest, Tested, bound_test, find_play, group_tests
from .update import Update, update
from .wordings import causes_of, maps_cause, play_cause

_NO_BODY = "the model has no body: its rows are compared with its bound alone"
# Times the bound of maps: a corner's rows share the errors of a few nodes
_SHARED_ERRORS = 2.0


@dataclass(frozen=True, eq=False, repr=False)
class Verdict:
    """What a log says of a model.

    Attributes
    ----------
    changed : bool or None
        Whether the arm or its sensor changed; None where the rows are too few to say.
    causes : tuple of Cause
        What explains the rows, the largest effect first, with intervals.
    bound_holds : bool
        Whether about as many rows as usual lie within the model's own 95 % bound.
    covered : float
        Share of the rows within that bound.
    score : float
        Largest score of a test: above 1 something changed.
    smallest : float [unit]
        Displacement (rms over the learned range) by the smallest change that rows could show.
    update : Update or None
        The belief with what the rows tell, and held-out errors before and after; None for maps
        without a body, and where nothing changed and nothing was to be learned.
    outliers, left_out : int
        Rows that contradict all others; rows that are wrong, or outside of what the model
        has learned, with these.
    notes : tuple of str
        What else the user should be told.
    rows : LogRows
        The rows that count, with the model's predictions.
    sound : (n,) array of bool
        Those that do not contradict all others.
    tests : Tested
        Each group of parameters freed alone.
    bound : BoundTest
        The rows beyond the bound, and the chance of so many.
    evidence : Evidence or None
        The workings; None for maps without a body.
    """

    changed: bool | None
    causes: tuple[Cause, ...]
    bound_holds: bool
    covered: float
    score: float
    smallest: float
    update: Update | None
    outliers: int
    left_out: int
    notes: tuple[str, ...]
    rows: LogRows
    sound: Mask
    tests: Tested
    bound: BoundTest
    evidence: Evidence | None = None

    @property
    def words(self) -> str:
        """The verdict in a few words."""
        if self.changed:
            return "drifted"
        if self.changed is None:
            return "too few rows to say"
        return "still calibrated" if self.bound_holds else "the bound does not hold"

    @property
    def unit_seen(self) -> str:
        """Unit of the positions; "sensor" where their scale shows that it is not the model's."""
        return self.rows.unit if self.evidence is None else self.evidence.unit_seen

    @property
    def improves(self) -> bool:
        """Whether held-out rows say that the updated belief is better."""
        return self.update is not None and self.update.improved

    @property
    def held_out(self) -> tuple[float, float] | None:
        """Mean distance of held-out rows from the model, and from the updated belief [unit]."""
        if self.update is None:
            return None
        before = float(self.update.before.mean())
        return before, float(np.linalg.norm(self.update.residual, axis=1).mean())

    def __repr__(self) -> str:
        """Say the verdict, its causes and its notes, a line each."""
        head = f"Verdict: {self.words}, score {self.score:.3g} (threshold 1), {len(self.rows)} rows"
        return "\n  ".join([head, *(cause.words for cause in self.causes), *self.notes])


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
    check_cause(cause)
    check_free(free)
    if free == "offsets":
        cause = free
    with plain_numbers():
        model = model.by(log.sensor)
        rows = rows_of(model, log)
        if model.body is None:
            return _of_maps(rows)
        return _of_body(rows, cause or rows.cause, learn)


def _of_body(rows: LogRows, cause: str | None, learn: bool) -> Verdict:
    body = rows.body

    # The belief that a changed arm starts from, in the frame of the log.
    prior = as_drawn(body) if cause == "offsets" else as_built(body)
    reference = reference_of(prior, rows.q, rows.x - rows.added, rows.unit)
    z = rows.x - _added_in_frame(rows, reference)
    sound = sound_rows(
        reference, rows.q, z, freedom(prior, tuple(body.structure.groups), cause)
    )
    data = Log(rows.q[sound], z[sound], float(np.sqrt(2.0)) * rows.shared)
    systems = _systems(reference, body, data)

    # Is anything wrong, and could these rows say so?
    play = find_play(systems[-1], rows.side[sound])
    if play is not None:
        data = replace(data, q=data.q - play.half * rows.side[sound])
        systems = _systems(reference, body, data)
    tests = group_tests(systems[0], rows.probes)
    limit = np.maximum(rows.bound, prior.bound(rows.q))
    bound = bound_test(rows, sound, limit, shared_variance(reference, data), tests)
    score = max(tests.score, bound.test.score)
    suspicious = reference.new or score > 1.0 or bound.beyond > BEYOND

    # Which hypotheses explain it?
    findings = explain(systems, cause, calm=not suspicious)
    evidence = Evidence(
        rows, cause, prior, reference, sound, data, limit, tests, bound, findings, score
    )
    if suspicious:
        if reference.new:
            score = max(score, 2.0)
        if not evidence.explained:
            score = max(score, 1.0 + evidence.misfit)
    better = evidence.explained and (reference.new or is_changed(findings))
    evidence = replace(evidence, score=score, attributed=better and score > 1.0)

    # The winner fitted to the rows, and held-out rows as they are and as explained.
    learned = None
    if learn or score > 1.0:
        learned = update(evidence)
    if better and score <= 1.0 and bound.beyond > BEYOND and tests.noisy is None:
        # no test fires, but the bound fails and held-out rows are nearer to a hypothesis
        contradicted = replace(evidence, score=1.0 + bound.beyond, attributed=True)
        candidate = update(contradicted)
        if candidate.improved:
            evidence = contradicted
            learned = candidate

    # Words.
    causes, notes = causes_of(evidence)
    score = max(evidence.score, evidence.tool.score)
    if play is not None and evidence.explained:
        score = max(score, play.score)
        causes = (play_cause(play, rows.model), *causes)
    bound_holds = bound.beyond <= BEYOND and bound.test.score <= 1.0
    changed: bool | None = score > 1.0
    if not changed and tests.too_few:
        changed = None
    strays = int(np.count_nonzero(~sound))
    if strays:
        notes = (f"rows that contradict all others are left out: {strays}", *notes)
    if not bound_holds:
        notes = (bound.words(noisier=not changed), *notes)
    return Verdict(
        changed=changed,
        causes=causes,
        bound_holds=bound_holds,
        covered=1.0 - bound.beyond,
        score=score,
        smallest=tests.smallest,
        update=learned,
        outliers=rows.wrong + strays,
        left_out=rows.lost + strays,
        notes=(*rows.notes, *notes),
        rows=rows,
        sound=sound,
        tests=tests,
        bound=bound,
        evidence=evidence,
    )


def _systems(reference: Reference, body: Body, log: Log) -> list[System]:
    """Return the log beside the belief as it was, and in its own frame where that is far."""
    references = [reference]
    if len(reference.forgotten) and not reference.new:
        references = [Reference(reference.body, body.beta), reference]
    causes = single_causes(reference.structure).values()
    indices = np.unique(np.concatenate(list(causes)))
    return [System(each, log, indices) for each in references]


def _of_maps(rows: LogRows) -> Verdict:
    """The verdict on a model without a body: its rows beside its bound."""
    noise = rows.model.baseline.noise if rows.model.baseline else 0.0
    limit = _SHARED_ERRORS * rows.bound
    usual = float(np.median(rows.missed))
    sound = np.asarray(rows.missed <= max(OUTLIER * usual, float(limit.max())))
    tests = Tested((), noise, noise)
    bound = bound_test(rows, sound, limit, rows.shared**2, tests)
    changed = bound.test.score > 1.0
    bound_holds = bound.beyond <= BEYOND and not changed
    notes = [*rows.notes, _NO_BODY]
    strays = int(np.count_nonzero(~sound))
    if strays:
        notes.append(f"rows that contradict all others are left out: {strays}")
    if not bound_holds:
        notes.append(bound.words(noisier=not changed))
    return Verdict(
        changed=changed,
        causes=(maps_cause(bound.beyond),) if changed else (),
        bound_holds=bound_holds,
        covered=1.0 - bound.beyond,
        score=bound.test.score,
        smallest=float(np.median(rows.model.expected_error(rows.logged))),
        update=None,
        outliers=rows.wrong + strays,
        left_out=rows.lost + strays,
        notes=tuple(notes),
        rows=rows,
        sound=sound,
        tests=tests,
        bound=bound,
    )


def _added_in_frame(rows: LogRows, reference: Reference) -> Array:
    """What maps add to the body, (n, m) [unit], in the frame of the log."""
    if not reference.new:
        return rows.added
    return carried_offset(rows.body, reference.body, reference.beta, rows.q, rows.added)


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
