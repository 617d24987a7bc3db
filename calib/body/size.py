"""The size of a whole arm: what its drawing and a stated length say of it, side by side.

Sockets tell an arm's shape, not its size: growing by one factor, arm and sockets together, leaves
every touch as it was.  The drawing knows the size to some `DRAWN_SIZE`, and so does a distance of
sockets that somebody stated; where both disagree, one of them is wrong.
"""

from __future__ import annotations

import numpy as np

from ..common.arrays import Array
from .belief import Body
from .spatial import SpatialStructure

DRAWN_SIZE = 2e-3
"""Sd of an arm's size over that of its drawing: machined links, and a frame of aluminium that is
20 deg warmer than the drawing grows by .5 of a thousandth."""


def with_size(body: Body, sd: float) -> Body:
    """Return the belief of an arm whose size is known to a relative `sd` alone."""
    growth = sd * _growth(_spatial(body))
    return body.changed(
        lambda belief: {
            "root": np.column_stack([belief.root, growth[belief.active]])
        }
    )


def _growth(structure: SpatialStructure) -> Array:
    """Return how the parameters (d,) move as the arm grows, by its own size."""
    growth = np.zeros(structure.size)
    stops = np.vstack([structure.chain.points, structure.chain.tip])
    *links, tool = np.diff(stops, axis=0)
    growth[structure.shifts[1:]] = links
    growth[structure.groups["tool"]] = structure.chain.rotation.T @ tool
    return growth


def _spatial(body: Body) -> SpatialStructure:
    structure = body.structure
    assert isinstance(structure, SpatialStructure)  # noqa: S101 - of arms in space alone
    return structure
