"""Deciding: what a log makes of a model, and whether held-out rows want it.

`check` and `adapt` ask here, so that the one promises what the other does.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..body.belief import Body
from ..common.arrays import Array
from ..common.rows import thinned
from .causes import Cause, find_causes
from .comparison import Comparison
from .explain import Explanation, called, likely, weighed
from .hypotheses import NOTHING
from .orientation import turned_tool
from .posterior import UPDATED_ROWS, updated
from .settings import CHANGED, CREEP, REFINED, SURE, SURER, UNSURE

_BLOCKS = 5  # contiguous ones, each of which tells a gain


@dataclass(frozen=True, eq=False)
class Decision:
    """What comes of a log."""

    changed: bool  # whether the arm or the sensor changed; otherwise rows are added
    best: Explanation
    body: Body  # the updated belief
    # (n,) [unit], distances of the same rows from the old prediction and, held out, from the new
    before: Array
    after: Array
    held_out: tuple[Array, Array]  # their joints (n, dof), and the latter as vectors (n, m)
    improved: bool  # whether the update is worth taking
    causes: tuple[Cause, ...]
    notes: tuple[str, ...]
    correction: str  # what was corrected, in words


def decide(found: Comparison) -> Decision:
    """Explain a log, update the body by it, and judge by rows that were held out."""
    changed = found.changed and found.explained
    chosen = likely(found.explanations)
    if not changed:  # the rows are added to what was known
        # What waves the rows show belongs to the arm as it was: with free ones 40 rows of another
        # mounting made an error 1.2 times as large elsewhere. A drawing has no waves to start from.
        same = [e for e in found.explanations if e.hypothesis == NOTHING]
        calm = [e for e in same if e.unchanged and e.waves <= CREEP]
        some = same if found.belief.simulated else calm
        chosen = weighed(some) if some else chosen
    body, held = updated(found.reference, chosen, found.log)
    some_rows = thinned(len(found.q), UPDATED_ROWS)
    kept = some_rows[found.log.kept[some_rows]]
    held_out = found.q[kept], held[found.log.kept[some_rows]]
    before, after = found.missed[kept], np.linalg.norm(held_out[1], axis=1)
    improved = found.explained and _improves(found, body, changed, before, after)
    causes, unsettled = find_causes(found)
    tool = turned_tool(found)
    if tool.causes:
        if not improved:  # the tool alone
            body, after = found.belief, before
            held_out = held_out[0], (found.x - found.predicted)[kept]
        body = turned_tool(found, body).of(body)
    known = "no single change explains the log" if found.unexpected else "nothing changed"
    correction = called(chosen[0][1]) if changed else f"{known}, rows added"
    return Decision(
        changed, chosen[0][1], body, before, after, held_out,
        improved or bool(tool.causes), (*causes, *tool.causes), (*unsettled, *tool.notes),
        correction,
    )  # fmt: skip


def _improves(found: Comparison, body: Body, changed: bool, before: Array, after: Array) -> bool:
    """Whether the update is worth taking: held-out blocks gain, and by more than chance."""
    gain = [float(part.mean()) for part in np.array_split(before - after, _BLOCKS)]
    error = float(np.std(gain, ddof=1) / np.sqrt(len(gain)))
    ratio = float(after.mean() / max(float(before.mean()), 1e-300))
    sure = float(np.mean(gain)) / max(error, 1e-300)
    if changed or ratio > REFINED or sure <= SURE:
        return bool(changed and ratio < CHANGED and sure > SURE)
    if found.tested.noisy is not None and found.score <= 1.0:
        return False
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
