"""Training: from samples to a calibrated model."""

from __future__ import annotations

import time
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from ..common.arrays import Array
from ..common.parallel import one_blas_thread, side_by_side
from ..common.scale import Scale
from ..errors import LogError, OptionError
from ..maps.local_models import NO_MODELS
from ..maps.model_selection import select
from ..maps.node_bounds import learn_bounds, near_border
from ..maps.predictor import Predictor
from ..model.about import About
from ..model.baseline import Paths, learn_baseline
from ..model.measured import Rows
from ..model.model import Model
from ..samples.joint_values import directions
from ..samples.samples import Samples
from ..samples.wrong_rows import screen
from .approach import BOUND_SAMPLES, approached, play_of, play_words
from .evaluate import Residuals, answered_within, fresh_residuals, summarise
from .held_out import held_out_residuals, node_bounds, turned_of
from .learn import UNFOLD, Progress, associate, resolved
from .options import TrainingOptions
from .smooth import find_smooth_part, taught, to_learn
from .sound_rows import fit_sound_rows
from .touched import fit_sockets

_LEAST_ROWS = 10  # fewest rows that anything can be learned and checked from
_ROUNDING = 4e-15  # share of the extent: what an answer in double precision is sure of at best
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
    given = len(samples) + samples.left_out
    notes: list[str] = []
    if samples.simulation is None and samples.touch is None:
        kept, notes = screen(samples)
        samples = samples if kept.all() else samples.take(kept)
    options, told = resolved(samples, options)
    notes += told
    scale = Scale.of_range(samples.lower, samples.upper, samples.revolute)
    part, play = None, None
    if samples.touch is not None:
        samples, part, told = fit_sockets(samples, scale, options.seed)
    elif options.body != "none":
        fit = partial(find_smooth_part, view=options.view, seed=options.seed)
        samples, part, told = fit_sound_rows(samples, scale, fit)
        notes += told
        play = play_of(samples, scale, part)
        told = []
        if play is not None:  # where the joints stood, rather than what they read
            samples = replace(samples, q=samples.q - play * directions(samples.q))
            part, told = fit(samples), [play_words(samples, play)]
    notes += [*told, *(part.fit.notes if part else ()), *(part.notes if part else ())]

    begin(0.1, "maps")
    seen_u, seen_x, wrong = to_learn(samples, scale, part, options)
    association = associate(
        scale, seen_u, seen_x, options, wrong,
        lambda done, stage, error: progress(0.1 + 0.6 * done, stage, error),
    )  # fmt: skip

    begin(0.7, "local models")
    motor, u = association.motor, scale.to_unit(samples.q)
    selected = None
    predictor = Predictor(motor, association.linear, NO_MODELS)
    if part is not None:
        some = part.rows
        selected = select(motor, u[some], samples.x[some], part.smooth, part.fit.held_out)
        predictor = selected.predictor

    begin(0.8, "evaluation")
    empty, visited = np.zeros(motor.size), np.zeros(motor.size, dtype=bool)
    visited[motor.nearest(u)[1][:, 0]] = True
    about = _about(samples, options, taught(samples, part, options))
    model = Model(about, association, predictor, empty, empty, visited, predictor.body)
    if samples.simulation is not None:
        bounds, u_known, x_known, tested = _by_simulation(model, samples, options)
    else:  # by blocks of the log's rows that were held out
        tested = held_out_residuals(model, samples, part, selected, options)
        u_known, x_known = scale.to_unit(tested.q), tested.x
        errors = tested.errors[model.default_readout]
        bounds = node_bounds(model, u_known, np.arange(len(u_known)), errors)
    model = replace(model, bounds=bounds[0], model_bounds=bounds[1])
    thin = slice(None, None, max(1, len(samples) // _TESTED))
    miss = np.linalg.norm(predictor.value(u[thin]) - samples.x[thin], axis=1)
    baseline = learn_baseline(association, u_known, x_known, miss)
    if part is None and samples.simulation is None:
        baseline = replace(baseline, paths=Paths.of(motor, baseline.motor, u_known))
    if play is not None:
        model = approached(model, samples.simulation, play, options.stream("bounds"))
    begin(1.0, "done")
    about = replace(
        about,
        errors=summarise(tested, turned_of(part)),
        within=answered_within(model, tested),
        tested=len(tested.q),
        left_out=tested.left_out + given - len(samples),
        notes=tuple(notes),
    )
    rows = Rows.of(samples.q, samples.x) if samples.simulation is None else None
    seconds = {stage: end - start for (stage, start), (_, end) in pairwise(marks)}
    seconds["total"] = sum(seconds.values())
    return replace(model, about=about, baseline=baseline, rows=rows, seconds=seconds)


def _about(samples: Samples, options: TrainingOptions, taught: bool) -> About:
    """What is known before anything is learned; errors and notes are added later."""
    arm, simulation = samples.arm, samples.simulation
    plane = samples.plane or getattr(arm, "plane", None)
    axes, source = ("origin", "x", "y"), samples.source
    of_board = source.get("source") == "board"
    return About(
        robot=arm.name if arm is not None else "",
        tip=arm.tip if arm is not None else "",
        joint_names=samples.joint_names,
        revolute=samples.revolute,
        lower=samples.lower,
        upper=samples.upper,
        locked=dict(arm.locked) if arm is not None else {},
        plane=None if plane is None else {k: getattr(plane, k).tolist() for k in axes},
        unit=samples.unit,
        bound_of="true position" if simulation is not None else "sensor reading",
        source="simulation" if simulation is not None else "log",
        taught=taught,
        samples=len(samples),
        seed=int(options.seed),
        # later pictures are read with the board and the lens that the log was made with
        options={**options.to_json(), **({"board": dict(source)} if of_board else {})},
        simulation=simulation.to_json() if simulation is not None else None,
        urdf=arm.urdf if arm is not None else "",
        columns=samples.columns,
        degrees=samples.degrees,
        picture=samples.camera.size if samples.camera is not None else None,
        frame=str(source.get("frame", "")),
    )


def _by_simulation(
    model: Model, samples: Samples, options: TrainingOptions
) -> tuple[tuple[Array, Array], Array, Array, Residuals]:
    """Bounds by exact samples that are neither learned nor tested, these, and the test's errors.

    Inverse answers often stand on a limit, where a map is least certain: some samples do too.
    """
    scale, readout, simulation = model.motor.scale, model.default_readout, samples.simulation
    assert simulation is not None  # noqa: S101
    rng = np.random.default_rng(options.stream("bounds"))

    def measured(q: Array) -> tuple[Array, Array, Array]:
        u, x = scale.to_unit(q), simulation.true(q, rng)
        inside = model.trust.covers(u)
        miss = np.linalg.norm(model.forward(q[inside], readout) - x[inside], axis=1)
        return u[inside], x[inside], miss

    def bounded() -> tuple[Array, Array, Array]:
        q = simulation.draw(BOUND_SAMPLES, rng)
        u, x, miss = measured(q)
        limits = q[: np.count_nonzero(near_border(model.motor, u)) // 20].copy()
        joint = rng.integers(q.shape[1], size=len(limits))
        there = np.where(rng.random(len(limits)) < 0.5, samples.upper[joint], samples.lower[joint])
        limits[np.arange(len(limits)), joint] = there
        more, _, more_miss = measured(limits)
        known, miss = np.concatenate([u, more]), np.concatenate([miss, more_miss])
        if not len(known):
            raise OptionError("no test sample is near the motor map's nodes", hint=UNFOLD)
        bounds = learn_bounds(model.motor, known, miss)
        return np.maximum(bounds, _ROUNDING * model.solver.extent), u, x

    (bounds, u, x), tested = side_by_side(bounded, lambda: fresh_residuals(model, simulation))
    return (bounds, bounds), u, x, tested
