"""Maps: both lattices, their links and their labels as points, lines and words of the scene."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...common.arrays import Array
from ...common.wording import for_people
from ...model.model import Model
from ..error_scale import ErrorScale, colours
from ..workspace import drawn_edges, extent, node_errors
from .canvas import Canvas, packed
from .placement import Placement

LINK, _FRAME = "#2f9e44", "#8b97a3"
_LINKS, _FEWEST, _MOST = 120_000, 6, 24  # in all, and of one node
_OFF = 0.06  # of the panel's side, from its edge to the words


@dataclass(frozen=True, eq=False)
class Panel:
    """The box beside the workspace in which the joints' ranges are drawn."""

    corner: Array  # (3,), where every joint is at the lower end of its range
    edges: Array  # (k, 3), where the first two or three joints lead, over their whole range

    @staticmethod
    def beside(frame: Array, points: Array, size: float, dof: int) -> Panel:
        """A panel of side `size` at the right of points (n, 3), in a plane of `frame` (3, 3)."""
        seen = points @ frame.T
        low, high = seen.min(axis=0), seen.max(axis=0)
        middle = (low[1] + high[1] - size) / 2
        corner = np.array([high[0] + 0.22 * size, middle, np.median(seen[:, 2])])
        return Panel(corner @ frame, size * frame[: min(dof, 3)])

    def lift(self, u: Array) -> Array:
        """Points (n, 3) of the scene for joints (n, dof) in their unit box."""
        return np.asarray(self.corner + np.asarray(u)[:, : len(self.edges)] @ self.edges)

    def outline(self) -> tuple[Array, NDArray[np.intp]]:
        """Corners (n, 3) and pairs of them (m, 2) that the box is drawn with."""
        corners = np.array(list(np.ndindex(*(2,) * len(self.edges))), dtype=float)
        i, j = np.triu_indices(len(corners), 1)
        near = np.abs(corners[i] - corners[j]).sum(axis=1) == 1
        return self.lift(corners), np.stack([i[near], j[near]], axis=1)


def draw_maps(
    canvas: Canvas, model: Model, placement: Placement, panel: Panel, scale: ErrorScale, size: float
) -> None:
    """Draw both maps, coloured by their errors, in a scene of this size."""
    few = "over the joints' ranges" if len(model.about.joint_names) < 4 else "over three joints"
    sensory, motor = placement.lift(model.sensory.weights), panel.lift(model.motor.units)
    dot = 0.12 if len(model.axes) == 3 else 0.5
    for name, part, points, text, errors in (
        ("Sensory map", model.sensory, sensory, "where they stand", node_errors(model)[1]),
        ("Motor map", model.motor, motor, few, node_errors(model)[0]),
    ):
        tint, shape = colours(scale.share(errors)), part.lattice.shape
        edges = drawn_edges(part)
        if len(shape) == 3:  # all edges would hide the arm, and each other
            place = np.indices(shape).reshape(3, -1).T
            middle = place == np.array(shape) // 2
            edges = edges[(middle[edges[:, 0]] & middle[edges[:, 1]]).any(axis=1)]
            text += ", edges of the middle sheets"
        canvas.layer(name, "scale", f"{'x'.join(map(str, shape))} nodes {text}")
        canvas.add(f"{name}/lattice", "lines", tint, points, edges)
        apart = np.median(np.linalg.norm(np.diff(points[edges], axis=1)[:, 0], axis=1))
        width = dot * max(float(apart), 0.003 * size)
        canvas.add(f"{name}/nodes", "points", tint, points, size=width)
    canvas.add("Motor map/range", "lines", _FRAME, *panel.outline())


def packed_links(model: Model) -> dict[str, Any]:
    """Strongest motor partners of each sensory node, for the page.

    Returns "each", how many of each node, and "partners", the strongest first, the largest number
    where there are fewer.
    """
    links = model.links.T.tocsr()
    width = min(_MOST, max(_FEWEST, _LINKS // links.shape[0]))
    partners = np.full((links.shape[0], width), -1, dtype=np.int64)
    for row, (start, end) in zip(partners, pairwise(links.indptr), strict=True):
        best = np.argsort(-links.data[start:end], kind="stable")[:width]
        row[: len(best)] = links.indices[start:end][best]
    return {"each": width, "partners": packed(partners.astype(np.uint32), np.uint32)}


def telling_node(model: Model, among: NDArray[np.intp]) -> int:
    """Sensory node of some whose partners spread the furthest: it shows every branch."""
    links, units = model.links.tocsc(), model.motor.units
    parts = (units[links.indices[slice(*links.indptr[k : k + 2])]] for k in among)
    return int(among[np.argmax([float(np.ptp(u, axis=0).sum()) if len(u) else 0.0 for u in parts])])


def labels(model: Model, placement: Placement, panel: Panel) -> Iterator[tuple[str, str, Array]]:
    """Yield layer, text and place (3,) of the names of both maps and of the joints' ranges."""
    about, up = model.about, placement.frame[1]
    points = placement.lift(model.sensory.weights)
    size = extent(model) * float(np.linalg.norm(placement.axes[1]))
    yield "Sensory map", "sensory map", points[np.argmax(points @ up)] + _OFF * size * up
    yield "Motor map", "motor map", panel.lift(np.array([[0.5, 1.0 + 1.5 * _OFF, 0.0]]))[0]
    for axis in range(len(panel.edges)):
        factor, unit = for_people(about.units_of_joints[axis])
        low, high = (f"{factor * v[axis]:.4g} {unit}" for v in (about.lower, about.upper))
        for share, text in ((0.0, low), (0.5, about.joint_names[axis]), (1.0, high)):
            # the third along the other side, where no other joint's words are
            at = np.array([-2 * _OFF, -_OFF, 0.0] if axis < 2 else [1.0 + _OFF, 0.0, 0.0])
            at[axis] = share
            yield "Motor map", text, panel.lift(at[None])[0]
