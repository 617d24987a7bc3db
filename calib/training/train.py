"""Training: from samples to a calibrated model."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..body.teacher import MOST_ROWS, learn_teacher
from ..body.trend_refinement import refine
from ..change.baseline import Baseline, learn_baseline
from ..common.parallel import one_blas_thread, side_by_side
from ..common.scale import Scale
from ..errors import LogError, OptionError
from ..maps.density import Gain
from ..maps.links import check_wiring
from ..maps.model_selection import blocks
from ..maps.node_bounds import learn_bounds, near_border
from ..model.about import About
from ..model.model import Model
from ..samples.samples import Samples
from ..samples.screening import gross, screen
from .evaluate import Residuals, evaluate_residuals, fresh_residuals, summarise
from .learn import UNFOLD, Options, Progress, Stopwatch, learn
from .sizes import Size, lattice_sizes

if TYPE_CHECKING:
    from ..samples.long_log import LongLog
    from ..samples.simulation import Simulation

Array = NDArray[np.float64]

LEAST_ROWS = 10
"""Fewest rows that anything can be learned and checked from."""

_BOUND_SAMPLES = 12_000
_TESTED = 20_000  # rows of a log that errors are measured on; more would tell no more


def train(
    samples: Samples,
    *,
    size: Size = None,
    motor_size: Size = None,
    sensory_size: Size = None,
    map: str | Gain = "vdsom",  # noqa: A002
    rule: str = "batch",
    epochs: int | None = None,
    sigma: tuple[float, float] | None = None,
    links: str = "reciprocal",
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
    map : str or gain function
        Network: "vdsom", "som", "dsom", "gng", "vdgng", or a reading of the varying
        density (eq. 7 and 8) such as "vdsom:error" or "gng:error".
    rule : {"batch", "online"}
        Kohonen's batch map, or the paper's eq. 1 to 4, sample by sample.
    epochs : int, optional
        Passes over the samples; with `sigma` it trains the full lattice alone, without
        the coarse lattices that come first by default.
    sigma : (float, float), optional
        Neighbourhood radius at the start and at the end [nodes].
    links : {"reciprocal", "oja", "local", "mutual"}
        How the links (eq. 5) are learned and read (eq. 6), see docs/paper.md.
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
    if isinstance(seed, bool) or not isinstance(seed, (int, np.integer)) or seed < 0:
        raise OptionError(f"seed {seed!r}: expected a whole number, 0 or more")
    if len(samples) < LEAST_ROWS:
        raise LogError(
            f"{len(samples)} sample{'s are' if len(samples) != 1 else ' is'} too few to learn "
            f"from: give at least {LEAST_ROWS}"
        )
    check_wiring(links)
    said: list[str] = []
    if samples.simulation is None:
        with one_blas_thread():
            screening = screen(samples)
        said = screening.notes()
        if screening.left_out:
            kept = screening.kept
            samples = replace(samples, q=samples.q[kept], x=samples.x[kept])
    motor, sensory, notes = lattice_sizes(samples, size, motor_size, sensory_size)
    taught = len(samples) < min(MOST_ROWS, int(np.prod(motor)))
    options = Options(motor, sensory, map, rule, epochs, sigma, int(seed), taught, links)
    # a BLAS that splits sums over threads would change the last bits
    with one_blas_thread():
        return _Trainer(samples, options, said + notes, progress or (lambda *_: None)).run()


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
        samples = self.samples
        scale = Scale.of_range(samples.lower, samples.upper, samples.revolute)
        simulation = samples.simulation
        model = self._learn(scale, samples.q, samples.x, share=0.75 if simulation else 0.2)
        if samples.long_log is not None:
            with self.watch("all rows"):
                model = self._refined(model, scale, samples.long_log)
        with self.watch("evaluation"):
            if simulation is not None:
                self.progress(0.8, "evaluation", float("nan"))
                (bounds, baseline), tested = side_by_side(
                    lambda: self._simulated_bounds(model, simulation),
                    lambda: fresh_residuals(model, simulation),
                )
            else:
                tested = self._held_out(scale)
                held = scale.to_unit(tested.q), tested.errors["local"]
                bounds, baseline = self._bounds(model, *held, held[0], tested.x)
        self.watch.seconds["total"] = time.perf_counter() - started
        about = replace(
            model.about,
            errors=summarise(tested),
            tested=len(tested.q),
            left_out=tested.left_out,
            notes=tuple(self.notes),
        )
        self.progress(1.0, "done", float("nan"))
        return replace(
            model, about=about, bounds=bounds, baseline=baseline, seconds=self.watch.seconds
        )

    def _learn(self, scale: Scale, q: Array, x: Array, share: float) -> Model:
        """Maps, links and local models from some of the samples."""
        options, samples = self.options, self.samples
        u = scale.to_unit(q)
        turning = samples.revolute
        self.teacher = None
        if options.taught:
            rng = np.random.default_rng(options.stream("teacher"))
            self.teacher = learn_teacher(scale, turning, u, x, rng)
            u = self.teacher.imagine(rng)
            x = self.teacher.value(u)
        learned = learn(
            scale,
            turning,
            u,
            x,
            options,
            trend=None if self.teacher is None else self.teacher.trend,
            watch=self.watch,
            progress=lambda done, stage, error: self.progress(share * done, stage, error),
        )
        empty = np.zeros(learned.association.motor.size)
        return Model(self._about(), learned.association, learned.predictor, empty, learned.visited)

    def _refined(self, model: Model, scale: Scale, log: LongLog) -> Model:
        """The model with a trend that rests on all rows of a long log.

        Local models rest on the rows that were drawn: their noise is their neighbourhood's,
        beside which that of the trend is nothing.
        """
        predictor = model.predictor
        if predictor.models.degree >= 0:
            return model
        self.progress(0.2, "all rows", float("nan"))
        some = slice(None, None, max(1, len(self.samples) // _TESTED))
        x = self.samples.x[some]
        error = np.linalg.norm(predictor.value(scale.to_unit(self.samples.q[some])) - x, axis=1)
        found = refine(predictor.trend, scale, log.batches(), gross(error, x))
        but = f", but for {found.left_out:,} that are far from it" if found.left_out else ""
        self.notes.append(f"the trend rests on all {log.rows:,} rows{but}")
        return replace(model, predictor=replace(predictor, trend=found.trend))

    def _simulated_bounds(self, model: Model, simulation: Simulation) -> tuple[Array, Baseline]:
        """Bounds and baseline from exact samples that are neither learned nor tested."""
        scale = model.motor.scale
        rng = np.random.default_rng(self.options.stream("bounds"))
        q = simulation.draw(_BOUND_SAMPLES, rng)
        held = Residuals.of(model, q, simulation.exact(q), readouts=("local",))
        u, miss = scale.to_unit(held.q), held.errors["local"]
        near = np.count_nonzero(near_border(model.motor, u))
        known, q = u, on_limits(self.samples, q[: near // 20], rng)
        if len(q):
            limits = Residuals.of(model, q, simulation.exact(q), readouts=("local",))
            known = np.concatenate([u, scale.to_unit(limits.q)])
            miss = np.concatenate([miss, limits.errors["local"]])
        return self._bounds(model, known, miss, u, held.x)

    def _bounds(
        self, model: Model, known: Array, miss: Array, u: Array, x: Array
    ) -> tuple[Array, Baseline]:
        """Bounds from the errors `miss` (n,) at `known` (n, dof), and what is undisturbed."""
        if not len(known):
            raise OptionError(f"no test sample is near the motor map's nodes: {UNFOLD}")
        samples, doubt = self.samples, None
        if self.teacher is not None:
            nodes = np.concatenate([np.clip(model.motor.units, 0, 1), known])
            doubt = self.teacher.deviation(nodes)
        bounds = learn_bounds(model.motor, known, miss, doubt)
        some = slice(None, None, max(1, len(samples) // _TESTED))
        said = model.predictor.value(model.motor.scale.to_unit(samples.q[some]))
        error = np.linalg.norm(said - samples.x[some], axis=1)
        return bounds, learn_baseline(model.association, u, x, error)

    def _held_out(self, scale: Scale) -> Residuals:
        """Errors on contiguous blocks of the log that training has not seen."""
        q, x = self.samples.q, self.samples.x
        taught, watch = self.teacher, self.watch
        self.watch = Stopwatch()
        parts = []
        folds = blocks(len(q))[::2]
        for k, rows in enumerate(folds):
            self.progress(0.2 + 0.75 * k / len(folds), "evaluation", float("nan"))
            others = np.setdiff1d(np.arange(len(q)), rows, assume_unique=True)
            model = self._learn(scale, q[others], x[others], share=0.0)
            rows = rows[:: -(-len(rows) * len(folds) // _TESTED)]
            parts.append(evaluate_residuals(model, q[rows], x[rows], None))
        self.teacher, self.watch = taught, watch
        return Residuals.join(parts)

    def _about(self) -> About:
        samples, options = self.samples, self.options
        arm, simulation = samples.arm, samples.simulation
        plane = samples.plane or (arm.plane if arm is not None else None)
        stated: Mapping[str, Any] | None = None
        if plane is not None:
            stated = {k: getattr(plane, k).tolist() for k in ("origin", "x", "y")}
        return About(
            robot=arm.name if arm is not None else "",
            tip=arm.tip if arm is not None else "",
            joint_names=samples.joint_names,
            revolute=samples.revolute,
            lower=samples.lower,
            upper=samples.upper,
            locked=dict(arm.locked) if arm is not None else {},
            plane=stated,
            unit=samples.unit,
            bound_of="true position" if simulation is not None else "sensor reading",
            source="simulation" if simulation is not None else "log",
            taught=options.taught,
            samples=len(samples),
            seed=options.seed,
            options=options.to_json(),
            simulation=simulation.to_json() if simulation is not None else None,
            urdf=arm.urdf if arm is not None else "",
        )
