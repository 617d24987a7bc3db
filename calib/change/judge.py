"""Judge: what happened to an arm between a model and a log, in the order of its equations.

The residuals of a log, whitened, are linear in all that may have changed and Gaussian in all that
is not known::

    y = X d + e,    e ~ N(0, K + s^2),    d ~ N(0, diag(sd^2)) of a cause that is freed, else 0

X has a column for each parameter of the arm and its sensor; K is the model's own posterior, a
creep, and a smooth residual of this log alone.  Tests (p), evidences (log p(y | causes)) and
estimates (d) are sub-blocks of the same equations; `_of_body` takes them in turn.  `check`,
`adapt`, `recognise` and the command line show the verdict.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from ..common.choices import CAUSES, FREED
from ..common.parallel import one_blas_thread
from ..errors import ModelError, OptionError, require
from ..model.model import Model
from ..samples.samples import Samples
from .causes import as_built, as_drawn
from .evidence import Evidence, bound_test, with_orientations
from .explain import explain
from .frame import Reference, reference_of
from .play import find_play
from .rows import LogRows, rows_of
from .settings import BEYOND
from .significance import FreeNoise, group_tests
from .system import System, frame_variance, sound_data
from .update import update
from .verdict import Verdict, notes_of, verdict_on_maps
from .words import causes_of


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
            return verdict_on_maps(rows)
        return _of_body(rows, cause or rows.cause, learn)


def _of_body(logged: LogRows, cause: str | None, learn: bool) -> Verdict:
    """The verdict on a model with a body."""
    body = logged.body

    # 1. y: the log beside the belief that a changed arm starts from, in the frame of the log.
    prior = as_drawn(body) if cause == "offsets" else as_built(body)
    positions = logged.x - logged.map_offset
    reference = reference_of(prior, logged.q, positions, logged.unit)
    rows, readings = sound_data(logged, reference)

    # 2. s: the noise where everything may have changed; a joint's play is found beside it, and
    # taken up.  A frame that no posterior tells of leaves no old one to compare with.
    old = reference if reference.new else Reference(body, body.beta)
    nearest = reference if reference.is_fitted else old
    noise_of_readings = FreeNoise(System(nearest, readings))
    play = find_play(noise_of_readings, rows)
    if play is None:
        data = readings
        noise = noise_of_readings
    else:
        data = replace(readings, q=readings.q - play.half * rows.side)
        noise = FreeNoise(System(nearest, data))
    temper = max(body.kappa**2, 1.0, noise.temper)

    # 3. p: the chance of such rows where nothing changed, by groups of parameters and by the bound.
    old_noise = noise if old is nearest else FreeNoise(System(old, data))
    tests = group_tests(old_noise, rows.probes)
    limit = np.maximum(rows.bound, prior.bound(rows.q))
    bound = bound_test(rows, limit, frame_variance(reference, data), tests)

    # 4. log p(y | causes): which sets of causes explain the rows?
    fired = max(tests.score, bound.test.score) > 1.0
    calm = not (fired or bound.beyond > BEYOND or reference.new)
    systems = [System(reference, data)]
    if reference.is_fitted and not reference.new:  # it may be where it was
        there = Reference(prior, body.beta)
        systems.insert(0, System(there, data))
    by_positions = Evidence(
        rows=rows,
        cause=cause,
        prior=prior,
        reference=reference,
        data=data,
        tests=tests,
        bound=bound,
        explanations=explain(systems, cause, temper=temper, calm=calm),
    )
    evidence = with_orientations(by_positions, systems, temper)

    # 5. d: the best explanation fitted to the rows, judged by rows that are held out.
    better = None
    if learn or evidence.score > 1.0:
        better = update(evidence, learn=learn)

    # 6. Words.
    causes, notes = causes_of(evidence, play)
    score = max(evidence.score, evidence.tool.score)
    if play is not None and evidence.is_explained:
        score = max(score, play.score)
    unsure = score <= 1.0 and tests.too_few
    return Verdict(
        changed=None if unsure else score > 1.0,
        causes=causes,
        score=score,
        notes=(*notes_of(rows, bound, score), *notes),
        rows=rows,
        tests=tests,
        bound=bound,
        update=better,
        evidence=evidence,
    )


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
