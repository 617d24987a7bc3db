"""What a body's structure is: its parameters, its prediction and their derivatives.

The fit, the gate, the bound, ``check`` and ``adapt`` know a body only through this class, of which
`PlanarStructure` and `SpatialStructure` are kinds.  A structure is immutable.  Its vector of
parameters ``beta`` (d,) always has the full layout: a group that a model does not use (a lens,
the joint curves) is there with its neutral value, so that it can be freed later.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from .views import VIEWS_OF_BODIES, ViewKind

if TYPE_CHECKING:
    from .derivative import Derivative
    from .layout import Layout

Indices = NDArray[np.intp]


class Label(NamedTuple):
    """What one parameter is, for words and JSON."""

    group: str  # key of `Structure.groups`
    joint: str | None  # the joint that it belongs to
    name: str  # its name within the body, unique: ``"elbow_joint.offset"``, ``"view.rotation"``
    unit: str  # ``"rad"``, ``"1"``, the unit of positions,


@dataclass(frozen=True)
class Hyper:
    """Parameters whose common prior scale is chosen by evidence.

    The prior variance of parameter ``indices[k]`` is ``scale**2 * shape[k]``.
    """

    name: str  # name of the scale, as `Body.scales` keeps it: ``"length"``, ``"curve.0"``
    indices: Indices  # (g,), the parameters
    shape: Array  # (g,), relative variances (mean 1 for curves)
    scale: float  # starting scale; also the scale of the pseudo-observations
    # number of pseudo-observations at `scale` (an inverse-gamma hyperprior); used by EM
    pseudo: float = 0.0
    # factors on `scale` that are compared by evidence; empty: the scale moves freely by EM
    choices: tuple[float, ...] = ()


@dataclass(frozen=True)
class Prior:
    """A Gaussian prior over the parameters: a zero `sd` keeps a parameter at its `mean`."""

    # (d,), prior mean and standard deviation, in each parameter's own unit
    mean: Array
    sd: Array
    # groups whose scale the evidence chooses; `sd` holds their starting values
    hypers: tuple[Hyper, ...] = ()
    # (k, k), precision of the active parameters where they depend on each other, in place of `sd`
    known: Array | None = None

    @property
    def active(self) -> Indices:
        """Indices (k,) of the parameters that are fitted."""
        return np.flatnonzero(self.sd > 0)


class Structure:
    """What a body needs to know of its structure (planar chain and view, spatial chain and view).

    ``n`` rows, ``dof`` joints, ``m`` outputs, ``d`` parameters.  Joint values are in rad or m as
    they are logged; positions in the structure's own unit.
    """

    kind: ClassVar[str]  # ``"planar"`` or ``"spatial"``: how a model file finds the class again
    # rows that the gate and the evidence use; the rest enters the final step
    gate_rows: ClassVar[int] = 3000
    # wider hyperprior of the curves for a second fit: pseudo-observations, rms [rad]
    wide: ClassVar[tuple[float, float]] = (200.0, 3e-3)
    joint_names: tuple[str, ...]  # names of the joints, base to tip
    revolute: tuple[bool, ...]  # which joints turn; the others slide
    view: str  # ``"rigid"``, ``"similarity"``, ``"affine"``, ``"homography"``, ``"base"``,
    unit: str  # unit of positions: ``"m"``, ``"px"``, ``"sensor"``,
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
        return 2

    @property
    def blocks(self) -> tuple[int, ...]:
        """Sizes of the outputs that share a unit and a noise: ``(2,)``, ``(3,)``, ``(3, 3)``."""
        return (3, 3) if self.outputs == 6 else (self.outputs,)

    @property
    def extents(self) -> Array:
        """Size (m,) of the workspace along the outputs: the reach [unit]; 1 rad for rotations."""
        raise NotImplementedError

    @property
    def layout(self) -> Layout:
        """Where each parameter stands, and what it is."""
        raise NotImplementedError

    @property
    def groups(self) -> Mapping[str, Indices]:
        """Indices of each group of parameters.

        Keys: ``"view.rotation"``, ``"view.shift"``, ``"view.scale"``, ``"view.shear"``,
        ``"view.tilt"``, ``"lens"``, ``"length"``, ``"offset"``, ``"gain"``, ``"elastic"``,
        ``"curve.0"``, ... (planar); spatial ones add ``"placement"``, ``"tool"``.
        """
        return self.layout.groups

    @cached_property
    def size(self) -> int:
        """Number d of parameters."""
        return sum(len(ix) for ix in self.groups.values())  # a kind may leave groups out

    @property
    def units(self) -> Mapping[str, str]:
        """Units that depend on the sensor, by how the layout calls them."""
        return {"position": self.unit}

    def predict(self, q: Array, beta: Array) -> Array:
        """Outputs (n, m) at joint values (n, dof); a rotation is a rotation vector."""
        raise NotImplementedError

    def linearise(
        self, q: Array, beta: Array, active: Indices | None = None
    ) -> tuple[Array, Array]:
        """Outputs (n, m) and their derivative (n, m, k) by the parameters `active` (or all)."""
        values, x = self.derivative(q, beta, np.arange(self.size) if active is None else active)
        return values, x.dense()

    def derivative(self, q: Array, beta: Array, active: Indices) -> tuple[Array, Derivative]:
        """The same with the derivative's structure, where it has one."""
        raise NotImplementedError

    def predict_and_slope(self, q: Array, beta: Array) -> tuple[Array, Array]:
        """Outputs (n, m) and their derivative (n, m, dof) by the joint values."""
        raise NotImplementedError

    def slope(self, q: Array, beta: Array) -> Array:
        """Derivative (n, m, dof) of the outputs by the joint values."""
        return self.predict_and_slope(q, beta)[1]

    def retract(self, beta: Array, delta: Array) -> Array:
        """`beta` (d,) moved by `delta` (d,): the sum, or a step on a rotation."""
        return beta + delta

    def residual(self, z: Array, predicted: Array) -> Array:
        """Residuals (n, m) of observed against predicted outputs."""
        return z - predicted

    def label(self, index: int) -> Label:
        """What parameter `index` is."""
        found = self.layout.labels[index]
        return found._replace(unit=self.units.get(found.unit, found.unit))

    def prior(self, free: Sequence[str]) -> Prior:
        """Prior of the member that fits the groups of `free`; ``"curve"`` stands for all curves."""
        raise NotImplementedError

    def members(self) -> tuple[tuple[str, tuple[str, ...]], ...]:
        """The gate's members from simple to rich: a name and the groups that it fits."""
        raise NotImplementedError

    def starts(self, q: Array, z: Array) -> Sequence[tuple[Structure, Array]]:
        """Candidate starts: structures (signs, mirror) with their parameters (d,), best first."""
        raise NotImplementedError

    def words(self, beta: Array, sd: Array) -> tuple[str, ...]:
        """Lines that say the parameters in words; `sd` (d,) is zero where nothing was fitted."""
        raise NotImplementedError
