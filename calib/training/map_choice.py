"""The map of a log without a body: a lattice, or a gas where held-out blocks prefer it.

A lattice is a sheet.  Over a log of a few paths it has to bridge the gaps between them, and in the
workspace the paths cross, so that the sheet folds.  A neural gas has nothing to fold.  Where rows
cover both spaces the lattice is as good or better, and it can follow a stream.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..common.scale import Scale
from ..samples.samples import Samples
from .learn import Options, associate

LATTICE, GAS = "vdsom", "gas"

_BLOCKS, _PARTS = 10, 3  # contiguous blocks, of which every third is held out in turn
_BETTER = 0.9  # of the lattice's error: what a gas has to reach


def with_chosen_map(samples: Samples, options: Options) -> tuple[Options, list[str]]:
    """The options with the map that answers held-out blocks better, and what the user is told.

    Both learn from the same other blocks of a log; the readout is ``linear``.  A simulation, a
    body, and a schedule that the user gives leave the lattice.
    """
    plain = options.rule == "batch" and options.epochs is None and options.sigma is None
    if options.body != "none" or samples.simulation is not None or not plain:
        return options, []
    folds = np.array_split(np.arange(len(samples)), _BLOCKS)
    scale = Scale.of_range(samples.lower, samples.upper, samples.revolute)
    u = scale.to_unit(samples.q)
    error = dict.fromkeys((LATTICE, GAS), 0.0)
    # each row is held out once: of an uneven log a third of the blocks alone, most of them from
    # where it dwells, had the gas at 0.86, all of them at 0.95 of the lattice's error
    for first in range(_PARTS):
        held = np.concatenate(folds[first::_PARTS])
        seen = np.setdiff1d(np.arange(len(samples)), held, assume_unique=True)
        for name in error:
            pair = associate(scale, u[seen], samples.x[seen], replace(options, map=name))
            missed = pair.linear.value(u[held]) - samples.x[held]
            error[name] += float(np.linalg.norm(missed, axis=1).sum())
    share = error[GAS] / max(error[LATTICE], 1e-300)
    if share >= _BETTER:
        return options, []
    told = (
        f"maps without a lattice (gas), which have {share:.2f} of a VDSOM's error on held-out "
        "blocks of the log; `map` chooses another"
    )
    return replace(options, map=GAS), [told]
