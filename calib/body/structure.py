"""Structure: a chain, the sensors that see it, and the parameters of both.

The fit, the gate, the bound, ``check`` and ``adapt`` know a body only through `Structure`::

    v_i = gain s q_i + offset + coupling q_(i-1) + curve_i(q_i) + sum_e elastic_e load_e(q)

with loads ``load_e = gravity . lever_e(q)``.

A vector of parameters ``beta`` (d,) always has the full layout: a block that a model does not use
(a lens, the joint curves) is there with its neutral value.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from itertools import product
from typing import Any, ClassVar, NamedTuple, Self, TypeVar

import numpy as np

from ..arm.spatial_chain import Motion, move
from ..common.arrays import Array
from ..errors import OptionError
from .curves import HARMONICS, curve_slope, curve_value, waves_of
from .parameters import Block, Gaussian, Hyper, Indices, Label, Prior
from .sensors import Sensor
from .views import ArmSize, Measurement, Moved, Placed, Scene, Sight, compose

Ladder = tuple[tuple[str, tuple[str, ...]], ...]
"""The gate's members from simple to rich: a name and the blocks that it frees."""

Moving = Iterator[tuple[Indices, Callable[[], Moved]]]
"""Parameters of a chain's geometry, and how the tip moves with each of them."""

_BELIEFS = 8  # whose constants are remembered

S = TypeVar("S", bound="Structure")


class Fixed(NamedTuple):
    """What follows from the parameters alone, whatever the joints are."""

    gain: Array  # (dof, 1), with each joint's direction
    offset: Array  # (dof, 1) [rad or m]
    bent: list[int]  # joints that have an error curve
    curves: Array  # (k, 96) [rad]
    # (dof - 1, 1), None where no joint moves with its neighbour's motor
    coupling: Array | None
    elastic: Mapping[str, Array]  # (e,) of each block by which joints bend, if they do
    gravity: Array  # (g,), what a load is of its levers
    links: Any  # of the chain
    blocks: Mapping[str, Array]  # all parameters
    placed: Placed  # the sensor


