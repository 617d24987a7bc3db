"""Training: from samples to a calibrated model."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from ..common.arrays import Array
from ..common.choices import BODIES, VIEWS
from ..common.parallel import one_blas_thread, side_by_side
from ..common.scale import Scale
from ..errors import LogError, OptionError
from ..maps.density import Gain
from ..maps.fields import LinkRule
from ..maps.lattice import Size
from ..maps.links import wiring_of
from ..maps.local_models import NO_MODELS
from ..maps.model_selection import select
from ..maps.node_bounds import learn_bounds, near_border
from ..maps.predictor import Predictor
from ..model.about import About
from ..model.baseline import learn_baseline
from ..model.measured import Rows
from ..model.model import Model
from ..samples.joint_values import directions
from ..samples.samples import Samples
from ..samples.simulation import Simulation
from ..samples.wrong_rows import screen
from .approach import play_of, play_words, simulated_approach, widened
from .evaluate import answered_within, fresh_residuals, summarise
from .held_out import held_out_residuals, node_bounds, tested_rows, turned_of
from .learn import UNFOLD, Options, Progress, associate
from .map_choice import LATTICE, lattice_sizes, with_chosen_map
from .smooth import SmoothPart, find_smooth_part, to_learn
from .sound_rows import fit_sound_rows
from .touched import fit_sockets

_LEAST_ROWS = 10  # fewest rows that anything can be learned and checked from
_BOUND_SAMPLES = 12_000
_ROUNDING = 4e-15  # share of the extent: what an answer in double precision is sure of at best
_TESTED = 20_000  # rows of a log that errors are measured on; more would tell no more


def train(
    samples: Samples,
    *,
    size: Size | None = None,
    motor_size: Size | None = None,
    sensory_size: Size | None = None,
    map: str | Gain | None = None,  # noqa: A002
    rule: str = "batch",
    epochs: int | None = None,
    sigma: tuple[float, float] | None = None,
    links: str | LinkRule = "reciprocal",
    body: str = "auto",
    view: str = "auto",
    seed: int = 0,
    progress: Progress | None = None,
) -> Model:
    """Learn a model from babbled or measured samples.

    Parameters
    ----------
    samples : Samples
        Joint values and positions.
    size : int or tuple of int, optional
        Nodes along each axis of both lattices.  70 by default, which stands for 70x70 and,
        with three joints, a 17x17x17 motor map; for a log about five rows per node.
    motor_size, sensory_size : int or tuple of int, optional
        Where they differ from `size`.
    map : str or gain function, optional
        Network: "vdsom" (default; "gas" where held-out blocks of a log without a body prefer
        it), "som", "dsom", "gng", or a reading of the varying density (eq. 7 and 8) such as
        "vdsom:error" or "gng:error", or a function of a :class:`calib.Visit`.
    rule : {"batch", "online"}
        Kohonen's batch map, or the paper's eq. 1 to 4, sample by sample.
    epochs : int, optional
        Passes over the samples; with `sigma` it trains the full lattice alone, without
        the coarse lattices that come first by default.
    sigma : (float, float), optional
        Neighbourhood radius at the start and at the end [nodes].
    links : {"reciprocal", "oja", "local", "mutual"} or link rule
        How the links (eq. 5) are learned and read (eq. 6), see docs/paper.md, or a
        function of :class:`calib.Pairs`.
    body : {"auto", "none"}
        ``auto`` fits a kinematic body under the maps; ``none`` learns from maps and links
        alone, as the paper does.
    view : {"auto", "base", "rigid", "similarity", "affine", "homography", "pinhole"}
        What the sensor measures: ``base`` says that positions are in the robot's root frame,
        ``auto`` is rigid for lengths, a homography for pixels, and for those of an arm in
        space a pinhole camera that looks from anywhere.
    seed : int
        The same seed gives the same model, byte for byte.
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
    if not isinstance(samples, Samples):
        raise LogError(f"samples {samples!r:.40}: expected what `calib.read_log` returns")
    if isinstance(seed, bool) or not isinstance(seed, (int, np.integer)) or seed < 0:
        raise OptionError(f"seed {seed!r}: expected a whole number, 0 or more")
    if len(samples) < _LEAST_ROWS:
        raise LogError(
            f"{len(samples)} sample{'s are' if len(samples) != 1 else ' is'} too few to learn from:"
            f" give at least {_LEAST_ROWS}"
        )
    wiring_of(links)
    if body not in BODIES:
        raise OptionError(f"body {body!r}: expected one of {', '.join(BODIES)}")
    if view not in VIEWS:
        raise OptionError(f"view {view!r}: expected one of {', '.join(VIEWS)}")
    screened: list[str] = []
    wrong = samples.left_out
    if samples.simulation is None and samples.touch is None:
        with one_blas_thread():
            kept, screened = screen(samples)
        wrong += int((~kept).sum())
        samples = samples if kept.all() else samples.take(kept)
    motor, sensory, notes = lattice_sizes(
        samples, size, motor_size, sensory_size, imagined=body != "none"
    )
    # a log may leave parts of the joints' range out; a simulation only has too few samples
    taught = body != "none" and (samples.simulation is None or len(samples) < math.prod(motor))
    options = Options(
        motor, sensory, map or LATTICE, rule, epochs, sigma, int(seed), taught, links, body, view
    )
    # a BLAS that splits sums over threads would change the last bits
    with one_blas_thread():
        if map is None:
            options, told = with_chosen_map(samples, options)
            notes += told
        return _learned(samples, options, screened + notes, progress or (lambda *_: None), wrong)


