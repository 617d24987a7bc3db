"""Evaluation: errors of every readout in both directions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..arm.loading import arm_from_urdf
from ..arm.rotations import logarithm, matrix_of, similarity
from ..body.belief import knows_orientation
from ..common.arrays import Array, Mask
from ..common.choices import MAP_READOUTS
from ..common.parallel import side_by_side
from ..common.wording import for_people
from ..errors import LogError, OptionError
from ..model.about import holds
from ..model.answers import unit_joints
from ..model.model import Model
from ..model.prediction import predict
from ..model.space import Space
from ..samples.motion import Motion
from ..samples.repeats import at_poses
from ..samples.samples import Samples
from ..samples.simulation import Simulation
from .learn import TrainingOptions, associate
from .smooth import SmoothPart, to_learn
from .sound_rows import sound_log
from .touched import NOT_LEARNED, in_sockets

EVALUATED = ("kept", "free")
_PLACED = 10  # rows that tell where a frame is
_FAR_NEARER = 0.5  # of the median error: a frame that moved explains so much
_FRESH = 10  # rows that were not learned, from which on errors are told
_SAMPLES = 10_000
# rows that errors are measured on, of maps and of a body; more would tell no more
_TESTED = 5_000
_ANSWERED = 1_000
_FOLDS = 20  # maps are tested on blocks that those of every other block did not show


@dataclass(frozen=True, eq=False)
class Residuals:
    """What was predicted less what is true, row by row."""

    q: Array  # (n, dof), joints that training never saw
    x: Array  # (n, m), positions there
    # of each readout: predicted less true positions (n, m) [unit], answered less true joints
    # (n, dof) [rad or m], distance (n,) [unit] from each target to where the answer really leads
    forward: dict[str, Array]
    inverse: dict[str, Array]
    distance: dict[str, Array]
    joint_names: tuple[str, ...]
    left_out: int = 0  # rows that lie outside of what was learned
    # (n,) [rad], errors of the orientation, which the body predicts
    turned: Array | None = None
    # (n, dof), from which side joints came, where that is known
    side: Array | None = None

    @staticmethod
    def of(
        model: Model,
        q: Array,
        x: Array,
        forward: dict[str, Array],
        answers: dict[str, Array],
        truth: Callable[[Array], Array] | None = None,
        **told: Any,
    ) -> Residuals:
        """Residuals of predictions less positions and of answers (n, dof) in the unit box.

        `truth` is the true kinematics; without it (a log) the learned map tells how far the
        answered joints lead from the recorded ones.
        """
        scale = model.motor.scale
        value = model.predictor.value
        u = scale.to_unit(q)
        inverse = {r: scale.difference(a, u) * scale.span for r, a in answers.items()}
        there = x if truth is not None else value(u)
        lead = value if truth is None else lambda a: truth(scale.from_unit(a))
        distance = {
            r: np.linalg.norm(lead(a) - there, axis=1) for r, a in answers.items()
        }
        return Residuals(
            q, x, forward, inverse, distance, model.about.joint_names, **told
        )

    @property
    def errors(self) -> dict[str, Array]:
        """Distance between predicted and true position, (n,) per readout."""
        return {r: np.linalg.norm(e, axis=1) for r, e in self.forward.items()}


def evaluate_residuals(
    model: Model,
    q: Array,
    x: Array,
    truth: Callable[[Array], Array] | None = None,
    side: Array | None = None,
) -> Residuals:
    """Residuals of all readouts in both directions, of the answer nearest to the true joints.

    side : (n, dof), from which side the joints came, where that is known
    """
    scale = model.motor.scale
    readouts = model.readouts
    answered = model.covers(q)
    if not answered.any():
        raise LogError(NOT_LEARNED)
    motion = Motion(q, side).take(answered)
    x = x[answered]
    prediction = predict(model, motion)
    near = model.solver.newton.clip(scale.to_unit(motion.q))
    # the answers' bounds, of which `Model.solve` takes most of the time, are not asked for
    forward, answers = side_by_side(
        lambda: {readout: prediction.read(readout) - x for readout in readouts},
        lambda: unit_joints(model, x, near, readouts),
    )
    left_out = int(np.count_nonzero(~answered))
    return Residuals.of(
        model, motion.q, x, forward, answers, truth, left_out=left_out, side=motion.side
    )


def held_out_residuals(
    model: Model,
    samples: Samples,
    part: SmoothPart | None,
    left: Array | None,
    options: TrainingOptions,
) -> Residuals:
    """Residuals of all readouts on rows of a log that were held out in contiguous blocks.

    `left` is what the default readout leaves over of the rows of `part` that it has not seen.
    """
    n = len(samples)
    scale = model.motor.scale
    clip = model.solver.newton.clip
    forward: dict[str, Array] = {}
    rows = np.arange(0, n, max(1, n // _TESTED))
    turned = None
    if part is not None and left is not None:
        some = slice(None, None, max(1, len(left) // _ANSWERED))
        rows = part.rows[some]
        turned = part.fit.turned
        turned = None if turned is None else turned[some]
        forward["local"] = -left[some]
        if "body" in model.readouts:
            forward["body"] = -part.fit.held_out[some]
    q = samples.q[rows]
    x = samples.x[rows]
    here = model.predictor.value(scale.to_unit(q))
    near = clip(scale.to_unit(q))
    # a target that a held-out prediction misses is answered by joints that the map leads there
    answers = {
        readout: unit_joints(model, here - error, near, ("local",))["local"]
        for readout, error in forward.items()
    }
    forward |= {readout: np.empty_like(x) for readout in MAP_READOUTS}
    answers |= {readout: np.empty_like(q) for readout in MAP_READOUTS}
    folds = np.array_split(np.arange(n), _FOLDS)
    for half in (0, 1):
        unseen, seen = (np.concatenate(folds[k::2]) for k in (half, 1 - half))
        own = np.isin(rows, unseen)
        seen_u, seen_x, wrong = to_learn(samples, part, options, np.sort(seen))
        pair = associate(scale, seen_u, seen_x, options, wrong)
        found = pair.inverses(pair.sensory.scale.to_unit(x[own]), near[own])
        for readout in MAP_READOUTS:
            forward[readout][own] = pair.predict(q[own], readout) - x[own]
            answers[readout][own] = clip(found[readout])
    return Residuals.of(model, q, x, forward, answers, turned=turned)


def summarise(residuals: Residuals) -> dict[str, Any]:
    """Mean, largest and 99th percentile of the absolute errors, per readout and direction."""
    table: dict[str, Any] = {}
    for readout, gap in residuals.forward.items():
        forward = dict(zip("xyz", gap.T, strict=False)) | {
            "distance": np.linalg.norm(gap, axis=1)
        }
        if residuals.turned is not None and readout in ("local", "body"):
            forward["orientation"] = residuals.turned
        inverse = dict(
            zip(residuals.joint_names, residuals.inverse[readout].T, strict=True)
        )
        inverse["distance"] = residuals.distance[readout]
        table[readout] = {
            side: {name: error_sizes(error) for name, error in errors.items()}
            for side, errors in (("forward", forward), ("inverse", inverse))
        }
    return table


def error_sizes(error: Array) -> dict[str, float]:
    """Mean, largest and 99th percentile of the absolute errors (n,)."""
    size = np.abs(error)
    found = {"mean": size.mean(), "max": size.max(), "p99": np.quantile(size, 0.99)}
    return {name: float(value) for name, value in found.items()}


def answered_within(model: Model, residuals: Residuals) -> dict[str, float]:
    """What 95 % of a model's answers are within [unit], and what share within its own bound."""
    errors = residuals.errors[model.default_readout]
    bound = predict(model, Motion(residuals.q, residuals.side)).bound
    covered = np.mean(errors <= bound + 1e-12)  # of an exact arm both are rounding
    return {"p95": float(np.quantile(errors, 0.95)), "covered": float(covered)}


