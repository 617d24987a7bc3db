"""Hypotheses: what may have changed between an old belief and a new log, and by how much.

They know an arm only by the groups of its structure's parameters, so that planar and spatial arms
share this table.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..body.belief import Body
from ..body.covariance import root_of
from ..body.parameters import Indices
from ..body.settings import SHIFT, TURN
from ..body.structure import Structure
from ..common.arrays import Array
from ..common.choices import CAUSES
from ..errors import OptionError
from .settings import ANYWHERE, BUILT_CURVE, CREEP, OWN_FLOOR

FRAME = ("view.rotation", "view.shift")
"""Groups that move when the sensor is put elsewhere; always freed together."""


class _Sizes(NamedTuple):
    """Standard deviations of a group's parameters."""

    freed: float  # of one that has changed
    creep: float = 0.0  # between two logs of an arm that has not
    built: float = 0.0  # of an arm as it was built, from its drawing


_SIZES = {
    "view.rotation": _Sizes(0.05),  # [rad], about the frame that fits the log best
    "view.shift": _Sizes(0.05),  # of the extents
    "view.scale": _Sizes(0.3),
    "view.shear": _Sizes(0.1),
    "view.tilt": _Sizes(0.3),  # over the chain's length
    "lens": _Sizes(0.2),
    "offset": _Sizes(np.radians(5.0), np.radians(0.02), np.radians(0.1)),
    "length": _Sizes(0.15, 1e-4, 1e-3),  # of the mean length; as built [m]
    "gain": _Sizes(0.03, 1e-4, 1e-3),
    "elastic": _Sizes(0.02, 2e-5, 1e-4),
    "tool": _Sizes(0.1, 1e-4, 1e-3),  # [m]; its prior in space is that of an unknown tool
    "tool.rotation": _Sizes(0.3, np.radians(0.02), np.radians(0.1)),
}
_OTHER = _Sizes(5.0, 0.1, 1.0)
"""The same of groups that are not listed, over their prior of a robot."""


@dataclass(frozen=True)
class Hypothesis:
    """What may have changed."""

    groups: tuple[str, ...]  # groups that are freed; ``"curve"`` stands for those of all joints

    @property
    def name(self) -> str:
        """Such as "nothing", "frame", "frame, length"."""
        own = [g.removeprefix("view.") for g in self.groups if g not in FRAME]
        return ", ".join([*["frame"] * self.framed, *own]) or "nothing"

    @property
    def framed(self) -> bool:
        """Whether the sensor's frame is free."""
        return "view.shift" in self.groups


NOTHING = Hypothesis(())

TESTED = ("offset", "length", "gain", "placement", "tool")
"""Groups that are tested joint by joint."""

_CAMERA = ("view.scale", "view.shear", "view.tilt")
_SENSOR = ((), ("view.scale",), _CAMERA, ("view.scale", "view.shear", "lens"))
_GEOMETRY = ("offset", "length", "gain", "placement")
_EVERY = (*_GEOMETRY, "elastic", "tool", "curve")
_ARM = (("offset",), ("length",), ("gain",), ("elastic",), ("tool",), _GEOMETRY, _EVERY)


def hypotheses_of(structure: Structure, cause: str | None = None) -> tuple[Hypothesis, ...]:
    """What may have changed, from simple to rich; the first is nothing.

    cause : {"sensor", "joints"}, if the user knows that only the one or the other may have
    """
    if cause is not None and cause not in CAUSES:
        hint = f"choose one of {', '.join(CAUSES)}"
        raise OptionError(f"cause {cause!r} is unknown", hint=hint, parameter="cause", value=cause)
    sensor, arm = cause != "joints", cause != "sensor"
    sets = [(), *((*FRAME, *more) for more in _SENSOR if sensor), *(_ARM if arm else ())]
    if sensor and arm:
        sets += [(*FRAME, *more) for more in (*_ARM, (*_EVERY, *_CAMERA, "lens"))]
    known = (tuple(g for g in groups if len(indices_of(structure, (g,)))) for groups in sets)
    return tuple(Hypothesis(groups) for groups in dict.fromkeys(known))


def parts_of(structure: Structure, group: str) -> list[tuple[str, Indices]]:
    """Parts of a group that are named apart, each with its parameters: the joints' curves."""
    curves = group == "curve"
    own = [n for n in structure.groups if (n.startswith("curve.") if curves else n == group)]
    return [(name, structure.groups[name]) for name in own]


def indices_of(structure: Structure, groups: Iterable[str]) -> Indices:
    """Parameters (k,) of some groups; those that the structure does not have are left out."""
    parts = [ix for group in groups for _, ix in parts_of(structure, group)]
    return np.concatenate([np.zeros(0), *parts]).astype(np.intp)


