"""One query of a spatial body, for a control loop: microseconds instead of NumPy's overhead.

Pinocchio moves the chain with its identified placements and weighs the nominal one under gravity;
curves and lens are plain floats, as in :mod:`calib.body.planar_row`.  The answers equal those of
`SpatialStructure` to rounding.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..arm.motion import Placements, placements
from ..arm.spatial_chain import SpatialChain
from ..common.arrays import Array
from .curves import curve_table, in_table, in_table_with_slope
from .spatial import SpatialStructure
from .spatial_view import LEAST_DEPTH


class SpatialRow:
    """A spatial body compiled for single rows; joint values [rad or m] are not checked.

    beta : (d,), parameters
    """

    def __init__(self, structure: SpatialStructure, beta: Array) -> None:
        chain, groups = structure.chain, structure.groups
        moved = placements(chain, structure.deviations(beta))
        self._joints = [
            (gain, offset, curve_table(beta[curve]))
            for gain, offset, curve in zip(
                beta[groups["gain"]].tolist(),
                beta[groups["offset"]].tolist(),
                (groups[f"curve.{k}"] for k in range(structure.dof)),
                strict=True,
            )
        ]
        plain = np.array_equal(chain.coupling, np.eye(chain.joints)) and not chain.bias.any()
        self._coupling = None if plain else chain.coupling
        self._bias = chain.bias
        elastic = beta[groups["elastic"]]
        # Pinocchio's generalised gravity is the torque that holds the arm: the load's negative
        self._torque = structure.torque
        self._bending = -elastic / self._torque if elastic.any() else None
        loads = _model(chain, placements(chain), structure.gravity)
        self._own = _Own(_model(chain, moved), loads)
        self._see, self._seen = _view(structure, beta)

    def predict(self, q: Sequence[float]) -> list[float]:
        """What the sensor sees at joint values (dof,): outputs [unit]; of a pose the position."""
        self._move(q)
        return self._see(self._own.tip())

    def sloped(self, q: Sequence[float]) -> tuple[list[float], Array]:
        """The same, and its derivative (outputs, dof) by the joint values."""
        jacobian = self._placed(q, self._own.world)
        return self._seen(self._own.tip(), jacobian[:3])

    def place(self, q: Sequence[float]) -> Any:
        """Placement (pinocchio.SE3) of the tip in the arm's root frame, a copy."""
        self._move(q)
        return self._own.placement.copy()

    def frames(self, q: Sequence[float]) -> tuple[Array, Array, Array]:
        """Places (m, 3) and orientations (m, 3, 3) of the joints, and the tip (3,), in the root."""
        self._move(q)
        own = self._own
        return np.array(own.places), np.array(own.rotations), np.array(own.tip())

    def shares(self, q: Sequence[float]) -> Array:
        """Loads (m,) of the nominal chain's joints, as `SpatialStructure.loads`."""
        own = self._own
        return np.asarray(own.load(own.loads, own.weighed, self._nominal(q)) / -self._torque)

    def twist(self, q: Sequence[float], goal: Any) -> tuple[Array, Array]:
        """Twist (6,) from the tip's placement to a goal, and its derivative's negative (6, dof).

        Both are in the tip's own frame.  The derivative is that at the goal itself, which is
        what Newton's steps need to converge quadratically.
        """
        own = self._own
        jacobian = self._placed(q, own.local)
        return own.log6(own.placement.actInv(goal)).vector, jacobian

    def _move(self, q: Sequence[float]) -> None:
        own = self._own
        values = [
            gain * value + offset + (0.0 if table is None else in_table(table, value))
            for (gain, offset, table), value in zip(self._joints, q, strict=True)
        ]
        own.move(own.model, own.data, self._loaded(q, values)[0])

    def _placed(self, q: Sequence[float], frame: Any) -> Array:
        """Move the chain; its geometric Jacobian (6, dof) by the joint values in a frame."""
        own, values, rates = self._own, [], []
        for (gain, offset, table), value in zip(self._joints, q, strict=True):
            wave, slope = (0.0, 0.0) if table is None else in_table_with_slope(table, value)
            values.append(gain * value + offset + wave)
            rates.append(gain + slope)
        moved, nominal = self._loaded(q, values)
        own.jacobians(own.model, own.data, moved)
        own.settle(own.model, own.data, own.frame)
        jacobian = own.jacobian(own.model, own.data, own.frame, frame)
        coupling, bending = self._coupling, self._bending
        by_values = jacobian if coupling is None else jacobian @ coupling
        by_joints = by_values * np.array(rates)
        if bending is not None:  # gravity bends by the nominal arm's posture
            bent = own.load_slopes(own.loads, own.weighed, nominal)
            by_joints += (jacobian * bending) @ (bent if coupling is None else bent @ coupling)
        return np.asarray(by_joints)

    def _loaded(self, q: Sequence[float], values: list[float]) -> tuple[Array, Array | None]:
        """Values (m,) of the chain's joints, and of the nominal chain where loads count."""
        own, moved = self._own, np.array(values)
        if self._coupling is not None:
            moved = self._coupling @ moved + self._bias
        if self._bending is None:
            return moved, None
        nominal = self._nominal(q)
        return moved + self._bending * own.load(own.loads, own.weighed, nominal), nominal

    def _nominal(self, q: Sequence[float]) -> Array:
        nominal = np.array(q)
        return nominal if self._coupling is None else self._coupling @ nominal + self._bias


