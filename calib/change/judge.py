"""Judge: what happened to an arm between a model and a log, in the order of its equations.

The residuals of a log, whitened, are linear in all that may have changed and Gaussian in all that
is not known::

    y = X d + e,    e ~ N(0, K + s^2),    d ~ N(0, diag(sd^2)) of a cause that is freed, else 0

X has a column for each parameter of the arm and its sensor; K is the model's own posterior, a
creep, and a smooth residual of this log alone.  Tests, evidences and estimates are sub-blocks of
the same equations.  `check`, `adapt`, `recognise` and the command line show the verdict.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from ..common.arrays import Mask
from ..common.choices import CAUSES
from ..common.parallel import one_blas_thread
from ..errors import ModelError, require
from ..model.model import Model
from ..samples.samples import Samples
from .causes import (
    Cause,
    as_built,
    as_drawn,
    check_choice,
    single_causes,
)
from .evidence import BoundTest, Evidence, bound_test
from .explain import explain
from .frame import Reference, carried_offset, reference_of
from .rows import LogRows, Signal, distortions, rows_of
from .settings import BEYOND, FALSE_ALARM, OUTLIER
from .significance import (
    GroupTest,
    Tested,
    find_play,
    fired,
    group_tests,
)
from .system import Log, System, shared_variance, sound_rows
from .update import Update, update
from .words import causes_of, play_cause

# Times the bound of maps: a corner's rows share the errors of a few nodes
_SHARED_ERRORS = 2.0
# Of the play that a model knows, by which that may be wrong: 20 mrad were learned as 19.1
_PLAY_SHARE = 0.1
_TOOL = ("tool",)  # the group of where it is


@dataclass(frozen=True, eq=False, repr=False)
class Verdict:
    """What a log says of a model.

    Attributes
    ----------
    changed : bool or None
        Whether the arm or its sensor changed; None where the rows are too few to say.
    causes : tuple of Cause
        What explains the rows, the largest effect first, with intervals.
    score : float
        Largest score of a test: above 1 something changed.
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
    update : Update or None
        The belief with what the rows tell, and held-out errors before and after; None for maps
        without a body, and where nothing changed and nothing was to be learned.
    evidence : Evidence or None
        The workings; None for maps without a body.
    tolerance : float or None [unit]
        Size of a change that the user does not mind.
    """

    changed: bool | None
    causes: tuple[Cause, ...]
    score: float
    notes: tuple[str, ...]
    rows: LogRows
    sound: Mask
    tests: Tested
    bound: BoundTest
    update: Update | None = None
    evidence: Evidence | None = None
    tolerance: float | None = None

    @property
    def drifted(self) -> bool | None:
        """Whether something changed; None where the rows are too few, or too coarse, to say."""
        coarse = self.tolerance is not None and self.smallest > self.tolerance
        return None if coarse and not self.changed else self.changed

    @property
    def words(self) -> str:
        """The verdict in a few words."""
        if self.changed:
            return "drifted"
        if self.changed is None:
            return "too few rows to say"
        if self.drifted is None:
            return "too coarse"
        return (
            "still calibrated"
            if self.bound_holds
            else "the bound does not hold"
        )

    @property
    def explanations(self) -> tuple[str, ...]:
        """The causes in words."""
        return tuple(cause.words for cause in self.causes)

    @property
    def groups(self) -> tuple[GroupTest, ...]:
        """Every group that was tested, and the bound."""
        return (*self.tests.groups, self.bound.test)

    @property
    def fired(self) -> tuple[str, ...]:
        """Names of the groups above their threshold, the most telling first."""
        return tuple(group.name for group in fired(self.groups))

    @property
    def bound_holds(self) -> bool:
        """Whether about as many rows as usual lie within the model's own 95 % bound."""
        return self.bound.holds

    @property
    def covered(self) -> float:
        """Share of the rows within the model's own 95 % bound."""
        return 1.0 - self.bound.beyond

    @property
    def smallest(self) -> float:
        """Displacement (rms over the learned range) by the smallest change to be seen [unit]."""
        if self.evidence is None:
            return float(
                np.median(self.rows.model.expected_error(self.rows.logged))
            )
        return self.tests.smallest

    @property
    def samples(self) -> int:
        """Rows that were compared."""
        return len(self.rows)

    @property
    def outliers(self) -> int:
        """Rows that contradict all others; they count for nothing."""
        return self.rows.wrong + int(np.count_nonzero(~self.sound))

    @property
    def left_out(self) -> int:
        """Rows that are wrong, or outside of what the model has learned, with the outliers."""
        return self.outliers + self.rows.lost - self.rows.wrong

    @property
    def noise(self) -> float:
        """Standard deviation per axis of what is left over [unit]."""
        return self.tests.noise

    @property
    def usual_noise(self) -> float:
        """The same in training [unit]."""
        return self.tests.usual

    @property
    def unit(self) -> str:
        """Unit of the positions; "sensor" where their scale shows that it is not the model's."""
        return self.rows.unit if self.evidence is None else self.evidence.unit

    @property
    def adapts(self) -> bool:
        """Whether held-out rows say that `adapt` re-calibrates the model."""
        return self.update is not None and self.update.improved

    @property
    def held_out(self) -> tuple[float, float] | None:
        """Mean distance of held-out rows from the model, and from the updated belief [unit]."""
        if self.update is None:
            return None
        return float(self.update.before.mean()), float(self.update.after.mean())

    @property
    def distortion(self) -> dict[str, Signal]:
        """How the rows lie on the maps (eq. 9): a display, no alarm."""
        return distortions(self.rows)

    def __repr__(self) -> str:
        """Say the verdict, its causes and its notes, a line each."""
        head = f"Verdict: {self.words}, score {self.score:.3g} (threshold 1), {len(self.rows)} rows"
        return "\n  ".join([head, *self.explanations, *self.notes])

    def to_json(self) -> dict[str, object]:
        """What `calib check --json` prints."""
        return {
            "drifted": self.drifted,
            "samples": self.samples,
            "outliers": self.outliers,
            "left_out": self.left_out,
            "score": self.score,
            "smallest": self.smallest,
            "tolerance": self.tolerance,
            "adapts": self.adapts,
            "bound_holds": self.bound_holds,
            "covered": self.covered,
            "threshold": 1,
            "distortion": {
                name: signal._asdict()
                for name, signal in self.distortion.items()
            },
            "fired": list(self.fired),
            "causes": [cause.to_json() for cause in self.causes],
            "smallest_by_group": {
                group.name: group.smallest for group in self.groups
            },
            "explanations": list(self.explanations),
            "noise": {"now": self.noise, "usual": self.usual_noise},
            "false_alarm": FALSE_ALARM,
        }


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
    check_choice("free", free, ("all", "offsets"))
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
    data = Log(rows.q[sound], z[sound], float(np.sqrt(2.0)) * rows.shared)

    # Is anything wrong, and could these rows say so?
    play = find_play(_system(reference, data), rows.side[sound])
    if play is not None:
        data = replace(data, q=data.q - play.half * rows.side[sound])
    before = reference if reference.new else Reference(body, body.beta)
    tests = group_tests(_system(before, data), rows.probes)
    limit = np.maximum(rows.bound, prior.bound(rows.q))
    shared = shared_variance(reference, data)
    bound = bound_test(rows, sound, limit, shared, tests)
    scores = tests.score, bound.test.score
    suspicious = max(scores) > 1.0 or bound.beyond > BEYOND

    # Which causes explain it?
    systems = [_system(reference, data)]
    if len(reference.forgotten) and not reference.new:
        # the frame may be where it was
        there = Reference(reference.body, body.beta)
        systems.insert(0, _system(there, data))
    explanations = explain(
        systems, cause, calm=not (suspicious or reference.new)
    )
    evidence = Evidence(
        rows=rows,
        cause=cause,
        prior=prior,
        reference=reference,
        sound=sound,
        data=data,
        tests=tests,
        bound=bound,
        explanations=explanations,
    )
    if _is_turned_otherwise(evidence):
        explanations = explain(systems, cause, calm=False, turned=_TOOL)
        evidence = replace(evidence, explanations=explanations)

    # The winner fitted to the rows, and held-out rows as they are and as explained.
    learned = None
    if learn or evidence.score > 1.0:
        learned = update(evidence)

    # Words.
    causes, notes = causes_of(evidence)
    score = max(evidence.score, evidence.tool.score)
    if play is not None and evidence.explained:
        share = _PLAY_SHARE
        approach = rows.model.approach
        if approach is None or (
            play.half[play.joint] > share * approach.play[play.joint]
        ):
            score = max(score, play.score)
            causes = (play_cause(play, rows.model), *causes)
    changed: bool | None = score > 1.0
    if not changed and tests.too_few:
        changed = None
    return Verdict(
        changed=changed,
        causes=causes,
        score=score,
        notes=(*_notes(rows, sound, bound, score), *notes),
        rows=rows,
        sound=sound,
        tests=tests,
        bound=bound,
        update=learned,
        evidence=evidence,
    )


