"""A planar arm: a chain of parallel axes, of which nothing leaves the plane.

As a chain in space it takes four times as long for a single query.  Its parameters are full lengths
and offsets, as an arm without any drawing has them: with those of an arm in space it was 2.6 %
worse on a real UR10 (.2013 for .1962 mm).  Elasticity is free::

    elastic_i = sum_{j>=i} a_ij cos psi_j + b_ij sin psi_j      psi: sums of s q, gravity
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np

from ..common.arrays import Array
from ..common.scale import METRES
from ..errors import OptionError
from . import settings
from .curves import curve_shape
from .measurement import Moved
from .nominal import Complex, Nominal, linear_chain, sides
from .parameters import Block, Hyper, Indices
from .planar_view import PlanarReading
from .structure import Ladder, Structure
from .views import PLANAR

_MOST = 16  # combinations of signs and mirrors that are refined


@dataclass(frozen=True, eq=False)
class PlanarMotion:
    """Where a planar chain is at n rows, as complex numbers: the angles of parallel axes add up."""

    direction: Complex  # (dof, n), of each link or slide
    terms: Complex  # (dof, n), the links
    revolute: tuple[bool, ...]

    @property
    def position(self) -> Array:
        """The tip (2, n)."""
        return _pairs(self.terms.sum(axis=0))

    def joints(self) -> Moved:
        """How the tip moves with the value of each joint, (dof, 2, n)."""
        # a joint turns all that comes after it about its own place
        moved = 1j * np.cumsum(self.terms[::-1], axis=0)[::-1]
        if not all(self.revolute):
            moved = np.where(np.asarray(self.revolute)[:, None], moved, self.direction)
        return _pairs(moved), 0.0


def _pairs(values: Complex) -> Array:
    """Complex numbers (..., n) as coordinates (..., 2, n)."""
    return np.stack([values.real, values.imag], axis=-2)


@dataclass(frozen=True)
class PlanarStructure(Structure):
    """Structure of a planar body; its parameters are a plain vector."""

    kind = "planar"
    gate_rows = 3000
    # with 3 mrad 10 to 200 real rows were bounded 3.8 to 9.2 times their error, now 3.1 to 5.2, and
    # covered to 97 to 99.7 %; logs along a path of an arm with waves of 4 mrad to 96 %
    wide = (200.0, 1.5e-3)
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
    def directions(self) -> Sequence[float]:
        """By how much each joint (dof,) moves with its log: 1 or -1, slides in the chain's unit."""
        return tuple(s * (1.0 if t else self.slide) for s, t in zip(self.signs, self.revolute))  # noqa: B905

    @property
    def scaled(self) -> bool:
        """Whether the view has a scale of its own, so that lengths are relative."""
        return self.seen_as.scaled

    @property
    def slide(self) -> float:
        """Chain units per metre of a slide."""
        return 1.0 if self.scaled else self.metre

    @cached_property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """Joints that bend, and the links (by their joints) that bend them."""
        turning = [i for i, turns in enumerate(self.revolute) if turns]
        return tuple((i, j) for i, j in product(turning, repeat=2) if j >= i)

    @property
    def anchored(self) -> bool:
        """Whether the first length is the chain's unit: a scaled view, no drawing, no slide."""
        return self.scaled and self.nominal is None and all(self.revolute)

    @cached_property
    def measurement(self) -> PlanarReading:
        """What its sensor measures."""
        nominal = self.nominal
        reach = 1.0 if self.scaled else self.extent  # of the chain, in its own units
        if nominal is not None:
            reach = max(float(np.sum(nominal.lengths)) * self.slide, 1e-12)
        known = nominal if self.view == "base" else None
        at = (self.metre * known.shift[0], self.metre * known.shift[1]) if known else (0.0, 0.0)
        return PlanarReading(
            self.unit, self._length, self.mirror, self.extent, self.centre, reach,
            known.rotation if known else 0.0, at,
        )  # fmt: skip

    @property
    def _length(self) -> str:
        """Unit of lengths."""
        return ("1" if self.nominal is None else "m") if self.scaled else self.unit

    def geometry(self) -> Sequence[Block]:
        """Blocks of the chain's geometry and of its joints."""
        names, nominal, turning = self.joint_names, self.nominal, np.asarray(self.revolute)
        drawn = nominal is not None
        size = np.where(turning, 1.0 if self.scaled else self.extent / 2, 0.0)
        wide = np.where(turning, 1.0 if self.anchored else self.extent, 0.0)
        wide *= 10.0 / self.extent if self.scaled and not self.anchored else 1.0
        wide[0] *= not self.anchored  # the view's scale is the first length
        flat = np.full(self.dof, 10.0)
        flat[0] = 0.0  # in a free frame the first joint's offset and a turn of the frame are one
        first = np.arange(0 if self.view == "base" else 1, self.dof)
        lengths = size if nominal is None else np.asarray(nominal.lengths) * self.slide
        offsets = 0.0 if nominal is None else np.asarray(nominal.offsets)
        shift, wider = settings.SHIFT * self.slide, settings.WIDER
        joints = (
            ("length", self._length, lengths, wide, (shift, wider)),
            ("offset", "rad", offsets, flat, (settings.TURN, settings.SERVOS, 0.0, first)),
            ("gain", "1", 1.0, 2 * settings.GAIN, (settings.GAIN, wider)),
        )
        bent = settings.ELASTIC_FLAT * (1.0 if drawn else 2.0)
        waves = product(self.pairs, ("cos", "sin"))
        return (
            *(
                Block(
                    what, self.of_joints(what, unit), mean, 0.0 if drawn else sd,
                    (Hyper(what, *scale),) if drawn else (),
                )
                for what, unit, mean, sd, scale in joints
            ),
            Block(
                "elastic",
                tuple(
                    (names[i], f"{names[i]}.elastic {wave} {names[j]}", "rad")
                    for (i, j), wave in waves
                ),
                scales=(Hyper("elastic", bent, pseudo=4.0),),
            ),
            *self.curves(settings.CURVE_RMS, settings.CURVE_ROWS_FLAT, curve_shape(settings.LONG)),
        )  # fmt: skip

    def offsets(self, beta: Array) -> Array:
        """What is added to the joints' values (dof,); a slide's offset is its direction."""
        return np.where(self.revolute, beta[self.groups["offset"]], 0.0)

    def links(self, beta: Array) -> tuple[Array, Complex]:
        """The links' lengths (dof, 1), and the slides' own directions (dof, 1)."""
        way = np.where(self.revolute, 0.0, beta[self.groups["offset"]])
        return beta[self.groups["length"], None], np.exp(1j * way)[:, None]

    def move(self, values: Array, beta: Array) -> PlanarMotion:  # type: ignore[override]
        """Where the chain is at the true values (dof, n) of its joints."""
        length, way = self.fixed(beta).links
        if all(self.revolute):
            direction = np.exp(1j * np.cumsum(values, axis=0))
        else:
            turning = np.asarray(self.revolute)[:, None]
            direction = np.exp(1j * np.cumsum(np.where(turning, values, 0.0), axis=0)) * way
            length = length + np.where(turning, 0.0, values)
        return PlanarMotion(direction, direction * length, self.revolute)

    def moving(
        self,
        motion: PlanarMotion,  # type: ignore[override]
        beta: Array,  # noqa: ARG002
    ) -> Iterator[tuple[Indices, Callable[[], Moved]]]:
        """How the tip moves with each part of the geometry."""
        yield self.groups["length"], lambda: (_pairs(motion.direction), 0.0)
        if slides := [i for i, turns in enumerate(self.revolute) if not turns]:
            # turning a slide's direction turns no other link
            yield self.groups["offset"][slides], lambda: (_pairs(1j * motion.terms[slides]), 0.0)

    def loads(self, q: Array) -> tuple[Array, Indices]:
        """Cosines and sines (e, n) of the links' directions, and the joints (e,) they bend."""
        signed = q * self.signs * np.asarray(self.revolute)
        sums = np.ascontiguousarray(np.cumsum(signed, axis=1).T)
        waves = [wave(sums[j]) for _, j in self.pairs for wave in (np.cos, np.sin)]
        return np.array(waves), np.repeat([i for i, _ in self.pairs], 2).astype(np.intp)

    def load_slopes(self, q: Array) -> Array:
        """Derivatives (e, dof, n) of those waves by the joint values."""
        waves = self.loads(q)[0].reshape(len(self.pairs), 2, 1, len(q))
        ways = np.asarray(self.signs) * np.asarray(self.revolute)
        turns = np.array([ways * (np.arange(self.dof) <= j) for _, j in self.pairs])
        slopes = waves[:, ::-1] * np.array([-1.0, 1.0])[:, None, None] * turns[:, None, :, None]
        return np.asarray(slopes.reshape(2 * len(self.pairs), self.dof, len(q)))

    def members(self) -> Ladder:
        """The gate's members from simple to rich."""
        frame, joints, turns = self.seen_as.groups, ("length", "offset", "gain"), any(self.revolute)
        chain = (*frame, *joints)
        ladder = (
            ("frame", frame or ("offset",), self.nominal is not None),
            # few rows of a camera that looks straight down need no more
            ("similarity", (*PLANAR["similarity"].groups, *joints), self.seen_as.tilted),
            ("chain", chain, True),
            ("elastic", (*chain, "elastic"), self.simulated and turns),
            # a simulated sensor may be tilted or bent; the lengths hold the scale
            ("view", (*chain, "view.shear", "view.tilt", "lens"), self.simulated),
            ("lens", (*chain, "lens"), self.lens and not self.simulated),
            ("curves", (*chain, "curve"), turns),
            ("elastic", (*chain, "elastic"), turns),
            ("curves and elastic", (*chain, "elastic", "curve"), turns),
        )
        return tuple((name, groups) for name, groups, wanted in ladder if wanted)

    @property
    def reversals(self) -> int:
        """How many joints turn against their drawing, and whether the sensor sees a mirror."""
        drawn = self.nominal.signs if self.nominal else self.signs
        return int(np.not_equal(drawn, self.signs).sum()) + (self.mirror < 0)

    def starts(self, q: Array, z: Array) -> list[tuple[Structure, Array]]:
        """Candidates of signs, mirror and parameters (d,), the best linear fits first.

        With a nominal geometry its own signs come first; every combination is tried where the view
        is not metric (a camera says nothing of the servos) or where the nominal signs do not fit.
        """
        tip = z[:, 0] + 1j * z[:, 1]
        found = [each.linear(q, tip) for each in self._sided(every=self.scaled)]
        best = min(error for error, _, _ in found)
        if self.nominal and not self.scaled and best > settings.DOUBTED * self.extent:
            found += [each.linear(q, tip) for each in self._sided(every=True)]
        found.sort(key=lambda item: item[0])
        return [(each, beta) for _, each, beta in found[:_MOST]]

    def _sided(self, *, every: bool) -> Iterator[PlanarStructure]:
        """The structure with each combination of signs and mirrors that may differ."""
        nominal = self.nominal
        pairs: Iterable[tuple[tuple[int, ...], int]] = sides(self.revolute)
        if nominal is not None:
            mirrors = (nominal.mirror,) if self.view == "base" else (1, -1)
            flips = product((1, -1) if every else (1,), repeat=self.dof)
            signs = [tuple(np.multiply(nominal.signs, flip).tolist()) for flip in flips]
            pairs = product(signs, mirrors)
        for signed, mirror in pairs:
            yield replace(self, signs=signed, mirror=mirror)

    def linear(self, q: Array, tip: Complex) -> tuple[float, PlanarStructure, Array]:
        """Error, structure and parameters of the best similarity of the chain to tips (n,)."""
        beta, groups = self.neutral(), self.groups
        if self.nominal is not None:
            if self.view != "base":  # the rotation, scale and shift that fit its chain best
                place = self.seen(q, beta)[0].position
                p = place[0] + 1j * self.mirror * place[1]
                t = np.vdot(p - p.mean(), tip) / (np.vdot(p - p.mean(), p).real + 1e-300)
                scale = np.log(max(abs(t), 1e-12)) if self.scaled else 0.0
                shift = np.mean(tip - np.exp(scale + 1j * np.angle(t)) * p)
                beta[groups["view.rotation"]], beta[groups["view.scale"]] = np.angle(t), scale
                beta[groups["view.shift"]] = shift.real, shift.imag
            miss = np.abs(tip - self.predict(q, beta) @ (1, 1j))
            return float(np.sqrt(np.mean(miss**2))), self, beta
        found, miss = linear_chain(q, tip, self.signs, self.mirror, self.revolute)
        beta[groups["offset"]], beta[groups["view.rotation"]] = found.offsets, found.rotation
        beta[groups["view.shift"]] = found.shift
        turning, sizes = np.asarray(self.revolute), np.asarray(found.lengths)
        if self.scaled:
            slides = sizes[~turning]
            unit = float(sizes[0] if self.anchored else np.exp(np.mean(np.log(slides + 1e-300))))
            unit = max(unit, 1e-9 * self.extent)
            beta[groups["view.scale"]] = np.log(unit)
            sizes = sizes / unit
        beta[groups["length"]] = np.where(turning, sizes, 0.0)
        return float(np.sqrt(np.mean(miss**2))), self, beta


