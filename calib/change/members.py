"""Members: what may have changed between an old belief and a new log, and by how much.

`adapt` and `check` compare the same members.  They know an arm only by the groups of its
structure's parameters, so that planar and spatial arms share this table.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..body.belief import Body
from ..body.covariance import root_of
from ..body.parameters import Indices
from ..body.settings import SHIFT, TURN
from ..body.spatial import SpatialStructure
from ..body.structure import Structure
from ..common.arrays import Array
from ..common.choices import CAUSES
from ..errors import OptionError

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
    "view.tilt": _Sizes(0.3),  # of the chain's size
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

ANYWHERE = 20.0
"""Sizes of a freed frame, a radian and an extent, beyond which it is not looked for."""

_CURVE = 0.3  # of a joint's curve that is freed or as built, over its prior
_SMALL = 0.1  # of the sizes above: a second prior of members with elasticity

CREEP = 0.01
"""Sd of a joint's curve that may creep between two logs, over that of its prior."""


@dataclass(frozen=True)
class Member:
    """A hypothesis of what changed."""

    groups: tuple[str, ...]  # groups that are freed; ``"curve"`` stands for those of all joints
    share: float = 1.0  # by how much of the usual size the arm's own groups are freed

    @property
    def name(self) -> str:
        """Such as "nothing", "frame", "frame, length"."""
        own = [g.removeprefix("view.") for g in self.groups if g not in FRAME]
        named = [*["frame"] * self.framed, *own, *["small"] * (self.share != 1.0)]
        return ", ".join(named) or "nothing"

    @property
    def framed(self) -> bool:
        """Whether the sensor's frame is free."""
        return "view.shift" in self.groups


NOTHING = Member(())

TESTED = ("offset", "length", "gain", "placement", "tool")
"""Groups that are tested joint by joint."""

_CAMERA = ("view.scale", "view.shear", "view.tilt")
_GEOMETRY = ("offset", "length", "gain")
_SENSOR = ((), ("view.scale",), _CAMERA, ("view.scale", "view.shear", "lens"))
_JOINTS = (
    ("offset",),
    ("length",),
    ("gain",),
    ("elastic",),
    ("tool",),
    _GEOMETRY,
    ("placement", "offset", "gain"),
    (*_GEOMETRY, "elastic"),
    (*_GEOMETRY, "elastic", "placement", "tool", "curve"),
)
_BOTH = (
    (*_GEOMETRY, *_CAMERA),
    (*_GEOMETRY, "elastic", "placement", "tool", "curve", *_CAMERA, "lens"),
)


def members_of(structure: Structure, cause: str | None = None) -> tuple[Member, ...]:
    """What may have changed, from simple to rich; the first is nothing.

    structure : groups that it does not have are left out
    cause : {"sensor", "joints"}, what the user knows: only the sensor's view is free, or only the
        arm
    """
    if cause is not None and cause not in CAUSES:
        raise OptionError(
            f"cause {cause!r} is unknown",
            hint=f"choose one of {', '.join(CAUSES)}",
            parameter="cause",
            value=cause,
        )
    sets: list[tuple[str, ...]] = []
    if cause != "joints":
        sets += [(*FRAME, *more) for more in _SENSOR]
    if cause != "sensor":
        sets += list(_JOINTS)
    if cause is None:
        sets += [(*FRAME, *more) for more in _JOINTS + _BOTH]
    found: dict[tuple[str, ...], Member] = {(): NOTHING}
    for groups in sets:
        known = tuple(g for g in groups if any(len(ix) for _, ix in parts_of(structure, g)))
        if known and known not in found:
            found[known] = Member(known)
    # Most arms give way little, a few by degrees: with the wide prior alone, what rows of a line
    # leave open went centimetres away.
    small = [replace(m, share=_SMALL) for m in found.values() if "elastic" in m.groups]
    richest = list(found.values())[-1]
    return (*(m for m in found.values() if m is not richest), *small, richest)


def parts_of(structure: Structure, group: str) -> list[tuple[str, Indices]]:
    """Parts of a group that are named apart, each with its parameters: the joints' curves."""
    curves = group == "curve"
    own = [n for n in structure.groups if (n.startswith("curve.") if curves else n == group)]
    return [(name, structure.groups[name]) for name in own]


def freedom(body: Body, member: Member, cause: str | None = None) -> Array:
    """Standard deviation (d,) by which the freed parameters may have changed."""
    sd = _deviations(body, member.groups, "freed", _CURVE)
    sd *= np.where(_mask(body.structure, FRAME), 1.0, member.share)
    _keep_gauge(body, sd, cause)
    return sd


def anywhere(structure: Structure, forgotten: Indices) -> Indices:
    """Parameters of a frame that was fitted to the log: no prior holds them.

    A narrow one about that fit would count the rows twice; `ANYWHERE` times its sd is none.
    """
    return np.intersect1d(np.flatnonzero(_mask(structure, FRAME)), forgotten)


