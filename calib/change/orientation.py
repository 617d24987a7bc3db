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
from .causes import Cause
from .rows import LogRows
from .settings import FALSE_ALARM


@dataclass(frozen=True)
class TurnedTool:
    """How the tool of a log is turned, beside what a belief says."""

    # statistic over its threshold; 0 where nothing can be compared
    score: float = 0.0
    turn: Array = field(
        default_factory=lambda: np.zeros(3)
    )  # [rad], in the tool's own axes
    covariance: Array = field(default_factory=lambda: np.zeros((3, 3)))
    notes: tuple[str, ...] = ()  # why orientations were not compared

    @property
    def cause(self) -> Cause:
        """A tool that is turned about its own tip."""
        angle = float(np.linalg.norm(self.turn))
        half = (
            1.96
            * float(np.sqrt(self.turn @ self.covariance @ self.turn))
            / angle
        )
        size = f"{np.degrees(angle):.3g} deg"
        words = f"the tool is turned by {size} (its orientation, not its place)"
        return Cause.measured(
            "tool", "tool.rotation", words, angle, half, "rad"
        )

    def of(self, body: Body) -> Body:
        """A belief with the tool turned."""
        tool = body.structure.groups["tool.rotation"]
        delta = np.zeros(body.structure.size)
        delta[tool] = self.turn
        place = np.searchsorted(body.active, tool)
        covariance = body.covariance.copy()
        covariance[place] = 0.0
        covariance[:, place] = 0.0
        covariance[np.ix_(place, place)] = self.covariance / body.kappa**2
        beta = body.structure.retract(body.beta, delta)
        return replace(body, beta=beta, root=root_of(covariance))


def turned_tool(
    rows: LogRows,
    structure: Any,
    beta: Array,
    deviation: Array,
    *,
    framed: bool,
) -> TurnedTool:
    """Compare orientations with those that parameters (d,) predict.

    deviation : (d,), standard deviations of the parameters, which may turn the tool, too
    framed : whether the sensor may be turned, too: positions tell that less well
    """
    from scipy.special import chdtri

    old = rows.body
    if rows.orientation is None:
        return TurnedTool()
    if not knows_orientation(old):
        why = (
            "orientations are not compared: the model was learned without them"
        )
        return TurnedTool(notes=(why,))
    tool = structure.groups["tool.rotation"]
    sd = deviation.copy()
    sd[tool] = FREE
    if framed:
        sd[structure.groups["view.rotation"]] = FREE
    poses = np.hstack([rows.x, logarithm(matrix_of(rows.orientation))])
    # of positions nothing is asked
    floor = np.repeat([FREE**2 * structure.extent, 1e-9], 3)
    fit = Fit(
        structure.with_view("pose"),
        [Rows(rows.q, poses, floor=floor)],
        beta,
        Prior(beta, sd),
        nu=STUDENT,
    ).maximise()
    before, after = exponential(np.stack([beta[tool], fit.beta[tool]]))
    turn = logarithm(before.T @ after)
    place = np.searchsorted(fit.active, tool)
    covariance = fit.covariance[np.ix_(place, place)]
    place = np.searchsorted(old.active, tool)
    # the model knows its own tool as well as it does
    both = covariance + old.kappa**2 * old.covariance[np.ix_(place, place)]
    score = float(turn @ np.linalg.solve(both, turn)) / float(
        chdtri(3, FALSE_ALARM)
    )
    # what the chain leaves over differs between regions of the workspace by about its scatter
    score = min(
        score, float(np.linalg.norm(turn) / (np.sqrt(3) * fit.noise[-1]))
    )
    return TurnedTool(score, turn, covariance)
