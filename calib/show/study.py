"""Study: a model as one sensor sees its arm, with the rows and deviations that are shown."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..change.verdict import Verdict
from ..common.arrays import Array
from ..common.rows import finite_rows, row_lengths, solve_least_squares
from ..common.wording import ROUNDED_AWAY
from ..model.model import Model
from ..samples.samples import Samples
from ..training.residuals import fresh_points, learned_rows
from ..use.evaluate import (
    FRESH,
    Evaluation,
    as_made,
    evaluate,
    simulation_of,
)
from .deviations import (
    Deviation,
    deviations_of,
    drawing_behind,
    frame_parameters,
)
from .settings import SETTINGS
from .workspace import extent


@dataclass(frozen=True, eq=False)
class StudiedRows:
    """Rows that a model is judged by, in the order of their log.

    Errors are measured less predicted positions, (n, m) [unit].
    """

    q: Array  # (n, dof) [rad or m]
    x: Array  # (n, m) [unit], measured positions
    held_out: Array  # of predictions that have not seen the row
    # of the model, which has learned from the row; None of a new log
    learned: Array | None
    source: str  # what the rows are
    # (k, m) [unit], positions of rows that take no part
    left_out: Array | None = None

    @property
    def distance(self) -> Array:
        """Distance (n,) [unit] between measured and held-out predicted positions."""
        return row_lengths(self.held_out)


class Bar(NamedTuple):
    """A mean error with half of its 95 % interval [unit]."""

    name: str
    mean: float
    half: float = 0.0

    @staticmethod
    def of(name: str, errors: Array, blocks: int = 10) -> Bar:
        """The mean distance of errors (n, m), with the spread of contiguous blocks of rows."""
        distance = row_lengths(errors)
        pieces = np.array_split(distance, min(blocks, len(distance)))
        means = [piece.mean() for piece in pieces]
        student = 2.26  # 95 % of ten blocks
        half = student * float(np.std(means)) / max(len(means) - 1, 1) ** 0.5
        return Bar(name, float(distance.mean()), half)


@dataclass(frozen=True, eq=False)
class Study:
    """What is shown of a model as one of its sensors sees the arm."""

    model: Model
    log: Samples | None = None
    suffix: str = ""  # of the names of its figures

    @cached_property
    def evaluation(self) -> Evaluation:
        """The errors on new rows of the log, else on those that training never saw."""
        if self.log is not None:
            evaluation = evaluate(self.model, self.log)
            if evaluation.verdict is not None:
                return evaluation
        return as_made(self.model)

    @cached_property
    def rows(self) -> StudiedRows | None:
        """Rows of the log, else of the training, else fresh ones of a simulation."""
        verdict = self.evaluation.verdict
        if self.log is not None and verdict is not None:
            return _rows_of_log(self.model, self.log, verdict)
        return _rows_of_training(self.model)

    @cached_property
    def delivered(self) -> Array | None:
        """Errors (n, m) [unit] of the drawing's arm in the frame and with the tool that suit it."""
        drawn = drawing_behind(self.model)
        body = self.model.body
        if self.rows is None or drawn is None or body is None:
            return None
        structure, beta = drawn
        outputs = structure.output_sizes[0]
        predicted, slope = structure.linearise(
            self.rows.q, beta, frame_parameters(body)
        )
        error = self.rows.x - predicted[:, :outputs]
        columns = slope[:, :outputs].reshape(error.size, -1)
        step = solve_least_squares(columns, error.reshape(-1, 1))
        return error - (columns @ step).reshape(error.shape)

    @cached_property
    def bars(self) -> list[Bar]:
        """Mean errors as delivered, before, as calibrated, and on rows held out."""
        if self.rows is None:
            return []
        bars = []
        if self.delivered is not None:
            bars.append(Bar.of("as delivered", self.delivered))
        history = self.model.history
        if history and "before" in history[-1]:
            mean = float(history[-1]["before"]["mean"])
            bars.append(Bar("before the change was learned", mean))
        if self.rows.learned is not None:
            simulation = self.model.about.simulation
            noise = (
                ", noise included" if simulation and simulation["noise"] else ""
            )
            bars.append(Bar.of(f"as calibrated{noise}", self.rows.learned))
        bars.append(Bar.of(f"on {self.rows.source}", self.rows.held_out))
        return bars

    @cached_property
    def exact(self) -> bool:
        """Whether the errors of its rows are rounding alone."""
        least = ROUNDED_AWAY * extent(self.model)
        rows = self.rows
        return rows is not None and bool(rows.distance.max() < least)

    @property
    def views(self) -> tuple[tuple[int, int], ...]:
        """Pairs of coordinates that positions are projected on."""
        if len(self.model.axes) == 3:
            return ((0, 1), (0, 2), (1, 2))
        return ((0, 1),)

    @cached_property
    def certain(self) -> list[Deviation]:
        """What is off, the largest effect first, but for deviations that hardly move the tip."""
        deviations = deviations_of(self.model)
        largest = max(
            (deviation.effect for deviation in deviations), default=0.0
        )
        least = SETTINGS.small_effect * largest
        return [
            deviation
            for deviation in deviations
            if deviation.certain and deviation.effect > least
        ]


def studies_of(model: Model, log: Samples | None) -> list[Study]:
    """Return a study for each sensor; a log is that of one of them."""
    measured = None if log is None else model.by(log.sensor).about.sensor
    return [
        Study(
            model.by(name),
            log if name == measured else None,
            f"-{number}" if number > 1 else "",
        )
        for number, name in enumerate(model.sensors, 1)
    ]


def _rows_of_log(model: Model, log: Samples, verdict: Verdict) -> StudiedRows:
    """The rows of a log that a verdict counts."""
    rows = verdict.rows
    counted = {row.tobytes() for row in rows.x}
    new = log.x[~learned_rows(model, log)]
    left_out = [row for row in new if row.tobytes() not in counted]
    return StudiedRows(
        q=rows.log.q,
        x=rows.x,
        held_out=rows.x - rows.predicted,
        learned=None,
        source="rows of the log",
        left_out=np.array(left_out).reshape(-1, rows.x.shape[1]),
    )


def _rows_of_training(model: Model) -> StudiedRows | None:
    """Fresh samples of a simulation, or the rows that are kept of a log; None without any."""
    simulation = simulation_of(model)
    if simulation is not None:
        # the points of its errors in `train` and `info`
        q, x = fresh_points(simulation, model.about.seed)
        held_out = x - model.forward(q)
        rng = np.random.default_rng(model.about.seed)
        noise = simulation.noise * rng.standard_normal(x.shape)
        learned = held_out + noise
        source = FRESH
    elif model.rows is not None:
        q = model.rows.q
        x = model.rows.x
        learned = x - model.forward(q)
        held_out = learned
        if model.rows.held_out is not None:
            held_out = model.rows.held_out
        source = "rows held out"
    else:
        return None
    answered = finite_rows(held_out + learned)
    if not answered.any():
        return None
    return StudiedRows(
        q[answered],
        x[answered],
        held_out[answered],
        learned[answered],
        source,
    )
