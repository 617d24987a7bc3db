"""What a body's structure is: a chain, a measurement, and their parameters.

The fit, the gate, the bound, ``check`` and ``adapt`` know a body only through `Structure`::

    v_i = gain s q_i + offset + coupling q_(i-1) + curve_i(q_i) + sum_e elastic_e load_e(q)

with loads ``load_e = gravity . lever_e(q)``.

A vector of parameters ``beta`` (d,) always has the full layout: a block that a model does not use
(a lens, the joint curves) is there with its neutral value.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from itertools import product
from typing import Any, ClassVar, NamedTuple

import numpy as np

from ..arm.spatial_chain import Motion, move
from ..common.arrays import Array
from .curves import HARMONICS, curve_slope, curve_value, waves_of
from .parameters import Block, Gaussian, Hyper, Indices, Label, Prior
from .sensors import Viewpoint
from .views import Measurement, Moved, Placed, Sight, ViewKind, compose

Ladder = tuple[tuple[str, tuple[str, ...]], ...]
"""The gate's members from simple to rich: a name and the blocks that it frees."""


Moving = Iterator[tuple[Indices, Callable[[], Moved]]]
"""Parameters of a chain's geometry, and how the tip moves with each of them."""


class Fixed(NamedTuple):
    """What follows from the parameters alone, whatever the joints are."""

    gain: Array  # (dof, 1), with each joint's direction
    offset: Array  # (dof, 1) [rad or m]
    bent: list[int]  # joints that have an error curve
    curves: Array  # (k, 96) [rad]
    coupling: (
        Array | None
    )  # (dof - 1, 1), None where no joint moves with its neighbour's motor
    elastic: Mapping[str, Array]  # (e,) of each block by which joints bend, if they do
    gravity: Array  # (g,), what a load is of its levers
    links: Any  # of the chain
    own: Mapping[
        str, Any
    ]  # all parameters, by block, and what follows from the sensor's


