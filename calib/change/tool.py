"""The tool: how it is turned, by a log's orientations, beside what a belief says."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ..arm.rotations import exponential, logarithm, matrix_of
from ..body.belief import Body, knows_orientation
from ..body.fit import Fit
from ..body.parameters import Prior
from ..body.rows import Rows
from ..body.settings import FREE, STUDENT
from ..body.structure import Structure
from ..common.arrays import Array
from ..common.rows import spread_rows
from ..common.wording import quantity
from .causes import Cause
from .rows import LogRows
from .settings import FALSE_ALARM, UPDATING


@dataclass(frozen=True)
class ToolTurn:
    """How the tool of a log is turned, beside what a belief says."""

    # statistic over its threshold; 0 where nothing can be compared
    score: float = 0.0
    # (3,) [rad], in the tool's own axes
    turn: Array = field(default_factory=lambda: np.zeros(3))
    covariance: Array = field(default_factory=lambda: np.zeros((3, 3)))

    @property
    def cause(self) -> Cause:
        """A tool that is turned about its own tip."""
        angle = float(np.linalg.norm(self.turn))
        variance = self.turn @ self.covariance @ self.turn
        half = 1.96 * float(np.sqrt(variance)) / angle
        size = quantity(angle, "rad", half)
        words = f"the tool is turned by {size} (its orientation, not its place)"
        cause = Cause("tool", "tool.rotation", words, angle, unit="rad")
        return cause.within(half)

    def of(self, body: Body) -> Body:
        """A belief with the tool turned."""
        tool = body.structure.groups["tool.rotation"]
        delta = np.zeros(body.structure.size)
        delta[tool] = self.turn
        root = body.root.copy()
        root[np.isin(body.active, tool)] = 0.0
        beta = body.structure.retract(body.beta, delta)
        turned = replace(body, beta=beta, root=root)
        return turned.with_covariance(tool, self.covariance / body.kappa**2)


def tool_turn(
    rows: LogRows,
    structure: Structure,
    beta: Array,
    deviation: Array | None = None,
) -> ToolTurn:
    """Compare orientations with those that parameters (d,) predict.

    deviation : (d,), standard deviations of the parameters, which may turn the tool, too; the
        sensor may be turned then: positions tell that less well
    """
    from scipy.special import chdtri

    old = rows.body
    rows = rows.take(spread_rows(len(rows), UPDATING.rows))
    if rows.log.orientation is None or not knows_orientation(old):
        return ToolTurn()
    tool = structure.groups["tool.rotation"]
    sd = np.zeros(len(beta))
    if deviation is not None:
        sd = deviation.copy()
        sd[structure.groups["view.rotation"]] = FREE
    sd[tool] = FREE
    fit = _fit_to_poses(rows, rows.log.orientation, structure, Prior(beta, sd))
    before, after = exponential(np.stack([beta[tool], fit.beta[tool]]))
    turn = logarithm(before.T @ after)
    place = np.searchsorted(fit.active, tool)
    covariance = fit.covariance[np.ix_(place, place)]
    # the model knows its own tool as well as it does
    place = np.searchsorted(old.active, tool)
    prior = old.kappa**2 * old.covariance[np.ix_(place, place)]
    square = float(turn @ np.linalg.solve(covariance + prior, turn))
    by_chance = square / float(chdtri(3, FALSE_ALARM))
    # what the chain leaves over differs between regions of the workspace by about its scatter
    scatter = np.sqrt(3) * fit.noise[-1]
    by_scatter = float(np.linalg.norm(turn) / scatter)
    score = min(by_chance, by_scatter)
    return ToolTurn(score, turn, covariance)


def _fit_to_poses(
    rows: LogRows, orientation: Array, structure: Structure, prior: Prior
) -> Fit:
    """The parameters by the rows' orientations; of their positions nothing is asked."""
    turns = logarithm(matrix_of(orientation))
    poses = np.hstack([rows.x, turns])
    floor = np.repeat([FREE**2 * structure.extent, 1e-9], 3)
    measured = [Rows(rows.q, poses, floor=floor)]
    poser = structure.with_sensor(view="pose")
    fit = Fit(poser, measured, prior.mean, prior, nu=STUDENT)
    return fit.maximise()
