"""Maps of a scene: both lattices, the links between them, and their labels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ...common.arrays import Array
from ...common.rows import row_lengths
from ...common.wording import quantity
from ...maps.lattice import Lattice
from ...maps.map import Map
from ...model.model import Model
from ...model.nominal import moves_in_space
from ..error_scale import UNKNOWN, ErrorScale
from ..settings import SETTINGS
from ..workspace import drawn_edges, node_errors
from .canvas import Canvas, Colour, packed

_LINK = "#2f9e44"


@dataclass(frozen=True, eq=False)
class Panel:
    """The box next to the workspace in which the joints' ranges are drawn."""

    corner: Array  # (3,), where every joint is at the lower end of its range
    edges: Array  # (k, 3), where the first two or three joints lead, over their whole range

    @staticmethod
    def beside(frame: Array, points: Array, size: float, dof: int) -> Panel:
        """A panel of side `size` at the right of points (n, 3), in a plane of `frame` (3, 3)."""
        flat = points @ frame.T
        right, top, _ = flat.max(axis=0)
        height = (flat[:, 1].min() + top - size) / 2
        corner = np.array([right + 0.22 * size, height, np.median(flat[:, 2])])
        return Panel(corner @ frame, size * frame[: min(dof, 3)])

    def lift(self, u: ArrayLike) -> Array:
        """Points (..., 3) of the scene for joints (..., dof) in their unit box."""
        shares = np.asarray(u, float)[..., : len(self.edges)]
        return self.corner + shares @ self.edges


def draw_maps(
    canvas: Canvas, model: Model, places: Array, panel: Panel, scale: ErrorScale
) -> None:
    """Draw both maps, coloured by their errors; of arms in space they are off until chosen.

    places : (nodes, 3), of the sensory map
    """
    shown = not moves_in_space(model)
    motor_errors, sensory_errors = node_errors(model)
    joints = panel.lift(model.motor.units)
    sensory_tints = scale.colours(sensory_errors)
    motor_tints = scale.colours(motor_errors)
    _draw_map(
        canvas, "Sensory map", model.sensory, places, sensory_tints, shown
    )
    _draw_map(canvas, "Motor map", model.motor, joints, motor_tints, shown)
    box = Lattice((2,) * len(panel.edges))
    corners = panel.lift(box.positions())
    canvas.add("Motor map/range", "lines", UNKNOWN, corners, box.edges())
    text = "of one node; click the sensory map for another"
    canvas.layer("Hebbian links", _LINK, text, shown=shown)
    up = panel.edges[1 % len(panel.edges)] / np.linalg.norm(panel.edges[0])
    top = places[np.argmax(places @ up)]
    canvas.label("Sensory map", "sensory map", top + 0.06 * canvas.size * up)
    canvas.label("Motor map", "motor map", panel.lift([0.5, 1.09, 0.0]))
    _label_joints(canvas, model, panel)


def _draw_map(
    canvas: Canvas,
    name: str,
    som: Map,
    points: Array,
    tints: Colour,
    shown: bool,
) -> None:
    """Draw a map with its nodes at points (nodes, 3)."""
    edges = drawn_edges(som)
    nodes = "x".join(map(str, som.lattice.shape))
    canvas.layer(name, "scale", f"{nodes} nodes", shown=shown)
    canvas.add(f"{name}/lattice", "lines", tints, points, edges)
    lengths = row_lengths(np.diff(points[edges], axis=1)[:, 0])
    share = 0.5 * np.median(lengths) / canvas.size
    width = float(np.clip(share, 0.003, 0.02))
    canvas.add(f"{name}/nodes", "points", tints, points, size=width)


def _label_joints(canvas: Canvas, model: Model, panel: Panel) -> None:
    """Write the names of the joints, and the ends of their ranges."""
    about = model.about
    for axis in range(len(panel.edges)):
        unit = about.units_of_joints[axis]
        words = {
            0.0: quantity(about.lower[axis], unit),
            0.5: about.joint_names[axis],
            1.0: quantity(about.upper[axis], unit),
        }
        for share, text in words.items():
            shares = np.array([-0.12, -0.06, 0.0])
            if axis == 2:
                # along the other side, where no other joint's words are
                shares[:2] = 1.06, 0.0
            shares[axis] = share
            canvas.label("Motor map", text, panel.lift(shares))


def links_of(model: Model, node: int) -> dict[str, object]:
    """Strongest motor partners of each sensory node, for the page.

    "each" is how many of each node, "partners" are the strongest first, the largest number where
    there are fewer, "node" is the one that is shown first.
    """
    links = model.links.T.tocoo()
    order = np.lexsort((-links.data, links.row))
    nodes = links.row[order]
    rank = np.arange(len(nodes)) - np.searchsorted(nodes, nodes)
    strong = rank < SETTINGS.links
    nobody = np.iinfo(np.uint32).max
    partners = np.full((links.shape[0], SETTINGS.links), nobody, np.uint32)
    partners[nodes[strong], rank[strong]] = links.col[order][strong]
    return {
        "each": SETTINGS.links,
        "partners": packed(partners, np.uint32),
        "node": node,
        "link": _LINK,
    }