class _Own(threading.local):
    """Pinocchio's models with data of each thread's own: a call writes into them."""

    def __init__(self, chain: tuple[Any, int], loads: tuple[Any, int]) -> None:
        import pinocchio as pin

        self.model, self.frame = chain
        self.data = self.model.createData()
        self.placement = self.data.oMf[self.frame]  # a live view, as is its translation
        self.tip = self.placement.translation.tolist
        self.places = [place.translation for place in self.data.oMi][1:]
        self.rotations = [place.rotation for place in self.data.oMi][1:]
        self.loads = loads[0]
        self.weighed = self.loads.createData()
        self.move, self.settle = pin.framesForwardKinematics, pin.updateFramePlacement
        self.jacobians, self.jacobian = pin.computeJointJacobians, pin.getFrameJacobian
        self.load = pin.computeGeneralizedGravity
        self.load_slopes = pin.computeGeneralizedGravityDerivatives
        self.log6 = pin.log6
        self.world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        self.local = pin.ReferenceFrame.LOCAL


def _model(
    chain: SpatialChain, moved: Placements, gravity: Sequence[float] | None = None
) -> tuple[Any, int]:
    """Pinocchio's model of a chain and its tip's frame; with its masses where gravity is given."""
    import pinocchio as pin

    model, joint = pin.Model(), 0
    for i, turns in enumerate(chain.revolute):
        kind = pin.JointModelRevoluteUnaligned if turns else pin.JointModelPrismaticUnaligned
        placed = pin.SE3(moved.turns[i], moved.strides[i])
        joint = model.addJoint(joint, kind(chain.axes[i]), placed, f"joint {i}")
        if gravity is not None and len(chain.masses):
            centre = chain.centres[i] - chain.points[i]
            body = pin.Inertia(float(chain.masses[i]), centre, np.zeros((3, 3)))
            model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    if gravity is not None:
        model.gravity.linear = np.asarray(gravity)
    tip = pin.SE3(moved.tip_turn, moved.tip)
    return model, model.addFrame(pin.Frame("tip", joint, 0, tip, pin.FrameType.OP_FRAME))


_See = Callable[[list[float]], list[float]]
_Seen = Callable[[list[float], Array], tuple[list[float], Array]]


def _view(structure: SpatialStructure, beta: Array) -> tuple[_See, _Seen]:
    """What the sensor sees of a point in the root frame; with a Jacobian also its derivative."""
    sensor = structure.sensor(beta)
    turned = sensor.scale * sensor.rotation
    (a, b, c), (d, e, f), (g, h, i) = turned.tolist()
    tx, ty, tz = sensor.shift.tolist()

    def see(point: list[float]) -> list[float]:
        x, y, z = point
        return [a * x + b * y + c * z + tx, d * x + e * y + f * z + ty, g * x + h * y + i * z + tz]

    if not structure.camera:
        return see, lambda point, jacobian: (see(point), turned @ jacobian)
    focal, u0, v0, k1 = sensor.lens.tolist()
    bend = structure.seen_as.bend

    def lens(point: list[float]) -> tuple[float, float, float, float, float]:
        x, y, z = see(point)
        depth = max(z, LEAST_DEPTH)
        u, v = x / depth, y / depth
        rise, ratio, _ = bend(k1, u * u + v * v)
        return u, v, depth, 1.0 + rise * ratio, 2.0 * rise

    def pixels(point: list[float]) -> list[float]:
        u, v, _, bent, _ = lens(point)
        return [focal * u * bent + u0, focal * v * bent + v0]

    def sloped(point: list[float], jacobian: Array) -> tuple[list[float], Array]:
        u, v, depth, bent, twice = lens(point)
        near = focal / depth
        uu, uv, vv = (
            near * (bent + twice * u * u),
            near * twice * u * v,
            near * (bent + twice * v * v),
        )
        slope = np.array([[uu, uv, -(uu * u + uv * v)], [uv, vv, -(uv * u + vv * v)]])
        return [focal * u * bent + u0, focal * v * bent + v0], slope @ (turned @ jacobian)

    return pixels, sloped
