"""Deciding: what a log makes of a model, and whether held-out rows want it.

`check` and `adapt` ask here, so that the one promises what the other does.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..body.belief import Body
from ..body.likeness import lengths_of
from ..body.posterior import BodyFit
from ..common.arrays import Array
from ..common.rows import thinned
from .cause import Cause
from .causes import find_causes
from .comparison import UNEXPLAINED, Comparison
from .explain import Explanation, likely, weighed
from .members import CREEP, NOTHING
from .orientation import turned_tool, with_orientations
from .own_residual import OwnResidual, own_residual
from .rows import UPDATED_ROWS
from .settings import CHANGED, REFINED, SURE, SURER, UNSURE
from .update import fit_from_drawing, updated

_BLOCKS = 5  # contiguous, held out in turn
_REFITS = 3  # the same where each takes a fit of its own


@dataclass(frozen=True)
class Decision:
    """What comes of a log."""

    changed: bool  # whether the arm or the sensor changed; otherwise rows are added
    best: Explanation
    body: Body  # the updated belief
    own: OwnResidual | None  # what the log shows beyond it
    anew: bool  # whether the body was fitted to the rows alone, from a drawing
    # (n,) [unit], distances of the same rows from the old prediction and, held out, from the new
    before: Array
    after: Array
    improved: bool  # whether the update is worth taking
    causes: tuple[Cause, ...]
    notes: tuple[str, ...]
    correction: str  # what was corrected, in words


def decide(found: Comparison) -> Decision:
    """Explain a log, update the body by it, and judge by rows that were held out."""
    model, explained = found.model, found.explained
    changed = found.changed and explained
    chosen = likely(found.explanations) if changed else _unchanged(found)
    best = chosen[0][1]
    rows = found.log.some(UPDATED_ROWS)
    moved, held = updated(found.reference, chosen, found.log, found.probes)
    residual, lengths = rows.z - moved.predict(rows.q), lengths_of(moved, rows.q)
    own = own_residual(rows.q, residual, held, rows.weight, lengths)
    after = np.linalg.norm(held, axis=1)
    if own is not None:
        after[own.rows] = own.held_out
    some = thinned(len(found.q), UPDATED_ROWS)[rows.kept]
    before, after = found.missed[some], after[rows.kept]
    fit = fit_from_drawing(found, float(after.mean())) if explained else None
    body = moved
    if fit is not None:
        body, own, after = fit.body, None, _held_out(found, fit, some)
    if model.body is None and own is not None:  # a smooth residual may follow what no member does
        explained |= float(np.median(own.held_out)) < UNEXPLAINED * found.spread
    improved = explained and _improves(found, body, own, changed, before, after)
    causes, unsettled = find_causes(found, found.score > 1.0)
    _, bent, untold = turned_tool(found)
    if bent and not improved:  # the tool alone
        body, own, after = found.belief, None, before
    if found.orientation is not None and not untold and (improved or bent):
        posed = with_orientations(body, found.q, found.orientation, bool(bent))
        if not improved:
            body = posed
        elif own is None and fit is None:
            refitted = _refitted(found, chosen, some, bool(bent))
            if refitted.mean() <= after.mean():  # orientations may tell of the tool alone
                body, after = posed, refitted
    known = "no single change explains the log" if found.unexpected else "nothing changed"
    correction = called(best) if changed else f"{known}, rows added"
    if own is not None:
        correction += ", and a smooth residual near the rows"
    return Decision(
        changed, best, body, own, fit is not None, before, after, improved or bool(bent),
        (*causes, *bent), (*unsettled, *untold), correction,
    )  # fmt: skip


def _held_out(found: Comparison, fit: BodyFit, some: NDArray[np.intp]) -> Array:
    """Held-out errors of a fit to the kept rows, at some of them."""
    place = np.cumsum(found.log.kept) - 1  # of each row among those that were fitted
    return np.asarray(np.linalg.norm(fit.held_out, axis=1)[place[some]])


def _refitted(
    found: Comparison,
    chosen: list[tuple[float, Explanation]],
    some: NDArray[np.intp],
    bent: bool,
) -> Array:
    """Errors of some rows, each predicted by positions and orientations of other blocks."""
    every, after = np.arange(len(found.q)), np.empty(len(found.q))
    for block in np.array_split(every, _REFITS):
        others = np.setdiff1d(every, block)
        seen = found.log.of(others)
        body, _ = updated(found.reference, chosen, seen, found.probes)
        assert found.orientation is not None  # noqa: S101 - asked for where they are known
        body = with_orientations(body, found.q[others], found.orientation[others], bent)
        miss = found.log.z[block] - body.predict(found.q[block])
        after[block] = np.linalg.norm(miss, axis=1)
    return after[some]


def _unchanged(found: Comparison) -> list[tuple[float, Explanation]]:
    """Nothing changed: the rows are added to what was known."""
    # What waves the rows show belongs to the arm as it was: with free ones 40 rows of another
    # mounting made an error 1.2 times as large elsewhere. A drawing has no waves to start from.
    simulated = found.belief.simulated
    some = [e for e in found.explanations if not e.margin and (simulated or e.waves <= CREEP)]
    return weighed(some) if some else likely(found.explanations)


def _improves(
    found: Comparison,
    body: Body,
    own: OwnResidual | None,
    changed: bool,
    before: Array,
    after: Array,
) -> bool:
    """Whether the update is worth taking."""
    ratio, sure = gain_on_held_out(before, after)
    if changed:
        return ratio < CHANGED and sure > SURE
    if ratio > REFINED or sure < SURE or (found.tested.noisy is not None and found.score <= 1.0):
        return False
    if own is not None and found.model.body is None:
        return True
    old = found.belief
    if float(before.mean()) > float(replace(old, second=None).bound(found.q).mean()):
        return sure > SURER  # rows that the old belief had not thought possible
    # root mean square error [unit] that each belief expects of itself over the learned range
    own_part = (old.tau**2 + old.noise**2).sum()
    new_error, old_error = (
        np.trace(b.spread(found.probes), axis1=1, axis2=2).mean() * b.kappa**2 + own_part
        for b in (body, old)
    )
    return bool(np.sqrt(new_error) < UNSURE * np.sqrt(old_error))


def gain_on_held_out(before: Array, after: Array) -> tuple[float, float]:
    """How much held-out rows gained: mean ratio of errors, and gain over its standard error.

    before, after : (n,) [unit], distances of the same rows from the old prediction, and from the
        new one without their block
    """
    gain = [float(part.mean()) for part in np.array_split(before - after, _BLOCKS)]
    error = float(np.std(gain, ddof=1)) / np.sqrt(len(gain))
    ratio = float(after.mean() / max(float(before.mean()), 1e-300))
    return ratio, float(np.mean(gain)) / max(error, 1e-300)


def called(e: Explanation) -> str:
    """An explanation in words: its member, or the shape that no member has."""
    shape = "waves of the joints" if e.waves > CREEP else "a smooth residual"
    return shape if e.member == NOTHING else e.member.name.removesuffix(", small")
