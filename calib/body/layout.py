"""Layout: the sensors that see a chain, and the parameters of both.

A vector of parameters ``beta`` (d,) always has the full layout: a block that a model does not use
(a lens, the joint curves) is there with its neutral value.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, ClassVar, Self, TypeVar

import numpy as np

from ..common.arrays import Array, Mask
from ..common.choices import check_choice
from ..common.wording import by_name
from ..errors import OptionError
from .curves import HARMONICS
from .parameters import Block, Hyper, Indices, Label, Prior
from .sensors import Sensor
from .settings import PRIOR
from .views import ArmSize, Measurement

LayoutT = TypeVar("LayoutT", bound="Layout")

Members = tuple[tuple[str, tuple[str, ...]], ...]
"""The gate's members from simple to rich: a name and the blocks that it frees."""


class Layout:
    """A chain and its sensors by their parameters; see `Structure`.

    `place` is the number of the measurement that is predicted, among `sensors` and then `others`.
    `viewpoint` is that sensor, or the first one where `place` is no sensor.

    ``n`` rows, ``dof`` joints, ``m`` outputs, ``d`` parameters, ``c`` joints of the chain.  Joint
    values are in rad or m as they are logged; positions in the structure's own unit.
    """

    # ``"planar"`` or ``"spatial"``: how a model file finds the class again
    kind: ClassVar[str]
    # rows that the gate and the evidence use; the rest enters the final step
    gate_rows: ClassVar[int]
    # wider hyperprior of the curves for a second fit: pseudo-observations, rms [rad]
    wide: ClassVar[tuple[float, float]]
    # rows below which held-out errors scale the second fit's spread
    few_rows: ClassVar[int]
    # prior sds of blocks in the second fit, where they differ from the first fit's
    guards: ClassVar[Mapping[str, tuple[float, ...]]] = {}
    joint_names: tuple[str, ...]  # names of the joints, base to tip
    chain_names: tuple[str, ...]  # names of all joints (c,) of the chain
    revolute: tuple[bool, ...]  # which joints turn; the others slide
    simulated: bool  # whether the rows are samples of a simulation
    # whether the geometry is as drawn, and only joints' zeros are not
    zeros_alone: bool
    sensors: tuple[Sensor, ...]  # all that see the arm
    # further measurements of it: touches
    others: tuple[Measurement, ...]
    # number, among `sensors` and then `others`, of what is predicted
    place: int

    @property
    def is_revolute(self) -> Mask:
        """Which joints (dof,) turn."""
        return np.array(self.revolute, dtype=bool)

    @property
    def dof(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    # Its sensors.

    @property
    def viewpoint(self) -> Sensor:
        """The sensor that is predicted, or the first one where a touch is."""
        if self.place < len(self.sensors):
            return self.sensors[self.place]
        return self.sensors[0]

    @property
    def measurement(self) -> Measurement:
        """What is predicted: a sensor, or another measurement such as touches."""
        return (*self.sensors, *self.others)[self.place]

    @property
    def view(self) -> str:
        """Name of its sensor's view, one of :data:`calib.body.views.PLANAR` or `SPATIAL`."""
        return self.viewpoint.view

    @property
    def unit(self) -> str:
        """Unit of positions."""
        return self.viewpoint.unit

    @property
    def metre(self) -> float:
        """Units of positions in one metre."""
        return self.viewpoint.metre

    @property
    def known_scale(self) -> float | None:
        """Units of its sensor's readings in a metre; None where that is fitted."""
        return None if self.viewpoint.view_kind.has_scale else self.metre

    @property
    def extent(self) -> float:
        """Size of the workspace along an output [unit]."""
        return self.viewpoint.extent

    @property
    def outputs(self) -> int:
        """Number m of outputs: 2 in the plane or pixels, 3 in space, 6 with orientation."""
        return self.measurement.outputs

    @property
    def output_sizes(self) -> tuple[int, ...]:
        """Numbers of outputs that share a unit and a noise: ``(2,)``, ``(3,)``, ``(3, 3)``."""
        return (3, 3) if self.outputs == 6 else (self.outputs,)

    @property
    def position(self) -> slice:
        """Outputs that are a position, without the orientation of a pose."""
        return slice(self.output_sizes[0])

    @property
    def extents(self) -> Array:
        """Size (m,) of the workspace along the outputs [unit]; 1 rad for rotations."""
        return np.where(np.arange(self.outputs) < 3, self.extent, 1.0)

    @property
    def tool(self) -> Hyper | None:
        """Prior scale of the tool; None where a sensor that measures lengths determines it."""
        tools = [sensor.tool for sensor in self.others[:1] or self.sensors]
        return None if None in tools else tools[0]

    @property
    def frame_groups(self) -> tuple[str, ...]:
        """Blocks that every member of the gate fits: of its viewpoint and of all other sensors."""
        groups: list[str] = []
        for number, sensor in enumerate(self.sensors):
            blocks = [*sensor.groups]
            if number and sensor.marked:
                blocks.append("marker")
            if sensor is not self.viewpoint:
                blocks = [b for b in blocks if not b.startswith("tool")]
            groups += [self._group_of(sensor, block) for block in blocks]
        for other in self.others:
            groups += other.free
        return tuple(groups)

    @property
    def scale_groups(self) -> tuple[str, ...]:
        """Scale blocks of all sensors in metres but the first, which may disagree with it."""
        metric = [sensor for sensor in self.sensors if sensor.is_metric]
        return tuple(
            self._group_of(sensor, "view.scale") for sensor in metric[1:]
        )

    def _group_of(self, sensor: Sensor, block: str) -> str:
        """Name of a sensor's block: prefixed by the sensor's name, except the viewpoint's."""
        if sensor is self.viewpoint:
            return block
        return f"{sensor.name}.{block}"

    def with_fields(self, **fields: Any) -> Self:
        """The structure with other values of its fields."""
        return replace(self, **fields)  # type: ignore[type-var]

    def with_sensor(self, **fields: Any) -> Self:
        """The structure with other values of its sensor's fields: view, unit, ..."""
        sensors = list(self.sensors)
        sensors[sensors.index(self.viewpoint)] = replace(
            self.viewpoint, **fields
        )
        return self.with_fields(sensors=tuple(sensors))

    def as_seen_by(self, sensor: str | Measurement | None) -> Self:
        """The structure that predicts a measurement, a sensor by its name, or its only sensor."""
        place = self.place
        if isinstance(sensor, str):
            names = [sight.name for sight in self.sensors]
            check_choice("sensor", sensor, names)
            place = names.index(sensor)
        elif sensor is not None:
            place = len(self.sensors) + self.others.index(sensor)
        elif self.others:
            place = 0
        if place == self.place:
            return self
        return self.with_fields(place=place)

    @property
    def first_free(self) -> int:
        """Number of the first joint with an offset and an origin of its own.

        In a free frame the first joint has none: a turn of the frame about its axis has the effect
        of an offset, and a move of the frame that of an origin.
        """
        based = any(sensor.view.startswith("base") for sensor in self.sensors)
        floating = any(other.floating for other in self.others)
        return 0 if based and not floating else 1

    # What the kinds of chains give.

    @property
    def arm_size(self) -> ArmSize:
        """Size and place of the arm, for the priors of sensors."""
        raise NotImplementedError

    @property
    def reversals(self) -> int:
        """How many joints turn against their drawing, and whether the sensor sees a mirror."""
        return 0

    @property
    def linear(self) -> Indices:
        """Parameters that the outputs are linear in where all others are constant."""
        return np.zeros(0, dtype=int)

    def turn_parameters(self, turn: Array) -> Array:
        """Parameters (t,) of the sensor's turn, a matrix (p, p)."""
        raise NotImplementedError

    def undrawn(self) -> Self | None:
        """The structure without its drawing; None where it has none, or cannot do without."""
        return None

    def geometry(self) -> Sequence[Block]:
        """Blocks of the chain's geometry and of its joints."""
        raise NotImplementedError

    def ladder(self) -> Sequence[tuple[str, tuple[str, ...], bool]]:
        """Members from simple to rich: a name, the blocks that it frees, whether it is wanted."""
        raise NotImplementedError

    def members(self) -> Members:
        """The gate's members from simple to rich."""
        if self.zeros_alone:
            frame = self.frame_groups
            return (
                ("frame", frame or ("offset",)),
                ("chain", (*frame, "offset")),
            )
        return tuple(
            (name, groups) for name, groups, wanted in self.ladder() if wanted
        )

    @property
    def chain_blocks(self) -> tuple[str, ...]:
        """Blocks of the member that frees the chain, or of the simplest one without it."""
        members = self.members()
        return dict(members).get("chain", members[0][1])

    @property
    def blocks_but_curves(self) -> list[str]:
        """All blocks that some member frees, except the curves."""
        blocks: dict[str, None] = {}
        for _, freed in self.members():
            blocks.update(dict.fromkeys(freed))
        return [block for block in blocks if block != "curve"]

    # Parameters.

    @cached_property
    def layout(self) -> tuple[Block, ...]:
        """The blocks of the sensors, the geometry and the joints."""
        arm = self.arm_size
        blocks: list[Block] = []
        for number, sensor in enumerate(self.sensors):
            for block in sensor.parameters_with_name(arm, further=number > 0):
                name = self._group_of(sensor, block.name)
                blocks.append(replace(block, name=name))
        for other in self.others:
            blocks += other.parameters(arm)
        return (*blocks, *self.geometry())

    @cached_property
    def sensor_blocks(self) -> tuple[str, ...]:
        """Names of the blocks of its viewpoint and of further measurements."""
        measurements = (self.viewpoint, *self.others)
        return tuple(
            block.name
            for measurement in measurements
            for block in measurement.parameters(self.arm_size)
        )

    @cached_property
    def labels(self) -> tuple[Label, ...]:
        """What each parameter (d,) is."""
        return tuple(
            Label(block.name, *part)
            for block in self.layout
            for part in block.parts
        )

    @cached_property
    def groups(self) -> Mapping[str, Indices]:
        """Indices of the parameters of each block, by its name."""
        names = [block.name for block in self.layout]
        ends = np.cumsum([len(block.parts) for block in self.layout])
        return by_name(names, np.split(np.arange(ends[-1]), ends[:-1]))

    @property
    def size(self) -> int:
        """Number d of parameters."""
        return len(self.labels)

    def neutral(self) -> Array:
        """Parameters (d,) at the mean of the prior."""
        out = np.empty(self.size)
        for block in self.layout:
            out[self.groups[block.name]] = block.mean
        return out

    def with_sensor_at(
        self, beta: Array, turn: Array, shift: Array, scale: float
    ) -> Array:
        """Parameters (d,) with the sensor that reads ``scale turn p + shift`` of a point p [m]."""
        groups = self.groups
        out = beta.copy()
        out[groups["view.rotation"]] = self.turn_parameters(turn)
        out[groups["view.scale"]] = np.log(scale / self.metre)
        out[groups["view.shift"]] = shift
        return out

    def prior(self, free: Sequence[str]) -> Prior:
        """Prior that frees the blocks of `free`; ``"curve"`` stands for all joints' curves."""
        sd = np.zeros(self.size)
        hypers: list[Hyper] = []
        for block in self.layout:
            is_curve = block.name.startswith("curve.") and "curve" in free
            if block.name not in free and not is_curve:
                continue
            indices = self.groups[block.name]
            sd[indices] = block.sd
            for hyper in block.scales:
                group = indices[hyper.indices]
                shape = np.broadcast_to(hyper.shape, group.shape)
                sd[group] = hyper.scale * np.sqrt(shape)
                if len(group):
                    hypers.append(hyper._replace(indices=group, shape=shape))
        return Prior(self.neutral(), sd, tuple(hypers))

    def gains(self) -> Block:
        """The joints' gains, near those of a drawing."""
        scale = Hyper("gain", PRIOR.gain, PRIOR.wider)
        names = self.joint_names
        return Block.of(
            "gain", "1", ["gain"], mean=1.0, scales=(scale,), joints=names
        )

    def curves(self, pseudo: float, shape: Array) -> Iterator[Block]:
        """Blocks of the joints' error curves, of an rms that the evidence moves."""
        orders = range(1, HARMONICS + 1)
        waves = [f"curve {wave} {n}" for wave in ("cos", "sin") for n in orders]
        rms_of_wave = PRIOR.curve_rms / np.sqrt(len(waves))
        for k, joint in enumerate(self.joint_names):
            block = Block(f"curve.{k}", ())
            if self.revolute[k]:
                scale = Hyper(
                    block.name, rms_of_wave, pseudo=pseudo, shape=shape
                )
                block = Block.of(
                    block.name, "rad", waves, scales=(scale,), joints=[joint]
                )
            yield block


def with_all_sensors(structures: Mapping[str, LayoutT]) -> LayoutT:
    """The first structure with the sensors of all structures, which share one chain."""
    first, *further = structures.values()
    if any(type(structure) is not type(first) for structure in further):
        raise OptionError(
            "one sensor sees a planar arm, another one an arm in space"
        )
    sensors = tuple(
        replace(structure.viewpoint, name=name)
        for name, structure in structures.items()
    )
    return first.with_fields(sensors=sensors)
