"""Structure: what a chain and its sensors predict at their parameters, and the derivatives.

The fit, the gate, the bound, ``check`` and ``adapt`` know a body only through `Structure`.  Three
steps lead from logged joint values q to outputs z::

    joints   v_i = gain s q_i + offset + coupling q_(i-1) + curve_i(q_i) + sum_e elastic_e load_e(q)
    chain    state = chain(v), with the tip's position and orientation
    sensor   z = sight(state)

with directions s = 1, -1 and loads ``load_e = gravity . lever_e(q)``.  Derivatives are products of
those of the steps; ``chain_slope`` is dz/dv, of all joints of the chain.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache, partial
from typing import Any, NamedTuple, TypeVar

import numpy as np

from ..arm.spatial_chain import ChainState, move
from ..common.arrays import Array, Mask
from .curves import (
    HARMONICS,
    ORDERS,
    Amplitudes,
    amplitudes_of,
    curve_value,
    waves_of,
)
from .layout import Layout
from .loads import BendingLoads, loads_at
from .parameters import Gaussian, Indices
from .sensors import InSpace, Sensor
from .views import Projection, Sight, TipMotion, compose

TipMotions = Iterator[tuple[Indices, Callable[[], TipMotion]]]
"""Parameters of a chain's geometry, and how the tip moves with them."""

_BELIEFS = 16  # whose constants are remembered
_STEP = 1e-4  # of a sensor's parameters, in derivatives

StructureT = TypeVar("StructureT", bound="Structure")


class Constants(NamedTuple):
    """Numbers that follow from the parameters alone, not from the joints."""

    gain: Array  # (dof, 1), with each joint's direction
    offset: Array  # (dof, 1) [rad or m]
    bent: list[int]  # joints that have an error curve
    curves: Amplitudes  # (k, 48) [rad]
    curve_rates: Amplitudes  # (k, 48) [rad/rad]
    # (dof - 1, 1), None where no joint moves with its neighbour's motor
    coupling: Array | None
    # (e,) of each block of elasticity that bends joints
    elastic: Mapping[str, Array]
    gravity: Array  # (g,), factors of a load on its levers
    links: Any  # of the chain
    sensor: Projection
    blocks: Mapping[str, Array]  # all parameters


