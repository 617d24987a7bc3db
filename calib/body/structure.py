"""What a body's structure is: a chain, a measurement, and their parameters.

The fit, the gate, the bound, ``check`` and ``adapt`` know a body only through `Structure`.  A
chain says how each of its parts moves the tip, a measurement what a sensor tells of the tip;
joints, their error curves and their elasticity are the same for all arms::

    v_i = gain s q_i + offset + curve_i(q_i) + sum_e elastic_e load_e(q)

A structure is immutable.  Its vector of parameters ``beta`` (d,) always has the full layout: a
block that a model does not use (a lens, the joint curves) is there with its neutral value.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from itertools import product
from typing import Any, ClassVar, NamedTuple, TypeVar

import numpy as np

from ..common.arrays import Array
from . import parameters
from .curves import HARMONICS, ORDERS, curve_value, powers
from .derivative import Derivative, Waves
from .measurement import Measurement, Moved, Sight, TipMotion
from .parameters import Block, Gaussian, Hyper, Indices, Label, Layout, Part, Prior
from .views import VIEWS_OF_BODIES, ViewKind

_BELIEFS = 8  # whose constants are kept: a body's two fits, the drawing

_T = TypeVar("_T")

Ladder = tuple[tuple[str, tuple[str, ...]], ...]
"""The gate's members from simple to rich: a name and the blocks that it frees."""


class Fixed(NamedTuple):
    """What follows from the parameters alone, whatever the joints are."""

    gain: Array  # (dof, 1), with each joint's direction
    offset: Array  # (dof, 1) [rad or m]
    bent: list[int]  # joints that have an error curve
    curves: Array  # (k, 96) [rad]
    slopes: Array  # (k, 96), coefficients of their derivatives
    elastic: Array | None  # (e, 1), None where nothing bends
    chain: Any  # of the chain
    sensor: Any  # of the measurement


