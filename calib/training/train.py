"""Training: from samples to a calibrated model."""

from __future__ import annotations

import time
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from ..arm.arm import Arm
from ..body.approach import Approach
from ..common.arrays import Array
from ..common.parallel import one_blas_thread, side_by_side
from ..common.scale import Scale
from ..errors import LogError
from ..maps.local_models import NO_MODELS
from ..maps.model_selection import select
from ..model.about import About, Rows
from ..model.baseline import Seen, learn_baseline
from ..model.model import Model
from ..samples.joint_values import directions
from ..samples.moved import moved_words
from ..samples.samples import Samples
from ..samples.wrong_rows import screen
from .bounds import node_bounds, play_of, play_words, simulated_bounds
from .evaluate import answered_within, fresh_residuals, held_out_residuals, summarise
from .learn import Progress, TrainingOptions, associate, resolved, unit_box
from .smooth import find_smooth_part, to_learn
from .sound_rows import fit_sound_rows
from .touched import fit_sockets

_UNLIMITED = 1e6  # [rad] of a joint that turns without end
_LEAST_ROWS = 10  # fewest rows that anything can be learned and checked from
_TESTED = 20_000  # rows of a log that errors are measured on; more would tell no more


def train(
    samples: Samples,
    options: TrainingOptions | None = None,
    *,
    progress: Progress | None = None,
    **named: Any,
) -> Model:
    """Learn a model from babbled or measured samples.

    Parameters
    ----------
    samples : Samples
        Joint values and positions.
    options : TrainingOptions, optional
        How; or its attributes by name, as in `calib.train(log, size=40, map="som")`.
    progress : callable, optional
        Called with the share of the work done, the stage and the current error.

    Returns
    -------
    Model

    Raises
    ------
    LogError
        If there are too few samples.
    OptionError
        If an option is out of range.

    Examples
    --------
    >>> import calib
    >>> samples = calib.babble(calib.load_arm("two_link"), 2000, seed=0)
    >>> model = calib.train(samples, size=20)
    >>> model.about.errors["local"]["forward"]["distance"]["mean"] < 1e-6
    True
    """
    options = replace(options or TrainingOptions(), **named)
    if not isinstance(samples, Samples):
        raise LogError(f"samples {samples!r:.40}: expected what `calib.read_log` returns")
    if len(samples) < _LEAST_ROWS:
        raise LogError(
            f"{len(samples)} sample{'s are' if len(samples) != 1 else ' is'} too few to learn from:"
            f" give at least {_LEAST_ROWS}"
        )
    # a BLAS that splits sums over threads would change the last bits
    with one_blas_thread():
        return _learned(samples, options, progress or (lambda *_: None))