def drift(body: Body, waves: float = CREEP) -> Array:
    """Standard deviation (d,) by which the arm's own parameters may have crept.

    The curves of the joints by `waves` times their prior's; beyond `CREEP` those too that the
    belief leaves out.
    """
    structure = body.structure
    sd = _deviations(body, _arm_groups(structure), "creep", waves)
    _keep_gauge(body, sd, None)
    known = np.isin(np.arange(len(sd)), body.active)
    if waves > CREEP:
        known |= _mask(structure, ("curve",))
    return np.where(known, sd, 0.0)


def _arm_groups(structure: Structure) -> list[str]:
    """Groups of the arm's own parameters."""
    return [g for g in structure.groups if not (g.startswith("view.") or g == "lens")]


def _mask(structure: Structure, groups: Iterable[str]) -> NDArray[np.bool_]:
    """Which parameters (d,) are of some groups."""
    parts = [ix for group in groups for _, ix in parts_of(structure, group)]
    return np.isin(np.arange(structure.size), np.concatenate([np.zeros(0, int), *parts]))


def _deviations(
    body: Body, groups: Iterable[str], kind: str, curve: float, metre: float | None = None
) -> Array:
    """Standard deviation (d,) of the parameters of some groups, 0 elsewhere.

    kind : a column of `_Sizes`
    curve : that of the joints' curves, over their prior's
    metre : [unit], what lengths are told in; their mean where not given
    """
    structure, sd = body.structure, np.zeros(body.structure.size)
    for group in groups:
        size = getattr(_SIZES.get(group, _OTHER), kind)
        for name, ix in parts_of(structure, group):
            if group not in _SIZES:
                share = curve if name.startswith("curve") else size
                sd[ix] = share * _usual(structure, name, ix)
                continue
            sd[ix] = size
            if group == "view.shift":
                sd[ix] *= float(structure.extents[0])
            elif group == "view.tilt":
                # a forged file may hold links of no length, and a chain no such group
                total = float(np.abs(_lengths(body)).sum())
                sd[ix] /= total or float(structure.extents[0])
            elif group == "length":
                sd[ix] *= metre or float(np.abs(_lengths(body)).mean())
    return sd


def _usual(structure: Structure, group: str, ix: Indices) -> Array:
    """Prior sd of the parameters `ix` of one group of an arm whose geometry is known.

    A chain without a drawing has flat priors of its joint origins.  What was learned has taken
    their place: shares of them let origins creep by a tenth of the reach, which hid any change.
    """
    sd = structure.prior((group,)).sd[ix]
    if isinstance(structure, SpatialStructure) and group == "placement":
        turns = np.isin(ix, structure.turns)
        sd = np.minimum(sd, np.where(turns, TURN, SHIFT))
    return np.asarray(sd)


def _lengths(body: Body) -> Array:
    """Lengths (k,) of the links, none of a chain without such a group [unit]."""
    return body.beta[body.structure.groups.get("length", np.zeros(0, dtype=int))]


def _keep_gauge(body: Body, sd: Array, cause: str | None) -> None:
    """Hold what a free frame already says: the first joint's offset, the first length."""
    active = np.isin(np.arange(len(sd)), body.active)
    none = np.zeros(0, dtype=np.intp)
    offset, length = (body.structure.groups.get(g, none) for g in ("offset", "length"))
    # with the frame held, the first joint's offset is what a turn about its axis is
    if len(offset) and not active[offset[0]] and cause != "joints":
        sd[offset[0]] = 0.0
    if len(length) and active[length[1:]].any() and not active[length[0]]:
        sd[length[0]] = 0.0


def as_built(body: Body) -> Body:
    """The belief that `check` and `adapt` start from.

    Exact samples of a simulation say exactly what was drawn.  An arm as it was built is some
    tenths of a millimetre and of a degree away from that.
    """
    if not body.simulated:
        return body
    structure = body.structure
    metre = float(getattr(structure, "metre", 1.0))
    if structure.view not in ("rigid", "base", "pose"):
        metre = float(np.abs(_lengths(body)).mean()) / 0.3
    sd = _deviations(body, _arm_groups(structure), "built", _CURVE, metre)
    _keep_gauge(body, sd, None)
    if isinstance(structure, SpatialStructure):  # the first origin's place is the frame's own
        sd[np.concatenate([structure.shifts[0], structure.turns[0]])] = 0.0
    # What the samples left open stays correlated: along the gauge of a chain without a drawing,
    # deviations alone, of radians, would say that nothing was learned.
    active = np.union1d(np.flatnonzero(sd), body.active)
    covariance = np.diag(sd[active] ** 2)
    covariance[np.ix_(*2 * (np.searchsorted(active, body.active),))] += body.covariance
    return replace(body, active=active, root=root_of(covariance), second=None)
