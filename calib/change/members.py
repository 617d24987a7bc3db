"""Members: what may have changed between an old belief and a new log, and by how much.

`adapt` and `check` compare the same members.  They know an arm only by the groups of its
structure's parameters, so that planar and spatial arms share this table.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..body.belief import Body
from ..body.covariance import root_of
from ..body.priors import SHIFT, TURN
from ..body.spatial import SpatialStructure
from ..body.structure import Indices, Structure
from ..common.arrays import Array
from ..common.choices import CAUSES
from ..errors import OptionError

FRAME = ("view.rotation", "view.shift")
"""Groups that move when the sensor is put elsewhere; always freed together."""

_FREE = {
    "view.rotation": 0.05,  # [rad], about the frame that fits the log best
    "view.shift": 0.05,  # of the extents
    "view.scale": 0.3,
    "view.shear": 0.1,
    "view.tilt": 0.3,  # of the chain's size
    "lens": 0.2,
    "offset": np.radians(5.0),
    "length": 0.15,  # of the mean length
    "gain": 0.03,
    "elastic": 0.02,
    "tool": 0.1,  # [m]; its prior in space is that of an unknown tool, far wider
    "tool.rotation": 0.3,
}
"""Prior sd of a group that is freed; what is not listed is 5 times its prior of a robot."""

_DRIFT = {
    "offset": np.radians(0.02),
    "length": 1e-4,
    "gain": 1e-4,
    "elastic": 2e-5,
    "tool": 1e-4,
    "tool.rotation": np.radians(0.02),
}
"""Sd by which everything may creep between two logs; curves creep by 10 urad."""

ANYWHERE = 20.0
"""Sizes of a freed frame, a radian and an extent, beyond which it is not looked for."""

_CURVE_FREE, _OTHER_FREE, _OTHER_DRIFT = 0.3, 5.0, 0.1

_SMALL = 0.1  # of the sizes above: a second prior of members with elasticity

CREEP = 0.01
"""Sd of a joint's curve that may creep between two logs, over that of its prior."""


@dataclass(frozen=True)
class Member:
    """A hypothesis of what changed."""

    name: str  # ``"nothing"``, ``"frame"``, ``"frame, length"``
    groups: tuple[str, ...]  # groups that are freed; ``"curve"`` stands for those of all joints
    share: float = 1.0  # by how much of the usual size the arm's own groups are freed

    @property
    def framed(self) -> bool:
        """Whether the sensor's frame is free."""
        return "view.shift" in self.groups


NOTHING = Member("nothing", ())

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
        known = tuple(g for g in groups if len(_indices(structure, g)))
        if known and known not in found:
            found[known] = Member(_named(known), known)
    # Most arms give way little, a few by degrees: with the wide prior alone, what rows of a line
    # leave open went centimetres away.
    small = [
        replace(m, name=f"{m.name}, small", share=_SMALL)
        for m in found.values()
        if "elastic" in m.groups
    ]
    richest = list(found.values())[-1]
    return (*(m for m in found.values() if m is not richest), *small, richest)


def _named(groups: tuple[str, ...]) -> str:
    words = {"view.scale": "scale", "view.shear": "shear", "view.tilt": "tilt"}
    named = (words.get(g, g) for g in groups if g not in FRAME)
    return ", ".join([*["frame"] * ("view.shift" in groups), *named])


def parts_of(structure: Structure, group: str) -> list[tuple[str, Indices]]:
    """Parts of a group that are named apart, each with its parameters: the joints' curves."""
    curves = group == "curve"
    own = [n for n in structure.groups if (n.startswith("curve.") if curves else n == group)]
    return [(name, structure.groups[name]) for name in own]


def _indices(structure: Structure, group: str) -> Indices:
    parts = [ix for _, ix in parts_of(structure, group)]
    return np.concatenate(parts) if parts else np.zeros(0, dtype=int)


def freedom(body: Body, member: Member, cause: str | None = None) -> Array:
    """Standard deviation (d,) by which the freed parameters may have changed."""
    sd = np.zeros(body.structure.size)
    for group in member.groups:
        ix = _indices(body.structure, group)
        share = 1.0 if group in FRAME else member.share
        sd[ix] = share * _size(body, group, ix, _FREE, _CURVE_FREE, _OTHER_FREE)
    _keep_gauge(body, sd, cause)
    return sd


def anywhere(structure: Structure, forgotten: Indices) -> Indices:
    """Parameters of a frame that was fitted to the log: no prior holds them.

    A narrow one about that fit would count the rows twice; `ANYWHERE` times its sd is none.
    """
    frame = [ix for name, ix in structure.groups.items() if name in FRAME]
    return np.intersect1d(np.concatenate(frame), forgotten) if frame else forgotten[:0]


