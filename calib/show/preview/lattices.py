"""Lattices: both maps, their links and their labels as points, lines and words of the scene."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...common.arrays import Array
from ...model.model import Model
from ..error_scale import ErrorScale, colours
from ..workspace import drawn_edges, extent, motor_errors, sensory_errors
from .canvas import Canvas
from .placement import Placement

LINK, FRAME = "#2f9e44", "#8b97a3"
_LINKS = 120_000
_FEWEST, _MOST = 6, 24


@dataclass(frozen=True, eq=False)
class Panel:
    """The box beside the workspace in which the joints' ranges are drawn."""

    corner: Array  # (3,), where every joint is at the lower end of its range
    edges: Array  # (k, 3), where the first two or three joints lead, over their whole range

    def lift(self, u: Array) -> Array:
        """Points (n, 3) of the scene for joints (n, dof) in their unit box."""
        k = len(self.edges)
        return np.asarray(self.corner + np.asarray(u)[:, :k] @ self.edges)

    @property
    def outline(self) -> tuple[Array, NDArray[np.intp]]:
        """Corners (n, 3) and pairs of them (m, 2) that the box is drawn with."""
        k = len(self.edges)
        corners = np.array(list(np.ndindex(*(2,) * k)), dtype=float)
        i, j = np.triu_indices(len(corners), 1)
        near = np.abs(corners[i] - corners[j]).sum(axis=1) == 1
        return self.lift(corners), np.stack([i[near], j[near]], axis=1)


def panel_beside(frame: Array, points: Array, size: float, dof: int) -> Panel:
    """Return a panel of side `size` at the right of points (n, 3), in a plane of `frame`."""
    seen = points @ frame.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    middle = (low[1] + high[1]) / 2
    corner = np.array([high[0] + 0.22 * size, middle - size / 2, np.median(seen[:, 2])])
    return Panel(corner @ frame, size * frame[: min(dof, 3)])


def draw_maps(
    canvas: Canvas, model: Model, placement: Placement, panel: Panel, scale: ErrorScale, size: float
) -> None:
    """Draw both maps, coloured by their errors.

    The sensory map is where the tip is, the motor map in its panel; `size` is that of the scene.
    """
    sensory = placement.lift(model.sensory.weights)
    motor = panel.lift(np.asarray(model.motor.units))
    few = len(model.about.joint_names) < 4
    for name, part, points, errors, text in (
        ("Sensory map", model.sensory, sensory, sensory_errors(model), "where they stand"),
        (
            "Motor map",
            model.motor,
            motor,
            motor_errors(model),
            "over the joints' ranges" if few else "over three joints",
        ),
    ):
        tint = colours(scale.share(errors))
        shape = "x".join(map(str, part.lattice.shape))
        edges, sheets = drawn_edges(part), ""
        if len(part.lattice.shape) == 3:  # all edges would hide the arm, and each other
            place = np.indices(part.lattice.shape).reshape(3, -1).T
            middle = place == np.array(part.lattice.shape) // 2
            edges = edges[(middle[edges[:, 0]] & middle[edges[:, 1]]).any(axis=1)]
            sheets = ", edges of the middle sheets"
        canvas.layer(name, "scale", f"{shape} nodes {text}{sheets}")
        canvas.add(f"{name}/lattice", "lines", tint, points, edges)
        ends = points[edges]
        spacing = float(np.median(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)))
        width = 0.12 if len(model.axes) == 3 else 0.5 if part.units.shape[1] == 2 else 0.25
        width *= max(spacing, 0.003 * size)
        canvas.add(f"{name}/nodes", "points", tint, points, size=width)
    corners, pairs = panel.outline
    canvas.add("Motor map/range", "lines", FRAME, corners, pairs)


def strongest_partners(model: Model) -> tuple[NDArray[np.int64], NDArray[np.uint8]]:
    """Strongest motor partners of each sensory node, and their strengths.

    Returns partners : (sensory nodes, k), motor nodes, the strongest first; -1 where there are
        fewer
    Returns strength : (sensory nodes, k), 255 for the strongest
    """
    links = model.links.T.tocsr()
    width = min(_MOST, max(_FEWEST, _LINKS // links.shape[0]))
    rows = np.repeat(np.arange(links.shape[0]), np.diff(links.indptr))
    # sorted within each row by strength; `rank` counts from the row's start
    order = np.lexsort((-links.data, rows))
    rank = np.arange(len(rows)) - links.indptr[rows]
    keep = rank < width
    partners = np.full((links.shape[0], width), -1, dtype=np.int64)
    strength = np.zeros((links.shape[0], width))
    partners[rows[keep], rank[keep]] = links.indices[order][keep]
    strength[rows[keep], rank[keep]] = links.data[order][keep]
    most = strength[:, :1]
    share = strength / np.where(most > 0, most, 1.0)
    return partners, np.round(255 * share).astype(np.uint8)


def telling_node(model: Model, among: NDArray[np.intp]) -> int:
    """Sensory node of some whose partners are the farthest apart: it shows every branch."""
    links = model.links[:, among].T.tocsr()
    units = model.motor.units
    total = np.asarray(links.sum(axis=1)).ravel()
    # a node without partners has no spread, and is not chosen
    total = np.where(total > 0, total, np.inf)
    # variance of the partners about their mean, E|u|^2 - |E u|^2
    mean = (links @ units) / total[:, None]
    spread = np.asarray(links @ (units**2)).sum(axis=1) / total - (mean**2).sum(axis=1)
    return int(among[np.argmax(spread)])


_OFF = 0.05  # of the panel's side, from its edge to the words


def labels(model: Model, placement: Placement, panel: Panel) -> list[dict[str, Any]]:
    """Names of both maps and the ends of the joints' ranges, with their places.

    Returns "layer" that a label belongs to, "text", "at", its place in the scene, and
    "align", which of its ends is there.
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
