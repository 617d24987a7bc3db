"""Orientation: whether the tool of a log is turned otherwise than the model's.

Positions of a tool that is bent about its own tip stay as they were; only orientations tell.  They
tell of the tool alone: what they say of a chain made the positions of real rows worse.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..arm.rotations import exponential, logarithm, matrix_of
from ..body.belief import Body, knows_orientation
from ..body.covariance import autocorrelation_time, root_of
from ..body.settings import STUDENT
from ..common.arrays import Array
from ..common.wording import for_people
from .causes import Cause
from .comparison import Comparison
from .equations import STEPS
from .settings import FALSE_ALARM


@dataclass(frozen=True)
class TurnedTool:
    """How the tool of a log is turned, beside what the model says."""

    score: float  # statistic over its threshold; 0 where nothing can be compared
    turn: Array  # (3,) [rad], of the parameters of the tool's rotation
    covariance: Array  # (3, 3)
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
        tool = body.structure.groups["tool.rotation"]
        delta = np.zeros(body.structure.size)
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

    none = np.zeros(3), np.zeros((3, 3))
    if found.orientation is None:
        return TurnedTool(0.0, *none)
    if not knows_orientation(found.model.body):
        told = "orientations are not compared: the model was learned without them"
        return TurnedTool(0.0, *none, (told,))
    changed = found.changed and found.explained
    structure: Any = found.reference.structure if changed else found.body.structure
    beta = found.explanations[0].beta if changed else found.body.beta
    if body is not None:
        structure, beta = body.structure, body.beta
    tool, posed = structure.groups["tool.rotation"], structure.with_view("pose")
    predicted, x = posed.linearise(found.q, beta, tool)
    seen, x = matrix_of(found.orientation), x[:, 3:]
    # in the tool's own axes, so that a sensor that is turned, too, does not mix in
    back = np.swapaxes(exponential(predicted[:, 3:]), 1, 2)
    turns = logarithm(seen @ back)
    # a sensor's turn, which only a change frees, beside the tool's
    frame = np.broadcast_to(np.eye(3), x.shape)
    design = np.concatenate([frame, x], axis=2) if changed and body is None else x
    weight = np.ones(len(turns))
    for _ in range(STEPS):
        gram = np.einsum("nij,nik,n->jk", design, design, weight)
        moved = np.linalg.pinv(gram) @ np.einsum("nij,ni,n->j", design, turns, weight)
        residual = turns - design @ moved
        square = (residual**2).sum(axis=1)
        noise = max(float((weight * square).sum()) / (3 * len(turns)), 1e-18)
        weight = (STUDENT + 3) / (STUDENT + square / noise)
    # rows that err together count once, and the model knows its own tool as well as it does
    own = noise * autocorrelation_time(residual) * np.linalg.pinv(gram)[-3:, -3:]
    old = found.body
    held = np.searchsorted(old.active, old.structure.groups["tool.rotation"])
    covariance = own + old.kappa**2 * old.covariance[np.ix_(held, held)]
    turn = moved[-3:]
    score = float(turn @ np.linalg.solve(covariance, turn)) / float(chdtri(3, FALSE_ALARM))
    # what the chain leaves over differs between regions of the workspace by about its scatter
    score = min(score, float(np.linalg.norm(turn)) / float(np.sqrt(3 * noise)))
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
    size, half = abs(low + high) / 2, (high - low) / 2
    how = (
        "has turned in its mount by" if unit == "deg" else "has moved in its mount, what it sees by"
    )
    told = replace(one, cause="tool", words=f"the {what} {how} {size:.3g} ± {half:.2g} {unit}")
    return (told, *(cause for cause in causes if cause not in moved))
