"""Training: from samples to a calibrated model.

In a straight line: sound rows and their body (`prepare`), the maps, the local models,
the held-out errors and the bounds, the facts that travel with the model.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..arm.arm import Arm
from ..common.arrays import Array
from ..common.parallel import one_blas_thread
from ..common.scale import TURN
from ..errors import LogError
from ..maps.association import Association
from ..maps.local_models import NO_MODELS
from ..maps.model_selection import select
from ..model.about import About
from ..model.model import Model
from ..samples.samples import Samples
from .bounds import tested_on_arm, tested_on_log
from .fitted_log import FittedLog, SoundLog
from .maps import maps_of
from .options import Progress, TrainingOptions, options_for
from .preparation import prepare
from .residuals import Residuals, p95_and_coverage, summarise
from .settings import LEARNING

# shares of a sensor's work that are done when these stages begin
_MAPS = 0.1
_LOCAL_MODELS = 0.7
_EVALUATION = 0.8

SLIDING_UNKNOWN = (
    "no arm of turning joints explains all that the rows show: if a joint slides, name it in "
    "`prismatic`"
)


def train(
    samples: Samples | Sequence[Samples],
    options: TrainingOptions | None = None,
    *,
    progress: Progress | None = None,
    **named: Any,
) -> Model:
    """Learn a model from babbled or measured samples.

    Parameters
    ----------
    samples : Samples or sequence of Samples
        Joint values and positions; or a log of each sensor that measured one arm, each with
        its own frame, unit, noise and poses.
    options : TrainingOptions, optional
        Options; or their values by name, as in `calib.train(log, size=40, map="som")`.
    progress : callable, optional
        Called with the share of the work done, of each sensor in turn, the stage and the current
        error.

    Returns
    -------
    Model
        Of several sensors it answers as the first one; `model.by(name)` answers as another.

    Raises
    ------
    LogError
        If there are too few samples, or logs that are not of one arm.
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
    logs = [samples] if isinstance(samples, Samples) else [*(samples or ())]
    if not logs:
        raise LogError("no samples: expected those of one sensor or more")
    for log in logs:
        _refuse_few(log)
    started = time.perf_counter()
    progress = progress or (lambda *_: None)
    # a BLAS that splits sums over threads would change the last bits
    with one_blas_thread():
        progress(0.0, "body", math.nan)
        first, *others = (
            _learn(log, options, progress) for log in prepare(logs, options)
        )
    seconds = {"total": time.perf_counter() - started}
    return replace(first, others=tuple(others), seconds=seconds)


def _refuse_few(samples: Samples) -> None:
    """Refuse what are no samples, or samples of too few poses."""
    if not isinstance(samples, Samples):
        raise LogError(
            f"samples {samples!r:.40}: expected what `calib.read_log` returns"
        )
    poses = samples.poses
    if samples.touch is not None or poses >= LEARNING.fewest_poses:
        return
    raise LogError(
        f"poses: {poses}, in {len(samples)} rows: too few to learn from, give at least "
        f"{LEARNING.fewest_poses}"
    )


def _learn(
    log: SoundLog, options: TrainingOptions, progress: Progress
) -> Model:
    """Learn maps, links and local models on a body, and measure the errors of them all."""
    samples = log.samples
    options, size_notes = options_for(samples, options)

    progress(_MAPS, "maps", math.nan)

    def maps_progress(done: float, stage: str, error: float) -> None:
        progress(_MAPS + (_LOCAL_MODELS - _MAPS) * done, stage, error)

    association = maps_of(log, options, progress=maps_progress)

    progress(_LOCAL_MODELS, "local models", math.nan)
    model, held_out = _untested(log, association, options)

    progress(_EVALUATION, "evaluation", math.nan)
    if samples.simulation is None:
        model, residuals = tested_on_log(model, log, held_out, options)
    else:
        model, residuals = tested_on_arm(
            model, samples.simulation, log, options
        )
    progress(1.0, "done", math.nan)
    return _with_errors(model, residuals, log, size_notes)


def _untested(
    log: SoundLog, association: Association, options: TrainingOptions
) -> tuple[Model, Array | None]:
    """The model before it has bounds, and what it leaves over of held-out rows (k, m) [unit]."""
    samples = log.samples
    motor = association.motor
    u = motor.scale.to_unit(samples.q)
    unknown = np.zeros(motor.size)
    visited = motor.visited_by(u)
    about = _about(samples, options)
    model = Model(about, association, NO_MODELS, unknown, unknown, visited)
    if not isinstance(log, FittedLog):
        return model, None
    rows = log.rows
    predictor, held_out = select(
        motor, u[rows], samples.x[rows], log.body, log.fit.held_out
    )
    model = replace(model, local=predictor.models, body=log.fit.body)
    return model, held_out


def _with_errors(
    model: Model, residuals: Residuals, log: SoundLog, size_notes: list[str]
) -> Model:
    """The model with its errors among its facts, and notes for the user."""
    notes = [*size_notes, *log.notes]
    if isinstance(log, FittedLog):
        notes += log.fit.notes
    about = replace(
        model.about,
        errors=summarise(residuals),
        within=p95_and_coverage(model, residuals),
        tested=len(residuals.x),
        left_out=residuals.left_out + log.left_out,
    )
    # a body of the right joints needs no local models
    is_arm = model.local.degree < 0 and about.bound_holds
    unknown_joints = log.samples.arm is None and all(about.revolute)
    if model.body is not None and unknown_joints and not is_arm:
        notes.append(SLIDING_UNKNOWN)
    about = replace(about, notes=tuple(notes))
    # bounds of a log hold for joints without play: the approach is added after p95;
    # `tested_on_arm` has set it before
    return replace(model, about=about, approach=log.approach)


def _limits(samples: Samples, arm: Arm) -> Array:
    """Limits (dof, 2) of queries [rad or m]: the learned ones, of more than a turn the arm's."""
    learned = np.column_stack([samples.lower, samples.upper])
    travel = np.clip(arm.travel, -LEARNING.unlimited, LEARNING.unlimited)
    several = samples.unit_box.periodic & (np.ptp(travel, axis=1) > TURN)
    return np.where(several[:, None], travel, learned)


def _about(samples: Samples, options: TrainingOptions) -> About:
    """The facts on a model before it is learned; errors and notes are added later."""
    arm = samples.arm
    simulation = samples.simulation
    plane = samples.plane or getattr(arm, "plane", None)
    axes = None
    if plane is not None:
        axes = {
            name: tuple(getattr(plane, name).tolist())
            for name in ("origin", "x", "y")
        }
    chosen = options.to_json()
    if samples.source.get("source") == "board":
        # later pictures are read with its board and lens
        chosen["board"] = dict(samples.source)
    return About(
        robot=arm.name if arm else "",
        tip=arm.tip if arm else "",
        joint_names=samples.joint_names,
        revolute=samples.revolute,
        lower=samples.lower,
        upper=samples.upper,
        locked=dict(arm.locked) if arm else {},
        plane=axes,
        unit=samples.unit,
        bound_of="sensor reading" if simulation is None else "true position",
        source="log" if simulation is None else "simulation",
        samples=len(samples),
        seed=int(options.seed),
        options=chosen,
        simulation=None if simulation is None else simulation.to_json(),
        urdf=arm.urdf if arm else "",
        columns=samples.columns,
        degrees=samples.degrees,
        picture=None if samples.camera is None else samples.camera.size,
        frame=str(samples.source.get("frame") or ""),
        sensor=samples.sensor,
        limits=None if arm is None else _limits(samples, arm),
    )