class Structure(Layout):
    """A chain and what a sensor measures of it.

    ``n`` rows, ``dof`` joints, ``m`` outputs, ``d`` parameters, ``c`` joints of the chain, ``e``
    loads under a gravity of ``g`` numbers, ``a`` further facts of a row.  Joint
    values are in rad or m as they are logged; positions in the structure's own unit.
    """

    # What the kinds of chains give.

    @property
    def directions(self) -> tuple[int, ...]:
        """How each joint (dof,) moves with its log, 1 or -1."""
        return (1,) * self.dof

    @property
    def is_reversed(self) -> Mask:
        """Which joints (dof,) turn against their drawing."""
        return np.less(self.directions, 0)

    @property
    def senses(self) -> Array:
        """Signs (d,) of changes of parameters as they are told: offsets add to logged values."""
        senses = np.ones(self.size)
        senses[self.groups["offset"]] = self.directions
        return senses

    def zeros(self, beta: Array) -> Array:
        """What is added to the joints' logged values (dof,), beyond the drawing [rad or m]."""
        deviation = self.senses * (beta - self.neutral())
        return deviation[self.groups["offset"]]

    def offsets(self, beta: Array) -> Array:
        """Offsets that are added to the joints' values (dof,)."""
        return beta[self.groups["offset"]]

    def chain_values(self, values: Array) -> Array:
        """Values (c, n) of the chain's joints that follow the logged ones (dof, n)."""
        return values

    def joint_slope(self, chain_slope: Array) -> Array:
        """How outputs move with each logged joint (dof, m, n), from the chain's (c, m, n)."""
        return chain_slope

    def links(self, beta: Array) -> Any:
        """The links of the chain at its parameters, for `move`."""
        raise NotImplementedError

    def tip_motions(self, state: ChainState) -> TipMotions:
        """How the tip moves with each part of the geometry."""
        raise NotImplementedError

    @property
    def loads(self) -> Mapping[str, BendingLoads]:
        """Loads that bend the joints, by the block of elasticity with a parameter for each."""
        raise NotImplementedError

    @property
    def tilts(self) -> Mapping[str, Array]:
        """Blocks that tilt gravity, and the ways (t, g) in which their parameters move it."""
        return {}

    def gravity_at(self, beta: Array) -> Array:  # noqa: ARG002
        """Factors (g,) of loads on their levers, at parameters (d,)."""
        return np.ones(1)

    # Predictions.

    def joint_values(self, q: Array, beta: Array) -> Array:
        """True values (c, n) of the chain's joints at logged values (n, dof) [rad or m]."""
        constants = constants_at(self, beta)
        logged = np.ascontiguousarray(q.T[: self.dof])
        values = logged * constants.gain
        values += constants.offset
        coupling = constants.coupling
        if coupling is not None:
            values[1:] += coupling * logged[:-1]
        bent = constants.bent
        if bent:
            values[bent] += curve_value(logged[bent], constants.curves)
        values = self.chain_values(values)
        if constants.elastic:
            values += self.bends(q, beta)
        return values

    def bends(
        self, q: Array, beta: Array, gravity: Array | None = None
    ) -> Array:
        """How much loads bend the chain's joints (c, n) [rad or m] at logged values (n, dof).

        gravity : (g,), by default that of the parameters
        """
        constants = constants_at(self, beta)
        if gravity is None:
            gravity = constants.gravity
        joints = len(self.chain_names)
        bends = np.zeros((joints, len(q)))
        for block, elastic in constants.elastic.items():
            loads = self._loads(block, q, gravity)
            angles = elastic[:, None] * loads
            np.add.at(bends, self.loads[block].joints, angles)
        return bends

    def _loads(self, block: str, q: Array, gravity: Array) -> Array:
        """Loads (e, n) of a block of elasticity at rows (n, dof + a)."""
        return loads_at(self.loads[block], q[:, : self.dof], gravity)

    def move(self, values: Array, beta: Array) -> ChainState:
        """Where the chain is at the true values (c, n) of its joints."""
        return move(constants_at(self, beta).links, values)

    def state_and_sight(
        self, q: Array, beta: Array
    ) -> tuple[ChainState, Sight]:
        """The chain's state at rows (n, dof + a), and its reading by the sensor.

        The columns after the joints are further facts of a row, for its measurement.
        """
        constants = constants_at(self, beta)
        values = self.joint_values(q, beta)
        state = self.move(values, beta)
        if isinstance(self.measurement, Sensor):
            return state, constants.sensor.look(state)
        row_facts = q[:, self.dof :]
        return state, self.measurement.look(constants.blocks, state, row_facts)

    def sensor(self, beta: Array) -> Projection:
        """The sensor with its place, its scale and its lens."""
        return constants_at(self, beta).sensor

    def predict(self, q: Array, beta: Array) -> Array:
        """Outputs (n, m) at joint values (n, dof); a rotation is a rotation vector."""
        _, sight = self.state_and_sight(q, beta)
        return sight.values

    def residual(self, z: Array, predicted: Array) -> Array:
        """Residuals (n, m): observed minus predicted outputs.

        Of a pose, the last three are the rotation vector, in the sensor's frame, that turns the
        predicted orientation into the observed one.
        """
        out = np.asarray(z - predicted)
        if len(self.output_sizes) == 2:
            observed = z[:, 3:]
            back = -predicted[:, 3:]
            out[:, 3:] = compose(observed, back)
        return out

    def retract(self, beta: Array, delta: Array) -> Array:
        """`beta` (d,) moved by `delta` (d,): the sum, or a step on a rotation."""
        return beta + delta

    def after_step(
        self, beta: Array, indices: Indices | int, step: Array | float
    ) -> Array:
        """`beta` (d,) moved by a step (k,) of some parameters."""
        delta = np.zeros(self.size)
        delta[indices] = step
        return self.retract(beta, delta)

    # Derivatives.

    def linearise(
        self, q: Array, beta: Array, active: Indices | None = None
    ) -> tuple[Array, Array]:
        """Outputs (n, m) and their derivative (n, m, k) by the parameters `active` (or all)."""
        state, sight = self.state_and_sight(q, beta)
        n, outputs = sight.values.shape
        if active is None:
            active = np.arange(self.size)
        column = np.full(self.size, -1)  # of each parameter in the derivative
        column[active] = np.arange(len(active))
        slopes = np.zeros((len(active), outputs, n))
        for indices, derivative in self._columns(q, beta, state, sight):
            columns = column[indices.ravel()]
            is_active = columns >= 0
            if is_active.any():
                part = derivative().reshape(len(columns), outputs, n)
                slopes[columns[is_active]] = part[is_active]
        return sight.values, slopes.transpose(2, 1, 0)

    def _columns(
        self, q: Array, beta: Array, state: ChainState, sight: Sight
    ) -> Iterator[tuple[Indices, Callable[[], Array]]]:
        """Parameters, and how outputs (..., m, n) move with them."""
        groups = self.groups
        motions: Mapping[str, TipMotion] = {}
        if isinstance(self.measurement, InSpace):
            motions = self.sensor(beta).tip_motions(state.position)
        for name, motion in motions.items():
            yield groups[name], partial(sight.push, *motion)
        for name in self.sensor_blocks:
            if name not in motions:
                by_sensor = partial(self._by_sensor, name, q, state, beta)
                yield groups[name], by_sensor
        chain_slope = sight.push(*state.joints())
        for block in self.loads:
            by_loads = partial(self._by_loads, block, q, beta, chain_slope)
            yield groups[block], by_loads
        if "gravity" in groups:
            by_gravity = partial(self._by_gravity, q, beta, chain_slope)
            yield groups["gravity"], by_gravity
        joint_slope = self.joint_slope(chain_slope)
        joints = q[:, : self.dof]
        if "coupling" in groups:
            motors = joints.T[:-1, None]
            yield groups["coupling"], lambda: joint_slope[1:] * motors
        signed = (joints * self.directions).T
        yield groups["offset"], lambda: joint_slope
        yield groups["gain"], lambda: joint_slope * signed[:, None]
        for indices, tip_motion in self.tip_motions(state):
            yield indices, partial(_by_tip, sight, tip_motion)
        for k in range(self.dof):
            by_curve = partial(_by_curve, joints[:, k], joint_slope[k])
            yield groups[f"curve.{k}"], by_curve

    def _by_loads(
        self, block: str, q: Array, beta: Array, chain_slope: Array
    ) -> Array:
        """How outputs (e, m, n) move with the elasticity under each load of a block."""
        gravity = constants_at(self, beta).gravity
        loads = self._loads(block, q, gravity)
        bent_slope = chain_slope[self.loads[block].joints]
        return bent_slope * loads[:, None]

    def _by_gravity(self, q: Array, beta: Array, chain_slope: Array) -> Array:
        """How outputs (t, m, n) move as gravity tilts."""
        bends = [self.bends(q, beta, tilt) for tilt in self.tilts["gravity"]]
        slopes: Array = np.einsum("cmn,tcn->tmn", chain_slope, bends)
        return slopes

    def _by_sensor(
        self, block: str, q: Array, state: ChainState, beta: Array
    ) -> Array:
        """How outputs (k, m, n) move with a block of the sensor's parameters, by differences."""
        blocks = constants_at(self, beta).blocks
        indices = self.groups[block]
        row_facts = q[:, self.dof :]

        def outputs_after(index: int, step: float) -> Array:
            moved = self.after_step(beta, index, step)[indices]
            stepped = {**blocks, block: moved}
            return self.measurement.look(stepped, state, row_facts).values

        slopes: list[Array] = []
        for index in indices.tolist():
            ahead = outputs_after(index, _STEP)
            behind = outputs_after(index, -_STEP)
            slopes.append(self.residual(ahead, behind).T)
        return np.array(slopes) / (2 * _STEP)

    def by_blocks(self, beta: Array) -> dict[str, Array]:
        """Parameters (d,) by block."""
        return {name: beta[indices] for name, indices in self.groups.items()}

    def predict_and_slope(self, q: Array, beta: Array) -> tuple[Array, Array]:
        """Outputs (n, m) and their derivative (n, m, dof) by the joint values."""
        state, sight = self.state_and_sight(q, beta)
        chain_slope = sight.push(*state.joints())
        slope = self.by_joints(q, beta, chain_slope)
        return sight.values, slope

    def by_joints(self, q: Array, beta: Array, chain_slope: Array) -> Array:
        """Derivative (n, m, dof) by the logged joints, of outputs (c, m, n) by the chain's."""
        joints = q[:, : self.dof]
        constants = constants_at(self, beta)
        rates = constants.gain  # of a joint's value by its own log
        bent = constants.bent
        if bent:
            rates = np.repeat(rates, len(q), axis=1)
            logged = joints.T[bent]
            rates[bent] += curve_value(logged, constants.curve_rates)
        joint_slope = self.joint_slope(chain_slope)
        slopes = joint_slope * rates[:, None]
        coupling = constants.coupling
        if coupling is not None:
            slopes[:-1] += joint_slope[1:] * coupling[:, None]
        for block, elastic in constants.elastic.items():
            loads = self.loads[block]
            load_slopes = loads.slopes(joints, constants.gravity)
            bends = elastic[:, None, None] * load_slopes
            bent_slope = chain_slope[loads.joints]
            slopes += np.einsum("emn,ekn->kmn", bent_slope, bends)
        return np.ascontiguousarray(slopes.transpose(2, 1, 0))

    def slope(self, q: Array, beta: Array) -> Array:
        """Derivative (n, m, dof) of the outputs by the joint values."""
        _, slope = self.predict_and_slope(q, beta)
        return slope


