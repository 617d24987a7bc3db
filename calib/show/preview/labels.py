"""Labels: words that stand beside the drawn maps."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from ..workspace import extent

if TYPE_CHECKING:
    from ...model.model import Model
    from .lattices import Panel
    from .placement import Placement

_OFF = 0.05  # of the panel's side, from its edge to the words


def labels(model: Model, placement: Placement, panel: Panel) -> list[dict[str, Any]]:
    """Names of both maps and the ends of the joints' ranges, with their places.

    Returns
    -------
    list of dict
        "layer" that a label belongs to, "text", "at", its place in the scene, and "align",
        which of its ends is there.
    """
    about, dim = model.about, len(panel.edges)
    points = placement.lift(model.sensory.weights)
    up = placement.frame[1]
    size = extent(model) * float(np.linalg.norm(placement.axes[1]))
    highest = points[np.argmax(points @ up)] + _OFF * size * up
    found = [("Sensory map", "sensory map", highest, "middle")]
    above = np.zeros(dim)
    above[:2] = 0.5, 1.0 + 1.5 * _OFF
    found.append(("Motor map", "motor map", panel.lift(above[None])[0], "middle"))
    for axis in range(dim):
        for share in (0.0, 0.5, 1.0):
            at = np.full(dim, -_OFF)
            at[2:] = 0.0
            at[axis] = share
            if axis == 2:  # along the other side, where no other joint's words are
                at[0], at[1] = 1.0 + _OFF, 0.0
            value = about.lower[axis] + share * (about.upper[axis] - about.lower[axis])
            turns = about.revolute[axis]
            end = f"{math.degrees(value):.4g}°" if turns else f"{1e3 * value:.4g} mm"
            text = about.joint_names[axis] if share == 0.5 else end
            side = ("middle", "right", "left")[axis]
            found.append(("Motor map", text, panel.lift(at[None])[0], side))
    return [
        {"layer": layer, "text": text, "at": [float(v) for v in at], "align": side}
        for layer, text, at, side in found
    ]
