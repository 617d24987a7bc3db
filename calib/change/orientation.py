"""Orientation: whether the tool of a log is turned otherwise than the model's.

Positions of a tool that is bent about its own tip stay as they were; only orientations tell.  They
tell of the tool alone: what they say of a chain made the positions of real rows worse.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..arm.rotations import exponential, logarithm, matrix_of
from ..body.belief import Body, knows_orientation
from ..body.covariance import root_of
from ..body.fit import Fit
from ..body.parameters import Prior
from ..body.settings import FREE, STUDENT
from ..common.arrays import Array
from ..common.wording import for_people
from .causes import Cause
from .comparison import Comparison
from .settings import FALSE_ALARM


@dataclass(frozen=True)
class TurnedTool:
    """How the tool of a log is turned, beside what the model says."""

    score: float = 0.0  # statistic over its threshold; 0 where nothing can be compared
    turn: Array = field(default_factory=lambda: np.zeros(3))  # [rad], in the tool's own axes
    covariance: Array = field(default_factory=lambda: np.zeros((3, 3)))
    notes: tuple[str, ...] = ()  # why orientations were not compared

    @property
    def causes(self) -> tuple[Cause, ...]:
        """The turned tool, where the score is above 1."""
        if self.score <= 1.0:
            return ()
        size = float(np.linalg.norm(self.turn))
        half = 1.96 * float(np.sqrt(self.turn @ self.covariance @ self.turn)) / size
        words = f"the tool is turned by {np.degrees(size):.3g} deg (its orientation, not its place)"
        return (Cause.measured("tool", "tool.rotation", words, size, half, "rad"),)

    def of(self, body: Body) -> Body:
        """A belief with the tool turned."""
        tool, delta = body.structure.groups["tool.rotation"], np.zeros(body.structure.size)
        delta[tool] = self.turn
        place, covariance = np.searchsorted(body.active, tool), body.covariance.copy()
        covariance[place], covariance[:, place] = 0.0, 0.0
        covariance[np.ix_(place, place)] = self.covariance / body.kappa**2
        beta = body.structure.retract(body.beta, delta)
        return replace(body, beta=beta, root=root_of(covariance))


def turned_tool(found: Comparison, body: Body | None = None) -> TurnedTool:
    """Compare the orientations of a log with those that the model predicts.

    body : what is compared with; by default the best explanation of the positions
    """
    from scipy.special import chdtri

    if found.orientation is None:
        return TurnedTool()
    if not knows_orientation(found.model.body):
        told = "orientations are not compared: the model was learned without them"
        return TurnedTool(notes=(told,))
    old, sd = found.body, np.zeros(found.body.structure.size)
    structure: Any = (body or old).structure
    beta, tool = (body or old).beta, structure.groups["tool.rotation"]
    if body is None and found.changed:
        structure, beta = found.reference.structure, found.explanations[0].beta
        sd[structure.groups["view.rotation"]] = FREE  # positions tell it less well
    sd[tool] = FREE
    posed, z = structure.with_view("pose"), logarithm(matrix_of(found.orientation))
    fit = Fit(
        posed, found.q, np.hstack([found.x, z]), beta, Prior(beta, sd), nu=STUDENT,
        floor=np.repeat([FREE**2 * structure.extent, 1e-9], 3),  # of positions nothing is asked
    ).maximise()  # fmt: skip
    before, after = exponential(np.stack([beta[tool], fit.beta[tool]]))
    turn, place = logarithm(before.T @ after), np.searchsorted(fit.active, tool)
    own, held = fit.covariance[np.ix_(place, place)], np.searchsorted(old.active, tool)
    # the model knows its own tool as well as it does
    covariance = own + old.kappa**2 * old.covariance[np.ix_(held, held)]
    score = float(turn @ np.linalg.solve(covariance, turn)) / float(chdtri(3, FALSE_ALARM))
    # what the chain leaves over differs between regions of the workspace by about its scatter
    score = min(score, float(np.linalg.norm(turn) / (np.sqrt(3) * fit.noise[-1])))
    return TurnedTool(score, turn, own)


def hand_told_once(causes: tuple[Cause, ...], seen: Mapping[str, Any] | None) -> tuple[Cause, ...]:
    """Causes in which a camera or board that moved in the hand stands once, in these words.

    seen : how a model's pictures of a board were taken, None for another model: causes stay
    """
    moved = [cause for cause in causes if cause.group in ("tool", "tool.rotation")]
    if not seen or not moved:
        return causes
    what = "camera" if seen["eye"] == "hand" else "board"
    one = next((cause for cause in moved if cause.unit == "rad"), moved[0])
    factor, unit = for_people(one.unit)
    low, high = (factor * end for end in one.interval or (0.0, 0.0))
    how = "turned in its mount by" if unit == "deg" else "moved in its mount, what it sees by"
    size = f"{abs(low + high) / 2:.3g} ± {(high - low) / 2:.2g} {unit}"
    told = replace(one, cause="tool", words=f"the {what} has {how} {size}")
    return (told, *(cause for cause in causes if cause not in moved))