def _by_tip(sight: Sight, tip_motion: Callable[[], TipMotion]) -> Array:
    """How outputs (..., m, n) move with parameters that move the tip."""
    velocity, angular = tip_motion()
    return sight.push(velocity, angular)


def _by_curve(q: Array, joint_slope: Array) -> Array:
    """How outputs (96, m, n) move with the waves of a joint (n,), which moves them by (m, n)."""
    return waves_of(q)[:, None] * joint_slope


def constants_at(structure: Structure, beta: Array) -> Constants:
    """The constants of a structure at parameters (d,), remembered."""
    return _constants(structure, beta.tobytes())


@lru_cache(_BELIEFS)
def _constants(structure: Structure, parameters: bytes) -> Constants:
    beta = np.frombuffer(parameters)
    blocks = structure.by_blocks(beta)
    joints = range(structure.dof)
    bent = [joint for joint in joints if blocks[f"curve.{joint}"].any()]
    curves = [blocks[f"curve.{joint}"] for joint in bent]
    amplitudes = amplitudes_of(np.reshape(curves, (-1, 2 * HARMONICS)))
    gain = blocks["gain"] * structure.directions
    offset = structure.offsets(beta)
    coupling = blocks.get("coupling", np.zeros(0))
    elastic = {
        name: blocks[name] for name in structure.loads if blocks[name].any()
    }
    return Constants(
        gain=gain[:, None],
        offset=offset[:, None],
        bent=bent,
        curves=amplitudes,
        curve_rates=1j * ORDERS * amplitudes,
        coupling=coupling[:, None] if coupling.any() else None,
        elastic=elastic,
        gravity=structure.gravity_at(beta),
        links=structure.links(beta),
        sensor=structure.viewpoint.projection(blocks),
        blocks=blocks,
    )


class OfStructure(Gaussian):
    """A belief with the structure of its parameters."""

    structure: Structure
