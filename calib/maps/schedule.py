"""Schedules: how the neighbourhood shrinks (eq. 4) and on which lattices a map grows."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .lattice import Lattice


def decay(start: float, end: float, n: int) -> NDArray[np.float64]:
    """`n` values that decay exponentially from `start` to `end` (eq. 4)."""
    return start * (end / start) ** np.linspace(0.0, 1.0, n) if n > 1 else np.array([end])


@dataclass(frozen=True)
class Stage:
    """Some epochs on one lattice; the last stage trains the one that is kept."""

    lattice: Lattice
    sigma: NDArray[np.float64]  # (epochs,) [nodes], neighbourhood radius of each epoch
    samples: int  # at most so many samples are shown per epoch
    # the nodes follow the winners' steps, times this (below 2, which would overshoot); without it
    # Kohonen's batch rule, see :func:`~calib.maps.batch.moved`
    step: float | None = None
    # t / T of a varying density before and after this stage; without it the density does not vary
    progress: tuple[float, float] | None = None


_LAST, _LAST_VARYING = 0.4, 1.5  # last radii of the full lattice [nodes]
_COARSEST = 64  # nodes of the lattice that is ordered first
_GROWTH = 10.0  # the next one has at most so many times the nodes
_PER_NODE = 10  # samples that a coarse lattice is shown per epoch and node
_STEP = 1.5  # see Stage.step
_ALL = np.iinfo(np.int64).max
_FIRST_GROWING = 3.0  # first radius of the full lattice, see `growing` [nodes]
_EPOCHS_GROWING = 5  # epochs on the full lattice
_GROWN = 0.5  # t / T after the coarse lattices


def coarse_to_fine(
    lattice: Lattice,
    epochs: int | None = None,
    sigma: tuple[float, float] | None = None,
    *,
    varying: bool = False,
) -> list[Stage]:
    """Stages that order a coarse lattice and refine it up to `lattice`.

    A coarse lattice settles with less work and fewer folds than a fine one, which starts from its
    interpolation with a small radius.  On the way the nodes follow the winners' steps, which leaves
    the border where it belongs; the last stage is eq. 2.  With `epochs` or `sigma` that is the only
    one, from a random start.  Where the density is `varying`, the last radius is wider: a smooth
    map whose border the gain holds in place is more accurate than one that follows each sample.
    """
    last = _LAST_VARYING if varying else _LAST
    if epochs is not None or sigma is not None:
        start, end = sigma or (max(max(lattice.shape) / 2, last), last)
        return [Stage(lattice, decay(start, end, epochs or 20), _ALL, progress=(0.0, 1.0))]
    growth = lattice.size / _COARSEST
    levels = math.ceil(math.log(growth, _GROWTH)) if growth >= 2 else 0
    coarser = [shrunk(lattice, _COARSEST * growth ** (k / levels)) for k in range(levels)]
    stages: list[Stage] = []
    # a varying density starts with so wide a radius that one coarse lattice will do
    for small in [s for s in coarser if s.size < lattice.size][: 1 if varying else None]:
        samples = _PER_NODE * small.size
        if not stages:
            stages.append(Stage(small, decay(2.0, 0.7, 8), samples))
        stages.append(Stage(small, decay(2.0, 1.5, 6), samples, _STEP))
    if not stages:
        start = max(max(lattice.shape) / 2, 1.0)
        radii = decay(start, min(last, start), 20)
    elif varying:
        # the gain draws nodes to the border: that takes wide radii and more epochs
        radii = decay(max(2 * last, max(lattice.shape) / 5), last, 14)
    else:
        stages.append(Stage(lattice, np.array([1.5]), _ALL, _STEP))
        radii = decay(1.0, last, 3)
    return [*stages, Stage(lattice, radii, _ALL, progress=(0.0, 1.0))]


def growing(
    lattice: Lattice, epochs: int | None = None, sigma: tuple[float, float] | None = None
) -> list[Stage]:
    """Stages of the default varying density: those of a plain map, with the gain in each.

    The gain grows on the coarse lattices, where an epoch costs little, and is full at the last
    radius: 0.4 nodes up to 20 a side, where half a node more would cost more inside than the gain
    wins at the border, 0.8 at 70.
    """
    if epochs is not None or sigma is not None:
        return coarse_to_fine(lattice, epochs, sigma, varying=True)
    first, *coarse = coarse_to_fine(lattice)
    if not coarse:
        return [first]
    share = np.linspace(0.0, _GROWN, len(coarse)).tolist()
    varying = [
        replace(stage, progress=(share[k], share[k + 1])) for k, stage in enumerate(coarse[:-1])
    ]
    side = lattice.size ** (1 / lattice.dim)
    last = float(np.clip(_LAST + 0.22 * math.log2(side / 20), _LAST, 0.8))
    radii = decay(_FIRST_GROWING, last, _EPOCHS_GROWING)
    return [first, *varying, Stage(lattice, radii, _ALL, progress=(_GROWN, 1.0))]


def total_work(stages: list[Stage], n: int) -> int:
    """Samples that the stages show in all, for a progress display."""
    return sum(len(s.sigma) * min(s.samples, n) for s in stages)


def shrunk(lattice: Lattice, nodes: float) -> Lattice:
    """A lattice of the same proportions with about `nodes` nodes."""
    factor = (nodes / lattice.size) ** (1 / lattice.dim)
    return Lattice(tuple(max(2, round(s * factor)) for s in lattice.shape))
