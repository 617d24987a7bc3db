"""Where each parameter of a planar body stands in its vector."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from types import MappingProxyType

import numpy as np

from .curves import HARMONICS
from .structure import Indices

VIEW = 11
"""Parameters of the view: rotation, log scale, shear (2), shift (2), tilt (2), lens (3)."""


class Layout:
    """Indices of the parameters of a planar chain with these joints.

    revolute : which joints turn
    """

    def __init__(self, revolute: tuple[bool, ...]) -> None:
        n = len(revolute)
        turning = [i for i in range(n) if revolute[i]]
        self.pairs = tuple((i, j) for i in turning for j in turning if j >= i)
        self.turning = tuple(turning)
        self.sliding = tuple(i for i in range(n) if not revolute[i])
        self.length = VIEW + np.arange(n)
        self.offset = VIEW + n + np.arange(n)
        self.gain = VIEW + 2 * n + np.arange(n)
        start = VIEW + 3 * n
        self.elastic = start + np.arange(2 * len(self.pairs))
        start += len(self.elastic)
        self.curve = {
            i: start + k * 2 * HARMONICS + np.arange(2 * HARMONICS) for k, i in enumerate(turning)
        }
        self.size = start + len(turning) * 2 * HARMONICS
        groups: dict[str, Indices] = {
            "view.rotation": np.array([0]),
            "view.scale": np.array([1]),
            "view.shear": np.array([2, 3]),
            "view.shift": np.array([4, 5]),
            "view.tilt": np.array([6, 7]),
            "lens": np.array([8, 9, 10]),
            "length": self.length,
            "offset": self.offset,
            "gain": self.gain,
            "elastic": self.elastic,
        }
        groups |= {f"curve.{i}": ix for i, ix in self.curve.items()}
        for ix in groups.values():
            ix.setflags(write=False)
        self.groups: Mapping[str, Indices] = MappingProxyType(groups)


@lru_cache(maxsize=64)
def layout_of(revolute: tuple[bool, ...]) -> Layout:
    """Layout of a chain with these joints; layouts are shared."""
    return Layout(revolute)
