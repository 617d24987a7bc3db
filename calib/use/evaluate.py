"""Evaluation: the errors of a model on a log, or on fresh samples of a simulation."""

from dataclasses import dataclass, field, replace
from typing import Any, Literal, get_args

import numpy as np

from ..arm.loading import arm_from_urdf
from ..arm.rotations import logarithm, matrix_of, similarity
from ..body.belief import knows_orientation
from ..change.judge import judge
from ..change.rows import (
    LEARNED_ROWS,
    LEAST_ROWS,
    REPEATED_ROWS,
    first_of_equal_rows,
)
from ..change.verdict import Verdict
from ..common.choices import check_choice
from ..common.rows import finite_rows, median_length, row_lengths
from ..common.wording import by_name, for_people
from ..errors import require
from ..model.about import holds
from ..model.alignment import Alignment
from ..model.model import Model
from ..model.space import Space
from ..samples.samples import Samples
from ..samples.simulation import Simulation
from ..training.options import Progress
from ..training.preparation import sound_log
from ..training.residuals import (
    ErrorTable,
    Residuals,
    evaluate_residuals,
    fresh_residuals,
    learned_rows,
    p95_and_coverage,
    summarise,
)
from ..training.settings import TESTING
from ..training.socket_places import in_sockets

Frame = Literal["kept", "free"]
FRAME_CHOICES = get_args(Frame)
FRESH = "fresh exact samples"
HELD_OUT = "rows held out in blocks of the log"


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
        the expected error bounds, of those "answered" (a share, all where it is not there). Empty
        where it is not known.
    notes : tuple of str
        Notes for the user on the samples.
    touch : dict
        Of touches: "scatter" of the tips about their sockets' means, in all and by "points", and
        stated and predicted "distances" [m]. Empty for other samples.
    residuals : Residuals or None
        The errors row by row; None for those of the training.
    learned : int
        Rows of the log that the model has learned, and which show nothing of its errors.
    verdict : Verdict or None
        The verdict of the log on the model, whose rows were evaluated; None of fewer than ten.
    """

    errors: ErrorTable
    rows: int
    left_out: int
    source: str
    within: dict[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    touch: dict[str, Any] = field(default_factory=dict)
    residuals: Residuals | None = None
    learned: int = 0
    verdict: Verdict | None = None

    @property
    def bound_holds(self) -> bool | None:
        """Whether the rows agree with the model's own bound; None where they are too few to say."""
        if self.verdict is not None:
            return self.verdict.bound_holds
        if self.rows < TESTING.fewest:
            return None
        return holds(self.within, self.rows)

    def __repr__(self) -> str:
        """Summarise in a line how well each readout predicts."""
        means = (
            f"{readout} {directions['forward']['distance']['mean']:.3g}"
            for readout, directions in self.errors.items()
        )
        return f"Evaluation of {self.rows:,} {self.source}, mean distances: {', '.join(means)}"


