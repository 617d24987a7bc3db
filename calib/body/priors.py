"""Priors of a body: what a URDF, a servo or nothing says of each parameter, and the gate's members.

A member is a set of groups of parameters that are fitted together; the gate tries them in the order
of the ladder, from simple to rich.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..common.arrays import Array
from .curves import curve_shape
from .structure import Hyper, Indices, Prior
from .views import PLANAR

if TYPE_CHECKING:
    from .planar import PlanarStructure
    from .spatial import SpatialStructure

_Ladder = tuple[tuple[str, tuple[str, ...]], ...]

FREE = 1e3
"""A prior sd of a thousand extents or radians: flat."""

_OFFSET_SCALES = (1.0, 5.0, 20.0, 100.0)
"""Offsets move by 0.1 deg where an arm was calibrated, by up to 10 deg where servos were put on."""

SCALES = (1.0, 5.0, 20.0)

_LONG = 3.0
"""Waves a turn up to which a planar arm's curve may be larger: eccentric wheels, loads."""

SHIFT, TURN = 1e-3, np.radians(0.1)
"""Joint origins are where a drawing says to 1 mm and 0.1 deg, or some times that."""

_ELASTIC = 1e-3
"""Joints bend by this much [rad] under the largest torque that gravity could put on the arm."""

_CURVE = 4e-4
"""Harmonic drives and industrial arms have 0.15 to 0.4 mrad; evidence finds those of others."""

_TAG = 2e-3
"""A camera's tag is held where the drawing says to so many metres."""


class GrowingPrior:
    """A prior that is put together group by group; `sd` is zero for what is left out."""

    def __init__(self, mean: Array) -> None:
        self.mean, self.sd = mean, np.zeros(len(mean))
        self._hypers: list[Hyper] = []

    def chosen(self, name: str, ix: Indices, scale: float, factors: tuple[float, ...]) -> None:
        """Let the evidence choose the scale of parameters among `factors` times `scale`."""
        self._add(Hyper(name, ix, np.ones(len(ix)), scale, choices=factors))

    def moving(
        self, name: str, ix: Indices, scale: float, pseudo: float, shape: Array | None = None
    ) -> None:
        """Let the scale of parameters move by EM; `pseudo` observations hold it at `scale`."""
        shape = np.ones(len(ix)) if shape is None else shape
        self._add(Hyper(name, ix, shape, scale, pseudo))

    def curves(
        self, groups: Mapping[str, Indices], free: Sequence[str], shape: Array, rms: float, n: float
    ) -> None:
        """Free the curves that `free` names, each of `rms` [rad], with `n` pseudo-observations."""
        for name, ix in groups.items():
            if len(ix) and name.startswith("curve.") and ("curve" in free or name in free):
                self.moving(name, ix, rms / np.sqrt(len(ix)), n, shape)

    def _add(self, hyper: Hyper) -> None:
        self.sd[hyper.indices] = hyper.scale * np.sqrt(hyper.shape)
        if len(hyper.indices):
            self._hypers.append(hyper)

    def whole(self) -> Prior:
        """The prior."""
        return Prior(self.mean, self.sd, tuple(self._hypers))


def planar_members(structure: PlanarStructure) -> _Ladder:
    """Members of the gate from simple to rich: a name and the groups that it fits."""
    frame = structure.seen_as.groups
    chain = (*frame, "length", "offset", "gain")
    ladder: list[tuple[str, tuple[str, ...]]] = []
    if structure.nominal is not None:
        ladder.append(("frame", frame or ("offset",)))
    if structure.seen_as.tilted:
        # Few rows of a camera that looks straight down need no more.
        ladder.append(("similarity", (*PLANAR["similarity"].groups, "length", "offset", "gain")))
    ladder.append(("chain", chain))
    turning = bool(structure.layout.turning)
    if structure.simulated:
        if turning:
            ladder.append(("elastic", (*chain, "elastic")))
        # A simulated sensor may be tilted or bent; the lengths hold the scale.
        ladder.append(("view", (*chain, "view.shear", "view.tilt", "lens")))
    elif structure.lens:
        ladder.append(("lens", (*chain, "lens")))
    if turning:
        ladder.append(("curves", (*chain, "curve")))
        ladder.append(("elastic", (*chain, "elastic")))
        ladder.append(("curves and elastic", (*chain, "elastic", "curve")))
    return tuple(ladder)