class Structure:
    """A chain and what a sensor measures of it.

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
    joint_names: tuple[str, ...]  # names of the joints, base to tip
    chain_names: tuple[str, ...]  # names of all joints (c,) of the chain
    revolute: tuple[bool, ...]  # which joints turn; the others slide
    simulated: bool  # whether the rows are samples of a simulation
    # whether the geometry is as drawn, and only joints' zeros are not
    zeros_alone: bool
    sensors: tuple[Sensor, ...]  # all that see the arm
    others: tuple[Measurement, ...]  # what else is measured of it: touches, corners
    place: int  # which of both it sees as

    @property
    def dof(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    # What it is seen by.

    @property
    def viewpoint(self) -> Sensor:
        """The sensor that it sees as, or beside which it measures something else."""
        beside = self.place >= len(self.sensors)
        return self.sensors[0 if beside else self.place]

    @property
    def measurement(self) -> Measurement:
        """What it sees as."""
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
    def extent(self) -> float:
        """Size of the workspace along an output [unit]."""
        return self.viewpoint.extent

    @property
    def outputs(self) -> int:
        """Number m of outputs: 2 in the plane or pixels, 3 in space, 6 with orientation."""
        return self.measurement.outputs

    @property
    def blocks(self) -> tuple[int, ...]:
        """Sizes of the outputs that share a unit and a noise: ``(2,)``, ``(3,)``, ``(3, 3)``."""
        return (3, 3) if self.outputs == 6 else (self.outputs,)

    @property
    def extents(self) -> Array:
        """Size (m,) of the workspace along the outputs [unit]; 1 rad for rotations."""
        return np.where(np.arange(self.outputs) < 3, self.extent, 1.0)

    @property
    def tool(self) -> Hyper | None:
        """What is known of the tool; one sensor that measures lengths is enough to tell it."""
        for other in self.others:
            if other.tool is not None:
                return other.tool
        tools = [sensor.tool for sensor in self.sensors]
        return None if None in tools else tools[0]

    @property
    def other_groups(self) -> tuple[str, ...]:
        """Blocks of further sensors and measurements that every member of the gate fits."""
        groups: list[str] = []
        for place, sensor in enumerate(self.sensors):
            prefix = "" if sensor is self.viewpoint else f"{sensor.name}."
            if prefix:
                groups += [prefix + block for block in sensor.frame]
            if place and sensor.marked:
                groups.append(f"{prefix}marker")
        for other in self.others:
            groups += other.free
        return tuple(groups)

    def changed(self, **fields: Any) -> Self:
        """Return the structure with other values of its fields."""
        return replace(self, **fields)  # type: ignore[type-var]

    def with_sensor(self, **fields: Any) -> Self:
        """Return the structure with other values of its sensor's fields: view, unit, ..."""
        sensors = list(self.sensors)
        sensors[sensors.index(self.viewpoint)] = replace(self.viewpoint, **fields)
        return self.changed(sensors=tuple(sensors))

    def as_seen_by(self, sensor: str | Measurement | None) -> Self:
        """Return the structure as one of its sensors, by name, or of its measurements sees it.

        None is the only sensor.
        """
        place = self.place
        if isinstance(sensor, str):
            names = [sight.name for sight in self.sensors]
            if sensor not in names:
                choices = ", ".join(names)
                raise OptionError(f"sensor {sensor!r}: expected one of {choices}")
            place = names.index(sensor)
        elif sensor is not None:
            place = len(self.sensors) + self.others.index(sensor)
        elif self.others:
            place = 0
        return self if place == self.place else self.changed(place=place)

    # What the kinds of chains give.

    @property
    def arm_size(self) -> ArmSize:
        """What the prior of a sensor rests on."""
        raise NotImplementedError

    @property
    def reversals(self) -> int:
        """How many joints turn against their drawing, and whether the sensor sees a mirror."""
        return 0

    @property
    def directions(self) -> tuple[int, ...]:
        """How each joint (dof,) moves with its log, 1 or -1."""
        return (1,) * self.dof

    def guard(self, block: str) -> Array | None:  # noqa: ARG002
        """Prior sds of a block in the second fit, None where they are the first one's."""
        return None

    def undrawn(self) -> Structure | None:
        """The structure without a drawing that rows may contradict, None where it needs one."""
        return None

    def geometry(self) -> Sequence[Block]:
        """Blocks of the chain's geometry and of its joints."""
        raise NotImplementedError

    def members(self) -> Ladder:
        """The gate's members from simple to rich."""
        raise NotImplementedError

    def links(self, beta: Array) -> Any:
        """What `move` needs of the parameters."""
        raise NotImplementedError

    def moving(self, motion: Motion) -> Moving:
        """How the tip moves with each part of the geometry."""
        raise NotImplementedError

    @property
    def bending(self) -> tuple[str, ...]:
        """Blocks of elasticity: a parameter for each load."""
        return ("elastic",)

    @property
    def tilts(self) -> Mapping[str, Array]:
        """Blocks that tilt gravity, and the ways (t, g) in which their parameters move it."""
        return {}

    def gravity_at(self, beta: Array) -> Array:  # noqa: ARG002
        """What (g,) loads are of their levers, at parameters (d,)."""
        return np.ones(1)

    def levers(self, block: str, q: Array) -> tuple[Array, Indices]:
        """Levers (e, g, n) of the loads of a block of elasticity, and the joints (e,) they bend."""
        raise NotImplementedError

    def load_slopes(self, block: str, q: Array, gravity: Array) -> Array:
        """Derivatives (e, dof, n) of the loads by the joint values."""
        raise NotImplementedError

    # Parameters.

    @cached_property
    def layout(self) -> tuple[Block, ...]:
        """The blocks of the sensors, the geometry and the joints."""
        arm = self.arm_size
        blocks: list[Block] = []
        for place, sensor in enumerate(self.sensors):
            for block in sensor.named_parameters(arm, further=place > 0):
                if sensor is self.viewpoint:
                    blocks.append(block)
                else:
                    blocks.append(replace(block, name=f"{sensor.name}.{block.name}"))
        for other in self.others:
            blocks += other.parameters(arm)
        return (*blocks, *self.geometry())

    @cached_property
    def labels(self) -> tuple[Label, ...]:
        """What each parameter (d,) is."""
        return tuple(
            Label(block.name, *part) for block in self.layout for part in block.parts
        )

    @cached_property
    def groups(self) -> Mapping[str, Indices]:
        """Indices of the parameters of each block, by its name."""
        groups: dict[str, Indices] = {}
        start = 0
        for block in self.layout:
            end = start + len(block.parts)
            groups[block.name] = np.arange(start, end)
            start = end
        return groups

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
                some = indices[hyper.indices]
                shape = np.broadcast_to(hyper.shape, some.shape)
                sd[some] = hyper.scale * np.sqrt(shape)
                if len(some):
                    hypers.append(hyper._replace(indices=some, shape=shape))
        return Prior(self.neutral(), sd, tuple(hypers))

    def of_joints(self, what: str, *units: str) -> tuple[tuple[str, str, str], ...]:
        """One parameter of each joint, in a unit that all share or each has."""
        every = units * self.dof if len(units) == 1 else units
        pairs = zip(self.joint_names, every, strict=True)
        return tuple((name, f"{name}.{what}", unit) for name, unit in pairs)

    def curves(self, rms: float, pseudo: float, shape: Array) -> Iterator[Block]:
        """Blocks of the joints' error curves, of an rms [rad] that the evidence moves."""
        rms_of_wave = rms / np.sqrt(2 * HARMONICS)
        waves = [*product(("cos", "sin"), range(1, HARMONICS + 1))]
        for k, (joint, turns) in enumerate(
            zip(self.joint_names, self.revolute, strict=True)
        ):
            name = f"curve.{k}"
            if not turns:
                yield Block(name, ())
                continue
            parts = tuple(
                (joint, f"{joint}.curve {wave} {order}", "rad") for wave, order in waves
            )
            scale = Hyper(name, rms_of_wave, pseudo=pseudo, shape=shape)
            yield Block(name, parts, scales=(scale,))

    # Predictions.

    def joint_values(self, q: Array, beta: Array) -> Array:
        """True values (c, n) of the chain's joints at logged values (n, dof) [rad or m]."""
        fixed = self.fixed(beta)
        logged = np.ascontiguousarray(q.T[: self.dof])
        values = logged * fixed.gain + fixed.offset
        if fixed.coupling is not None:
            values[1:] += fixed.coupling * logged[:-1]
        if fixed.bent:
            # all at once: of one row each operation costs as much as of a hundred
            values[fixed.bent] += curve_value(logged[fixed.bent], fixed.curves)
        values = self.coupled(values)
        if fixed.elastic:
            values += self.bends(q, beta)
        return values

    def bends(self, q: Array, beta: Array) -> Array:
        """How much loads bend the chain's joints (c, n) [rad or m] at logged values (n, dof)."""
        fixed = self.fixed(beta)
        out = np.zeros((len(self.chain_names), len(q)))
        for block, elastic in fixed.elastic.items():
            levers, joints = self._levers(block, q)
            bends = elastic[:, None] * loads_of(levers, fixed.gravity)
            for joint, bend in zip(joints.tolist(), bends, strict=True):
                out[joint] += bend
        return out

    def fixed(self, beta: Array) -> Fixed:
        """What follows from parameters (d,) alone, remembered: a body's are read-only."""
        key = None if beta.flags.writeable else id(beta)
        last, fixed = self._fixed.get(key, (None, None))
        same = last is beta if key else last is not None and np.array_equal(last, beta)
        if fixed is None or not same:
            if len(self._fixed) > _BELIEFS:
                self._fixed.clear()
            fixed = self._fixed_at(beta)
            self._fixed[key] = (beta if key else beta.copy(), fixed)
        return fixed

    @cached_property
    def _fixed(self) -> dict[int | None, tuple[Array, Fixed]]:
        """What follows from parameters, by their id; of those that may change under None."""
        return {}

    @cached_property
    def _last_levers(self) -> dict[str, tuple[Array, tuple[Array, Indices]]]:
        """The last rows of each block of elasticity, and their levers."""
        return {}

    def __getstate__(self) -> dict[str, Any]:
        """What is pickled: not what is remembered."""
        forgotten = ("_fixed", "_last_levers")
        return {
            name: value for name, value in vars(self).items() if name not in forgotten
        }

    def _fixed_at(self, beta: Array) -> Fixed:
        blocks = {name: beta[indices] for name, indices in self.groups.items()}
        bent = [k for k in range(self.dof) if blocks[f"curve.{k}"].any()]
        curves = np.reshape([blocks[f"curve.{k}"] for k in bent], (-1, 2 * HARMONICS))
        gain = blocks["gain"] * self.directions
        coupling = blocks.get("coupling", np.zeros(0))
        return Fixed(
            gain=gain[:, None],
            offset=self.offsets(beta)[:, None],
            bent=bent,
            curves=curves,
            coupling=coupling[:, None] if coupling.any() else None,
            elastic={name: blocks[name] for name in self.bending if blocks[name].any()},
            gravity=self.gravity_at(beta),
            links=self.links(beta),
            blocks=blocks,
            placed=self.viewpoint.place(blocks),
        )

    def offsets(self, beta: Array) -> Array:
        """What is added to the joints' values (dof,)."""
        return beta[self.groups["offset"]]

    def coupled(self, values: Array) -> Array:
        """Values (c, n) of the chain's joints that follow the logged ones (dof, n)."""
        return values

    def led(self, chained: Array) -> Array:
        """How outputs move with each logged joint (dof, m, n), from the chain's (c, m, n)."""
        return chained

    def _levers(self, block: str, q: Array) -> tuple[Array, Indices]:
        """Levers of rows, remembered: a fit asks for the same again."""
        rows, levers = self._last_levers.get(block, (None, None))
        if levers is None or rows is not q:
            levers = self.levers(block, q[:, : self.dof])
            self._last_levers[block] = (q, levers)
        return levers

    def move(self, values: Array, beta: Array) -> Motion:
        """Where the chain is at the true values (c, n) of its joints."""
        return move(self.fixed(beta).links, values)

    def seen(self, q: Array, beta: Array) -> tuple[Motion, Sight]:
        """Where the chain is at rows (n, dof + g), and what the sensor sees of it.

        Further columns than the joints' are what a row tells the measurement.
        """
        motion = self.move(self.joint_values(q, beta), beta)
        fixed = self.fixed(beta)
        scene = Scene(fixed.blocks, fixed.placed, motion, q[:, self.dof :])
        return motion, self.measurement.look(scene)

    def sensor(self, beta: Array) -> Placed:
        """The sensor: where it stands, its scale and its lens."""
        return self.fixed(beta).placed

    def predict(self, q: Array, beta: Array) -> Array:
        """Outputs (n, m) at joint values (n, dof); a rotation is a rotation vector."""
        return self.seen(q, beta)[1].values

    def residual(self, z: Array, predicted: Array) -> Array:
        """Residuals (n, m) of observed against predicted outputs.

        Of a pose, the last three are the rotation vector, in the sensor's frame, that turns the
        predicted orientation into the observed one.
        """
        out = np.asarray(z - predicted)
        if len(self.blocks) == 2:
            out[:, 3:] = compose(z[:, 3:], -predicted[:, 3:])
        return out

    def retract(self, beta: Array, delta: Array) -> Array:
        """`beta` (d,) moved by `delta` (d,): the sum, or a step on a rotation."""
        return beta + delta

    # Derivatives.

    def linearise(
        self, q: Array, beta: Array, active: Indices | None = None
    ) -> tuple[Array, Array]:
        """Outputs (n, m) and their derivative (n, m, k) by the parameters `active` (or all)."""
        motion, sight = self.seen(q, beta)
        n, outputs = sight.values.shape
        active = np.arange(self.size) if active is None else active
        column = np.full(self.size, -1)
        column[active] = np.arange(len(active))
        out = np.zeros((n, outputs, len(active)))
        for indices, columns in self._columns(q, beta, motion, sight):
            columns_out = column[indices.ravel()]
            wanted = columns_out >= 0
            if wanted.any():
                moved = columns().reshape(len(columns_out), outputs, n)
                out[:, :, columns_out[wanted]] = moved[wanted].transpose(2, 1, 0)
        return sight.values, out

    def _columns(
        self, q: Array, beta: Array, motion: Motion, sight: Sight
    ) -> Iterator[tuple[Indices, Callable[[], Array]]]:
        """Parameters, and how outputs (..., m, n) move with them."""
        groups = self.groups
        fixed = self.fixed(beta)
        joints = q[:, : self.dof]
        for name, columns in sight.columns():
            yield groups[name], columns
        chained = sight.push(*motion.joints())
        led = self.led(chained)

        def by_loads(block: str) -> Array:
            levers, bent = self._levers(block, q)
            return np.asarray(chained[bent] * loads_of(levers, fixed.gravity)[:, None])

        for block in self.bending:
            yield groups[block], partial(by_loads, block)
        for block, ways in self.tilts.items():
            yield groups[block], partial(self._by_gravity, q, fixed, chained, ways)
        if "coupling" in groups:
            yield groups["coupling"], lambda: led[1:] * joints.T[:-1, None]
        yield groups["offset"], lambda: led
        yield groups["gain"], lambda: led * (joints * self.directions).T[:, None]
        for indices, moved in self.moving(motion):
            yield indices, partial(_pushed, sight, moved)
        for k in range(self.dof):
            yield groups[f"curve.{k}"], partial(_waved, joints[:, k], led[k])

    def predict_and_slope(self, q: Array, beta: Array) -> tuple[Array, Array]:
        """Outputs (n, m) and their derivative (n, m, dof) by the joint values."""
        motion, sight = self.seen(q, beta)
        return sight.values, self.by_joints(q, beta, sight.push(*motion.joints()))

    def by_joints(self, q: Array, beta: Array, chained: Array) -> Array:
        """Derivative (n, m, dof) by the logged joints, of outputs (c, m, n) by the chain's."""
        joints = q[:, : self.dof]
        fixed = self.fixed(beta)
        rates = fixed.gain
        if fixed.bent:
            rates = np.repeat(rates, len(q), axis=1)
            rates[fixed.bent] += curve_slope(joints.T[fixed.bent], fixed.curves)
        led = self.led(chained)
        moved = led * rates[:, None]
        if fixed.coupling is not None:
            moved[:-1] += led[1:] * fixed.coupling[:, None]
        for block, elastic in fixed.elastic.items():
            slopes = self.load_slopes(block, joints, fixed.gravity)
            bent = self._levers(block, q)[1]
            slopes = elastic[:, None, None] * slopes
            moved += np.einsum("emn,ekn->kmn", chained[bent], slopes)
        return np.ascontiguousarray(moved.transpose(2, 1, 0))

    def _by_gravity(self, q: Array, fixed: Fixed, chained: Array, ways: Array) -> Array:
        """How outputs move (t, m, n) as gravity moves along `ways` (t, g)."""
        moved = np.zeros((len(ways), *chained.shape[1:]))
        for block, elastic in fixed.elastic.items():
            levers, bent = self._levers(block, q)
            for way, out in zip(ways, moved, strict=True):
                bends = elastic[:, None] * loads_of(levers, way)
                out += (chained[bent] * bends[:, None]).sum(axis=0)
        return moved

    def slope(self, q: Array, beta: Array) -> Array:
        """Derivative (n, m, dof) of the outputs by the joint values."""
        return self.predict_and_slope(q, beta)[1]


def joined(structures: Mapping[str, S]) -> S:
    """Return the first structure with the sensors of all, which are of one chain, by name."""
    first, *further = structures.values()
    if any(type(structure) is not type(first) for structure in further):
        raise OptionError("one sensor sees a planar arm, another one an arm in space")
    sensors = tuple(
        replace(structure.viewpoint, name=name)
        for name, structure in structures.items()
    )
    return first.changed(sensors=sensors)


def _pushed(sight: Sight, moved: Callable[[], Moved]) -> Array:
    """How outputs (..., m, n) move with the tip."""
    return sight.push(*moved())


def _waved(q: Array, led: Array) -> Array:
    """How outputs (96, m, n) move with the waves of a joint (n,) that leads them (m, n)."""
    return waves_of(q)[:, None] * led


def loads_of(levers: Array, gravity: Array) -> Array:
    """Loads (e, n) of levers (e, g, n) under gravity (g,)."""
    loads: Array = levers[:, 0] * gravity[0]
    for k in range(1, len(gravity)):
        loads += levers[:, k] * gravity[k]
    return loads


class OfStructure(Gaussian):
    """A belief with the structure that its parameters are of."""

    structure: Structure