def evaluate(
    model: Model,
    samples: Samples | None = None,
    *,
    frame: Frame = "kept",
    progress: Progress | None = None,
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
        Whether the sensor's frame is fitted again to `samples`, as where a tracker was set up
        again: "free" gives the errors after that, and by how much it moved.
    progress : callable, optional
        Called with the share of the work done on `samples`, the stage and a number, NaN.

    Returns
    -------
    Evaluation

    Raises
    ------
    LogError
        If the joints of `samples` are not those of the model.
    """
    require("model", model, Model)
    check_choice("frame", frame, FRAME_CHOICES)
    if samples is None:
        simulation = simulation_of(model)
        if simulation is None:
            return as_made(model)
        return _evaluation(model, fresh_residuals(model, simulation), FRESH)
    model = model.by(samples.sensor)
    source = "measured rows of the log"
    left_out = samples.left_out
    if samples.touch is not None:
        positions, scatter = in_sockets(model, samples, samples.touch)
        left_out += len(samples) - len(positions)
        residuals = _residuals(model, positions)
        evaluation = _evaluation(model, residuals, source, left_out)
        return replace(evaluation, touch=scatter)

    # rows that the model has learned show nothing of its errors
    is_learned = learned_rows(model, samples)
    learned = int(np.count_nonzero(is_learned))
    notes: list[str] = []
    if learned and len(samples) - learned < TESTING.fewest:
        note = (
            f"{LEARNED_ROWS.format(learned)}: errors on rows that were held out "
            "while it was trained follow"
        )
        training = as_made(model)
        left_out += training.left_out + len(samples) - learned
        return replace(
            training, notes=(note,), learned=learned, left_out=left_out
        )
    if learned:
        notes.append(LEARNED_ROWS.format(learned))
        samples = samples.take(~is_learned)
        source += " that were not learned"

    if frame == "free":
        samples, frame_notes = _in_model_frame(model, samples)
        notes += frame_notes
    evaluation = _of_log(model, samples, source, progress)
    return replace(
        evaluation,
        left_out=evaluation.left_out + left_out,
        learned=learned,
        notes=(*notes, *evaluation.notes),
    )


def _of_log(
    model: Model, samples: Samples, source: str, progress: Progress | None
) -> Evaluation:
    """The errors of the rows that the verdict on a log counts, of few rows those of all."""
    different = samples.take(first_of_equal_rows(samples))
    verdict = None
    if len(different) < LEAST_ROWS:  # for a verdict
        rows, notes = sound_log(model, different)
        lost = len(different) - len(rows)
        if len(different) < len(samples):
            repeated = len(samples) - len(different)
            notes.append(REPEATED_ROWS.format(repeated))
    else:
        verdict = judge(model, samples, learn=False, progress=progress)
        rows = verdict.rows.log
        lost = verdict.rows.left_out - samples.left_out
        notes = [*verdict.notes]
        if verdict.changed:
            words = f"{verdict.words}: {verdict.main_cause}"
            notes.append(f"{words}; `check` says what to do")
    evaluation = _evaluation(model, _residuals(model, rows), source, lost)
    if verdict is not None:
        evaluation.within["covered"] = verdict.covered
    return replace(evaluation, notes=tuple(notes), verdict=verdict)


def as_made(model: Model) -> Evaluation:
    """The errors on rows that a model had not seen when it was made."""
    about = model.about
    errors = dict(about.errors)
    within = dict(about.within)
    source = FRESH if about.source == "simulation" else HELD_OUT
    return Evaluation(errors, about.tested, about.left_out, source, within)


def _residuals(model: Model, samples: Samples) -> Residuals:
    """Residuals on measured positions, and on orientations where they are known."""
    residuals = evaluate_residuals(model, samples, samples.x)
    q = samples.q
    if samples.orientation is None or not knows_orientation(model.body):
        return residuals
    space = Space.of(model)
    predicted = space.to_sensor(*space.evaluate(q)[:2])[1]
    rotation = matrix_of(samples.orientation) @ np.swapaxes(predicted, 1, 2)
    answered = finite_rows(model.forward(q))
    angles = row_lengths(logarithm(rotation[answered]))
    return replace(residuals, orientation=angles)


def _evaluation(
    model: Model, residuals: Residuals, source: str, lost: int = 0
) -> Evaluation:
    """The evaluation of residuals; `lost` rows were left out before."""
    return Evaluation(
        errors=summarise(residuals),
        rows=len(residuals.x),
        left_out=residuals.left_out + lost,
        source=source,
        within=p95_and_coverage(model, residuals),
        residuals=residuals,
    )


def _in_model_frame(
    model: Model, samples: Samples
) -> tuple[Samples, list[str]]:
    """The log in the model's frame, and a note on how its own frame moved."""
    tip = model.forward(samples.q)
    answered = finite_rows(tip)
    if answered.sum() < TESTING.placed:
        return samples, []
    x = samples.x[answered]
    tip = tip[answered]
    turn, _, _ = similarity(x, tip)
    shift = np.median(tip - x @ turn.T, axis=0)
    back = Alignment(turn, shift)
    moved = back.apply(x)
    factor, unit = for_people(samples.unit)
    before = factor * median_length(x - tip)
    after = factor * median_length(moved - tip)
    note = (
        f"the sensor's frame was found anew, {back.inverse().words(samples.unit)}: rows are "
        f"{before:.3g} {unit} off (median) in the old one, {after:.3g} in the new one"
    )
    return replace(samples, x=back.apply(samples.x)), [note]


def simulation_of(model: Model) -> Simulation | None:
    """Simulated arm and sensor that a model was trained on, None for a log."""
    about = model.about
    if about.simulation is None:
        return None
    limits = zip(about.lower.tolist(), about.upper.tolist(), strict=True)
    ranges = by_name(about.joint_names, limits)
    arm = arm_from_urdf(
        about.urdf,
        about.joint_names,
        about.tip,
        lock=about.locked,
        ranges=ranges,
    )
    return Simulation.from_json(arm, about.simulation)
