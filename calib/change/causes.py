"""Causes: what may have changed between a belief and a log, by how much, and in which words.

They know an arm only by the groups of its structure's parameters: one table serves all arms.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from ..body.belief import Body
from ..body.covariance import root_of
from ..body.parameters import Indices
from ..body.settings import LOG_FLOOR, SHIFT, TURN
from ..body.spatial import SpatialStructure
from ..body.structure import Structure
from ..common.arrays import Array
from ..errors import OptionError
from .settings import ANYWHERE, BUILT_CURVE, CREEP

FRAME = ("view.rotation", "view.shift")
"""Groups that move when the sensor is put elsewhere; always freed together."""


@dataclass(frozen=True)
class Cause:
    """One change that explains a log."""

    # ``"sensor"``, ``"offset:JOINT"``, ``"length:JOINT"``, ``"gain:JOINT"``, ``"elastic:JOINT"``,
    # ``"curve:JOINT"``, ``"curve"`` of all joints, ``"scale"``, ``"tilt"``, ``"lens"``,
    # ``"mirror"``, ``"sign:JOINT"``, ``"lost:JOINT"``, ``"backlash:JOINT"``, ``"noise"``,
    # ``"noise:JOINT"`` or ``"unknown"``
    cause: str
    group: str  # group of parameters: ``"view.rotation"``, ``"offset"``, ``"length"``,
    words: str  # the same in words
    # size of the change, None where no number tells it
    value: float | None = None
    interval: tuple[float, float] | None = None  # 95 % interval of the value
    unit: str = ""  # unit of the value

    @staticmethod
    def measured(
        name: str, group: str, words: str, value: float, half: float, unit: str
    ) -> Cause:
        """A cause with half the width of its 95 % interval."""
        return Cause(
            name, group, words, value, (value - half, value + half), unit
        )

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return {
            k: list(v) if isinstance(v, tuple) else v
            for k, v in asdict(self).items()
        }


class Group(NamedTuple):
    """How far the parameters of a group may move (standard deviations), and its words."""

    freed: float  # of one that has changed
    creep: float = 0.0  # between two logs of an arm that has not
    built: float = 0.0  # of an arm as it was built, from its drawing
    # of what an adaptation leaves as it was; "" where that is not told
    kept: str = ""
    changed: str = "{name} changed by {value:+.3g} ± {half:.2g} {unit}"
    whole: bool = False  # whether all of its parameters are one cause


_DEGREE = float(np.radians(1.0))
GROUPS = {
    # [rad], about the frame that fits the log best; of the extents
    "view.rotation": Group(0.05, kept="the sensor's frame"),
    "view.shift": Group(0.05),
    "view.scale": Group(
        0.3,
        0,
        0,
        "the sensor's scale",
        "the sensor's scale changed by {value:+.3g} %",
        True,
    ),
    "view.shear": Group(
        0.1, changed="the sensor's axes are stretched or sheared", whole=True
    ),
    # over the chain's length
    "view.tilt": Group(
        0.3, 0, 0, "the camera's tilt", "the camera is tilted", True
    ),
    "lens": Group(
        0.2, 0, 0, "the lens", "the sensor's frame is bent, as by a lens", True
    ),
    # of the mean length; as built [m]
    "length": Group(
        0.15,
        1e-4,
        1e-3,
        "the links' lengths",
        "the link of {joint} is {share}{size} {longer}",
    ),
    "offset": Group(
        5 * _DEGREE,
        0.02 * _DEGREE,
        0.1 * _DEGREE,
        "the joints' offsets",
        "{joint} is off by {value:+.3g} ± {half:.2g} {unit}",
    ),
    "gain": Group(
        0.03,
        1e-4,
        1e-3,
        "the joints' gains",
        "{joint} moves {value:+.3g} ± {half:.2g} % further than it says",
    ),
    "elastic": Group(
        0.02,
        2e-5,
        1e-4,
        "elasticity",
        "{joint} bends under load, by up to {most:.3g} deg",
        True,
    ),
    "payload": Group(
        0.02,
        2e-5,
        1e-4,
        "the payload",
        "a payload bends {joint}, by up to {most:.3g} deg",
        True,
    ),
    # over the prior of a robot
    "placement": Group(5.0, 0.1, 1.0, "the joints' placements"),
    "tool": Group(0.1, 1e-4, 1e-3, "the tool"),  # [m]
    "tool.rotation": Group(0.3, 0.02 * _DEGREE, 0.1 * _DEGREE),
    "curve": Group(  # of sizes that are given
        0.0,
        changed="{joint} has another error curve, by up to {most:.3g} deg",
        whole=True,
    ),
}

_NEVER = Group(
    0.0
)  # of a group that is as it was, such as the coupling of joints

TESTED = ("offset", "length", "gain", "placement", "tool", "elastic", "payload")
"""Groups that are tested joint by joint."""

_CAMERA = ("view.tilt", "view.shear", "view.scale")
_GEOMETRY = ("offset", "length", "gain", "placement")
_ARM = (*_GEOMETRY, "elastic", "tool")
_SENSORS = {
    "sensor": FRAME,
    "scale": ("view.scale", *FRAME),
    "tilt": (*_CAMERA, *FRAME),
    "lens": ("lens", "view.scale", "view.shear", *FRAME),
}
"""Groups of each cause of the sensor, its own first."""

_SETS = (
    ("offset",),
    ("length",),
    ("gain",),
    ("offset", "length"),
    _GEOMETRY,
    _ARM,
    ("offset", *FRAME),
    ("length", *FRAME),
    (*_ARM, *FRAME),
    (*_ARM, *_CAMERA, "lens", *FRAME),
)
"""Groups of which all parameters may have changed together."""


def check_choice(name: str, value: str | None, choices: Sequence[str]) -> None:
    """Refuse what cannot be chosen."""
    if value is not None and value not in choices:
        raise OptionError(
            f"{name} {value!r} is unknown",
            hint=f"choose one of {', '.join(choices)}",
            parameter=name,
            value=value,
        )


def single_causes(
    structure: Structure, cause: str | None = None
) -> dict[str, Indices]:
    """Return the parameters of each cause that may stand alone.

    cause : {"sensor", "joints", "offsets"}, if it is known that only these may have changed;
        "offsets" are the joints' zeros and the frame
    """
    sensors = _SENSORS
    groups: tuple[str, ...] = TESTED
    if cause == "offsets":
        sensors = {"sensor": FRAME}
        groups = ("offset",)
    elif cause == "joints":
        sensors = {}
    elif cause == "sensor":
        groups = ()
    causes: dict[str, Indices] = {}
    for name, moved in sensors.items():
        if len(indices_of(structure, moved[:1])):
            causes[name] = indices_of(structure, moved)
    for group in groups:
        for index in indices_of(structure, (group,)).tolist():
            joint = structure.labels[index].joint
            first = joint == structure.joint_names[0]
            if group == "placement" and first and cause != "joints":
                continue  # the first origin's place is the sensor's frame
            name = f"{group}:{joint}"
            if joint is None or group in ("elastic", "payload"):
                name = group  # a payload bends all joints at once
            indices = causes.get(name, np.zeros(0, np.intp))
            causes[name] = np.append(indices, index)
    return causes


def rich_sets(
    structure: Structure, singles: dict[str, Indices]
) -> dict[str, Indices]:
    """Return the parameters of single causes that may have changed together."""
    allowed = np.concatenate([*singles.values()])
    sets = {}
    for groups in _SETS:
        indices = indices_of(structure, groups)
        sets["+".join(groups)] = indices[np.isin(indices, allowed)]
    return sets


def is_sensors(group: str) -> bool:
    """Whether a group of parameters is the sensor's."""
    return group.startswith("view.") or group == "lens"


