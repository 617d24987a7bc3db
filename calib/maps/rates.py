"""Rates: how fast samples are learned, eq. 4 in a training, eq. 10 and 12 after a change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from .settings import ONLINE


@dataclass(frozen=True)
class Rates:
    """How fast some samples are learned; each array (n,) has a value for every sample."""

    sigma: tuple[Array, ...]  # neighbourhood radius of each map [nodes]
    alpha: Array  # learning rate of the maps
    progress: Array  # t / T
    eta: Array  # learning rate of the links
    beta: Array  # their forgetting factor

    @staticmethod
    def training(
        t: NDArray[np.intp],
        sigma: tuple[float, float],
        T: int,
        maps: int,
    ) -> Rates:
        """Rates at the times `t` of a training of `T` samples.

        The time constant of eq. 4 is that at which sigma goes from its first value to its last.
        """
        first, last = sigma
        fall = (last / first) ** (t / max(T - 1, 1))  # exp(-t / T)
        return Rates(
            sigma=(first * fall,) * maps,  # eq. 4
            alpha=ONLINE.alpha * fall,  # eq. 4
            progress=t / T,
            eta=np.full(len(t), ONLINE.eta),
            beta=np.ones(len(t)),
        )

    @staticmethod
    def following(
        t: NDArray[np.intp],
        start: Sequence[float],
        end: float,
        T: int,
    ) -> Rates:
        """Rates `t` samples after a change, at rest after `T`.

        start : of each map [nodes], sigma(tau) of eq. 10, at which training had the distortion
            that the map has now
        """
        t = np.minimum(t, T)
        rise = np.exp((T - t) / T)
        return Rates(
            sigma=tuple(s * (end / s) ** (t / T) for s in start),  # eq. 10
            alpha=ONLINE.alpha * 0.1 ** (t / T),
            progress=t / T,
            eta=ONLINE.eta * rise,  # eq. 12
            beta=rise,  # eq. 12, beta_init = 1
        )