class Structure:
    """A chain and what a sensor measures of it.

    ``n`` rows, ``dof`` joints, ``m`` outputs, ``d`` parameters, ``c`` joints of the chain.  Joint
    values are in rad or m as they are logged; positions in the structure's own unit.
    """

    kind: ClassVar[
        str
    ]  # ``"planar"`` or ``"spatial"``: how a model file finds the class again
    # rows that the gate and the evidence use; the rest enters the final step
    gate_rows: ClassVar[int]
    # wider hyperprior of the curves for a second fit: pseudo-observations, rms [rad]
    wide: ClassVar[tuple[float, float]]
    # rows below which held-out errors scale the second fit's spread
    few_rows: ClassVar[int]
    joint_names: tuple[str, ...]  # names of the joints, base to tip
    chain_names: tuple[str, ...]  # names of all joints (c,) of the chain
    revolute: tuple[bool, ...]  # which joints turn; the others slide
    view: str  # one of :data:`calib.body.views.PLANAR` or `SPATIAL`
    unit: str  # unit of positions
    extent: float  # size of the workspace along an output [unit]
    simulated: bool  # whether the rows are samples of a simulation
    # whether the geometry is as drawn, and only joints' zeros are not
    zeros_alone: bool
    # of several sensors, see `calib.body.sensors`: the name and the place of the one that it sees
    # as, and the others in their order
    sensor_name: str
    place: int
    beside: tuple[Viewpoint, ...]

    @property
    def dof(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    @property
    def seen_as(self) -> ViewKind:
        """The kind of its sensor."""
        raise NotImplementedError

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

    # What the kinds of chains give.

    @property
    def viewpoint(self) -> Viewpoint:
        """What it says of the sensor that it sees as."""
        raise NotImplementedError

    @cached_property
    def measurement(self) -> Measurement:
        """What its sensor measures."""
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
        """The blocks of the sensor, the geometry and the joints."""
        return (*self.measurement.parameters(), *self.geometry())

    @cached_property
    def labels(self) -> tuple[Label, ...]:
        """What each parameter (d,) is."""
        return tuple(
            Label(block.name, *part) for block in self.layout for part in block.parts
        )

    @cached_property
    def groups(self) -> Mapping[str, Indices]:
        """Indices of the parameters of each block, by its name."""
        ends = np.cumsum([len(block.parts) for block in self.layout])
        pairs = zip(self.layout, ends, strict=True)
        return {each.name: np.arange(end - len(each.parts), end) for each, end in pairs}

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
        hypers = []
        for block in self.layout:
            if block.name in free or (
                "curve" in free and block.name.startswith("curve.")
            ):
                own = self.groups[block.name]
                sd[own] = block.sd
                for each in block.scales:
                    at = own if each.indices is None else own[each.indices]
                    shape = np.ones(len(at)) if each.shape is None else each.shape
                    sd[at] = each.scale * np.sqrt(shape)
                    if len(at):
                        hypers.append(each._replace(indices=at, shape=shape))
        return Prior(self.neutral(), sd, tuple(hypers))

    def of_joints(self, what: str, *units: str) -> tuple[tuple[str, str, str], ...]:
        """One parameter of each joint, in a unit that all share or each has."""
        every = units * self.dof if len(units) == 1 else units
        pairs = zip(self.joint_names, every, strict=True)
        return tuple((name, f"{name}.{what}", unit) for name, unit in pairs)

    def curves(self, rms: float, pseudo: float, shape: Array) -> Iterator[Block]:
        """Blocks of the joints' error curves, of an rms [rad] that the evidence moves."""
        for k, (name, turns) in enumerate(
            zip(self.joint_names, self.revolute, strict=True)
        ):
            waves = product(("cos", "sin"), range(1, HARMONICS + 1 if turns else 1))
            parts = tuple(
                (name, f"{name}.curve {wave} {order}", "rad") for wave, order in waves
            )
            scale = Hyper(
                f"curve.{k}", rms / np.sqrt(2 * HARMONICS), pseudo=pseudo, shape=shape
            )
            yield Block(f"curve.{k}", parts, scales=(scale,) if turns else ())

    # Predictions.

    def joint_values(self, q: Array, beta: Array) -> Array:
        """True values (c, n) of the chain's joints at logged values (n, dof) [rad or m]."""
        fixed = self.fixed(beta)
        logged = np.ascontiguousarray(q.T[: self.dof])
        own = logged * fixed.gain + fixed.offset
        if fixed.coupling is not None:
            own[1:] += fixed.coupling * logged[:-1]
        if (
            fixed.bent
        ):  # all at once: of one row each operation costs as much as of a hundred
            own[fixed.bent] += curve_value(logged[fixed.bent], fixed.curves)
        values = self.coupled(own)
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
        """What follows from parameters (d,) alone, kept: those of a body are read-only."""
        key = None if beta.flags.writeable else id(beta)
        last = self._kept.get(key)
        if last is None or not (
            last[0] is beta if key else np.array_equal(last[0], beta)
        ):
            if len(self._kept) > 8:  # beliefs
                self._kept.clear()
            own = beta if key else beta.copy()
            last = self._kept[key] = (own, self._fixed(own))
        found: Fixed = last[1]
        return found

    @cached_property
    def _kept(self) -> dict[Any, tuple[Array, Any]]:
        """What follows from parameters, by their id, and from the last rows."""
        return {}

    def __getstate__(self) -> dict[str, Any]:
        """What is pickled: not what is kept."""
        return {name: own for name, own in vars(self).items() if name != "_kept"}

    def _fixed(self, beta: Array) -> Fixed:
        own = {name: beta[indices] for name, indices in self.groups.items()}
        bent = [k for k in range(self.dof) if own[f"curve.{k}"].any()]
        curves = np.reshape([own[f"curve.{k}"] for k in bent], (-1, 2 * HARMONICS))
        gain = own["gain"] * self.directions
        coupling = own.get("coupling", np.zeros(0))
        return Fixed(
            gain=gain[:, None],
            offset=self.offsets(beta)[:, None],
            bent=bent,
            curves=curves,
            coupling=coupling[:, None] if coupling.any() else None,
            elastic={block: own[block] for block in self.bending if own[block].any()},
            gravity=self.gravity_at(beta),
            links=self.links(beta),
            own={**own, "placed": self.measurement.placed(own)},
        )

    def offsets(self, beta: Array) -> Array:
        """What is added to the joints' values (dof,)."""
        return beta[self.groups["offset"]]

    def coupled(self, own: Array) -> Array:
        """Values (c, n) of the chain's joints that follow the logged ones (dof, n)."""
        return own

    def led(self, chained: Array) -> Array:
        """How outputs move with each logged joint (dof, m, n), from the chain's (c, m, n)."""
        return chained

    def _levers(self, block: str, q: Array) -> tuple[Array, Indices]:
        """Levers of rows, kept: a fit asks for the same again."""
        last = self._kept.get(block)
        if last is None or last[0] is not q:
            last = self._kept[block] = (q, self.levers(block, q[:, : self.dof]))
        levers: tuple[Array, Indices] = last[1]
        return levers

    def move(self, values: Array, beta: Array) -> Motion:
        """Where the chain is at the true values (c, n) of its joints."""
        return move(self.fixed(beta).links, values)

    def seen(self, q: Array, beta: Array) -> tuple[Motion, Sight]:
        """Where the chain is at rows (n, dof + g), and what the sensor sees of it.

        Further columns than the joints' are what a row tells the measurement.
        """
        motion = self.move(self.joint_values(q, beta), beta)
        return motion, self.measurement.look(
            self.fixed(beta).own, motion, q[:, self.dof :]
        )

    def sensor(self, beta: Array) -> Placed:
        """The sensor: where it stands, its scale and its lens."""
        placed: Placed = self.fixed(beta).own["placed"]
        return placed

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
        groups = self.groups
        place = np.full(self.size, -1)
        place[active] = np.arange(len(active))
        out = np.zeros((n, outputs, len(active)))

        def put(indices: Indices, columns: Callable[[], Array]) -> None:
            """Set the columns (..., outputs, n) of parameters, if one of them is asked for."""
            stands = place[indices.ravel()]
            asked = stands >= 0
            if asked.any():
                found = columns().reshape(len(stands), outputs, n)
                out[:, :, stands[asked]] = found[asked].transpose(2, 1, 0)

        for name, own in sight.columns():
            put(groups[name], own)
        joints = q[:, : self.dof]
        chained = sight.push(*motion.joints())
        led = self.led(chained)

        fixed = self.fixed(beta)

        def by_loads(block: str) -> Array:
            levers, bent = self._levers(block, q)
            return np.asarray(chained[bent] * loads_of(levers, fixed.gravity)[:, None])

        for block in self.bending:
            put(groups[block], lambda block=block: by_loads(block))  # type: ignore[misc]
        for group, ways in self.tilts.items():
            put(
                groups[group],
                lambda ways=ways: self._by_gravity(  # type: ignore[misc]
                    q, fixed, chained, ways
                ),
            )
        if "coupling" in groups:
            put(groups["coupling"], lambda: led[1:] * joints.T[:-1, None])
        put(groups["offset"], lambda: led)
        put(groups["gain"], lambda: led * (joints * self.directions).T[:, None])
        for indices, moved in self.moving(motion):
            put(indices, lambda moved=moved: sight.push(*moved()))  # type: ignore[misc]
        for k, q_k in enumerate(joints.T):
            put(
                groups[f"curve.{k}"],
                lambda k=k, q_k=q_k: (  # type: ignore[misc]
                    waves_of(q_k)[:, None] * led[k]
                ),
            )
        return sight.values, out

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
            slopes = elastic[:, None, None] * self.load_slopes(
                block, joints, fixed.gravity
            )
            bent = self._levers(block, q)[1]
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


def loads_of(levers: Array, gravity: Array) -> Array:
    """Loads (e, n) of levers (e, g, n) under gravity (g,)."""
    loads: Array = levers[:, 0] * gravity[0]
    for k in range(1, len(gravity)):
        loads += levers[:, k] * gravity[k]
    return loads


class OfStructure(Gaussian):
    """A belief with the structure that its parameters are of."""

    structure: Structure
