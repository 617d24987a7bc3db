"""Causes: what is off about an arm against its drawing, and how far each moves the tip.

Motions of the tip that several parameters share are told once: a minimal set of parameters, in
the order of `_ORDER`, stands for all others (zeros before turned origins, lengths before shifts).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array
from ..errors import CalibError
from ..model.model import Model
from ..model.nominal import nominal_in_plane
from .judged import frame_of
from .settings import AMOUNTS, LIMITS, Z95

_ORDER = ("length", "offset", "gain", "elastic", "placement")
_WORDS = {
    "offset": "zero",
    "gain": "gain",
    "length": "link length",
    "shift": "origin along",
    "turn": "axis turned about",
    "elastic": "bends",
    "curve": "error curve",
}


@dataclass(frozen=True)
class Cause:
    """One difference from the drawing, with half of its 95 % interval."""

    name: str
    value: float  # [unit of the parameter]
    half: float
    unit: str  # "rad", "m", "1" or the sensor's
    effect: float  # [unit of positions], rms motion of the tip that it makes
    certain: bool  # whether its interval excludes nothing

    @property
    def effect_half(self) -> float:
        """Half of the 95 % interval of the effect."""
        return self.effect * self.half / abs(self.value) if self.value else 0.0


def causes_of(model: Model) -> list[Cause]:
    """Return what differs from the drawing, the largest effect first; none without a drawing."""
    body = model.body
    if body is None or not model.about.urdf:
        return []
    structure = body.structure
    drawing = structure.neutral()
    if structure.kind == "planar":
        try:
            drawing = nominal_in_plane(model)[1]
        except CalibError:
            return []
    away = body.beta - drawing
    columns = _columns(model)
    size = np.linalg.norm(columns, axis=0)
    active = set(body.active.tolist())
    arm = [k for name in _ORDER for k in structure.groups.get(name, ()) if k in active]
    chosen, others = _independent(columns, arm)
    share = np.linalg.lstsq(columns[:, chosen], columns[:, others], rcond=None)[0]
    root = np.zeros((structure.size, body.root.shape[1]))
    root[body.active] = body.root
    values = away[chosen] + share @ away[others]
    halves = Z95 * np.linalg.norm(root[chosen] + share @ root[others], axis=1)
    causes = []
    for k, value, half in zip(chosen, values.tolist(), halves.tolist(), strict=True):
        label = structure.labels[k]
        effect = float(size[k]) * abs(value)
        name = _words(label.name, str(label.joint))
        certain = abs(value) > half
        causes.append(Cause(name, value, half, label.unit, effect, certain))
    for k, joint in enumerate(structure.joint_names):
        waves = structure.groups[f"curve.{k}"]
        if len(waves) and away[waves].any():
            effect = float(np.linalg.norm(columns[:, waves] @ away[waves]))
            value = float(np.linalg.norm(away[waves])) / 2**0.5
            causes.append(
                Cause(f"{joint}: error curve, rms", value, 0.0, "rad", effect, True)
            )
    return sorted(causes, key=lambda cause: -cause.effect)


def _columns(model: Model) -> Array:
    """How parameters move the tip, (postures m, d), without what sensor and tool take up.

    The length of a column is the rms motion of the tip for one unit of its parameter.
    """
    assert model.body is not None  # noqa: S101 - the caller has looked
    structure = model.body.structure
    size = AMOUNTS.postures, structure.dof
    q = np.random.default_rng(0).uniform(model.about.lower, model.about.upper, size)
    slope = structure.linearise(q, model.body.beta)[1][:, : structure.blocks[0]]
    columns = slope.reshape(-1, structure.size) / AMOUNTS.postures**0.5
    frame = columns[:, frame_of(model)]
    return np.asarray(columns - frame @ np.linalg.lstsq(frame, columns, rcond=1e-9)[0])


def _independent(columns: Array, parameters: list[int]) -> tuple[list[int], list[int]]:
    """Parameters whose columns are independent, the first ones first, and the others."""
    chosen = []
    others = []
    basis = np.zeros((len(columns), 0))
    most = float(np.linalg.norm(columns[:, parameters], axis=0).max(initial=0.0))
    for k in parameters:
        column = columns[:, k]
        rest = column - basis @ (basis.T @ column)
        length = float(np.linalg.norm(rest))
        if length > max(LIMITS.same * float(np.linalg.norm(column)), 1e-9 * most):
            chosen.append(k)
            basis = np.column_stack([basis, rest / length])
        else:
            others.append(k)
    return chosen, others


def _words(name: str, joint: str) -> str:
    """A parameter in words: "elbow: zero", "elbow: origin along x"."""
    what, _, axis = name.removeprefix(f"{joint}.").partition(".")
    kind, _, rest = what.partition(" ")
    return " ".join(f"{joint}: {_WORDS.get(kind, kind)} {rest} {axis}".split())
