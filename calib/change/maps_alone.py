"""Maps alone, without a body: what few rows make of them is another frame of the sensor.

Anything else that may have changed is no matter of a few rows without a body: the paper's rule
(method "online") follows it in some thousands.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..body.covariance import RADIUS_95
from ..common.arrays import Array
from ..model.alignment import Alignment
from ..model.model import Model
from ..training.evaluate import error_sizes
from .adaptation import Adaptation, finished
from .cause import Cause
from .causes import causes_of_maps
from .comparison import Comparison
from .posterior import gain_on_held_out
from .rebuilding import carried
from .settings import BLOCKS, CHANGED, SURE


def adapt_maps(found: Comparison) -> Adaptation:
    """Move the maps with the sensor, where rows that are held out want it."""
    model, kept = found.model, found.kept
    old, new = found.predicted[kept], found.x[kept]
    residual = np.empty_like(new)
    for block in np.array_split(np.arange(len(new)), BLOCKS):
        others = np.setdiff1d(np.arange(len(new)), block)
        residual[block] = new[block] - Alignment.between(old[others], new[others]).apply(old[block])
    before, after = found.missed[kept], np.linalg.norm(residual, axis=1)
    ratio, sure = gain_on_held_out(before, after)
    frame = Alignment.between(old, new)
    words = f"the sensor's frame moved: {frame.words(found.unit_seen)}"
    improved = found.score > 1.0 and ratio < CHANGED and sure > SURE
    made = Adaptation(
        model, improved, len(new), found.outliers, error_sizes(before), error_sizes(after),
        "frame" if improved else "nothing", causes_of_maps(found), (), found.coverage,
        tuple(found.notes), found.spans, left_out=found.left_out,
    )  # fmt: skip
    if not improved:
        told = "maps without a body follow a moved sensor alone: give method 'online' and a stream"
        return replace(made, notes=(*made.notes, told) if found.score > 1.0 else made.notes)
    made = replace(made, changed=(Cause("sensor", "view.rotation", words),))
    fresh = carried(model, None, lambda u: frame.apply(model.predictor.value(u)))
    unsure = RADIUS_95 * float(np.sqrt(np.mean(after**2) / 2)) * _leverage(model, old)
    bounds = [np.hypot(frame.scale * b, unsure) for b in (model.bounds, model.model_bounds)]
    bounds[0] = np.maximum(bounds[0], float(np.quantile(after, 0.95)))
    fresh = replace(fresh, bounds=bounds[0], model_bounds=bounds[1], visited=model.visited)
    return replace(
        made, model=finished(found, made, fresh, found.q[kept], residual, "few-shot", frame)
    )


def _leverage(model: Model, rows: Array) -> Array:
    """Root (nodes,) of how much each node's place depends on the errors of the rows."""
    nodes = model.predictor.value(np.clip(model.motor.units, 0.0, 1.0))
    design, asked = (np.column_stack([np.ones(len(x)), x - rows.mean(0)]) for x in (rows, nodes))
    inverse = np.linalg.pinv(design.T @ design)
    return np.asarray(np.sqrt(np.einsum("ni,ij,nj->n", asked, inverse, asked)))
