"""A planar arm and its sensor: chain, joint curves, elasticity and view, with derivatives.

Equations of ``docs/body.md``; angles accumulate along the chain::

    theta_i = g_i s_i q_i + o_i + elastic_i + c_i(q_i)          joints that turn
    elastic_i = sum_{j>=i} a_ij cos psi_j + b_ij sin psi_j      psi: sums of s q, gravity
    p = sum_i l_i exp(j phi_i) + sum_sliding (l_i + g_i s_i q_i) exp(j (phi_i + o_i))
    z = lens(t + A p / (1 + h.p)),  A = exp(s) R(alpha) [[1+a, b], [b, 1-a]] mirror
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from . import planar_start, planar_view, priors
from .curves import curve_slope, curve_value, powers
from .derivative import Derivative
from .layout import PlanarLayout, planar_layout
from .nominal import Nominal
from .structure import Indices, Structure
from .words import planar_words

_Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class PlanarStructure(Structure):
    """Structure of a planar body; its parameters are a plain vector."""

    kind = "planar"
    joint_names: tuple[str, ...]
    revolute: tuple[bool, ...]
    view: str  # one of :data:`calib.body.views.PLANAR`
    unit: str  # unit of positions
    metre: float  # units per metre where the sensor's unit is a length, else 1
    lens: bool  # whether the lens is fitted where the gate prefers it
    signs: tuple[int, ...]  # direction of each joint against its log, +1 or -1
    mirror: int  # -1 where the sensor sees the plane from behind
    extent: float  # root mean square distance of the rows from their mean [unit]
    centre: tuple[float, float]  # mean position [unit]; origin of the lens
    nominal: Nominal | None  # prior geometry, in metres
    simulated: bool  # whether the rows are samples of a simulation

    @property
    def layout(self) -> PlanarLayout:
        """Where each parameter stands, and what it is."""
        return planar_layout(self.joint_names, self.revolute)

    @property
    def extents(self) -> Array:
        """Spread (2,) of the positions [unit]."""
        return np.full(2, self.extent)

    @property
    def units(self) -> Mapping[str, str]:
        """Units that depend on the sensor: lengths are relative where its scale is free."""
        relative = "1" if self.nominal is None else "m"
        length = relative if self.scaled else self.unit
        return {"position": self.unit, "length": length, "tilt": f"1/{length}"}

    @property
    def scaled(self) -> bool:
        """Whether the view has a scale of its own, so that lengths are relative."""
        return self.seen_as.scaled

    @property
    def slide(self) -> float:
        """Chain units per metre of a slide."""
        return 1.0 if self.scaled else self.metre

    def angles(self, q: Array, beta: Array) -> tuple[Array, Array, Array]:
        """Signed joint values, their sums along the chain, and joint angles, each (n, dof)."""
        lay = self.layout
        signed = q * np.asarray(self.signs, dtype=float)
        turning = np.asarray(self.revolute)
        sums = np.cumsum(np.where(turning, signed, 0.0), axis=1)
        theta = signed * beta[lay.gain] + beta[lay.offset]
        theta[:, ~turning] = 0.0
        elastic = beta[lay.elastic]
        if elastic.any():
            for c, (i, j) in enumerate(lay.pairs):
                theta[:, i] += elastic[2 * c] * np.cos(sums[:, j])
                theta[:, i] += elastic[2 * c + 1] * np.sin(sums[:, j])
        for i, ix in lay.curve.items():
            if beta[ix].any():
                theta[:, i] += curve_value(q[:, i], beta[ix])
        return signed, sums, theta

    def terms(self, signed: Array, theta: Array, beta: Array) -> tuple[_Complex, _Complex]:
        """Directions and terms of the chain, each (n, dof) complex."""
        lay = self.layout
        direction = np.exp(1j * np.cumsum(theta, axis=1))  # a slide's own direction is added below
        reach = np.broadcast_to(beta[lay.length], signed.shape)
        if lay.sliding:
            ix = list(lay.sliding)
            direction[:, ix] *= np.exp(1j * beta[lay.offset[ix]])
            reach = reach.copy()
            reach[:, ix] += signed[:, ix] * beta[lay.gain[ix]] * self.slide
        return direction, direction * reach

    def moved(self, q: Array, beta: Array) -> tuple[Array, Array, _Complex, _Complex, _Complex]:
        """Signed joint values, their sums, directions, terms, and dp / d theta; each (n, dof)."""
        signed, sums, theta = self.angles(q, beta)
        direction, terms = self.terms(signed, theta, beta)
        # a joint turns all that comes after it about its own place
        return signed, sums, direction, terms, 1j * np.cumsum(terms[:, ::-1], axis=1)[:, ::-1]

    def chain(self, q: Array, beta: Array) -> _Complex:
        """Tip (n,) of the chain in its own frame, as complex numbers."""
        signed, _, theta = self.angles(q, beta)
        return np.asarray(self.terms(signed, theta, beta)[1].sum(axis=1))

    @property
    def size_of_lens(self) -> float:
        """Radius [unit] at which the lens bends by its radial parameter."""
        return 1.5 * self.extent

    def matrix(self, beta: Array) -> Array:
        """Linear part A (2, 2) of the view, with the mirror."""
        return planar_view.matrix(beta, self.mirror)

    seen = planar_view.seen

    def predict(self, q: Array, beta: Array) -> Array:
        """Positions (n, 2) [unit] at joint values (n, dof)."""
        return self.seen(self.chain(q, beta), beta)

    def derivative(self, q: Array, beta: Array, active: Indices) -> tuple[Array, Derivative]:
        """Positions (n, 2) and derivatives (n, 2, k) by the parameters `active`."""
        lay = self.layout
        place = np.full(lay.size, -1)
        place[active] = np.arange(len(active))
        signed, sums, direction, terms, turned = self.moved(q, beta)
        z, view, out = planar_view.columns(self, terms.sum(axis=1), beta, place, len(active))

        def put(ix: Indices, columns: _Complex) -> None:
            where = place[ix]
            columns, where = columns[:, where >= 0], where[where >= 0]
            for m in range(2):
                out[:, m, where] = (
                    view[:, m, 0, None] * columns.real + view[:, m, 1, None] * columns.imag
                )

        slides = list(lay.sliding)
        by_offset, by_gain = turned.copy(), turned * signed
        if slides:
            by_offset[:, slides] = 1j * terms[:, slides]
            by_gain[:, slides] = direction[:, slides] * signed[:, slides] * self.slide
        put(lay.length, direction)
        put(lay.offset, by_offset)
        put(lay.gain, by_gain)
        if (place[lay.elastic] >= 0).any():
            columns = np.empty((len(q), len(lay.elastic)), dtype=complex)
            for c, (i, j) in enumerate(lay.pairs):
                columns[:, 2 * c] = turned[:, i] * np.cos(sums[:, j])
                columns[:, 2 * c + 1] = turned[:, i] * np.sin(sums[:, j])
            put(lay.elastic, columns)
        for i, ix in lay.curve.items():
            if (place[ix] >= 0).any():
                waves = powers(q[:, i])
                put(ix, turned[:, i, None] * np.concatenate([waves.real, waves.imag], axis=1))
        return z, Derivative.of(out)

    def predict_and_slope(self, q: Array, beta: Array) -> tuple[Array, Array]:
        """Positions (n, 2) and their derivative (n, 2, dof) by the joint values."""
        lay = self.layout
        _, sums, direction, terms, turned = self.moved(q, beta)
        by_joint = turned * (beta[lay.gain] * np.asarray(self.signs, dtype=float))
        for i, ix in lay.curve.items():
            if beta[ix].any():
                by_joint[:, i] += turned[:, i] * curve_slope(q[:, i], beta[ix])
        elastic = beta[lay.elastic]
        if elastic.any():
            for c, (i, j) in enumerate(lay.pairs):
                bend = elastic[2 * c + 1] * np.cos(sums[:, j]) - elastic[2 * c] * np.sin(sums[:, j])
                for k in lay.turning:
                    if k <= j:
                        by_joint[:, k] += turned[:, i] * bend * self.signs[k]
        for i in lay.sliding:
            by_joint[:, i] = direction[:, i] * beta[lay.gain[i]] * self.signs[i] * self.slide
        place = np.full(lay.size, -1)
        z, view, _ = planar_view.columns(self, terms.sum(axis=1), beta, place, 0)
        return z, np.asarray(view @ np.stack([by_joint.real, by_joint.imag], axis=1))

    prior, members = priors.planar_prior, priors.planar_members
    starts, words = planar_start.planar_starts, planar_words