@dataclass(frozen=True, eq=False, repr=False)
class Evaluation:
    """Errors of a model.

    Attributes
    ----------
    errors : dict
        {readout: {"forward": {"x", "y", "distance"}, "inverse": {joint, ..., "distance"}}},
        each with "mean", "max" and "p99" [unit, rad or m].
    rows : int
        Samples that were evaluated.
    left_out : int
        Samples outside of what was learned, and rows that contradict the others.
    source : str
        What the samples are.
    within : dict
        "p95": what 95 % of the answers' distances are within [unit]; "covered": the share that
        the expected error bounds. Empty where it is not known.
    notes : tuple of str
        What the user should be told of the samples.
    touch : dict
        Of touches: "scatter" of the tips about their sockets' means, in all and by "points", and
        stated and predicted "distances" [m]. Empty for other samples.
    residuals : Residuals or None
        The errors row by row; None for those of the training.
    learned : int
        Rows of the log that the model has learned, and which tell nothing of its errors.
    """

    errors: dict[str, Any]
    rows: int
    left_out: int
    source: str
    within: dict[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    touch: dict[str, Any] = field(default_factory=dict)
    residuals: Residuals | None = None
    learned: int = 0

    @property
    def bound_holds(self) -> bool:
        """Whether the rows agree with the model's own bound."""
        return holds(self.within, self.rows)

    def __repr__(self) -> str:
        """Say in a line how well each readout predicts."""
        means = (
            f"{r} {e['forward']['distance']['mean']:.3g}"
            for r, e in self.errors.items()
        )
        return f"Evaluation of {self.rows:,} {self.source}, mean distances: {', '.join(means)}"


def evaluate(
    model: Model, samples: Samples | None = None, *, frame: str = "kept"
) -> Evaluation:
    """Evaluate a model.

    Parameters
    ----------
    model : Model
    samples : Samples, optional
        Measured samples.  Without them a simulated model is tested on 10,000 fresh exact
        samples of the simulated arm, and a model of a log repeats the errors on the rows
        that were held out in contiguous blocks while it was trained.
    frame : {"kept", "free"}
        Whether the sensor's frame is found anew for `samples`, as where a tracker was set up
        again: "free" gives the errors after that, and says by how much it moved.

    Returns
    -------
    Evaluation

    Raises
    ------
    LogError
        If the joints of `samples` are not those of the model.
    """
    if frame not in EVALUATED:
        raise OptionError(f"frame {frame!r}: expected one of {', '.join(EVALUATED)}")
    if samples is None:
        simulation = simulation_of(model)
        if simulation is None:
            return _of_training(model)
        residuals = fresh_residuals(model, simulation)
        rows_given = len(residuals.q) + residuals.left_out
        return _evaluation(model, residuals, rows_given, "fresh exact samples")
    model = model.by(samples.sensor)
    rows_given = len(samples) + samples.left_out
    source = "measured rows of the log"
    if samples.touch is not None:
        samples, touch = in_sockets(model, samples, samples.touch)
        residuals = evaluate_residuals(model, samples.q, samples.x)
        residuals = replace(residuals, turned=_turned(model, samples))
        return replace(_evaluation(model, residuals, rows_given, source), touch=touch)
    learned = learned_rows(model, samples)
    count = int(np.count_nonzero(learned))
    notes: list[str] = []
    if count:
        if len(samples) - count < _FRESH:
            note = (
                f"the model has learned {count} of these {len(samples)} rows, so that they do not "
                "tell its errors: those of rows that were held out while it was trained follow"
            )
            training = _of_training(model)
            left_out = training.left_out + rows_given - count
            return replace(training, notes=(note,), learned=count, left_out=left_out)
        notes.append(
            f"{count} of these rows were learned by the model and tell nothing of it"
        )
        samples = samples.take(~learned)
        rows_given -= count
        source = "measured rows of the log that were not learned"
    samples, more = sound_log(model, samples)
    notes += more
    samples, more = _in_frame(model, samples, free=frame == "free")
    notes += more
    side = Motion.of(samples).side
    residuals = evaluate_residuals(model, samples.q, samples.x, side=side)
    residuals = replace(residuals, turned=_turned(model, samples))
    evaluation = _evaluation(model, residuals, rows_given, source)
    return replace(evaluation, notes=tuple(notes), learned=count)


def _of_training(model: Model) -> Evaluation:
    """The errors on rows of its log that were held out while a model was trained."""
    about = model.about
    source = "rows held out in contiguous blocks"
    return Evaluation(
        dict(about.errors), about.tested, about.left_out, source, dict(about.within)
    )


def _evaluation(
    model: Model, residuals: Residuals, rows_given: int, source: str
) -> Evaluation:
    """The evaluation that residuals tell."""
    tested = len(residuals.q)
    return Evaluation(
        errors=summarise(residuals),
        rows=tested,
        left_out=rows_given - tested,
        source=source,
        within=answered_within(model, residuals),
        residuals=residuals,
    )


def learned_rows(model: Model, samples: Samples) -> Mask:
    """Whether each row of a log (n,) is one that a model has learned.

    A reading has so many digits that no other row has the same.
    """
    rows = model.rows
    if (
        rows is None
        or samples.unit != model.about.unit
        or samples.x.shape[1] != rows.x.shape[1]
    ):
        return np.zeros(len(samples), dtype=bool)
    readings = {reading.tobytes() for reading in rows.x}
    pose_is_learned = np.array([x.tobytes() in readings for x in at_poses(samples).x])
    learned = pose_is_learned[samples.pose_index]
    if model.about.samples > len(rows) and pose_is_learned.sum() > len(rows) // 2:
        return np.ones(
            len(samples), dtype=bool
        )  # of a long log a model keeps some rows alone
    return np.asarray(learned)


def _in_frame(
    model: Model, samples: Samples, *, free: bool
) -> tuple[Samples, list[str]]:
    """The log in the model's frame where `free`, and what is told of how its own frame moved."""
    tip = model.forward(samples.q)
    known = np.isfinite(tip).all(axis=1)
    if known.sum() < _PLACED:
        return samples, []
    x = samples.x[known]
    tip = tip[known]
    turn, _, _ = similarity(x, tip)
    shift = np.median(tip - x @ turn.T, axis=0)
    moved = x @ turn.T + shift
    before, after = (
        float(np.median(np.linalg.norm(each - tip, axis=1))) for each in (x, moved)
    )
    if not free and after > _FAR_NEARER * before:
        return samples, []
    away = float(np.linalg.norm(x.mean(axis=0) - moved.mean(axis=0)))
    angle = 2.0 * np.arcsin(
        min(1.0, float(np.linalg.norm(turn - np.eye(len(turn)))) / 8**0.5)
    )
    factor, unit = for_people(samples.unit)
    found = (
        f"moved by {factor * away:.3g} {unit} and {np.degrees(angle):.2g} deg: rows are "
        f"{factor * before:.3g} {unit} off (median), {factor * after:.3g} once it is found anew"
    )
    if free:
        samples = replace(samples, x=samples.x @ turn.T + shift)
        return samples, [f"the sensor's frame was found anew, {found}"]
    return samples, [
        f"the sensor's frame seems to have {found}; an arm that changed may look like that in few "
        "places: `check` tells which it is, `frame='free'` gives the errors after that, `adapt` "
        "takes it over"
    ]


def _turned(model: Model, samples: Samples) -> Array | None:
    """Errors (n,) of the orientation [rad], None where it is not measured or not known."""
    if samples.orientation is None or not knows_orientation(model.body):
        return None
    space = Space.of(model)
    q = model.about.joints_of(samples)
    predicted = space.to_sensor(*space.evaluate(q)[:2])[1]
    residual = matrix_of(samples.orientation) @ np.swapaxes(predicted, 1, 2)
    known = np.isfinite(model.forward(q)).all(axis=1)
    return np.asarray(np.linalg.norm(logarithm(residual[known]), axis=1))


def fresh_residuals(model: Model, simulation: Simulation) -> Residuals:
    """Residuals on 10,000 true positions of the simulated arm that training never saw."""
    return evaluate_residuals(
        model, *fresh_points(simulation, model.about.seed), simulation.exact
    )


def fresh_points(simulation: Simulation, seed: int) -> tuple[Array, Array]:
    """Joints (n, dof) and true positions (n, 2) of the 10,000 points that test a seed's models."""
    rng = np.random.default_rng(TrainingOptions(seed=seed).stream("evaluation"))
    q = simulation.draw(_SAMPLES, rng)
    return q, simulation.true(q, rng)


def simulation_of(model: Model) -> Simulation | None:
    """Simulated arm and sensor that a model was trained on, None for a log."""
    about = model.about
    if about.simulation is None:
        return None
    limits = zip(about.lower.tolist(), about.upper.tolist(), strict=True)
    ranges = dict(zip(about.joint_names, limits, strict=True))
    arm = arm_from_urdf(
        about.urdf, about.joint_names, about.tip, lock=about.locked, ranges=ranges
    )
    return Simulation.from_json(arm, about.simulation)