def drift(body: Body, waves: float = CREEP) -> Array:
    """Standard deviation (d,) by which the arm's own parameters may have crept.

    The curves of the joints by `waves` times their prior's; beyond `CREEP` those too that the
    belief leaves out.
    """
    sd = np.zeros(body.structure.size)
    for group, ix in body.structure.groups.items():
        if not (group.startswith("view.") or group == "lens"):
            sd[ix] = _size(body, group, ix, _DRIFT, waves, _OTHER_DRIFT)
    _keep_gauge(body, sd, None)
    known = np.isin(np.arange(len(sd)), body.active)
    if waves > CREEP:
        known[_indices(body.structure, "curve")] = True
    return np.where(known, sd, 0.0)


def _size(
    body: Body, group: str, ix: Indices, table: dict[str, float], curve: float, other: float
) -> Array:
    """Sd of the parameters `ix` of one group."""
    structure = body.structure
    size = table.get(group)
    if size is not None:
        if group == "view.shift":
            size = size * float(structure.extents[0])
        elif group == "view.tilt":
            size = size / _chain_size(body)
        elif group == "length":
            size = size * _mean_length(body)
        return np.full(len(ix), size)
    share = curve if group.startswith("curve") else other
    return share * _usual(structure, group, ix)


def _usual(structure: Structure, group: str, ix: Indices) -> Array:
    """Prior sd of the parameters `ix` of one group of an arm whose geometry is known.

    A chain without a drawing has flat priors of its joint origins.  What was learned has taken
    their place: shares of them let origins creep by a tenth of the reach, which hid any change.
    """
    sd = structure.prior((group,)).sd[ix]
    if isinstance(structure, SpatialStructure) and group == "placement":
        turns = np.isin(ix, structure.layout.turns)
        sd = np.minimum(sd, np.where(turns, TURN, SHIFT))
    return np.asarray(sd)


def _mean_length(body: Body) -> float:
    return float(np.abs(body.beta[_indices(body.structure, "length")]).mean())


def _chain_size(body: Body) -> float:
    """Sum of the lengths; for a chain without such a group the extents."""
    ix = _indices(body.structure, "length")
    # a forged file may hold links of no length
    return float(np.abs(body.beta[ix]).sum()) or float(body.structure.extents[0])


def _keep_gauge(body: Body, sd: Array, cause: str | None) -> None:
    """Hold what a free frame already says: the first joint's offset, the first length."""
    active = np.isin(np.arange(len(sd)), body.active)
    offset, length = (_indices(body.structure, group) for group in ("offset", "length"))
    # with the frame held, the first joint's offset is what a turn about its axis is
    if len(offset) and not active[offset[0]] and cause != "joints":
        sd[offset[0]] = 0.0
    if len(length) and active[length[1:]].any() and not active[length[0]]:
        sd[length[0]] = 0.0


_BUILT = {"length": 1e-3, "offset": np.radians(0.1), "gain": 1e-3, "elastic": 1e-4}
_BUILT |= {"tool": 1e-3, "tool.rotation": np.radians(0.1)}
"""How far an arm as built is from its drawing; lengths in m."""


def as_built(body: Body) -> Body:
    """The belief that `check` and `adapt` start from.

    Exact samples of a simulation say exactly what was drawn.  An arm as it was built is some
    tenths of a millimetre and of a degree away from that.
    """
    if not body.simulated:
        return body
    structure = body.structure
    sd = np.zeros(structure.size)
    metre = float(getattr(structure, "metre", 1.0))
    if structure.view not in ("rigid", "base", "pose"):
        metre = _mean_length(body) / 0.3
    for group, ix in structure.groups.items():
        if group.startswith("view.") or group == "lens":
            continue
        if group in _BUILT:
            sd[ix] = _BUILT[group] * (metre if group == "length" else 1.0)
        else:
            share = _CURVE_FREE if group.startswith("curve") else 1.0
            sd[ix] = share * _usual(structure, group, ix)
    _keep_gauge(body, sd, None)
    if isinstance(structure, SpatialStructure):  # the first origin's place is the frame's own
        sd[np.concatenate([structure.layout.shifts[0], structure.layout.turns[0]])] = 0.0
    # What the samples left open stays correlated: along the gauge of a chain without a drawing,
    # deviations alone, of radians, would say that nothing was learned.
    active = np.union1d(np.flatnonzero(sd), body.active)
    covariance = np.diag(sd[active] ** 2)
    covariance[np.ix_(*2 * (np.searchsorted(active, body.active),))] += body.covariance
    return replace(body, active=active, root=root_of(covariance), second=None)
