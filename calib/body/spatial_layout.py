"""Layout of a spatial body's parameters: which index is what."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .curves import HARMONICS
from .structure import Indices, Label

AXES = ("x", "y", "z")
LENS = ("focal", "centre.u", "centre.v", "k1")


@dataclass(frozen=True)
class SpatialLayout:
    """Indices of a chain of joints that follow `dof` values, before a view."""

    joint_names: tuple[str, ...]  # names of the active joints (dof)
    chain_names: tuple[str, ...]  # names of all joints of the chain (m), mimic joints included
    revolute: tuple[bool, ...]  # which active joints turn
    weighted: bool  # whether masses are known, and with them the torque of gravity

    @cached_property
    def groups(self) -> Mapping[str, Indices]:
        """Indices of each group of parameters."""
        dof, m = len(self.joint_names), len(self.chain_names)
        sizes: dict[str, int] = {
            "view.rotation": 3,
            "view.shift": 3,
            "view.scale": 1,
            "lens": len(LENS),
            "tool": 3,
            "tool.rotation": 3,
            "placement": 6 * m,
            "offset": dof,
            "gain": dof,
            "elastic": m if self.weighted else 0,
        }
        for k in range(dof):
            sizes[f"curve.{k}"] = 2 * HARMONICS if self.revolute[k] else 0
        groups, start = {}, 0
        for name, size in sizes.items():
            groups[name] = np.arange(start, start + size)
            start += size
        return groups

    @property
    def shifts(self) -> Indices:
        """Shifts of the joint origins (m, 3)."""
        return self.groups["placement"].reshape(-1, 6)[:, :3]

    @property
    def turns(self) -> Indices:
        """Turns of the joint origins (m, 3)."""
        return self.groups["placement"].reshape(-1, 6)[:, 3:]

    def label(self, index: int, unit: str) -> Label:
        """What a parameter is; `unit` is that of positions."""
        group = next(name for name, ix in self.groups.items() if index in ix)
        k = index - int(self.groups[group][0])
        if group == "placement":
            joint, part = self.chain_names[k // 6], k % 6
            kind, what = ("m", "shift") if part < 3 else ("rad", "turn")
            return Label(group, joint, f"{joint}.{what}.{AXES[part % 3]}", kind)
        if group == "elastic":
            joint = self.chain_names[k]
            return Label(group, joint, f"{joint}.elastic", "rad")
        if group in ("offset", "gain"):
            joint = self.joint_names[k]
            kind = "1" if group == "gain" else "rad" if self.revolute[k] else "m"
            return Label(group, joint, f"{joint}.{group}", kind)
        if group.startswith("curve."):
            joint = self.joint_names[int(group.removeprefix("curve."))]
            wave, order = ("sin", k - HARMONICS) if k >= HARMONICS else ("cos", k)
            return Label(group, joint, f"{joint}.curve.{wave}.{order + 1}", "rad")
        if group == "lens":
            return Label(group, None, f"lens.{LENS[k]}", "1" if k == 3 else "px")
        if group == "view.scale":
            return Label(group, None, group, "1")
        kind = "rad" if "rotation" in group else "m" if group == "tool" else unit
        return Label(group, None, f"{group}.{AXES[k]}", kind)
