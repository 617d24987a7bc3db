"""Deciding: what a log makes of a model, and whether held-out rows want it.

`check` and `adapt` ask here, so that the one promises what the other does.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..body.belief import Body
from ..common.arrays import Array
from ..common.rows import thinned
from ..training.evaluate import error_sizes
from .adaptation import Adaptation
from .causes import WORDS, Cause, find_causes
from .comparison import Comparison
from .explain import Explanation, called, weighed
from .hypotheses import NOTHING
from .orientation import turned_tool
from .posterior import UPDATED_ROWS, updated
from .settings import CHANGED, CREEP, REFINED, SURE, SURER, UNSURE

_LOUD = ("mirror", "scale", "sign", "lost")
_BLOCKS = 5  # contiguous ones, each of which tells a gain


class Decision(NamedTuple):
    """What comes of a log: the word on it, and what a new model would be made of."""

    made: Adaptation  # with the old model
    best: Explanation
    body: Body  # the updated belief
    held_out: tuple[Array, Array]  # joints (n, dof) of held-out rows, and their residuals (n, m)


def decide(found: Comparison) -> Decision:
    """Explain a log, update the body by it, and judge by rows that were held out.

    `check` asks here too, so that the one promises what the other does.
    """
    changed = found.changed and found.explained
    chosen = weighed(found.explanations)
    if not changed:  # the rows are added to what was known
        # What waves the rows show belongs to the arm as it was: with free ones 40 rows of another
        # mounting made an error 1.2 times as large elsewhere. A drawing has no waves to start from.
        same = [e for e in found.explanations if e.hypothesis == NOTHING]
        calm = [e for e in same if e.unchanged and e.waves <= CREEP]
        some = same if found.belief.simulated else calm
        chosen = weighed(some) if some else chosen
    body, held = updated(found.reference, chosen, found.log)
    rows = thinned(len(found.q), UPDATED_ROWS)
    kept = rows[found.log.kept[rows]]
    held = held[found.log.kept[rows]]
    before, after = found.missed[kept], np.linalg.norm(held, axis=1)
    improved = found.explained and _improves(found, body, changed, before, after)
    causes, notes = find_causes(found)
    tool = turned_tool(found)
    if tool.causes:
        if not improved:  # the tool alone
            body, after, held = found.belief, before, (found.x - found.predicted)[kept]
        body = turned_tool(found, body).of(body)
        causes, improved = (*causes, *tool.causes), True
    known = "no single change explains the log" if found.score > 1.0 else "nothing changed"
    # what nobody may miss: another unit, a mirror, a joint that turns round or not at all
    loud = [c.words for c in causes if c.cause.split(":")[0] in _LOUD]
    rivals = _rivals(found) if changed and improved else []
    correction = called(chosen[0][1]) if changed else f"{known}, rows added"
    made = kept_model(found, before, after, correction, causes, *loud, *notes, *tool.notes, *rivals)
    if changed:
        groups = found.reference.structure.groups
        left = {g for g, ix in groups.items() if len(ix)} - {*chosen[0][1].hypothesis.groups}
        if len(found.reference.sizes) >= 3:  # a tracker has no lens
            left.discard("lens")
        made = replace(made, kept=tuple(w.kept for g, w in WORDS.items() if g in left and w.kept))
    return Decision(replace(made, improved=improved), chosen[0][1], body, (found.q[kept], held))


def kept_model(
    found: Comparison, before: Array, after: Array, correction: str, causes: tuple[Cause, ...],
    *notes: str,
) -> Adaptation:  # fmt: skip
    """An adaptation that keeps the old model, of distances (k,) from held-out rows [unit]."""
    return Adaptation(
        found.model, False, int(np.count_nonzero(found.kept)), found.outliers,
        error_sizes(before), error_sizes(after), correction,
        tuple(c for c in causes if c.group != "noise"), ("the arm and the sensor",),
        found.coverage, (*found.notes, *notes), found.spans, found.left_out,
    )  # fmt: skip


def _rivals(found: Comparison) -> list[str]:
    """What is told where more than one change explains the log."""
    best, *others = (e for _, e in weighed(found.explanations))
    # a richer one that frees the same and more is no other cause
    others = [e for e in others if not set(best.hypothesis.groups) <= {*e.hypothesis.groups}]
    names = list(dict.fromkeys(called(e) for e in (best, *others)))
    if len(names) < 2:
        return []
    rivals = " or ".join(f"({name.replace(', ', ' + ')})" for name in names)
    return [f"more than one change explains the log: {rivals}; poses of calib plan tell which"]


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
