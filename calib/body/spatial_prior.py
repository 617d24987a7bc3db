"""Priors of a spatial body: what a URDF, a servo or nothing says of each parameter."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from .curves import HARMONICS, curve_shape
from .structure import Hyper, Indices, Prior

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
    mean, sd = structure.neutral(), np.zeros(structure.size)
    hypers: list[Hyper] = []
    reach = max(structure.chain.reach, 1e-9)
    camera = structure.camera

    def varied(name: str, ix: Indices, scale: float, factors: tuple[float, ...]) -> None:
        sd[ix] = scale
        if len(ix):
            hypers.append(Hyper(name, ix, np.ones(len(ix)), scale, choices=factors))

    if "view.rotation" in free:
        sd[groups["view.rotation"]] = 100.0
    if "view.shift" in free:
        sd[groups["view.shift"]] = FREE * (reach if camera else structure.extent)
    if "view.scale" in free:
        sd[groups["view.scale"]] = 100.0
    if "lens" in free:
        sd[groups["lens"]] = structure.lens_sd
    if "tool.rotation" in free:
        sd[groups["tool.rotation"]] = 100.0
    if "tool" in free and camera and structure.informed:
        varied("tool", groups["tool"], TAG, SCALES)
    elif "tool" in free:
        sd[groups["tool"]] = FREE * reach if structure.informed else reach
    if "offset" in free:
        # before the placements: turned and shifted origins would explain an offset too, by freeing
        # sixfold what they are; of a camera's arm they took 2 deg where 0.2 deg was true
        # the first turning joint's offset and a turn of the frame about its axis are one
        first = 0 if structure.view == "base" else 1
        turning = np.flatnonzero(structure.revolute)
        turning = turning[turning >= first]
        sliding = np.flatnonzero(~np.asarray(structure.revolute))
        varied("offset", groups["offset"][turning], TURN, OFFSET_SCALES)
        varied("offset.slide", groups["offset"][sliding[sliding >= first]], SHIFT, SCALES)
    if "placement" in free and structure.informed:
        # in a free frame the first origin's place is the frame's own
        first = 0 if structure.view == "base" else 1
        varied("placement.shift", layout.shifts[first:].ravel(), SHIFT, SCALES)
        varied("placement.turn", layout.turns[first:].ravel(), TURN, SCALES)
    elif "placement" in free:
        sd[layout.shifts] = reach
        sd[layout.turns] = 3.0
    if "gain" in free:
        varied("gain", groups["gain"], 1e-3, SCALES)
    if "elastic" in free and len(groups["elastic"]):
        ix = groups["elastic"]
        sd[ix] = ELASTIC
        hypers.append(Hyper("elastic", ix, np.ones(len(ix)), ELASTIC, pseudo=1.0))
    for k in range(structure.dof):
        ix = groups[f"curve.{k}"]
        if len(ix) and ("curve" in free or f"curve.{k}" in free):
            shape = curve_shape()
            scale = CURVE / np.sqrt(2 * HARMONICS)
            sd[ix] = scale * np.sqrt(shape)
            hypers.append(Hyper(f"curve.{k}", ix, shape, scale, pseudo=5.0))
    return Prior(mean, sd, tuple(hypers))