def planar_prior(structure: PlanarStructure, free: Sequence[str]) -> Prior:
    """Prior of the member that fits the groups `free`; ``"curve"`` stands for all curves."""
    lay, nominal = structure.layout, structure.nominal
    found = GrowingPrior(planar_neutral(structure))
    sd, extent = found.sd, structure.extent
    reach = 1.0 if structure.scaled else extent  # of the chain, in its own units
    if nominal is not None:
        reach = max(float(np.sum(nominal.lengths)) * structure.slide, 1e-12)
    flat = {
        "view.rotation": 100.0,
        "view.scale": 100.0,
        "view.shift": FREE * extent,
        "view.shear": 1.0,
        "view.tilt": 1.0 / reach,
        "lens": 0.5,
    }
    for group in free:
        if group in flat:
            sd[lay.groups[group]] = flat[group]
    if nominal is not None:
        # in a free frame the first joint's offset and a turn of the frame are one
        first = 0 if structure.view == "base" else 1
        if "length" in free:
            found.chosen("length", lay.length, SHIFT * structure.slide, SCALES)
        if "offset" in free:
            found.chosen("offset", lay.offset[first:], TURN, _OFFSET_SCALES)
        if "gain" in free:
            found.chosen("gain", lay.gain, 1e-3, SCALES)
    else:
        if "length" in free:
            turning = np.asarray(structure.revolute)
            sd[lay.length] = np.where(turning, 1.0 if anchored(structure) else extent, 0.0)
            if structure.scaled and not anchored(structure):
                sd[lay.length] *= 10.0 / extent
            if anchored(structure):
                sd[lay.length[0]] = 0.0  # the view's scale is the first length
        if "offset" in free:
            sd[lay.offset[1:]] = 10.0
        if "gain" in free:
            sd[lay.gain] = 2e-3
    if "elastic" in free:
        found.moving("elastic", lay.elastic, 1e-4 if nominal is not None else 2e-4, 4.0)
    # a weak hyperprior (10) left 30 rows 1 % worse
    found.curves(lay.groups, free, curve_shape(_LONG), _CURVE, 40.0)
    return found.whole()


def planar_neutral(structure: PlanarStructure) -> Array:
    """Parameters (d,) of the nominal arm, or of equal links, in a sensor frame at the base."""
    lay, nominal = structure.layout, structure.nominal
    beta = np.zeros(lay.size)
    beta[lay.gain] = 1.0
    if nominal is not None:
        beta[lay.length] = np.asarray(nominal.lengths) * structure.slide
        beta[lay.offset] = nominal.offsets
        if structure.view == "base":
            beta[0] = nominal.rotation
            beta[4:6] = np.asarray(nominal.shift) * structure.metre
    else:
        turning = np.asarray(structure.revolute)
        beta[lay.length] = np.where(turning, 1.0 if structure.scaled else structure.extent / 2, 0.0)
    return beta


def anchored(structure: PlanarStructure) -> bool:
    """Whether the first length is the unit of the chain: a scaled view, no geometry, no slide."""
    return structure.scaled and structure.nominal is None and not structure.layout.sliding


def frame_groups(structure: SpatialStructure) -> tuple[str, ...]:
    """Groups that every member fits: the sensor's place and the tip that it sees."""
    groups = structure.seen_as.groups
    return (*groups, "lens") if structure.camera and any(structure.lens_sd) else groups


def spatial_members(structure: SpatialStructure) -> _Ladder:
    """Members of the gate from simple to rich: a name and the groups that it fits."""
    frame = frame_groups(structure)
    chain = (*frame, "placement")
    ladder: list[tuple[str, tuple[str, ...]]] = []
    if structure.informed:
        chain = (*chain, "offset")
        ladder.append(("frame", frame))
        if structure.few:
            return tuple(ladder)
        if structure.camera:
            ladder.append(("offsets", (*frame, "offset")))
    ladder.append(("chain", chain))
    if len(structure.groups["elastic"]) and structure.informed:
        chain = (*chain, "elastic")
        ladder.append(("elastic", chain))
    if any(structure.revolute):
        ladder.append(("curves", (*chain, "curve")))
    return tuple(ladder)


def spatial_prior(structure: SpatialStructure, free: Sequence[str]) -> Prior:
    """Prior of the member that fits the groups `free`; ``"curve"`` stands for all curves."""
    groups, layout = structure.groups, structure.layout
    found = GrowingPrior(structure.neutral())
    sd, reach = found.sd, max(structure.chain.reach, 1e-9)
    camera, informed = structure.camera, structure.informed
    flat: dict[str, Any] = {
        "view.rotation": 100.0,
        "view.shift": FREE * (reach if camera else structure.extent),
        "view.scale": 100.0,
        "lens": structure.lens_sd,
        "tool": FREE * reach if informed else reach,
        "tool.rotation": 100.0,
    }
    for group in free:
        if group in flat and not (group == "tool" and camera and informed):
            sd[groups[group]] = flat[group]
    if "tool" in free and camera and informed:
        found.chosen("tool", groups["tool"], _TAG, SCALES)
    # in a free frame the first turning joint's offset and a turn of the frame about its axis are
    # one, and the first origin's place is the frame's own
    first = 0 if structure.view == "base" else 1
    if "offset" in free:
        # before the placements: turned and shifted origins would explain an offset too, by freeing
        # sixfold what they are; of a camera's arm they took 2 deg where 0.2 deg was true
        turns, offset = np.asarray(structure.revolute)[first:], groups["offset"][first:]
        found.chosen("offset", offset[turns], TURN, _OFFSET_SCALES)
        found.chosen("offset.slide", offset[~turns], SHIFT, SCALES)
    if "placement" in free and informed:
        found.chosen("placement.shift", layout.shifts[first:].ravel(), SHIFT, SCALES)
        found.chosen("placement.turn", layout.turns[first:].ravel(), TURN, SCALES)
    elif "placement" in free:
        sd[layout.shifts] = reach
        sd[layout.turns] = 3.0
    if "gain" in free:
        found.chosen("gain", groups["gain"], 1e-3, SCALES)
    if "elastic" in free:
        found.moving("elastic", groups["elastic"], _ELASTIC, 1.0)
    found.curves(groups, free, curve_shape(), _CURVE, 5.0)
    return found.whole()
