"""About a model: what it is a model of, how it was made, what it keeps of its log; in words."""

from __future__ import annotations

import io
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array, Document, ReadOnly, Shape
from ..common.choices import READOUTS
from ..common.rows import thinned
from ..common.wording import for_people, quantity, unit_of_joint, vector
from ..errors import ModelError

if TYPE_CHECKING:
    from ..arm.arm import Arm
    from ..samples.samples import Samples

STATISTICS = ("mean", "p99", "max")
Errors = Mapping[str, Mapping[str, Mapping[str, Document]]]
"""Statistics by readout, direction and quantity, as a model keeps them."""
_ErrorRow = dict[str, dict[str, float]]
"""Statistics of one quantity, by readout."""

MOST_ROWS = 5_000
"""Rows that are kept of a longer log, evenly spread over it."""


@dataclass(frozen=True, eq=False)
class About(ReadOnly):
    """Plain facts that travel with a model."""

    robot: str  # its name ("" without a URDF)
    tip: str  # the frame whose position is sensed
    joint_names: tuple[str, ...]  # active joints from base to tip
    revolute: tuple[bool, ...]  # whether each joint turns (rad) or slides (m)
    # [rad or m], learned range of each joint
    lower: Annotated[Array, Shape("dof")]
    upper: Annotated[Array, Shape("dof")]
    # other joints and where they are held [rad or m]
    locked: Mapping[str, float]
    # its "origin", "x" and "y" in the root link's frame [m]
    plane: Mapping[str, tuple[float, float, float]] | None
    unit: str  # unit of the positions
    # "true position" or "sensor reading": what the expected error bounds
    bound_of: str
    source: str  # "simulation" or "log"
    samples: int  # number of training samples
    seed: int
    options: Document  # "map", "rule", "epochs", "sigma" of the training
    simulation: Document | None  # noise and changes of the simulated arm
    urdf: str  # the URDF's own text ("" without one)
    # errors per readout as ``calib evaluate --json`` prints them
    errors: Document = field(default_factory=dict)
    # "p95" and "covered" of the answers' distances, see `calib.Evaluation.within`
    within: Mapping[str, float] = field(default_factory=dict)
    tested: int = 0  # samples behind those errors
    left_out: int = 0  # samples outside of what was learned from the others
    # notes that were printed while the model was made
    notes: tuple[str, ...] = ()
    # columns of its log that have other names than what they hold
    columns: Mapping[str, str] = field(default_factory=dict)
    # whether its log, and so later ones, has turning joints in degrees
    degrees: bool = False
    # [px], width and height of a camera's pictures in space
    picture: tuple[int, int] | None = None
    frame: str = ""  # the sensor's, as its log names it
    # [rad or m], permitted ranges of joints in a drawing: all turns of a periodic one
    limits: Annotated[Array, Shape("dof", "ends")] | None = None
    sensor: str = ""  # its name, where the arm was seen by several

    @property
    def bound_holds(self) -> bool:
        """Whether the rows that the model was tested on agree with its own bound."""
        return holds(self.within, self.tested)

    @property
    def board(self) -> Document | None:
        """Source of a log of pictures of a board: "board", "eye", "lens", "point", "rig".

        `BoardPictures.log` writes it; other logs have none.
        """
        return self.options.get("board")

    @property
    def units_of_joints(self) -> tuple[str, ...]:
        """Unit of each joint: "rad" or "m"."""
        return tuple("rad" if turns else "m" for turns in self.revolute)

    def by_readings(self, **facts: Any) -> About:
        """The facts, with these instead, of a model that was adapted to readings of a sensor."""
        return replace(
            self,
            source="log",
            bound_of="sensor reading",
            simulation=None,
            **facts,
        )

    def joints_of(self, log: Samples) -> Array:
        """Joint values (n, dof) of a log in the order of the model's joints.

        Raises LogError if the log is of other joints.
        """
        return log.reordered(self.joint_names).q


def holds(within: Mapping[str, float], rows: int) -> bool:
    """Whether rows agree with a 95 % bound that covers the share `within["covered"]` of them.

    They do not where three times as many as 5 %, and two rows more, are beyond it: a few are by
    chance.  Without a share nothing contradicts the bound.  Where most rows have no answer,
    as their bound exceeds a tenth of the reach, it is no bound that helps.
    """
    answered = within.get("answered", 1.0)
    beyond = rows * answered * (1.0 - within.get("covered", 1.0))
    return answered >= 0.5 and beyond <= 0.15 * rows * answered + 2.0