def _learned(samples: Samples, options: TrainingOptions, progress: Progress) -> Model:
    """The steps of a training in the order of the data flow."""
    marks: list[tuple[str, float]] = []

    def begin(share: float, stage: str) -> None:
        marks.append((stage, time.perf_counter()))
        progress(share, stage, float("nan"))

    begin(0.0, "body")
    given, simulation = len(samples) + samples.left_out, samples.simulation
    notes, part, play = list[str](), None, None
    if simulation is None and samples.touch is None:
        kept, notes = screen(samples)
        samples = samples if kept.all() else samples.take(kept)
    options, told = resolved(samples, options)
    notes += told
    if samples.touch is not None:
        samples, part, told = fit_sockets(samples, options.seed)
        notes += told
    elif options.body != "none":
        fit = partial(find_smooth_part, view=options.view, seed=options.seed)
        samples, part, told = fit_sound_rows(samples, fit)
        notes += told
        play = play_of(samples, part)
        if play is not None:  # where the joints stood, rather than what they read
            samples = replace(samples, q=samples.q - play * directions(samples.q))
            part = fit(samples)
            notes.append(play_words(samples, play))
        if simulation is None:
            notes += moved_words(samples, part.fit.body.predict(samples.q))
    notes += part.fit.notes if part is not None else ()

    begin(0.1, "maps")
    scale = unit_box(samples)
    seen_u, seen_x, wrong = to_learn(samples, part, options)
    association = associate(
        scale, seen_u, seen_x, options, wrong,
        lambda done, stage, error: progress(0.1 + 0.6 * done, stage, error),
    )  # fmt: skip

    begin(0.7, "local models")
    motor, u = association.motor, scale.to_unit(samples.q)
    body, local, left = None, NO_MODELS, None
    if part is not None:
        own = u[part.rows], samples.x[part.rows]
        chosen, left = select(motor, *own, part.smooth, part.fit.held_out)
        body, local = part.fit.body, chosen.models

    begin(0.8, "evaluation")
    empty, visited = np.zeros(motor.size), np.zeros(motor.size, dtype=bool)
    visited[motor.nearest(u)[1][:, 0]] = True
    about = _about(samples, options)
    model = Model(about, association, local, empty, empty, visited, body)
    if simulation is not None:
        seed = options.stream("bounds")
        (reading, known_u, known_x), tested = side_by_side(
            lambda: simulated_bounds(model, simulation, play, seed),
            lambda: fresh_residuals(model, simulation),
        )
        position = reading
    else:  # by blocks of the log's rows that were held out
        tested = held_out_residuals(model, samples, part, left, options)
        known_u, known_x = scale.to_unit(tested.q), tested.x
        reading, position = node_bounds(model, known_u, tested.errors[model.default_readout])
    model = replace(model, bounds=reading, model_bounds=position)
    some = slice(None, None, max(1, len(samples) // _TESTED))
    miss = np.linalg.norm(model.predictor.value(u[some]) - samples.x[some], axis=1)
    baseline = learn_baseline(association, known_u, known_x, miss)
    if part is None and simulation is None:
        baseline = replace(baseline, seen=Seen.of(scale, known_u))
    if play is not None:
        model = replace(model, approach=Approach(play))
    begin(1.0, "done")
    about = replace(
        about,
        errors=summarise(tested),
        within=answered_within(model, tested),
        tested=len(tested.q),
        left_out=tested.left_out + given - len(samples),
        notes=tuple(notes),
    )
    rows = None
    if simulation is None and part is not None:
        rows = Rows.of(samples.q[part.rows], samples.x[part.rows], left)
    elif simulation is None:
        rows = Rows.of(samples.q, samples.x)
    seconds = {stage: end - start for (stage, start), (_, end) in pairwise(marks)}
    seconds["total"] = sum(seconds.values())
    return replace(model, about=about, baseline=baseline, rows=rows, seconds=seconds)


def _limits(samples: Samples, arm: Arm) -> Array:
    """What each joint (dof, 2) [rad or m] may be asked for: of whole turns what the arm says."""
    scale = Scale.of_range(samples.lower, samples.upper, samples.revolute)
    learned = np.column_stack([samples.lower, samples.upper])
    turns = np.clip(arm.travel, -_UNLIMITED, _UNLIMITED)
    return np.where(scale.periodic[:, None], turns, learned)


def _about(samples: Samples, options: TrainingOptions) -> About:
    """What is known before anything is learned; errors and notes are added later."""
    arm, simulation, source = samples.arm, samples.simulation, samples.source
    plane, how = samples.plane or getattr(arm, "plane", None), options.to_json()
    if source.get("source") == "board":  # later pictures are read with its board and lens
        how["board"] = dict(source)
    same = ("joint_names", "revolute", "lower", "upper", "unit", "columns", "degrees")
    axes = ("origin", "x", "y")
    limits = None
    if arm is not None:
        limits = _limits(samples, arm)
    return About(
        robot=arm.name if arm else "",
        tip=arm.tip if arm else "",
        locked=dict(arm.locked) if arm else {},
        urdf=arm.urdf if arm else "",
        plane=plane and {name: tuple(getattr(plane, name).tolist()) for name in axes},
        bound_of="true position" if simulation is not None else "sensor reading",
        source="simulation" if simulation is not None else "log",
        samples=len(samples),
        seed=int(options.seed),
        options=how,
        simulation=simulation.to_json() if simulation is not None else None,
        picture=samples.camera.size if samples.camera is not None else None,
        frame=str(source.get("frame", "")),
        limits=limits,
        **{name: getattr(samples, name) for name in same},
    )
