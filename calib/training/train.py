"""Training: from samples to a calibrated model."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from ..common.choices import BODIES, VIEWS
from ..common.parallel import one_blas_thread, side_by_side
from ..common.scale import Scale
from ..errors import LogError, OptionError
from ..maps.density import Gain
from ..maps.fields import LinkRule
from ..maps.links import wiring_of
from ..maps.local_models import NO_MODELS
from ..maps.model_selection import select
from ..maps.node_bounds import learn_bounds, near_border
from ..maps.predictor import Predictor
from ..model.baseline import Baseline, learn_baseline
from ..model.measured import Rows
from ..model.model import Model
from ..samples.samples import Samples
from .about import about_of
from .approach import corrected, play_of, play_words, simulated_approach, widened
from .evaluate import Residuals, fresh_residuals, summarise
from .held_out import held_out_residuals, tested_rows, turned_of
from .learn import UNFOLD, Options, Progress, Stopwatch, both_maps, link
from .log_bounds import node_bounds
from .map_choice import LATTICE, with_chosen_map
from .screening import screen
from .sizes import Size, lattice_sizes
from .smooth import SmoothPart, find_smooth_part, uses_body, with_imagined, wrong_around

if TYPE_CHECKING:
    from ..samples.simulation import Simulation

LEAST_ROWS = 10
"""Fewest rows that anything can be learned and checked from."""

_BOUND_SAMPLES = 12_000
_ROUNDING = 4e-15  # share of the extent: what an answer in double precision is sure of at best
_TESTED = 20_000  # rows of a log that errors are measured on; more would tell no more


def train(
    samples: Samples,
    *,
    size: Size = None,
    motor_size: Size = None,
    sensory_size: Size = None,
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
    if len(samples) < LEAST_ROWS:
        raise LogError(
            f"{len(samples)} sample{'s are' if len(samples) != 1 else ' is'} too few to learn from:"
            f" give at least {LEAST_ROWS}"
        )
    wiring_of(links)
    if body not in BODIES:
        raise OptionError(f"body {body!r}: expected one of {', '.join(BODIES)}")
    if view not in VIEWS:
        raise OptionError(f"view {view!r}: expected one of {', '.join(VIEWS)}")
    screened: list[str] = []
    if samples.simulation is None:
        with one_blas_thread():
            screening = screen(samples)
        screened = screening.notes()
        if screening.left_out:
            samples = samples.take(screening.kept)
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
        return _Trainer(samples, options, screened + notes, progress or (lambda *_: None)).run()


def on_limits(samples: Samples, q: Array, rng: np.random.Generator) -> Array:
    """Joint values `q` (n, dof) with one joint of each row moved onto one of its limits.

    Inverse answers often stand there, where a map is least certain.
    """
    moved, rows = q.copy(), np.arange(len(q))
    joint = rng.integers(q.shape[1], size=len(q))
    upper = rng.random(len(q)) < 0.5
    moved[rows, joint] = np.where(upper, samples.upper[joint], samples.lower[joint])
    return moved


@dataclass
class _Trainer:
    """One training: the steps in the order of the data flow, with their times."""

    samples: Samples
    options: Options
    notes: list[str]
    progress: Progress

    def run(self) -> Model:
        started = time.perf_counter()
        self.watch = Stopwatch()
        samples, options = self.samples, self.options
        scale = Scale.of_range(samples.lower, samples.upper, samples.revolute)
        self.progress(0.0, "body", float("nan"))
        with self.watch("body"):
            part = find_smooth_part(
                samples, scale, body=options.body, view=options.view, seed=options.seed
            )
            play = play_of(samples, scale, part)
            if play is not None:  # where the joints stood, rather than what they read
                samples = self.samples = corrected(samples, play)
                part = find_smooth_part(
                    samples, scale, body=options.body, view=options.view, seed=options.seed
                )
                self.notes.append(play_words(samples, play))
        if part.fit is not None:
            self.notes += part.fit.notes
        self.notes += part.notes
        u = scale.to_unit(samples.q)
        seen_u, seen_x = with_imagined(u, samples.x, part, options)
        motor, sensory = both_maps(
            scale,
            seen_u,
            seen_x,
            options,
            self.watch,
            lambda done, stage, error: self.progress(0.1 + 0.6 * done, stage, error),
            wrong_around(part, scale, samples, seen_u),
        )
        self.progress(0.7, "Hebbian links and local models", float("nan"))
        with self.watch("Hebbian links and local models"):
            selected, association = side_by_side(
                lambda: select(motor, u[part.rows], part.candidates) if part.candidates else None,
                lambda: link(motor, sensory, seen_u, seen_x, options),
            )
        linear = Predictor(motor, association.linear, NO_MODELS)
        predictor = linear if selected is None else selected.predictor
        visited = np.bincount(motor.nearest(u)[1][:, 0], minlength=motor.size) > 0
        body = part.fit.body if part.fit is not None and uses_body(predictor) else None
        empty = np.zeros(motor.size)
        taught = options.taught and part.fit is not None
        about = about_of(samples, options, taught)
        model = Model(about, association, predictor, empty, empty, visited, body)
        self.progress(0.8, "evaluation", float("nan"))
        with self.watch("evaluation"):
            simulation = samples.simulation
            if simulation is not None:
                (model, baseline), tested = side_by_side(
                    lambda: self._simulated_bounds(model, simulation),
                    lambda: fresh_residuals(model, simulation),
                )
            else:
                tested = held_out_residuals(model, samples, part, selected, options)
                if selected is not None:
                    held = selected.rows, selected.errors
                else:
                    held = tested_rows(part), tested.errors[model.default_readout]
                model, baseline = self._log_bounds(model, part, *held)
            if play is not None:
                model = self._for_directions(model, play)
        self.watch.seconds["total"] = time.perf_counter() - started
        about = replace(
            model.about,
            errors=summarise(tested, turned_of(part)),
            tested=len(tested.q),
            left_out=tested.left_out,
            notes=tuple(self.notes),
        )
        self.progress(1.0, "done", float("nan"))
        rows = Rows.of(samples.q, samples.x) if samples.simulation is None else None
        return replace(model, about=about, baseline=baseline, rows=rows, seconds=self.watch.seconds)

    def _simulated_bounds(self, model: Model, simulation: Simulation) -> tuple[Model, Baseline]:
        """Bounds and baseline from exact samples that are neither learned nor tested."""
        scale = model.motor.scale
        rng = np.random.default_rng(self.options.stream("bounds"))
        q = simulation.draw(_BOUND_SAMPLES, rng)
        held = Residuals.of(model, q, simulation.true(q, rng), readouts=(model.default_readout,))
        u, miss = scale.to_unit(held.q), held.errors[model.default_readout]
        near = np.count_nonzero(near_border(model.motor, u))
        known, q = u, on_limits(self.samples, q[: near // 20], rng)
        if len(q):
            limits = Residuals.of(
                model, q, simulation.true(q, rng), readouts=(model.default_readout,)
            )
            known = np.concatenate([u, scale.to_unit(limits.q)])
            miss = np.concatenate([miss, limits.errors[model.default_readout]])
        if not len(known):
            raise OptionError("no test sample is near the motor map's nodes", hint=UNFOLD)
        bounds = learn_bounds(model.motor, known, miss)
        bounds = np.maximum(bounds, _ROUNDING * model.solver.extent)
        return replace(model, bounds=bounds, model_bounds=bounds), self._baseline(model, u, held.x)

    def _for_directions(self, model: Model, play: Array) -> Model:
        """The model with bounds for a known and an unknown direction of approach."""
        simulation = self.samples.simulation
        if simulation is None:
            return widened(model, play)
        rng = np.random.default_rng(self.options.stream("bounds"))
        approach = simulated_approach(model, simulation, play, rng, _BOUND_SAMPLES)
        return replace(model, approach=approach)

    def _log_bounds(
        self, model: Model, part: SmoothPart, rows: NDArray[np.intp], errors: Array
    ) -> tuple[Model, Baseline]:
        """Bounds of a log's model: the body's, or held-out errors that grow away from rows."""
        u = model.motor.scale.to_unit(self.samples.q[part.rows])
        has_models = model.predictor.models.degree >= 0
        bounds, model_bounds = node_bounds(model, u, rows, errors, has_models=has_models)
        baseline = self._baseline(model, u[rows], self.samples.x[part.rows][rows])
        return replace(model, bounds=bounds, model_bounds=model_bounds), baseline

    def _baseline(self, model: Model, u: Array, x: Array) -> Baseline:
        """What the distortions of the undisturbed arm look like."""
        some = slice(None, None, max(1, len(self.samples) // _TESTED))
        predicted = model.predictor.value(model.motor.scale.to_unit(self.samples.q[some]))
        error = np.linalg.norm(predicted - self.samples.x[some], axis=1)
        return learn_baseline(model.association, u, x, error)