@dataclass(frozen=True, eq=False)
class Photo:
    """A JPEG of the arm by the camera that measured it, at most 3 MB; its borders are positions."""

    jpeg: Annotated[NDArray[np.uint8], Shape("bytes")]  # the picture
    # [unit], positions of its left, right, lower and upper border. Of pixels the lower one is the
    # larger: they count from the top.
    box: tuple[float, float, float, float]

    def pixels(self) -> NDArray[np.uint8]:
        """Return red, green and blue (height, width, 3), the first row on top."""
        from PIL import Image

        try:
            with Image.open(io.BytesIO(self.jpeg.tobytes())) as opened:
                return np.asarray(opened.convert("RGB"))
        except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):
            raise ModelError("the model's photo cannot be read") from None


@dataclass(frozen=True, eq=False)
class MeasuredRows(ReadOnly):
    """Measured rows."""

    q: Annotated[Array, Shape("rows", "dof")]  # [rad or m], joint values
    x: Annotated[Array, Shape("rows", "width")]  # [unit], positions
    # [unit], measured less predicted position, of predictions that had not seen the row
    held_out: Annotated[Array, Shape("rows", "width")] | None = None

    def __len__(self) -> int:
        return len(self.q)

    @staticmethod
    def of(q: Array, x: Array, held_out: Array | None = None) -> MeasuredRows:
        """At most 5,000 of the rows of a log, evenly spread over it."""
        rows = thinned(len(q), MOST_ROWS)
        errors = None if held_out is None else held_out[rows].copy()
        return MeasuredRows(q[rows].copy(), x[rows].copy(), errors)


def facts(
    about: About,
    size_in_words: str,
    others: Sequence[About] = (),
    *,
    degrees: bool = True,
) -> dict[str, str]:
    """Return names and values; ranges of joints that turn in degrees or in rad.

    others : of further sensors
    """
    options = about.options
    words = {"robot": about.robot or "none, learned from a log alone"}
    for k, name in enumerate(about.joint_names):
        words[f"joint {name}"] = range_in_words(about, k, degrees=degrees)
    if about.tip:
        words["tip"] = about.tip
    if about.locked:
        places = [f"{name}={value:.6g}" for name, value in about.locked.items()]
        words["locked"] = ", ".join(places)
    if about.plane:
        axes = [
            f"{name} {vector(about.plane[name])}"
            for name in ("origin", "x", "y")
        ]
        words["plane"] = ", ".join(axes)
    words |= {
        "positions in": about.unit,
        "learned from": _source(about, others),
        "maps": f"{options['map']}, {options['rule']} rule, {size_in_words}",
        "expected error": f"95 % bound on the distance to the {about.bound_of}",
        "model error": (
            "95 % bound on the distance to the true position in the sensor's frame"
        ),
    }
    words["bounds hold"] = (
        "in the session of the log: see an evaluation with `frame='free'`"
    )
    if about.source == "simulation":
        words["bounds hold"] = (
            "for the simulated arm: a real one may be as far off as its log shows"
        )
    return words


def range_in_words(about: About | Arm, k: int, *, degrees: bool) -> str:
    """Return the learned range of joint `k` in words."""
    factor, unit = unit_of_joint(about.revolute[k], degrees)
    return (
        f"{about.lower[k] * factor:.6g} to {about.upper[k] * factor:.6g} {unit}"
    )


def error_statistics(
    about: About, errors: Errors
) -> Iterator[tuple[str, str, str, _ErrorRow]]:
    """Yield direction, name and unit of each error with its statistics in that unit, by readout.

    The best readout comes first; NaN means that it could not be measured.
    """
    readouts = [readout for readout in READOUTS if readout in errors]
    joints = dict(zip(about.joint_names, about.units_of_joints, strict=True))
    for direction, units in (
        ("forward", {"orientation": "rad"}),
        ("inverse", joints),
    ):
        for name in errors[readouts[0]][direction]:
            factor, unit = for_people(units.get(name, about.unit))
            statistics: _ErrorRow = {}
            for readout in readouts:
                error = errors[readout][direction].get(name)
                if error is None:
                    continue
                statistics[readout] = {}
                for statistic in STATISTICS:
                    value = error[statistic]
                    value = math.nan if value is None else factor * value
                    statistics[readout][statistic] = value
            yield direction, name, unit, statistics


def _source(about: About, others: Sequence[About]) -> str:
    kind = f"rows of {len(others) + 1} logs" if others else "rows of a log"
    if about.simulation:
        kind = "simulated samples"
    samples = about.samples + sum(other.samples for other in others)
    words = [f"{samples} {kind}", f"seed {about.seed}"]
    if about.simulation:
        noise = about.simulation.get("noise") or 0.0
        if noise:
            words.append(f"sensor noise {quantity(noise, about.unit)}")
        else:
            words.append("no noise")
        words += map(str, about.simulation.get("changes", ()))
    return ", ".join(words)
