"""Lattices: both maps and their links as points and lines of the scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from ...model.model import Model

Array = NDArray[np.float64]

_LINKS = 120_000
_FEWEST, _MOST = 6, 24


@dataclass(frozen=True, eq=False)
class Panel:
    """The box beside the workspace in which the joints' ranges are drawn.

    Attributes
    ----------
    corner : (3,) array
        Where every joint is at the lower end of its range.
    edges : (k, 3) array
        Where the first two or three joints lead, over their whole range.
    """

    corner: Array
    edges: Array

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


def strongest_partners(model: Model) -> tuple[NDArray[np.int64], NDArray[np.uint8]]:
    """Strongest motor partners of each sensory node, and their strengths.

    Returns
    -------
    partners : (sensory nodes, k) int array
        Motor nodes, the strongest first; -1 where there are fewer.
    strength : (sensory nodes, k) uint8 array
        255 for the strongest.
    """
    links = model.links.T.tocsr()
    width = min(_MOST, max(_FEWEST, _LINKS // links.shape[0]))
    rows = np.repeat(np.arange(links.shape[0]), np.diff(links.indptr))
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
    total = np.where(total > 0, total, np.inf)
    mean = (links @ units) / total[:, None]
    spread = np.asarray(links @ (units**2)).sum(axis=1) / total - (mean**2).sum(axis=1)
    return int(among[np.argmax(spread)])
