"""Priors of a spatial body: what a URDF, a servo or nothing says of each parameter."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .curves import curve_shape
from .structure import GrowingPrior, Prior

if TYPE_CHECKING:
    from .spatial import SpatialStructure

#: A prior sd of a thousand extents: flat.
FREE = 1e3
#: Joint origins are where a drawing says to 1 mm and 0.1 deg; evidence takes 1, 5 or 20 times that.
SHIFT, TURN = 1e-3, np.radians(0.1)
SCALES = (1.0, 5.0, 20.0)
#: Offsets move by 0.1 deg where an arm was calibrated, by up to 10 deg where servos were put on.
OFFSET_SCALES = (1.0, 5.0, 20.0, 100.0)
#: Joints bend by this much [rad] under the largest torque that gravity could put on the arm.
ELASTIC = 1e-3
#: Curves of industrial arms are 0.15 to 0.4 mrad; evidence finds those of others.
CURVE = 4e-4
#: A camera's tag is held where the drawing says to so many metres.
TAG = 2e-3


def frame_groups(structure: SpatialStructure) -> tuple[str, ...]:
    """Groups that every member fits: the sensor's place and the tip that it sees."""
    groups = structure.seen_as.groups
    return (*groups, "lens") if structure.camera and any(structure.lens_sd) else groups


def members(structure: SpatialStructure) -> tuple[tuple[str, tuple[str, ...]], ...]:
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


def prior(structure: SpatialStructure, free: Sequence[str]) -> Prior:
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
        found.chosen("tool", groups["tool"], TAG, SCALES)
    # in a free frame the first turning joint's offset and a turn of the frame about its axis are
    # one, and the first origin's place is the frame's own
    first = 0 if structure.view == "base" else 1
    if "offset" in free:
        # before the placements: turned and shifted origins would explain an offset too, by freeing
        # sixfold what they are; of a camera's arm they took 2 deg where 0.2 deg was true
        turns, offset = np.asarray(structure.revolute)[first:], groups["offset"][first:]
        found.chosen("offset", offset[turns], TURN, OFFSET_SCALES)
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
        found.moving("elastic", groups["elastic"], ELASTIC, 1.0)
    found.curves(groups, free, curve_shape(), CURVE, 5.0)
    return found.whole()
