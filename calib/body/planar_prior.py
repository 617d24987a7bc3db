"""Priors of a planar body: what a URDF, a servo or nothing says of each parameter."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..common.arrays import Array
from .curves import curve_shape
from .structure import GrowingPrior, Prior
from .views import PLANAR

if TYPE_CHECKING:
    from .planar import PlanarStructure

FREE = 1e3
"""A prior sd of a thousand extents or radians: flat."""

OFFSET_SCALES = (1.0, 5.0, 20.0, 100.0)
"""Offsets move by 0.1 deg where an arm was calibrated, by up to 10 deg where servos were put on."""

SCALES = (1.0, 5.0, 20.0)

LONG = 3.0
"""Waves a turn up to which a joint's curve may be larger: eccentric wheels, loads out of plane."""


def members(structure: PlanarStructure) -> tuple[tuple[str, tuple[str, ...]], ...]:
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


def prior(structure: PlanarStructure, free: Sequence[str]) -> Prior:
    """Prior of the member that fits the groups `free`; ``"curve"`` stands for all curves."""
    lay, nominal = structure.layout, structure.nominal
    found = GrowingPrior(neutral(structure))
    sd, extent = found.sd, structure.extent
    flat = {
        "view.rotation": 100.0,
        "view.scale": 100.0,
        "view.shift": FREE * extent,
        "view.shear": 1.0,
        "view.tilt": 1.0 / chain_reach(structure),
        "lens": 0.5,
    }
    for group in free:
        if group in flat:
            sd[lay.groups[group]] = flat[group]
    if nominal is not None:
        # in a free frame the first joint's offset and a turn of the frame are one
        first = 0 if structure.view == "base" else 1
        if "length" in free:
            found.chosen("length", lay.length, 1e-3 * structure.slide, SCALES)
        if "offset" in free:
            found.chosen("offset", lay.offset[first:], np.radians(0.1), OFFSET_SCALES)
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
    # Harmonic drives have 0.15 to 0.4 mrad; a weak hyperprior (10) left 30 rows 1 % worse.
    found.curves(lay.groups, free, curve_shape(LONG), 4e-4, 40.0)
    return found.whole()


def neutral(structure: PlanarStructure) -> Array:
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


def chain_reach(structure: PlanarStructure) -> float:
    """Size of the chain in its own units, for the prior of a tilt."""
    if structure.nominal is not None:
        return max(float(np.sum(structure.nominal.lengths)) * structure.slide, 1e-12)
    return 1.0 if structure.scaled else structure.extent
