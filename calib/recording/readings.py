"""Readings: what tables of poses mean, by how well each reading fits the pictures."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations
from typing import TypedDict

import numpy as np

from ..arm.rigid import inverse, rigid
from ..arm.rotations import matrix_of
from ..common.arrays import Array
from ..common.choices import ROTATIONS, check_choice
from ..common.rows import median_length
from ..common.scale import METRES
from ..errors import OptionError
from .board_pictures import View
from .pose_files import FlangeTable
from .start import UNITS, RigStart, find_starts

AXES = ["".join(axes) for axes in permutations("xyz")]
ORDERS = (*AXES, *map(str.upper, AXES), "ZYZ", "zyz", "ZXZ", "zxz")
"""Orders of three angles about fixed (small) or moving axes."""

NAMES = {"xyz": "rpy", "ZYX": "kuka"}
"""Orders that have their own names."""

ALIKE = {"fanuc": "rpy"}
"""Synonyms of a rotation."""

MAKERS = {
    "rpy": "fixed axes x, y, z: ROS, Fanuc, Yaskawa",
    "kuka": "moving axes z, y, x: KUKA's A, B, C",
    "ZYZ": "moving axes z, y, z: Kawasaki, Doosan",
    "XYZ": "moving axes x, y, z: Staubli, Mecademic",
    "vector": "rotation vector: Universal Robots",
    "xyzw": "quaternion x, y, z, w",
    "wxyz": "quaternion w, x, y, z: ABB",
    "matrix": "matrix by rows",
    "transposed": "matrix by columns",
}

TIED = 2.5
"""Factor on the least misfit below which other readings count as equally good.

Where a flange turns on the spot, readings that exchange axes of both base and flange fit equally
well: in 12 rendered sets the next one fitted 1.0 to 1.9 times worse, others 18 times or more.
"""

_REACH = (0.005, 20.0)  # of the flange of any arm [m]


class Convention(TypedDict):
    """The meaning of a table of poses, for JSON."""

    unit: str
    angles: str
    rotation: str
    inverse: bool  # whether rows are the base in the flange
    ratio: float  # how much worse the next reading fits


@dataclass(frozen=True, eq=False)
class Reading:
    """One way to read a table of poses."""

    rotation: str  # a key of MAKERS, or an order of axes
    angles: str  # "rad" or "deg"; "" where there are no angles
    inverse: bool  # whether rows are the base in the flange
    flange: Array  # (n, 4, 4), the flange in the base [table's lengths]

    @property
    def words(self) -> str:
        """The reading for people."""
        kind = MAKERS.get(self.rotation, f"axes {self.rotation}")
        unit = f" in {self.angles}" if self.angles else ""
        way = "base in flange" if self.inverse else "flange in base"
        return f"{kind}{unit}, {way}"


@dataclass(frozen=True, eq=False)
class Choice:
    """The reading that fits best."""

    reading: Reading
    start: RigStart
    convention: Convention
    ties: tuple[str, ...]  # readings that fit as well


def pose_readings(table: FlangeTable) -> list[Reading]:
    """All ways to read a table."""
    readings = []
    for rotation, angles, matrices in _turns(table.numbers[:, 3:]):
        flange = rigid(matrices, table.numbers[:, :3])
        readings.append(Reading(rotation, angles, False, flange))
        readings.append(Reading(rotation, angles, True, inverse(flange)))
    return readings


def _turns(numbers: Array) -> list[tuple[str, str, Array]]:
    """Rotation, unit of angles and matrices (n, 3, 3) of all ways to read 3, 4 or 9 numbers."""
    from scipy.spatial.transform import Rotation

    if numbers.shape[1] == 9:
        matrices = numbers.reshape(-1, 3, 3)
        return [("matrix", "", matrices), ("transposed", "", matrices.mT)]
    if numbers.shape[1] == 4:
        wxyz = np.roll(numbers, -1, axis=1)
        return [("xyzw", "", matrix_of(numbers)), ("wxyz", "", matrix_of(wxyz))]
    turns = []
    for unit in ("rad", "deg"):
        degrees = unit == "deg"
        vectors = Rotation.from_rotvec(numbers, degrees=degrees)
        turns.append(("vector", unit, vectors.as_matrix()))
        for order in ORDERS:
            angles = Rotation.from_euler(order, numbers, degrees=degrees)
            turns.append((NAMES.get(order, order), unit, angles.as_matrix()))
    return turns


def _readings_as_stated(table: FlangeTable) -> list[Reading]:
    """Readings of a table that agree with the user's options; OptionError where none does."""
    rotation = table.rotation
    alike = ALIKE.get(rotation or "", rotation)
    angles = None
    if table.degrees is not None:
        angles = "deg" if table.degrees else "rad"
    readings = [
        reading
        for reading in pose_readings(table)
        if alike in (None, reading.rotation)
        and angles in (None, reading.angles or angles)
    ]
    if not readings:
        raise OptionError(
            f"rotation {rotation!r} is none of the poses: expected one of {', '.join(ROTATIONS)} "
            "that has as many numbers"
        )
    return readings


def choose(table: FlangeTable, view: View) -> Choice:
    """The reading of a table that fits best; OptionError where no reading is possible."""
    _refuse_unit(table)
    readings = _readings_as_stated(table)
    flanges = np.stack([reading.flange[view.rows] for reading in readings])
    starts = find_starts(flanges, view, table.unit)
    fits = list(zip(readings, starts, strict=True))
    fits.sort(key=lambda fit: fit[1].rank)
    least = fits[0][1].rank
    tied = [fit for fit in fits if fit[1].rank < TIED * least]
    best, start = min(tied, key=lambda fit: _oddity(fit[0], table.named))
    others = [other.rank for reading, other in fits if reading is not best]
    convention = Convention(
        unit=start.unit,
        angles=best.angles,
        rotation=best.rotation,
        inverse=best.inverse,
        ratio=min(others, default=np.inf) / max(start.rank, 1e-12),
    )
    ties = tuple(reading.words for reading, _ in tied if reading is not best)
    return Choice(best, start, convention, ties)


def _refuse_unit(table: FlangeTable) -> None:
    """Refuse a stated unit in which no arm reaches the flange."""
    if table.unit is None:
        return
    check_choice("unit", table.unit, UNITS)
    places = table.numbers[:, :3] / METRES[table.unit]
    distance = median_length(places)
    nearest, farthest = _REACH
    # zero in any unit: a flange that turns at the base's origin
    if distance > 0.0 and not nearest < distance < farthest:
        raise OptionError(
            f"unit {table.unit!r}: the flange is {distance:.3g} m from its base, expected "
            f"{nearest:g} to {farthest:g} m: leave `unit` out to have it found"
        )


def _oddity(reading: Reading, named: str) -> tuple[bool, bool, bool]:
    """Whether a reading is inverse, is not what the header names, and is no maker's convention."""
    is_named = reading.rotation == named
    return reading.inverse, not is_named, reading.rotation not in MAKERS
