"""Orientation: whether the tool of a log is turned otherwise than the model's.

Positions of a tool that is bent about its own tip stay as they were; only orientations tell.  They
tell of the tool alone: what they say of a chain made the positions of real rows worse.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..arm.rotations import exponential, logarithm, matrix_of
from ..body.belief import Body, knows_orientation
from ..body.covariance import root_of
from ..body.fit import Fit
from ..body.parameters import Prior
from ..body.rows import Rows
from ..body.settings import FREE, STUDENT
from ..common.arrays import Array
from .settings import FALSE_ALARM


@dataclass(frozen=True)
class TurnedTool:
    """How the tool of a log is turned, beside what a belief says."""

    score: float = 0.0  # statistic over its threshold; 0 where nothing can be compared
    turn: Array = field(
        default_factory=lambda: np.zeros(3)
    )  # [rad], in the tool's own axes
    covariance: Array = field(default_factory=lambda: np.zeros((3, 3)))
    notes: tuple[str, ...] = ()  # why orientations were not compared

    def of(self, body: Body) -> Body:
        """A belief with the tool turned."""
        tool = body.structure.groups["tool.rotation"]
        delta = np.zeros(body.structure.size)
        delta[tool] = self.turn
        place = np.searchsorted(body.active, tool)
        covariance = body.covariance.copy()
        covariance[place], covariance[:, place] = 0.0, 0.0
        covariance[np.ix_(place, place)] = self.covariance / body.kappa**2
        beta = body.structure.retract(body.beta, delta)
        return replace(body, beta=beta, root=root_of(covariance))


def turned_tool(
    old: Body,
    structure: Any,
    beta: Array,
    q: Array,
    x: Array,
    orientation: Array | None,
    *,
    framed: bool,
) -> TurnedTool:
    """Compare orientations (n, 4) with those that parameters (d,) predict.

    old : the belief of the model
    framed : whether the sensor may be turned, too: positions tell that less well
    """
    from scipy.special import chdtri

    if orientation is None:
        return TurnedTool()
    if not knows_orientation(old):
        told = "orientations are not compared: the model was learned without them"
        return TurnedTool(notes=(told,))
    tool = structure.groups["tool.rotation"]
    sd = np.zeros(structure.size)
    sd[tool], sd[structure.groups["view.rotation"]] = FREE, FREE * framed
    poses = np.hstack([x, logarithm(matrix_of(orientation))])
    # of positions nothing is asked
    rows = [Rows(q, poses, floor=np.repeat([FREE**2 * structure.extent, 1e-9], 3))]
    seen = structure.with_view("pose")
    fit = Fit(seen, rows, beta, Prior(beta, sd), nu=STUDENT).maximise()
    before, after = exponential(np.stack([beta[tool], fit.beta[tool]]))
    turn = logarithm(before.T @ after)
    place = np.searchsorted(fit.active, tool)
    own = fit.covariance[np.ix_(place, place)]
    held = np.searchsorted(old.active, tool)
    # the model knows its own tool as well as it does
    covariance = own + old.kappa**2 * old.covariance[np.ix_(held, held)]
    score = float(turn @ np.linalg.solve(covariance, turn)) / float(
        chdtri(3, FALSE_ALARM)
    )
    # what the chain leaves over differs between regions of the workspace by about its scatter
    score = min(score, float(np.linalg.norm(turn) / (np.sqrt(3) * fit.noise[-1])))
    return TurnedTool(score, turn, own)
