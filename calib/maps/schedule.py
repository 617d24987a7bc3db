"""Schedules: how the neighbourhood shrinks and on which lattices a map grows."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .lattice import Lattice


def exponential(start: float, end: float, n: int) -> NDArray[np.float64]:
    """`n` values that decay exponentially from `start` to `end` (eq. 4)."""
    return start * (end / start) ** np.linspace(0.0, 1.0, n) if n > 1 else np.array([end])


@dataclass(frozen=True)
class Stage:
    """Some epochs on one lattice.

    Attributes
    ----------
    lattice : Lattice
        The lattice that is trained.
    sigma : (epochs,) array [nodes]
        Neighbourhood radius of each epoch.
    samples : int
        At most so many samples are shown per epoch.
    final : bool
        Whether this is the lattice that is kept.
    """

    lattice: Lattice
    sigma: NDArray[np.float64]
    samples: int
    final: bool


# nodes per axis (two axes), sigma at the start and the end, epochs, samples per node
_FINE, _LAST, _LAST_VARYING = 1.5, 0.4, 1.5  # radii of the full lattice: first, last [nodes]
_COARSE = ((10, 5.0, 0.7, 15, 30), (30, 2.0, 0.6, 8, 9))


def coarse_to_fine(
    lattice: Lattice,
    epochs: int | None = None,
    sigma: tuple[float, float] | None = None,
    *,
    varying: bool = False,
) -> list[Stage]:
    """Stages that order a coarse lattice and refine it up to `lattice`.

    A coarse lattice orders itself with far less work and fewer folds than a fine one;
    the finer one then starts from its interpolation with a small radius.  Where the
    user gives `epochs` or `sigma` there is one stage, on `lattice` itself, from a
    random start.

    Where the density is `varying`, the last radius is wider: a smooth map whose border
    the gain holds in place is more accurate than one that follows each sample.
    """
    last = _LAST_VARYING if varying else _LAST
    if epochs is not None or sigma is not None:
        start, end = sigma or (max(max(lattice.shape) / 2, last), last)
        radii = exponential(start, end, epochs or 20)
        return [Stage(lattice, radii, np.iinfo(np.int64).max, final=True)]
    stages: list[Stage] = []
    for side, start, end, n, per_node in _COARSE:
        # the same number of nodes whatever the dimension, in the lattice's proportions
        shrink = (side**2 / lattice.size) ** (1 / lattice.dim)
        if shrink > 0.75:
            break
        small = Lattice(tuple(max(2, round(s * shrink)) for s in lattice.shape))
        start = max(start * side ** (2 / lattice.dim - 1), 1.0) if not stages else start
        stages.append(Stage(small, exponential(start, end, n), per_node * small.size, final=False))
    # the gain draws nodes to the border: that takes wider radii and more epochs
    wide = max(2 * last, max(lattice.shape) / 5) if varying else _FINE
    start = wide if stages else max(lattice.shape) / 2
    epochs = (20 if varying else 8) if stages else 20
    radii = exponential(max(start, 1.0), min(last, max(start, 1.0)), epochs)
    stages.append(Stage(lattice, radii, np.iinfo(np.int64).max, final=True))
    return stages


def total_work(stages: list[Stage], n: int) -> int:
    """Samples that the stages show in all, for a progress display."""
    return sum(len(s.sigma) * min(s.samples, n) for s in stages)


def shrunk(lattice: Lattice, nodes: int) -> Lattice:
    """A lattice of the same proportions with about `nodes` nodes."""
    factor = (nodes / lattice.size) ** (1 / lattice.dim)
    return Lattice(tuple(max(2, math.floor(s * factor)) for s in lattice.shape))