def planar_structure(
    z: Array,
    joint_names: Sequence[str],
    revolute: Sequence[bool],
    nominal: Nominal | None = None,
    view: str = "auto",
    unit: str = "m",
    simulated: bool = False,
) -> PlanarStructure:
    """The structure that the rows and options ask for, signs and mirror still open."""
    names, turns = tuple(joint_names), tuple(bool(r) for r in revolute)
    if view not in ("auto", *PLANAR):
        raise OptionError(f"view {view!r}, expected one of auto, {', '.join(PLANAR)}")
    if view == "base" and nominal is None:
        raise OptionError("view 'base' needs the nominal geometry of a robot; give nominal")
    if view == "auto":
        view = "rigid" if unit in METRES else "homography"
    centre = z.mean(axis=0)
    extent = float(np.sqrt(((z - centre) ** 2).sum(axis=1).mean()))
    extent = max(extent, 1e-9 * (1e-3 + float(np.abs(z).max())))
    return PlanarStructure(
        names, turns, view, unit, METRES.get(unit, 1.0), PLANAR[view].lens,
        signs=nominal.signs if nominal else (1,) * len(names), mirror=1, extent=extent,
        centre=(float(centre[0]), float(centre[1])), nominal=nominal, simulated=simulated,
    )  # fmt: skip