def changeable(structure: Structure) -> tuple[str, ...]:
    """Groups of a structure without the joints' curves."""
    return tuple(g for g in structure.groups if not g.startswith("curve"))


def indices_of(structure: Structure, groups: Iterable[str]) -> Indices:
    """Parameters (k,) of some groups; those that the structure does not have are left out."""
    parts: list[Array | Indices] = [np.zeros(0)]
    for group in groups:
        for name, indices in structure.groups.items():
            if group == name or group == "curve" == name.split(".")[0]:
                parts.append(indices)
    return np.concatenate(parts).astype(np.intp)


def freedom(
    body: Body,
    groups: tuple[str, ...],
    cause: str | None = None,
    forgotten: Indices | None = None,
) -> Array:
    """Standard deviation (d,) by which the parameters of some groups may have changed.

    forgotten : parameters of a frame that was fitted to the log: a narrow prior would count rows
        twice
    """
    sd = _deviations(body, groups, "freed", BUILT_CURVE, cause=cause)
    if FRAME[1] in groups and forgotten is not None:
        sd[np.intersect1d(indices_of(body.structure, FRAME), forgotten)] *= (
            ANYWHERE
        )
    return sd


def creep(body: Body, waves: float = CREEP) -> Array:
    """Standard deviation (d,) by which the arm's own parameters may have crept.

    waves : that of the joints' curves over their prior's; beyond `CREEP` of those too that the
        belief leaves out
    """
    sd = _deviations(body, _arms(body), "creep", waves)
    known = body.active
    if waves > CREEP:
        known = np.union1d(known, indices_of(body.structure, ("curve",)))
    return np.where(np.isin(np.arange(len(sd)), known), sd, 0.0)