def _learned(
    samples: Samples, options: Options, notes: list[str], progress: Progress, wrong_rows: int
) -> Model:
    """The steps of a training in the order of the data flow."""
    begin, seconds = _stages(progress)
    begin(0.0, "body")
    scale = Scale.of_range(samples.lower, samples.upper, samples.revolute)
    body, view, seed = options.body, options.view, options.seed

    def fit(samples: Samples) -> SmoothPart:
        scale = Scale.of_range(samples.lower, samples.upper, samples.revolute)
        return find_smooth_part(samples, scale, body=body, view=view, seed=seed)

    given = len(samples)
    if samples.touch is not None:
        samples, part, told = fit_sockets(samples, scale, seed)
    else:
        samples, part, told = fit_sound_rows(samples, scale, fit)
    notes += told
    play = play_of(samples, scale, part) if samples.touch is None else None
    if play is not None:  # where the joints stood, rather than what they read
        samples = replace(samples, q=samples.q - play * directions(samples.q))
        part = fit(samples)
        notes.append(play_words(samples, play))
    notes += [*(part.fit.notes if part.fit is not None else ()), *part.notes]
    begin(0.1, "maps")
    seen_u, seen_x, wrong = to_learn(samples, scale, part, options)
    association = associate(
        scale,
        seen_u,
        seen_x,
        options,
        wrong,
        lambda done, stage, error: progress(0.1 + 0.6 * done, stage, error),
    )
    begin(0.7, "local models")
    motor, u = association.motor, scale.to_unit(samples.q)
    selected = select(motor, u[part.rows], part.candidate) if part.candidate else None
    linear = Predictor(motor, association.linear, NO_MODELS)
    predictor = linear if selected is None else selected.predictor
    begin(0.8, "evaluation")
    visited = np.bincount(motor.nearest(u)[1][:, 0], minlength=motor.size) > 0
    about = _about(samples, options, options.taught and part.fit is not None)
    empty = np.zeros(motor.size)
    model = Model(about, association, predictor, empty, empty, visited, predictor.body)
    simulation = samples.simulation
    if simulation is not None:
        (bounds, fresh_u, fresh_x), tested = side_by_side(
            lambda: _simulated_bounds(model, samples, simulation, options),
            lambda: fresh_residuals(model, simulation),
        )
        model = replace(model, bounds=bounds, model_bounds=bounds)
    else:
        tested = held_out_residuals(model, samples, part, selected, options)
        rows, errors = tested_rows(part), tested.errors[model.default_readout]
        if selected is not None:
            rows, errors = selected.rows, selected.errors
        bounds, positions = node_bounds(model, u[part.rows], rows, errors)
        model = replace(model, bounds=bounds, model_bounds=positions)
        fresh_u, fresh_x = u[part.rows][rows], samples.x[part.rows][rows]
    some = slice(None, None, max(1, len(samples) // _TESTED))
    miss = np.linalg.norm(predictor.value(u[some]) - samples.x[some], axis=1)
    baseline = learn_baseline(association, fresh_u, fresh_x, miss)
    if play is not None and simulation is not None:
        rng = np.random.default_rng(options.stream("bounds"))
        approach = simulated_approach(model, simulation, play, rng, _BOUND_SAMPLES)
        model = replace(model, approach=approach)
    elif play is not None:
        model = widened(model, play)
    begin(1.0, "done")
    about = replace(
        about,
        errors=summarise(tested, turned_of(part)),
        within=answered_within(model, tested),
        tested=len(tested.q),
        left_out=tested.left_out + wrong_rows + given - len(samples),
        notes=tuple(notes),
    )
    kept = Rows.of(samples.q, samples.x) if simulation is None else None
    seconds["total"] = sum(seconds.values())
    return replace(model, about=about, baseline=baseline, rows=kept, seconds=seconds)


def _stages(progress: Progress) -> tuple[Callable[[float, str], None], dict[str, float]]:
    """What to call as a stage begins, and the time that each stage took [s]."""
    seconds: dict[str, float] = {}
    now: list[tuple[str, float]] = []

    def begin(share: float, stage: str) -> None:
        if now:
            seconds[now[-1][0]] = time.perf_counter() - now[-1][1]
        now.append((stage, time.perf_counter()))
        progress(share, stage, float("nan"))

    return begin, seconds


def _about(samples: Samples, options: Options, taught: bool) -> About:
    """What is known before anything is learned; errors and notes are added later."""
    arm, simulation = samples.arm, samples.simulation
    plane = samples.plane or getattr(arm, "plane", None)
    axes = ("origin", "x", "y")
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
        seed=options.seed,
        options={**options.to_json(), **_seen_board(samples)},
        simulation=simulation.to_json() if simulation is not None else None,
        urdf=arm.urdf if arm is not None else "",
        columns=samples.columns,
        degrees=samples.degrees,
        picture=samples.camera.size if samples.camera is not None else None,
    )


def _seen_board(samples: Samples) -> dict[str, Any]:
    """What later pictures are read with: the board and the lens that the log was made with."""
    return {"board": dict(samples.source)} if samples.source.get("source") == "board" else {}


def _simulated_bounds(
    model: Model, samples: Samples, simulation: Simulation, options: Options
) -> tuple[Array, Array, Array]:
    """Bounds (nodes,) from exact samples that are neither learned nor tested, and these samples.

    Inverse answers often stand on a limit, where a map is least certain: some samples do too.
    """
    scale, readout = model.motor.scale, model.default_readout
    rng = np.random.default_rng(options.stream("bounds"))

    def measured(q: Array) -> tuple[Array, Array, Array]:
        u, x = scale.to_unit(q), simulation.true(q, rng)
        inside = model.trust.covers(u)
        miss = np.linalg.norm(model.forward(q[inside], readout) - x[inside], axis=1)
        return u[inside], x[inside], miss

    q = simulation.draw(_BOUND_SAMPLES, rng)
    u, x, miss = measured(q)
    limits = q[: np.count_nonzero(near_border(model.motor, u)) // 20].copy()
    known = u
    if len(limits):
        joint = rng.integers(q.shape[1], size=len(limits))
        upper = rng.random(len(limits)) < 0.5
        there = np.where(upper, samples.upper[joint], samples.lower[joint])
        limits[np.arange(len(limits)), joint] = there
        more, _, more_miss = measured(limits)
        known, miss = np.concatenate([u, more]), np.concatenate([miss, more_miss])
    if not len(known):
        raise OptionError("no test sample is near the motor map's nodes", hint=UNFOLD)
    bounds = learn_bounds(model.motor, known, miss)
    return np.maximum(bounds, _ROUNDING * model.solver.extent), u, x
