"""Adapting by the paper's rule (eq. 10 to 12): maps and links re-formed sample by sample."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..maps.model_selection import better, blocks
from ..maps.node_bounds import learn_bounds
from ..training.evaluate import figures
from ..training.learn import Progress
from .adaptation import Adaptation, finished
from .causes import find_causes
from .comparison import Comparison
from .follow import BLOCK, HORIZON, OnlineAdapter


def adapt_online(found: Comparison, report: Progress) -> Adaptation:
    """Show a log to the online rule, again and again where it is short."""
    model, kept = found.model, found.log.kept
    u, q, x = found.u[kept], found.q[kept], found.x[kept]
    # every tenth block is kept apart to judge by
    held = np.concatenate(blocks(len(u), max(10, len(u) // BLOCK))[4::10])
    learned = np.setdiff1d(np.arange(len(u)), held)
    adapter = OnlineAdapter(model, max(HORIZON, len(learned)), force=True)
    shown = 0
    while shown < HORIZON:  # a short stream is shown again
        step = adapter.feed(q[learned], x[learned])
        shown += len(learned)
        report(0.9 * min(1.0, shown / HORIZON), "online", step.error)
    fresh = adapter.model()
    before = found.missed[kept][held]
    after = np.linalg.norm(x[held] - fresh.predictor.value(u[held]), axis=1)
    known = np.isfinite(fresh.expected_error(q[held]))
    notes = found.notes
    if shown > len(learned):
        notes.append(f"{len(learned)} samples were shown {shown // len(learned)} times")
    causes, unsettled = find_causes(found, found.changed or not found.explained)
    made = Adaptation(
        model,
        better(after, before) and bool(known.mean() > 0.5),
        len(u),
        found.outliers,
        figures(before),
        figures(after),
        "maps and Hebbian links trained online",
        tuple(c for c in causes if c.cause != "noise"),
        (),
        found.coverage,
        (*notes, *unsettled),
    )
    if not made.improved:
        return made
    bounds = learn_bounds(fresh.motor, u[held], after)
    fresh = replace(fresh, bounds=bounds, model_bounds=bounds)
    return replace(made, model=finished(found, made, fresh, after, "online", None))
