"""Held out: errors of a log's model on blocks of rows that it has not seen."""

from __future__ import annotations

import numpy as np

from ..common.arrays import Array
from ..common.choices import MAP_READOUTS
from ..model.answers import unit_joints
from ..model.model import Model
from ..samples.samples import Samples
from .evaluate import Residuals
from .learn import associate
from .options import TrainingOptions
from .smooth import SmoothPart, to_learn

# rows that errors are measured on, of maps and of a body; more would tell no more
_TESTED, _ANSWERED = 5_000, 1_000
_FOLDS, _HALVES = 20, 2  # maps are tested on blocks that those of the other half did not show


def held_out_residuals(
    model: Model,
    samples: Samples,
    part: SmoothPart | None,
    left: Array | None,
    options: TrainingOptions,
) -> Residuals:
    """Residuals of all readouts on rows that were held out in contiguous blocks.

    The default readout and the body are held out in ten blocks; the readouts of the maps
    are those of maps that have learned from every other block.

    left : what the default readout leaves over of the rows of `part` that it has not seen
    """
    n, scale, clip = len(samples), model.motor.scale, model.solver.clip
    forward: dict[str, Array] = {}
    rows, turned = np.arange(0, n, max(1, n // _TESTED)), None
    if part is not None and left is not None:
        some = slice(None, None, max(1, len(left) // _ANSWERED))
        rows, turned = part.rows[some], part.fit.turned
        turned = None if turned is None else turned[some]
        forward["local"] = -left[some]
        if "body" in model.readouts:
            forward["body"] = -part.fit.held_out[some]
    q, x = samples.q[rows], samples.x[rows]
    u = scale.to_unit(q)
    here, near = model.predictor.value(u), clip(u)
    # a target that a held-out prediction misses is answered by joints that the map leads there
    answers = {
        readout: unit_joints(model, here - error, near, ("local",))["local"]
        for readout, error in forward.items()
    }
    forward |= {readout: np.empty_like(x) for readout in MAP_READOUTS}
    answers |= {readout: np.empty_like(u) for readout in MAP_READOUTS}
    folds = np.array_split(np.arange(n), _FOLDS)
    for half in range(_HALVES):
        unseen = np.concatenate(folds[half::_HALVES])
        chosen = np.flatnonzero(np.isin(rows, unseen))
        seen = np.setdiff1d(np.arange(n), unseen, assume_unique=True)
        seen_u, seen_x, wrong = to_learn(samples, part, options, seen)
        pair = associate(scale, seen_u, seen_x, options, wrong)
        found = pair.inverses(pair.sensory.scale.to_unit(x[chosen]), near[chosen])
        for readout in MAP_READOUTS:
            forward[readout][chosen] = pair.predict(q[chosen], readout) - x[chosen]
            answers[readout][chosen] = clip(found[readout])
    return Residuals.of(model, q, x, forward, answers, turned=turned)