def _of_maps(rows: LogRows) -> Verdict:
    """The verdict on a model without a body: its rows beside its bound."""
    noise = rows.model.baseline.noise if rows.model.baseline else 0.0
    limit = _SHARED_ERRORS * rows.bound
    usual = float(np.median(rows.missed))
    sound = np.asarray(rows.missed <= max(OUTLIER * usual, float(limit.max())))
    tests = Tested((), noise, noise)
    bound = bound_test(rows, sound, limit, rows.shared**2, tests)
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
        notes=(*_notes(rows, sound, bound, score), note),
        rows=rows,
        sound=sound,
        tests=tests,
        bound=bound,
    )


def _notes(
    rows: LogRows, sound: Mask, bound: BoundTest, score: float
) -> list[str]:
    """Return the notes on the rows, and that the bound does not hold."""
    notes = list(rows.notes)
    if not bound.holds:
        notes.append(bound.words(noisier=score <= 1.0))
    strays = int(np.count_nonzero(~sound))
    if strays:
        notes.append(f"rows that contradict all others are left out: {strays}")
    return notes


def _is_turned_otherwise(evidence: Evidence) -> bool:
    """Whether orientations contradict the best explanation, which leaves the tool in its place.

    A camera that is turned moves what it sees: positions alone may call that a joint's offset,
    which the tool would have to be turned back by.
    """
    if not evidence.attributed or evidence.cause not in (None, "joints"):
        return False
    moved = _TOOL[0] in evidence.explanations[0].groups
    return not moved and evidence.tool.score > 1.0


def _system(reference: Reference, log: Log) -> System:
    """Return the system of all that may have changed."""
    causes = single_causes(reference.structure).values()
    return System(reference, log, np.unique(np.concatenate(list(causes))))


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
