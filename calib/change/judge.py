"""Judge: what happened to an arm between a model and a log.

The residuals of a log are linear in what may have changed, and Gaussian in all else::

    y = X d + e,    e ~ N(0, K + s^2 I),    d ~ N(0, diag(sd^2))

    y   (N,)    measured less predicted positions, over the sensor's noise  (`rows`, `frame`)
    X   (N, d)  derivatives of the predictions by all parameters            (`System.columns`)
    sd  (d,)    by which parameters change; zero where no cause frees them  (`causes`)
    K   (N, N)  what an unchanged arm may show: the model's own posterior, a creep, and a smooth
                residual of this log alone                                  (`system`)
    s           size of the noise, 1 as usual                               (`noise`)

From these follow in turn the p-values of the tests (`significance`), the evidence p(y | causes)
of each set of causes (`explain`) and the posterior of d (`update`); `_verdict_on_body` reads in
that order.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from ..body.belief import Body
from ..common.choices import CAUSES, FREED, check_choice
from ..common.parallel import one_blas_thread
from ..errors import LogError, ModelError, require
from ..model.model import Model
from ..samples.samples import Samples
from ..training.options import Progress
from .causes import Cause, as_built, as_drawn, with_chain_in_doubt
from .evidence import Evidence, unnamed_log_evidence, with_orientations
from .explain import explain
from .frame import Reference, reference_of
from .noise import NoiseFit, Play, find_play, noise_of, with_waves
from .rows import LogRows, rows_of, sound_rows
from .significance import bound_test, group_tests, variance_of_all
from .steps import Step, find_step
from .system import NoisyJoint, System, system_of
from .update import Update, update
from .verdict import Episode, Verdict, notes_of, verdict_on_maps
from .words import causes_of


def judge(
    model: Model,
    log: Samples,
    *,
    cause: str | None = None,
    free: str = "all",
    learn: bool = True,
    progress: Progress | None = None,
) -> Verdict:
    """Judge a model by a log.

    Parameters
    ----------
    model : Model
    log : Samples
        At least ten different rows of the same arm, of `log.sensor` (the first one if "").
    cause : {"sensor", "joints"}, optional
        What is known about the change.
    free : {"all", "offsets"}
        With "offsets" only the joints' zeros and the sensor's frame may have changed.
    learn : bool
        Whether the belief is also updated by rows of an arm that did not change.
    progress : callable, optional
        Called with the share of the work done, the stage, and NaN.

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
    if cause is not None:
        check_choice("cause", cause, CAUSES)
    check_choice("free", free, FREED)
    if free == "offsets":
        cause = free
    report = progress or (lambda *_: None)
    with guarded_algebra():
        model = model.by(log.sensor)
        measured = log
        if model.about.board:
            from ..recording.board_pictures import with_lens_of

            measured = with_lens_of(model, log)
        report(0.0, "rows", math.nan)
        rows = rows_of(model, measured)
        if model.body is None:
            return verdict_on_maps(rows)
        if log.touch is not None:  # touches do not depend on a sensor
            cause = cause or "joints"
        verdict = _verdict_on_body(rows, cause, learn, report)
        evidence = verdict.evidence
        if evidence is None or evidence.step is None:
            return verdict
        step = _step_in_words(evidence.step, model, log, cause)
        return replace(verdict, causes=(step,))


def _verdict_on_body(
    all_rows: LogRows, cause: str | None, learn: bool, report: Progress
) -> Verdict:
    """The verdict on a model with a body."""
    # 1. y: the rows against the belief that a changed arm starts from, in the frame of the log
    belief = with_chain_in_doubt(all_rows.body)
    prior = as_drawn(belief) if cause == "offsets" else as_built(belief)
    positions = all_rows.x - all_rows.map_offset
    reference = reference_of(prior, all_rows.q, positions, all_rows.unit)
    all_observations = all_rows.without_maps(reference)
    sound = sound_rows(reference, all_observations)
    rows = all_rows.without_strays(sound)

    report(0.2, "tests", math.nan)
    # 2. s: the noise where everything may have changed, and the play and the waves of joints
    old_frame = Reference(belief, belief.beta)
    frame = reference if reference.is_fitted else old_frame
    noise, play = _noise_and_play(frame, all_observations.take(sound))
    if play is not None:
        all_observations = play.taken_up(all_observations)
    observations = all_observations.take(sound)
    reference = replace(
        reference,
        waves=noise.system.reference.waves,
        simulated=belief if belief.simulated else None,
    )

    # 3. p: the chance of such rows where nothing changed, by groups of parameters and by the bound
    noise_beside_belief = noise
    if reference.is_doubtful:
        system = system_of(old_frame, observations)
        noise_beside_belief = with_waves(noise_of(system))
    tests = group_tests(noise_beside_belief, rows.probes)
    # a simulated arm has not changed within the tolerances of its making
    tolerance = np.maximum(rows.bound, prior.bound(rows.q))
    shared_variance = variance_of_all(reference, observations)
    bound = bound_test(rows, rows.bound, tolerance, shared_variance, tests)

    report(0.4, "causes", math.nan)
    # 4. p(y | causes): which sets of causes explain the rows?
    correlation_time = max(rows.body.kappa**2, 1.0, noise.correlation_time)
    observations = replace(observations, correlation_time=correlation_time)
    systems = _systems(prior, reference, observations)
    unnamed = unnamed_log_evidence(systems[-1])
    evidence = Evidence(
        rows, cause, prior, reference, observations, tests, bound, unnamed, play
    )
    explanations = explain(systems, cause, calm=not evidence.fired)
    evidence = replace(evidence, explanations=explanations)
    step = _step_within(evidence, all_observations, noise.system.noisy_joint)
    evidence = with_orientations(replace(evidence, step=step), systems)

    # 5. d: the best explanation fitted to the rows, judged by rows that are held out
    needs_update = learn or evidence.score > 1.0
    better = update(evidence, learn=learn) if needs_update else None

    # 6. the verdict in words
    return _verdict_of(evidence, better)


