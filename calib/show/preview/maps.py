"""Maps of a scene: both lattices, the links between them, and the words beside them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...common.arrays import Array, Index, Mask
from ...common.wording import for_people
from ...model.model import Model
from ..error_scale import ErrorScale, colours, number
from ..settings import AMOUNTS
from ..workspace import drawn_edges, extent, node_errors
from .canvas import Canvas, packed
from .placement import Placement

_LINK = "#2f9e44"
_FRAME = "#8b97a3"
_OFF = 0.06  # of the panel's side, from its edge to the words


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
        corner = np.array([high[0] + 0.22 * size, middle, np.median(flat[:, 2])])
        return Panel(corner @ frame, size * frame[: min(dof, 3)])

    def lift(self, u: Array) -> Array:
        """Points (n, 3) of the scene for joints (n, dof) in their unit box."""
        return np.asarray(
            self.corner + np.asarray(u)[:, : len(self.edges)] @ self.edges
        )

    def outline(self) -> tuple[Array, NDArray[np.intp]]:
        """Corners (n, 3) and pairs of them (m, 2) that the box is drawn with."""
        corners = np.array(list(np.ndindex(*(2,) * len(self.edges))), dtype=float)
        first, second = np.triu_indices(len(corners), 1)
        near = np.abs(corners[first] - corners[second]).sum(axis=1) == 1
        return self.lift(corners), np.stack([first[near], second[near]], axis=1)


def draw_maps(
    canvas: Canvas,
    model: Model,
    placement: Placement,
    panel: Panel,
    scale: ErrorScale,
    size: float,
) -> None:
    """Draw both maps, coloured by their errors; of arms in space they are off until asked for."""
    flat = len(model.axes) == 2
    few = (
        "over the joints' ranges"
        if len(model.about.joint_names) < 4
        else "over three joints"
    )
    motor_errors, sensory_errors = node_errors(model)
    sensory = placement.lift(model.sensory.weights)
    motor = panel.lift(model.motor.units)
    for name, part, points, text, errors in (
        ("Sensory map", model.sensory, sensory, "where they stand", sensory_errors),
        ("Motor map", model.motor, motor, few, motor_errors),
    ):
        tint = colours(scale.share(errors))
        shape = part.lattice.shape
        edges = drawn_edges(part)
        if len(shape) == 3:  # all edges would hide the arm, and each other
            edges = edges[_on_middle_sheets(shape, edges)]
            text += ", edges of the middle sheets"
        nodes = "x".join(map(str, shape))
        canvas.layer(name, "scale", f"{nodes} nodes {text}", shown=flat)
        canvas.add(f"{name}/lattice", "lines", tint, points, edges)
        apart = float(
            np.median(np.linalg.norm(np.diff(points[edges], axis=1)[:, 0], axis=1))
        )
        width = max(apart, 0.003 * size)
        canvas.add(
            f"{name}/nodes",
            "points",
            tint,
            points,
            size=width * (0.5 if flat else 0.12),
        )
    canvas.add("Motor map/range", "lines", _FRAME, *panel.outline())
    text = "of one node; click the sensory map for another"
    canvas.layer("Hebbian links", _LINK, text, shown=flat)


def _on_middle_sheets(shape: tuple[int, ...], edges: Index) -> Mask:
    """Which edges (m, 2) of a lattice with three axes lie on one of its middle sheets, (m,)."""
    place = np.indices(shape).reshape(3, -1).T
    middle = place == np.array(shape) // 2
    return np.asarray((middle[edges[:, 0]] & middle[edges[:, 1]]).any(axis=1))


def links_of(model: Model, among: NDArray[np.intp]) -> dict[str, Any]:
    """Strongest motor partners of each sensory node, for the page.

    "each" is how many of each node, "partners" are the strongest first, the largest number where
    there are fewer, "node" is the one of `among` whose partners spread the furthest.
    """
    links = model.links.T.tocsr()
    width = min(AMOUNTS.most, max(AMOUNTS.fewest, AMOUNTS.links // links.shape[0]))
    partners = np.full((links.shape[0], width), -1, dtype=np.int64)
    for row, (start, end) in zip(partners, pairwise(links.indptr), strict=True):
        best = np.argsort(-links.data[start:end], kind="stable")[:width]
        row[: len(best)] = links.indices[start:end][best]
    spreads = []
    for node in among:
        units = model.motor.units[links.indices[slice(*links.indptr[node : node + 2])]]
        spreads.append(float(np.ptp(units, axis=0).sum()) if len(units) else 0.0)
    return {
        "each": width,
        "partners": packed(partners.astype(np.uint32), np.uint32),
        "node": int(among[np.argmax(spreads)]),
        "link": _LINK,
    }


def labels(
    model: Model, placement: Placement, panel: Panel
) -> Iterator[tuple[str, str, Array]]:
    """Yield layer, text and place (3,) of the names of both maps and of the joints' ranges."""
    about = model.about
    up = placement.frame[1]
    points = placement.lift(model.sensory.weights)
    size = extent(model) * float(np.linalg.norm(placement.axes[1]))
    yield (
        "Sensory map",
        "sensory map",
        points[np.argmax(points @ up)] + _OFF * size * up,
    )
    yield (
        "Motor map",
        "motor map",
        panel.lift(np.array([[0.5, 1.0 + 1.5 * _OFF, 0.0]]))[0],
    )
    for axis in range(len(panel.edges)):
        factor, unit = for_people(about.units_of_joints[axis])
        low = f"{number(factor * about.lower[axis])} {unit}"
        high = f"{number(factor * about.upper[axis])} {unit}"
        for share, text in ((0.5, about.joint_names[axis]), (0.0, low), (1.0, high)):
            # the third along the other side, where no other joint's words are
            at = np.array(
                [-2 * _OFF, -_OFF, 0.0] if axis < 2 else [1.0 + _OFF, 0.0, 0.0]
            )
            at[axis] = share
            yield "Motor map", text, panel.lift(at[None])[0]
