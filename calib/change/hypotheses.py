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
from ..common.arrays import Array, Mask
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
_GEOMETRY = ("offset", "length", "gain")
_SENSOR = ((), ("view.scale",), _CAMERA, ("view.scale", "view.shear", "lens"))
_ARM = (
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
_BOTH = ((*_GEOMETRY, *_CAMERA), (*_ARM[-1], *_CAMERA, "lens"))


def hypotheses_of(structure: Structure, cause: str | None = None) -> tuple[Hypothesis, ...]:
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
    sets: list[tuple[str, ...]] = [()]
    if cause != "joints":
        sets += [(*FRAME, *more) for more in _SENSOR]
    if cause != "sensor":
        sets += list(_ARM)
    if cause is None:
        sets += [(*FRAME, *more) for more in _ARM + _BOTH]
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

    The curves of the joints by `waves` times their prior's; beyond `CREEP` those too that the
    belief leaves out.
    """
    structure = body.structure
    sd = _deviations(body, _arm_groups(structure), "creep", waves)
    _keep_gauge(body, sd, None)
    known = _mask(structure, body.active)
    if waves > CREEP:
        known |= _mask(structure, indices_of(structure, ("curve",)))
    return np.where(known, sd, 0.0)


def _arm_groups(structure: Structure) -> list[str]:
    return [g for g in structure.groups if not is_sensors(g)]


def _mask(structure: Structure, indices: Indices) -> Mask:
    return np.isin(np.arange(structure.size), indices)


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
    if group == "placement" and (turns := getattr(structure, "turns", None)) is not None:
        sd = np.minimum(sd, np.where(np.isin(ix, turns), TURN, SHIFT))
    return np.asarray(sd)


def _lengths(body: Body) -> Array:
    """Lengths (k,) of the links, none of a chain without such a group [unit]."""
    return body.beta[indices_of(body.structure, ("length",))]


def _keep_gauge(body: Body, sd: Array, cause: str | None) -> None:
    """Hold what a free frame already says: the first joint's offset, the first length."""
    active = _mask(body.structure, body.active)
    offset, length = (indices_of(body.structure, (g,)) for g in ("offset", "length"))
    # with the frame held, the first joint's offset is what a turn about its axis is
    if len(offset) and not active[offset[0]] and cause != "joints":
        sd[offset[0]] = 0.0
    if len(length) and active[length[1:]].any() and not active[length[0]]:
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
        metre = float(np.abs(_lengths(body)).mean()) / 0.3
    sd = _deviations(body, _arm_groups(structure), "built", BUILT_CURVE, metre)
    _keep_gauge(body, sd, None)
    if structure.kind == "spatial":  # the first origin's place is the frame's own
        first = (getattr(structure, name)[0] for name in ("shifts", "turns"))
        sd[np.concatenate(list(first))] = 0.0
    # What the samples left open stays correlated: along the gauge of a chain without a drawing,
    # deviations alone, of radians, would say that nothing was learned.
    active = np.union1d(np.flatnonzero(sd), body.active)
    covariance = np.diag(sd[active] ** 2)
    covariance[np.ix_(*2 * (np.searchsorted(active, body.active),))] += body.covariance
    return replace(body, active=active, root=root_of(covariance), second=None)
