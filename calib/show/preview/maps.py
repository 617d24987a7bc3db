"""Maps of a scene: both lattices, the links between them, and the words beside them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...common.arrays import Array
from ...common.wording import for_people
from ...model.model import Model
from ...model.nominal import moves_in_space
from ..error_scale import UNKNOWN, ErrorScale, colours, number
from ..settings import SETTINGS
from ..workspace import drawn_edges, node_errors
from .canvas import Canvas, packed

_LINK = "#2f9e44"


@dataclass(frozen=True, eq=False)
class Panel:
    """The box beside the workspace in which the joints' ranges are drawn."""

    corner: Array  # (3,), where every joint is at the lower end of its range
    edges: Array  # (k, 3), where the first two or three joints lead, over their whole range

    @staticmethod
    def beside(frame: Array, points: Array, size: float, dof: int) -> Panel:
        """A panel of side `size` at the right of points (n, 3), in a plane of `frame` (3, 3)."""
        flat = points @ frame.T
        low = flat.min(axis=0)
        high = flat.max(axis=0)
        middle = (low[1] + high[1] - size) / 2
        corner = np.array(
            [high[0] + 0.22 * size, middle, np.median(flat[:, 2])]
        )
        return Panel(corner @ frame, size * frame[: min(dof, 3)])

    def lift(self, u: ArrayLike) -> Array:
        """Points (..., 3) of the scene for joints (..., dof) in their unit box."""
        shares = np.asarray(u, dtype=float)[..., : len(self.edges)]
        return np.asarray(self.corner + shares @ self.edges)

    def outline(self) -> tuple[Array, NDArray[np.intp]]:
        """Corners (n, 3) and pairs of them (m, 2) that the box is drawn with."""
        corners = np.array(
            list(np.ndindex(*(2,) * len(self.edges))), dtype=float
        )
        first, second = np.triu_indices(len(corners), 1)
        near = np.abs(corners[first] - corners[second]).sum(axis=1) == 1
        return self.lift(corners), np.stack([first[near], second[near]], axis=1)


def draw_maps(
    canvas: Canvas,
    model: Model,
    places: Array,
    panel: Panel,
    scale: ErrorScale,
    size: float,
) -> None:
    """Draw both maps, coloured by their errors; of arms in space they are off until asked for.

    places : (nodes, 3), of the sensory map
    """
    shown = not moves_in_space(model)
    motor_errors, sensory_errors = node_errors(model)
    joints = panel.lift(model.motor.units)
    for name, part, points, text, errors in (
        (
            "Sensory map",
            model.sensory,
            places,
            "where they stand",
            sensory_errors,
        ),
        (
            "Motor map",
            model.motor,
            joints,
            "over the joints' ranges",
            motor_errors,
        ),
    ):
        tint = colours(scale.share(errors))
        edges = drawn_edges(part)
        nodes = "x".join(map(str, part.lattice.shape))
        canvas.layer(name, "scale", f"{nodes} nodes {text}", shown=shown)
        canvas.add(f"{name}/lattice", "lines", tint, points, edges)
        lengths = np.linalg.norm(np.diff(points[edges], axis=1)[:, 0], axis=1)
        width = float(
            np.clip(0.5 * np.median(lengths), 0.003 * size, 0.02 * size)
        )
        canvas.add(f"{name}/nodes", "points", tint, points, size=width)
    canvas.add("Motor map/range", "lines", UNKNOWN, *panel.outline())
    text = "of one node; click the sensory map for another"
    canvas.layer("Hebbian links", _LINK, text, shown=shown)
    _label_maps(canvas, model, places, panel, size)


def _label_maps(
    canvas: Canvas, model: Model, places: Array, panel: Panel, size: float
) -> None:
    """Write the names of both maps, and of the joints with the ends of their ranges."""
    about = model.about
    up = panel.edges[1 % len(panel.edges)]
    up = up / np.linalg.norm(up)
    top = places[np.argmax(places @ up)]
    canvas.label("Sensory map", "sensory map", top + 0.06 * size * up)
    canvas.label("Motor map", "motor map", panel.lift([0.5, 1.09, 0.0]))
    for axis in range(len(panel.edges)):
        factor, unit = for_people(about.units_of_joints[axis])
        low = f"{number(factor * about.lower[axis])} {unit}"
        high = f"{number(factor * about.upper[axis])} {unit}"
        for share, text in (
            (0.5, about.joint_names[axis]),
            (0.0, low),
            (1.0, high),
        ):
            # the third along the other side, where no other joint's words are
            place = np.array(
                [-0.12, -0.06, 0.0] if axis < 2 else [1.06, 0.0, 0.0]
            )
            place[axis] = share
            canvas.label("Motor map", text, panel.lift(place))


def links_of(model: Model, among: NDArray[np.intp]) -> dict[str, object]:
    """Strongest motor partners of each sensory node, for the page.

    "each" is how many of each node, "partners" are the strongest first, the largest number where
    there are fewer, "node" is the one of `among` whose partners spread the furthest.
    """
    links = model.links.T.tocoo()
    order = np.lexsort((-links.data, links.row))
    nodes = links.row[order]
    rank = np.arange(len(nodes)) - np.searchsorted(nodes, nodes)
    width = min(SETTINGS.links, max(6, 120_000 // links.shape[0]))
    strong = rank < width
    nobody = np.iinfo(np.uint32).max
    partners = np.full((links.shape[0], width), nobody, dtype=np.uint32)
    partners[nodes[strong], rank[strong]] = links.col[order][strong]
    spreads = []
    for row in partners[among]:
        units = model.motor.units[row[row != nobody]]
        spreads.append(
            float(np.ptp(units, axis=0).sum()) if len(units) else 0.0
        )
    return {
        "each": width,
        "partners": packed(partners, np.uint32),
        "node": int(among[np.argmax(spreads)]),
        "link": _LINK,
    }