def is_sensors(group: str) -> bool:
    """Whether a group of parameters is the sensor's."""
    return group.startswith("view.") or group == "lens"


def freedom(
    body: Body, hypothesis: Hypothesis, cause: str | None = None, found: Indices | None = None
) -> Array:
    """Standard deviation (d,) by which the freed parameters may have changed.

    found : parameters of a frame that was fitted to the log, of which no prior holds any; a narrow
        one about that fit would count the rows twice
    """
    sd = _deviations(body, hypothesis.groups, "freed", BUILT_CURVE)
    _keep_gauge(body, sd, cause)
    if hypothesis.framed and found is not None:
        sd[np.intersect1d(indices_of(body.structure, FRAME), found)] *= ANYWHERE
    return sd


def creep(body: Body, waves: float = CREEP) -> Array:
    """Standard deviation (d,) by which the arm's own parameters may have crept.

    waves : that of the joints' curves over their prior's; beyond `CREEP` of those too that the
        belief leaves out
    """
    sd, known = _deviations(body, None, "creep", waves), body.active
    _keep_gauge(body, sd)
    if waves > CREEP:
        known = np.union1d(known, indices_of(body.structure, ("curve",)))
    return np.where(np.isin(np.arange(len(sd)), known), sd, 0.0)


def _deviations(
    body: Body, groups: Iterable[str] | None, kind: str, curve: float, metre: float | None = None
) -> Array:
    """Standard deviation (d,) of the parameters of some groups, 0 elsewhere.

    groups : by default all of the arm
    kind : a column of `_Sizes`
    curve : that of the joints' curves, over their prior's
    metre : [unit], what lengths are told in; their mean where not given
    """
    structure, sd = body.structure, np.zeros(body.structure.size)
    extent, length = float(structure.extents[0]), metre or _length(body)
    # what is tilted is the chain, in its own unit: a log may be in another
    chain = float(np.abs(body.beta[indices_of(structure, ("length",))]).sum()) or extent
    times = {"view.shift": extent, "view.tilt": 1.0 / chain, "length": length}
    if groups is None:
        groups = [g for g in structure.groups if not is_sensors(g)]
    for group in groups:
        size = getattr(_SIZES.get(group, _OTHER), kind) * times.get(group, 1.0)
        for name, ix in parts_of(structure, group):
            sd[ix] = curve if name.startswith("curve") else size
            if group in _SIZES:
                continue
            usual = structure.prior((name,)).sd[ix]
            # A chain without a drawing has flat priors of its joint origins.  What was learned has
            # taken their place: shares of them let origins creep by a tenth of the reach.
            if group == "placement" and (turns := getattr(structure, "turns", None)) is not None:
                usual = np.minimum(usual, np.where(np.isin(ix, turns), TURN, SHIFT))
            sd[ix] *= usual
    return sd


def _length(body: Body) -> float:
    """Mean length of the links [unit]; 1 of a chain without such a group."""
    lengths = body.beta[indices_of(body.structure, ("length",))]
    return float(np.abs(lengths).mean()) if len(lengths) else 1.0


def _keep_gauge(body: Body, sd: Array, cause: str | None = None) -> None:
    """Hold what a free frame already says: the first joint's offset, the first length."""
    offset, length = (indices_of(body.structure, (g,)) for g in ("offset", "length"))
    # with the frame held, the first joint's offset is what a turn about its axis is
    if len(offset) and offset[0] not in body.active and cause != "joints":
        sd[offset[0]] = 0.0
    if np.isin(length[1:], body.active).any() and length[0] not in body.active:
        sd[length[0]] = 0.0


def as_built(body: Body) -> Body:
    """The belief that a changed arm starts from.

    Exact samples of a simulation say exactly what was drawn.  An arm as it was built is some
    tenths of a millimetre and of a degree away from that.
    """
    structure = body.structure
    body = replace(body, tau=np.maximum(body.tau, OWN_FLOOR * np.asarray(structure.extents)))
    if not body.simulated:
        return body
    metre = float(getattr(structure, "metre", 1.0))
    if structure.view not in ("rigid", "base", "pose"):
        metre = _length(body) / 0.3
    sd = _deviations(body, None, "built", BUILT_CURVE, metre)
    _keep_gauge(body, sd)
    if structure.kind == "spatial":  # the first origin's place is the frame's own
        first = (getattr(structure, name)[0] for name in ("shifts", "turns"))
        sd[np.concatenate(list(first))] = 0.0
    # What the samples left open stays correlated: along the gauge of a chain without a drawing,
    # deviations alone, of radians, would say that nothing was learned.
    active = np.union1d(np.flatnonzero(sd), body.active)
    covariance = np.diag(sd[active] ** 2)
    covariance[np.ix_(*2 * (np.searchsorted(active, body.active),))] += body.covariance
    return replace(body, active=active, root=root_of(covariance), second=None)
