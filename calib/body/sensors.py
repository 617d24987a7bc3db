"""Several sensors of one arm: each with a frame, a lens, a unit and a noise of its own.

All share one vector of parameters and one belief.  A structure sees as one of the sensors: its own
blocks are named as those of a single one (``view.rotation``), those of the others after them
(``right.view.rotation``).  The order of parameters is the same, whichever it sees as.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Protocol, TypeVar

from ..arm.spatial_chain import Motion
from ..common.arrays import Array
from ..errors import OptionError
from .parameters import Block, Hyper
from .settings import MARKER, MARKERS
from .views import Measurement, Placed, Sight


@dataclass(frozen=True)
class Viewpoint:
    """What a structure says of the sensor that it sees as, by the names of its fields."""

    sensor_name: str
    view: str
    unit: str
    metre: float
    extent: float


class Sighted(Protocol):
    """A structure that sees as one of several sensors."""

    @property
    def place(self) -> int:
        """Place of the sensor among all."""

    @property
    def beside(self) -> tuple[Viewpoint, ...]:
        """The others in their order."""

    @property
    def viewpoint(self) -> Viewpoint:
        """What it says of the sensor that it sees as."""


_Structure = TypeVar("_Structure", bound=Sighted)


@dataclass(frozen=True)
class ViewpointInSpace(Viewpoint):
    """The same of an arm in space."""

    lens: tuple[float, float, float, float]
    lens_sd: tuple[float, float, float, float]


@dataclass(frozen=True)
class ViewpointInPlane(Viewpoint):
    """The same of a planar arm."""

    mirror: int
    centre: tuple[float, float]


@dataclass(frozen=True, eq=False)
class NamedSensor:
    """One of several sensors."""

    name: str
    measurement: Measurement
    frame: tuple[str, ...]  # blocks of its own that every member of the gate fits
    marked: bool  # whether it sees a marker of its own, apart from the first sensor's

    def blocks(self) -> tuple[Block, ...]:
        """Its own parameters, their names after its own."""
        own = self.measurement.parameters()
        if self.marked:
            axes = [f"marker.{axis}" for axis in "xyz"]
            scale = Hyper(f"{self.name}.marker", MARKER, MARKERS)
            own = (*own, Block.of("marker", "m", axes, 0.0, scales=(scale,)))
        return tuple(self._named(block) for block in own)

    def _named(self, block: Block) -> Block:
        parts = tuple(
            (joint, f"{self.name}.{name}", unit) for joint, name, unit in block.parts
        )
        return replace(block, parts=parts)


@dataclass(frozen=True, eq=False)
class Several(Measurement):
    """The measurement of one of several sensors, with the parameters of all."""

    sensors: tuple[NamedSensor, ...]
    place: int  # of the one whose measurement it is
    outputs: int
    free: tuple[str, ...]
    tool: Hyper | None

    @staticmethod
    def of(sensors: Sequence[NamedSensor], place: int) -> Several:
        """The measurement of the sensor at a place among all."""
        free: list[str] = []
        for k, sensor in enumerate(sensors):
            if k != place:
                free += [f"{sensor.name}.{block}" for block in sensor.frame]
            if sensor.marked:
                free.append("marker" if k == place else f"{sensor.name}.marker")
        tools = [sensor.measurement.tool for sensor in sensors]
        # only where all sensors need it held, such as cameras: one that measures lengths tells it
        tool = None if None in tools else tools[0]
        return Several(
            sensors=tuple(sensors),
            place=place,
            outputs=sensors[place].measurement.outputs,
            free=tuple(free),
            tool=tool,
        )

    def parameters(self) -> tuple[Block, ...]:
        """The parameters of all sensors, in their order."""
        blocks: list[Block] = []
        for k, sensor in enumerate(self.sensors):
            for block in sensor.blocks():
                name = block.name if k == self.place else f"{sensor.name}.{block.name}"
                blocks.append(replace(block, name=name))
        return tuple(blocks)

    def placed(self, own: Mapping[str, Array]) -> Placed:
        """The sensor at its parameters."""
        return self.sensors[self.place].measurement.placed(own)

    def look(self, own: Mapping[str, Any], motion: Motion, also: Array) -> Sight:
        """See the chain."""
        return self.sensors[self.place].measurement.look(own, motion, also)


def viewpoints(structure: Sighted) -> tuple[Viewpoint, ...]:
    """All sensors of a structure in their order."""
    place = structure.place
    return (*structure.beside[:place], structure.viewpoint, *structure.beside[place:])


def as_seen_by(structure: _Structure, sensor: str) -> _Structure:
    """Return the structure as another of its sensors sees the arm."""
    every = viewpoints(structure)
    names = [viewpoint.sensor_name for viewpoint in every]
    if sensor not in names:
        raise OptionError(f"sensor {sensor!r}: expected one of {', '.join(names)}")
    place = names.index(sensor)
    if place == structure.place:
        return structure
    own = {
        field.name: getattr(every[place], field.name) for field in fields(every[place])
    }
    return replace(
        structure, **own, place=place, beside=(*every[:place], *every[place + 1 :])
    )  # type: ignore[type-var]


def joined(structures: Mapping[str, _Structure]) -> _Structure:
    """Return the first structure with the sensors of all, which are of one chain, by name."""
    named = [replace(each, sensor_name=name) for name, each in structures.items()]  # type: ignore[type-var]
    if len({type(structure) for structure in named}) > 1:
        raise OptionError("one sensor sees a planar arm, another one an arm in space")
    others = tuple(structure.viewpoint for structure in named[1:])
    return replace(named[0], beside=others)  # type: ignore[type-var]