class Structure:
    """A chain and what a sensor measures of it.

    ``n`` rows, ``dof`` joints, ``m`` outputs, ``d`` parameters, ``c`` joints of the chain.  Joint
    values are in rad or m as they are logged; positions in the structure's own unit.
    """

    kind: ClassVar[str]  # ``"planar"`` or ``"spatial"``: how a model file finds the class again
    # rows that the gate and the evidence use; the rest enters the final step
    gate_rows: ClassVar[int]
    # wider hyperprior of the curves for a second fit: pseudo-observations, rms [rad]
    wide: ClassVar[tuple[float, float]]
    joint_names: tuple[str, ...]  # names of the joints, base to tip
    revolute: tuple[bool, ...]  # which joints turn; the others slide
    view: str  # one of :data:`calib.body.views.PLANAR` or `SPATIAL`
    unit: str  # unit of positions
    extent: float  # size of the workspace along an output [unit]
    simulated: bool  # whether the rows are samples of a simulation

    @property
    def dof(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    @property
    def seen_as(self) -> ViewKind:
        """The kind of its sensor."""
        return VIEWS_OF_BODIES[self.kind][self.view]

    @property
    def outputs(self) -> int:
        """Number m of outputs: 2 in the plane or pixels, 3 in space, 6 with orientation."""
        return self.seen_as.outputs

    @property
    def blocks(self) -> tuple[int, ...]:
        """Sizes of the outputs that share a unit and a noise: ``(2,)``, ``(3,)``, ``(3, 3)``."""
        return self.measurement.blocks

    @property
    def extents(self) -> Array:
        """Size (m,) of the workspace along the outputs [unit]; 1 rad for rotations."""
        out = np.full(self.outputs, self.extent)
        out[3:] = 1.0
        return out

    @property
    def directions(self) -> Sequence[int]:
        """Which way each joint (dof,) turns against its log, 1 or -1."""
        return (1,) * self.dof

    # What the kinds of chains give.

    @cached_property
    def measurement(self) -> Measurement:
        """What its sensor measures."""
        raise NotImplementedError

    def geometry(self) -> Sequence[Block]:
        """Blocks of the chain's geometry and of its joints' offsets."""
        raise NotImplementedError

    def move(self, values: Array, beta: Array) -> TipMotion:
        """Where the chain is at the true values (c, n) of its joints."""
        raise NotImplementedError

    def moving(self, motion: TipMotion) -> Iterator[tuple[Indices, Callable[[], Moved]]]:
        """How the tip moves with each part of the geometry: parameters, and their motions."""
        raise NotImplementedError

    def loads(self, q: Array) -> tuple[Array, Indices]:
        """Loads (e, n) that bend joints, one for each elastic parameter, and which joints (e,)."""
        raise NotImplementedError

    def members(self) -> Ladder:
        """The gate's members from simple to rich."""
        raise NotImplementedError

    # Parameters.

    @cached_property
    def _blocks(self) -> tuple[Block, ...]:
        """The blocks of the sensor, the geometry and the joints."""
        return (*self._sensor, *self.geometry())

    @cached_property
    def layout(self) -> Layout:
        """Where each parameter stands, and what it is."""
        return parameters.layout_of(tuple((block.name, block.parts) for block in self._blocks))

    @property
    def groups(self) -> Mapping[str, Indices]:
        """Indices of the parameters of each block, by its name."""
        return self.layout.groups

    @property
    def size(self) -> int:
        """Number d of parameters."""
        return self.layout.size

    def label(self, index: int) -> Label:
        """What parameter `index` is."""
        return self.layout.labels[index]

    def neutral(self) -> Array:
        """Parameters (d,) at the mean of the prior."""
        out = np.empty(self.size)
        for block in self._blocks:
            out[self.groups[block.name]] = block.mean
        return out

    def prior(self, free: Sequence[str]) -> Prior:
        """Prior that frees the blocks of `free`; ``"curve"`` stands for all joints' curves."""
        return parameters.prior_of(self._blocks, self.layout, self.neutral(), free)

    def of_joints(self, what: str, *units: str) -> tuple[Part, ...]:
        """One parameter of each joint, in a unit that all share or each has."""
        every = units * self.dof if len(units) == 1 else units
        pairs = zip(self.joint_names, every, strict=True)
        return tuple((name, f"{name}.{what}", unit) for name, unit in pairs)

    def curves(self, rms: float, pseudo: float, shape: Array) -> Iterator[Block]:
        """Blocks of the joints' error curves, of an rms [rad] that the evidence moves."""
        for k, (name, turns) in enumerate(zip(self.joint_names, self.revolute, strict=True)):
            waves = product(("cos", "sin"), range(1, HARMONICS + 1 if turns else 1))
            parts = tuple((name, f"{name}.curve {wave} {order}", "rad") for wave, order in waves)
            scale = Hyper(f"curve.{k}", rms / np.sqrt(2 * HARMONICS), pseudo=pseudo, shape=shape)
            yield Block(f"curve.{k}", parts, scales=(scale,) if turns else ())

    # Predictions.

    def joint_values(self, q: Array, beta: Array) -> Array:
        """True values (c, n) of the chain's joints at logged values (n, dof) [rad or m]."""
        fixed = self.fixed(beta)
        own = np.ascontiguousarray(q.T) * fixed.gain + fixed.offset
        if fixed.bent:  # all at once: of one row each operation costs as much as of a hundred
            own[fixed.bent] += curve_value(q.T[fixed.bent], fixed.curves)
        values = self.coupled(own)
        if fixed.elastic is not None:
            loads, joints = self._remembered(self.loads, q)
            for joint, load in zip(joints.tolist(), fixed.elastic * loads, strict=True):
                values[joint] += load
        return values

    def fixed(self, beta: Array) -> Fixed:
        """What follows from parameters (d,) alone, kept: those of a body are read-only."""
        key = None if beta.flags.writeable else id(beta)
        last = self._kept.get(key)
        if last is None or not (last[0] is beta if key else np.array_equal(last[0], beta)):
            if len(self._kept) > _BELIEFS:
                self._kept.clear()
            own = beta if key else beta.copy()
            last = self._kept[key] = (own, self._fixed(own))
        return last[1]

    @cached_property
    def _kept(self) -> dict[int | None, tuple[Array, Fixed]]:
        return {}

    def _fixed(self, beta: Array) -> Fixed:
        groups = self.groups
        each = [beta[groups[f"curve.{k}"]] for k in range(self.dof)]
        bent = [k for k, curve in enumerate(each) if curve.any()]
        curves = np.reshape([each[k] for k in bent], (-1, 2 * HARMONICS))
        a, b = ORDERS * curves[:, :HARMONICS], ORDERS * curves[:, HARMONICS:]
        elastic = beta[groups["elastic"], None]
        return Fixed(
            (beta[groups["gain"]] * self.directions)[:, None], self.offsets(beta)[:, None],
            bent, curves, np.concatenate([b, -a], axis=1), elastic if elastic.any() else None,
            self.chained(beta), self.measurement.ready(self.seeing(beta)),
        )  # fmt: skip

    def chained(self, beta: Array) -> Any:
        """What `move` needs of the parameters."""
        raise NotImplementedError

    def offsets(self, beta: Array) -> Array:
        """What is added to the joints' values (dof,)."""
        return beta[self.groups["offset"]]

    def coupled(self, own: Array) -> Array:
        """Values (c, n) of the chain's joints that follow the logged ones (dof, n)."""
        return own

    @cached_property
    def _memory(self) -> dict[Callable[[Array], Any], tuple[Array, Any]]:
        return {}

    def _remembered(self, what: Callable[[Array], _T], q: Array) -> _T:
        """What is computed of rows: a fit asks for the same again."""
        last = self._memory.get(what)
        if last is None or last[0] is not q:
            last = self._memory[what] = (q, what(q))
        found: _T = last[1]
        return found

    def apart(self, q: Array) -> tuple[Array, Array]:
        """Joint values (n, dof) of rows, and what else they tell the measurement (n, g)."""
        if q.shape[1] == self.dof:
            return q, q[:, :0]
        return self._remembered(self._parts, q)

    def _parts(self, q: Array) -> tuple[Array, Array]:
        return np.ascontiguousarray(q[:, : self.dof]), q[:, self.dof :]

    def seen(self, q: Array, beta: Array) -> tuple[TipMotion, Sight]:
        """Where the chain is at rows (n, dof + g), and what the sensor sees of it."""
        joints, also = self.apart(q)
        motion = self.move(self.joint_values(joints, beta), beta)
        return motion, self.measurement.look(self.fixed(beta).sensor, motion, also)

    def seeing(self, beta: Array) -> dict[str, Array]:
        """Values of the sensor's own parameters, by block."""
        return {block.name: beta[self.groups[block.name]] for block in self._sensor}

    @cached_property
    def _sensor(self) -> tuple[Block, ...]:
        return self.measurement.parameters()

    def predict(self, q: Array, beta: Array) -> Array:
        """Outputs (n, m) at joint values (n, dof); a rotation is a rotation vector."""
        return self.seen(q, beta)[1].values

    def residual(self, z: Array, predicted: Array) -> Array:
        """Residuals (n, m) of observed against predicted outputs."""
        return self.measurement.residual(z, predicted)

    def retract(self, beta: Array, delta: Array) -> Array:
        """`beta` (d,) moved by `delta` (d,): the sum, or a step on a rotation."""
        return beta + delta

    # Derivatives.

    def linearise(
        self, q: Array, beta: Array, active: Indices | None = None
    ) -> tuple[Array, Array]:
        """Outputs (n, m) and their derivative (n, m, k) by the parameters `active` (or all)."""
        values, x = self.derivative(q, beta, np.arange(self.size) if active is None else active)
        return values, x.dense()

    def derivative(self, q: Array, beta: Array, active: Indices) -> tuple[Array, Derivative]:
        """The same with the derivative's structure."""
        motion, sight = self.seen(q, beta)
        q = self.apart(q)[0]
        n, outputs = sight.values.shape
        groups, place, wanted = self.groups, *np.full((2, self.size), -1)
        place[active] = np.arange(len(active))
        curves = [groups[f"curve.{k}"] for k in range(self.dof)]
        bare = np.flatnonzero(~np.isin(active, np.concatenate(curves)))
        wanted[active[bare]] = np.arange(len(bare))
        out = np.zeros((n, outputs, len(bare)))

        def put(indices: Indices, columns: Callable[[], Array]) -> None:
            """Set the columns (..., outputs, n) of parameters, if one of them is asked for."""
            stands = wanted[indices.ravel()]
            if (stands >= 0).any():
                found = columns().reshape(len(stands), outputs, n)
                out[:, :, stands[stands >= 0]] = found[stands >= 0].transpose(2, 1, 0)

        for name, own in sight.columns():
            put(groups[name], own)
        chained = sight.push(*motion.joints())
        led = self.led(chained)

        def by_loads() -> Array:
            loads, joints = self._remembered(self.loads, q)
            return np.asarray(chained[joints] * loads[:, None])

        put(groups["elastic"], by_loads)
        put(groups["offset"], lambda: led)
        put(groups["gain"], lambda: led * (q * self.directions).T[:, None])
        for indices, moved in self.moving(motion):
            put(indices, lambda moved=moved: sight.push(*moved()))  # type: ignore[misc]
        waved: list[Waves] = []
        for k, curve in enumerate(curves):
            stands = place[curve]
            if not (stands >= 0).any():
                continue
            chosen, waves = np.flatnonzero(stands >= 0), powers(q[:, k])
            factors = np.concatenate([waves.real, waves.imag], axis=1)
            gaps = np.flatnonzero(np.diff(stands[chosen]) != 1) + 1
            for run in np.split(chosen, gaps):  # of harmonics in a row, mostly all of them
                at = slice(int(stands[run[0]]), int(stands[run[-1]]) + 1)
                waved.append(Waves(at, np.ascontiguousarray(led[k].T), factors[:, run]))
        return sight.values, Derivative(out, bare, tuple(waved))

    def load_slopes(self, q: Array) -> Array:
        """Derivatives (e, dof, n) of the loads by the joint values."""
        raise NotImplementedError

    def led(self, chained: Array) -> Array:
        """How outputs move with each logged joint (dof, m, n), from the chain's (c, m, n)."""
        return chained

    def predict_and_slope(self, q: Array, beta: Array) -> tuple[Array, Array]:
        """Outputs (n, m) and their derivative (n, m, dof) by the joint values."""
        motion, sight = self.seen(q, beta)
        return sight.values, self.by_joints(q, beta, sight.push(*motion.joints()))

    def by_joints(self, q: Array, beta: Array, chained: Array) -> Array:
        """Derivative (n, m, dof) by the logged joints, of outputs (c, m, n) by the chain's."""
        fixed = self.fixed(beta)
        rates = fixed.gain
        if fixed.bent:
            rates = np.repeat(rates, len(q), axis=1)
            rates[fixed.bent] += curve_value(q.T[fixed.bent], fixed.slopes)
        moved = self.led(chained) * rates[:, None]
        if fixed.elastic is not None:
            joints = self._remembered(self.loads, self.apart(q)[0])[1]
            slopes = fixed.elastic[..., None] * self.load_slopes(q)
            moved += np.einsum("emn,ekn->kmn", chained[joints], slopes)
        return np.ascontiguousarray(moved.transpose(2, 1, 0))

    def slope(self, q: Array, beta: Array) -> Array:
        """Derivative (n, m, dof) of the outputs by the joint values."""
        return self.predict_and_slope(q, beta)[1]


class OfStructure(Gaussian):
    """A belief with the structure that its parameters are of."""

    structure: Structure
