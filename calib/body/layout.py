"""Layout: where each parameter of a body stands in its vector, and what it is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from itertools import product

import numpy as np

from .curves import HARMONICS
from .structure import Indices, Label

_AXES = ("x", "y", "z")

_Part = tuple[str | None, str, str]
"""Joint, name and unit of a parameter; ``"position"``, ``"length"`` and ``"tilt"`` stand for units
that depend on the sensor."""


class Layout:
    """Indices of groups of parameters that follow each other."""

    def __init__(self, parts: Mapping[str, Sequence[_Part]]) -> None:
        self.labels = tuple(Label(group, *part) for group, own in parts.items() for part in own)
        groups: dict[str, Indices] = {}
        start = 0
        for group, own in parts.items():
            groups[group] = np.arange(start, start := start + len(own))
            groups[group].setflags(write=False)
        self.groups: Mapping[str, Indices] = groups  # a plain one: models are pickled
        self.size = start


class PlanarLayout(Layout):
    """Parameters of a planar chain; `pairs` (i, j) are the joints that bend and what bends them."""

    def __init__(self, names: tuple[str, ...], revolute: tuple[bool, ...]) -> None:
        self.turning = tuple(i for i, turns in enumerate(revolute) if turns)
        self.sliding = tuple(i for i, turns in enumerate(revolute) if not turns)
        self.pairs = tuple((i, j) for i, j in product(self.turning, repeat=2) if j >= i)
        view = {
            "view.rotation": [("view.rotation", "rad")],
            "view.scale": [("view.log scale", "1")],
            "view.shear": [("view.stretch", "1"), ("view.shear", "1")],
            "view.shift": [("view.shift x", "position"), ("view.shift y", "position")],
            "view.tilt": [("view.tilt x", "tilt"), ("view.tilt y", "tilt")],
            "lens": [(f"lens.{what}", "1") for what in ("radial", "centre x", "centre y")],
        }
        units = {"length": "length", "offset": "rad", "gain": "1"}
        waves = ("cos", "sin")
        super().__init__(
            {group: [(None, *part) for part in own] for group, own in view.items()}
            | {group: [(n, f"{n}.{group}", unit) for n in names] for group, unit in units.items()}
            | {
                "elastic": [
                    (names[i], f"{names[i]}.elastic {wave} {names[j]}", "rad")
                    for (i, j), wave in product(self.pairs, waves)
                ]
            }
            | {
                f"curve.{i}": [
                    (names[i], f"{names[i]}.curve {wave} {k + 1}", "rad")
                    for wave, k in product(waves, range(HARMONICS))
                ]
                for i in self.turning
            }
        )
        groups = self.groups
        self.length, self.offset, self.gain = (groups[group] for group in units)
        self.elastic = groups["elastic"]
        self.curve = {i: groups[f"curve.{i}"] for i in self.turning}


class SpatialLayout(Layout):
    """Parameters of a spatial chain, mimic joints included, and of its sensor.

    names, chain : of the active joints and of all joints of the chain
    revolute : which active joints turn
    weighted : whether masses are known, and with them the torque of gravity
    """

    def __init__(
        self,
        names: tuple[str, ...],
        chain: tuple[str, ...],
        revolute: tuple[bool, ...],
        weighted: bool,
    ) -> None:
        frame = {"view.rotation": "rad", "view.shift": "position"}
        tool = {"tool": "m", "tool.rotation": "rad"}
        lens = {"focal": "px", "centre.u": "px", "centre.v": "px", "k1": "1"}
        places = list(product((("shift", "m"), ("turn", "rad")), _AXES))
        units = ["rad" if turns else "m" for turns in revolute]

        def along_axes(groups: Mapping[str, str]) -> dict[str, list[_Part]]:
            return {
                g: [(None, f"{g}.{axis}", unit) for axis in _AXES] for g, unit in groups.items()
            }

        super().__init__(
            along_axes(frame)
            | {
                "view.scale": [(None, "view.scale", "1")],
                "lens": [(None, f"lens.{what}", unit) for what, unit in lens.items()],
            }
            | along_axes(tool)
            | {
                "placement": [
                    (n, f"{n}.{what}.{axis}", unit) for n in chain for (what, unit), axis in places
                ],
                "offset": [(n, f"{n}.offset", unit) for n, unit in zip(names, units, strict=True)],
                "gain": [(n, f"{n}.gain", "1") for n in names],
                "elastic": [(n, f"{n}.elastic", "rad") for n in chain if weighted],
            }
            | {
                f"curve.{k}": [
                    (n, f"{n}.curve.{wave}.{order + 1}", "rad")
                    for wave, order in product(("cos", "sin"), range(HARMONICS))
                    if revolute[k]
                ]
                for k, n in enumerate(names)
            }
        )
        placement = self.groups["placement"].reshape(-1, 2, 3)
        # shifts and turns (m, 3) of the joint origins
        self.shifts, self.turns = placement[:, 0], placement[:, 1]


planar_layout = lru_cache(maxsize=64)(PlanarLayout)
spatial_layout = lru_cache(maxsize=64)(SpatialLayout)