def _noise_and_play(
    frame: Reference, observations: LogRows
) -> tuple[NoiseFit, Play | None]:
    """The noise without the play and the waves of joints, and a play that the log shows."""
    noise = noise_of(system_of(frame, observations))
    play = find_play(noise)
    if play is not None:
        noise = noise_of(system_of(frame, play.taken_up(observations)))
    return with_waves(noise), play


def _step_within(
    evidence: Evidence,
    all_observations: LogRows,
    noisy_joint: NoisyJoint | None,
) -> Step | None:
    """The change within the log beside the best explanation, where a test hints at one.

    all_observations : of all rows, also of those that contradict the others
    noisy_joint : a joint whose encoder is noisy
    """
    if (
        evidence.rows.log.touch is not None
    ):  # touches have no order of their own
        return None
    if not (evidence.fired or evidence.tests.is_noisier):
        return None
    best = evidence.best
    reference = replace(best.reference, beta=best.beta)
    return find_step(reference, all_observations, noisy_joint)


def _systems(
    prior: Body, reference: Reference, observations: LogRows
) -> list[System]:
    """The observations in the frame of the log, and in that of the belief if it may be the same."""
    references = [reference]
    if reference.is_doubtful:
        old_frame = Reference(
            prior,
            prior.beta,
            waves=reference.waves,
            simulated=reference.simulated,
        )
        references.insert(0, old_frame)
    return [system_of(frame, observations) for frame in references]


def _verdict_of(evidence: Evidence, better: Update | None) -> Verdict:
    """The verdict, with causes and notes in words."""
    causes, notes = causes_of(evidence)
    score = max(evidence.score, evidence.tool.score)
    if evidence.play is not None and evidence.is_explained:
        score = max(score, evidence.play.score)
    unsure = score <= 1.0 and evidence.tests.too_few
    return Verdict(
        changed=None if unsure else score > 1.0,
        causes=causes,
        score=score,
        notes=(*notes_of(evidence.rows, evidence.bound, score), *notes),
        rows=evidence.rows,
        tests=evidence.tests,
        bound=evidence.bound,
        update=better,
        evidence=evidence,
    )


def _step_in_words(
    step: Step, model: Model, log: Samples, cause: str | None
) -> Cause:
    """The cause of a change within a log, described by the verdicts on both parts of the log."""
    first = int(np.argmax(log.rows == step.row))
    states = []
    for part in (slice(first), slice(first, None)):
        try:
            state = judge(model, log.take(part), cause=cause, learn=False)
        except LogError as error:
            states.append(str(error))
            continue
        if state.has_step:
            states.append("it changed there, too")
        else:
            states.append(state.main_cause if state.drifted else state.words)
    before, after = states
    how = "near"
    if step.is_gradual:
        how = "bit by bit from the first row to the last, by half near"
    words = (
        f"the arm or the sensor changed within the log, {how} row {step.row}: split it there; "
        f"before: {before}; after: {after}"
    )
    return Cause("step", "", words)


@contextmanager
def guarded_algebra() -> Iterator[None]:
    """One BLAS thread; ModelError where a model's numbers are singular, as a forged file's are."""
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
    progress: Progress | None = None,
) -> Verdict:
    """Compare new samples with a model.

    Parameters
    ----------
    model : Model
    log : Samples
        At least ten different rows of the same arm, of `log.sensor` (the first one if "").
    cause : {"sensor", "joints"}, optional
        What is known about a change.
    tolerance : float, optional [unit]
        `drifted` is None where nothing fired and the rows could not have shown a change of this
        size.
    progress : callable, optional
        See :func:`judge`.

    Returns
    -------
    Verdict

    Raises
    ------
    LogError
        If the log is not of this arm, too short, or looks wrong.
    """
    verdict = judge(model, log, cause=cause, learn=False, progress=progress)
    episodes = _episodes(model, log, cause)
    return replace(verdict, tolerance=tolerance, episodes=episodes)


def _episodes(
    model: Model, log: Samples, cause: str | None
) -> tuple[Episode, ...]:
    """The verdict on each series of a log that names them."""
    if log.episode is None:
        return ()
    episodes: list[Episode] = []
    for number in np.unique(log.episode.astype(int)).tolist():
        series = log.take(np.flatnonzero(log.episode == number))
        count = len(series)
        try:
            verdict = judge(model, series, cause=cause, learn=False)
        except LogError as error:
            episode = Episode(number, count, None, None, (str(error),))
        else:
            episode = Episode(
                number,
                count,
                verdict.drifted,
                verdict.score,
                verdict.explanations,
            )
        episodes.append(episode)
    return tuple(episodes)