def as_built(body: Body) -> Body:
    """The belief that a changed arm starts from: of a simulation, that of an arm as it is built."""
    structure: Any = body.structure
    body = replace(
        body,
        tau=np.maximum(body.tau, LOG_FLOOR * np.asarray(structure.extents)),
    )
    if not body.simulated:
        return body
    sd = _deviations(body, _arms(body), "built", BUILT_CURVE, 1.0)
    # the first origin's place is the frame's own
    if isinstance(structure, SpatialStructure):
        sd[np.concatenate([structure.shifts[0], structure.turns[0]])] = 0.0
    # What the samples left open stays correlated: along the gauge of a chain without a drawing,
    # deviations alone, of radians, would say that nothing was learned.
    active = np.union1d(np.flatnonzero(sd), body.active)
    covariance = np.diag(sd[active] ** 2)
    covariance[np.ix_(*2 * (np.searchsorted(active, body.active),))] += (
        body.covariance
    )
    return replace(body, active=active, root=root_of(covariance), second=None)


def as_drawn(body: Body) -> Body:
    """The belief that all but the joints' zeros and the sensor's frame is as the model has it."""
    body = as_built(body)
    structure = body.structure
    own = [
        name
        for name in structure.groups
        if name == "offset" or is_sensors(name)
    ]
    open_ = np.flatnonzero(np.isin(body.active, indices_of(structure, own)))
    root = root_of(body.covariance[np.ix_(open_, open_)])
    return replace(body, active=body.active[open_], root=root, second=None)


def _arms(body: Body) -> tuple[str, ...]:
    return tuple(g for g in body.structure.groups if not is_sensors(g))


def _deviations(
    body: Body,
    groups: tuple[str, ...],
    kind: str,
    curve: float,
    metre: float = 0.0,
    cause: str | None = None,
) -> Array:
    """Standard deviation (d,) of the parameters of some groups by a column of `GROUPS`, else 0.

    curve : that of the joints' curves, over their prior's
    metre : what lengths are told in; their mean where not given
    """
    structure: Any = body.structure
    sd = np.zeros(structure.size)
    extent = float(structure.extents[0])
    offset, lengths = (
        indices_of(structure, (g,)) for g in ("offset", "length")
    )
    links = np.abs(body.beta[lengths]) if len(lengths) else np.ones(1)
    # what is tilted is the chain, in its own unit: a log may be in another
    chain = float(links.sum()) if links.any() and len(lengths) else extent
    times = {
        "view.shift": extent,
        "view.tilt": 1.0 / chain,
        "length": metre or links.mean(),
    }
    for name in groups:
        ix = indices_of(structure, (name,))
        if name.startswith("curve"):
            sd[ix] = curve * structure.prior((name,)).sd[ix]
            continue
        group = GROUPS.get(name, _NEVER)
        sd[ix] = getattr(group, kind) * times.get(name, 1.0)
        if name == "placement":
            # A chain without a drawing has flat priors of its joint origins.  What was learned has
            # taken their place: shares of them let origins creep by a tenth of the reach.
            least = np.where(np.isin(ix, structure.turns), TURN, SHIFT)
            sd[ix] *= np.minimum(structure.prior((name,)).sd[ix], least)
    # what a free frame already says: the first joint's offset, the first length
    if len(offset) and offset[0] not in body.active and cause != "joints":
        sd[offset[0]] = 0.0
    if (
        np.isin(lengths[1:], body.active).any()
        and lengths[0] not in body.active
    ):
        sd[lengths[0]] = 0.0
    return sd
