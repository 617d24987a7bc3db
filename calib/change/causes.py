"""Causes: what may have changed between a belief and a log, by how much, and in which words.

They know an arm only by the groups of its structure's parameters: one table serves all arms.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, replace
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np

from ..body.belief import Body
from ..body.covariance import root_of
from ..body.parameters import Indices
from ..body.settings import FIT, SHIFT, TURN
from ..body.spatial import SpatialStructure
from ..body.structure import Structure
from ..common.arrays import Array

CREEP_WAVES = 0.01  # sd of a joint's curve that may creep between two logs, over that of its prior
# the same of an arm as it was built
BUILT_CURVE = 0.3
LEAST_MISFIT = 1e-4
"""Least residual sd of an arm that may have changed, beyond the noise [extents]: also of samples
without noise."""
# Times the standard deviation of a freed frame: to a radian and an extent
ANYWHERE = 20.0
CALM_WAVES = 0.7
# of an arm that is exactly as it was simulated: without the tolerances of its making, too
AS_SIMULATED = 0.0
WAVE_SIZES = (CREEP_WAVES, CALM_WAVES, 4.0)
"""Joints' waves, of unknown size, that a log may show besides any change: sd of their curves, over
that of its prior.  With the least alone, waves of 2 mrad along a line were taken for lengths and a
lens.  Each is as likely before: a prior uniform in the logarithm of a size (Jeffreys).  An arm that
has not changed may show calm ones: .25 mrad are what a model of 400 rows had not learned of a real
UR10, and did harm where they were taken for a change.  A larger smooth residual as well (4 times
the usual) left an error of .64 mm on rows of another day, for .29."""

FRAME = ("view.rotation", "view.shift")
"""Groups that move when the sensor is put elsewhere; always freed together."""


@dataclass(frozen=True)
class Cause:
    """One change that explains a log."""

    # ``"sensor"``, ``"offset:JOINT"`` or another one of the table in docs/howto/after-a-knock.md
    cause: str
    group: str  # of parameters, such as ``"view.rotation"`` or ``"offset"``
    words: str  # the change in words
    # size of the change, None where it has no number
    value: float | None = None
    interval: tuple[float, float] | None = None  # 95 % interval of the value
    unit: str = ""  # unit of the value

    def within(self, half: float) -> Cause:
        """The same with half the width of its 95 % interval."""
        middle = self.value or 0.0
        return replace(self, interval=(middle - half, middle + half))

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        document = asdict(self)
        if self.interval is not None:
            document["interval"] = list(self.interval)
        return document


class Group(NamedTuple):
    """How far the parameters of a group may move (standard deviations), and its words."""

    freed: float  # of one that has changed
    creep: float = 0.0  # between two logs of an arm that has not
    built: float = 0.0  # of an arm as it was built, from its drawing
    # of what an adaptation leaves unchanged; "" without a note
    name: str = ""
    changed: str = "{name} changed by {size}"
    whole: bool = False  # whether all of its parameters are one cause


_DEGREE = float(np.radians(1.0))
GROUPS = {
    # [rad], about the frame that fits the log best; of the extents
    "view.rotation": Group(freed=0.05, name="the sensor's frame"),
    "view.shift": Group(freed=0.05),
    "view.scale": Group(
        freed=0.3,
        name="the sensor's scale",
        changed="the sensor's scale changed by {size}",
        whole=True,
    ),
    "view.shear": Group(
        freed=0.1,
        changed="the sensor's axes are stretched or sheared",
        whole=True,
    ),
    # over the chain's length
    "view.tilt": Group(
        freed=0.3,
        name="the camera's tilt",
        changed="the camera is tilted",
        whole=True,
    ),
    "lens": Group(
        freed=0.2,
        name="the lens",
        changed="the sensor's frame is bent, as by a lens",
        whole=True,
    ),
    # of the mean length; as built [m]
    "length": Group(
        freed=0.15,
        creep=1e-4,
        built=1e-3,
        name="the links' lengths",
        changed="the link of {joint} is {share} ({length}) {longer}",
    ),
    "offset": Group(
        freed=5 * _DEGREE,
        creep=0.02 * _DEGREE,
        built=0.1 * _DEGREE,
        name="the joints' offsets",
        changed="{joint} is off by {size}",
    ),
    "gain": Group(
        freed=0.03,
        creep=1e-4,
        built=1e-3,
        name="the joints' gains",
        changed="{joint} moves {size} further than its encoder reads",
    ),
    "coupling": Group(
        freed=0.03,
        creep=1e-4,
        built=1e-3,
        name="the joints' coupling",
        changed="{joint} moves with the joint before it, by {size} more",
    ),
    "elastic": Group(
        freed=0.02,
        creep=2e-5,
        built=1e-4,
        name="elasticity",
        changed="{joint} bends under load, by up to {most} deg",
        whole=True,
    ),
    "payload": Group(
        freed=0.02,
        creep=2e-5,
        built=1e-4,
        name="the payload",
        changed="a payload bends {joint}, by up to {most} deg",
        whole=True,
    ),
    # over the prior of a robot
    "placement": Group(
        freed=5.0,
        creep=0.1,
        built=1.0,
        name="the joints' placements",
        changed="{joint} sits elsewhere, {name} by {size}",
    ),
    # [rad], of the two parameters of a wave
    "curve": Group(
        freed=0.02,
        changed="{joint} errs by a wave of {size}, {order} a turn: a gear, or its encoder's disc",
    ),
    "tool": Group(freed=0.1, creep=1e-4, built=1e-3, name="the tool"),  # [m]
    "tool.rotation": Group(
        freed=0.3, creep=0.02 * _DEGREE, built=0.1 * _DEGREE
    ),
}

TESTED = (
    "offset",
    "length",
    "gain",
    "coupling",
    "placement",
    "tool",
    "elastic",
    "payload",
)
"""Groups that are tested joint by joint."""

_CAMERA = ("view.tilt", "view.shear", "view.scale")
_ARM = ("offset", "length", "gain", "placement", "elastic", "tool")
_SENSORS = {
    "sensor": FRAME,
    "scale": ("view.scale", *FRAME),
    "tilt": (*_CAMERA, *FRAME),
    "lens": ("lens", "view.scale", "view.shear", *FRAME),
}
"""Groups of each cause of the sensor, its own first."""

SETS = (
    ("offset",),
    ("offset", "length"),
    _ARM,
    (*_ARM, *FRAME),
    (*_ARM, *_CAMERA, "lens", *FRAME),
)
"""Groups of which all parameters may have changed together."""


def single_causes(
    structure: Structure,
    cause: str | None = None,
    waves: Indices | None = None,
    *,
    by_touch: bool = False,
) -> dict[str, Indices]:
    """Return the parameters of each cause that may occur alone.

    cause : {"sensor", "joints", "offsets"}, if it is known that only these may have changed;
        "offsets" are the joints' zeros and the frame
    waves : parameters of joints' waves that a log shows
    by_touch : whether touches alone show them: no sensor, no first joint's offset, and not where
        its origin is
    """
    if by_touch and cause != "offsets":
        cause = "joints"
    groups: tuple[str, ...] = TESTED
    sensors: Iterable[str] = _SENSORS
    if cause == "offsets":
        groups = ("offset",)
        sensors = ("sensor",)
    elif cause == "joints":
        sensors = ()
    elif cause == "sensor":
        groups = ()
    causes: dict[str, Indices] = {}
    for name in sensors:
        if len(indices_of(structure, _SENSORS[name][:1])):
            causes[name] = indices_of(structure, _SENSORS[name])
    indices = indices_of(structure, groups)
    if waves is not None and cause in (None, "joints"):
        indices = np.append(indices, waves)
    first = structure.joint_names[0]
    for index in indices.tolist():
        label = structure.labels[index]
        is_first = label.joint == first
        if label.group == "placement" and is_first and cause != "joints":
            continue  # the first origin's place is the sensor's frame
        if label.group in ("elastic", "payload") and label.unit == "m":
            continue  # the pull on a slide hardly changes with the posture: its offset
        name = f"{kind_of(label.group)}:{label.joint}"
        if label.joint is None or label.group in ("elastic", "payload"):
            name = label.group  # a payload bends all joints at once
        others = causes.get(name, np.zeros(0, np.intp))
        causes[name] = np.append(others, index)
    if by_touch:
        for name in (f"offset:{first}", f"placement:{first}", "sensor"):
            causes.pop(name, None)
    return causes


def frame_twin(body: Body) -> Indices:
    """The first joint's offset (k,) where a free frame does the same: a belief frees one."""
    first = indices_of(body.structure, ("offset",))[:1]
    return first[~np.isin(first, body.active)]


def kind_of(group: str) -> str:
    """The kind of cause of a group of parameters: of all joints' curves it is one."""
    return "curve" if group.startswith("curve.") else group


def is_sensors(group: str) -> bool:
    """Whether a group of parameters is the sensor's."""
    return group.startswith("view.") or group == "lens"


def indices_of(structure: Structure, groups: Iterable[str]) -> Indices:
    """Parameters (k,) of some groups; those that the structure does not have are left out."""
    parts = [np.zeros(0, np.intp)]
    for group in groups:
        for name, indices in structure.groups.items():
            if name == group or (group == "curve" and name.startswith(group)):
                parts.append(indices)
    return np.concatenate(parts)


def sd_if_changed(body: Body) -> Array:
    """Standard deviation (d,) by which parameters may have changed."""
    return _sd_of_groups(body, body.structure.groups, attrgetter("freed"))


def sd_of_creep(body: Body, wave_size: float = CREEP_WAVES) -> Array:
    """Standard deviation (d,) by which the arm's own parameters may have crept.

    wave_size : that of the joints' curves over their prior's; beyond `CREEP_WAVES` of those too
        that the belief leaves out
    """
    sd = _sd_of_arm(body, attrgetter("creep"), wave_size)
    creeping = body.active
    if wave_size > CREEP_WAVES:
        curves = indices_of(body.structure, ("curve",))
        creeping = np.union1d(creeping, curves)
    crept = np.zeros_like(sd)
    crept[creeping] = sd[creeping]
    return crept


def as_built(body: Body) -> Body:
    """The belief that a changed arm starts from: of a simulation, that of an arm as it is built."""
    structure = body.structure
    least = LEAST_MISFIT * np.asarray(structure.extents)
    body = replace(body, tau=np.maximum(body.tau, least))
    if not body.simulated:
        return body
    sd = _sd_of_arm(body, attrgetter("built"), BUILT_CURVE, link=1.0)
    # the first origin's place is the frame's own
    if isinstance(structure, SpatialStructure):
        sd[structure.shifts[0]] = 0.0
        sd[structure.turns[0]] = 0.0
    # What samples did not determine stays correlated: along the gauge of a chain without a drawing,
    # deviations alone, of radians, would look as if nothing was learned.
    wrong = np.flatnonzero(sd)
    body = replace(body, second=None)
    return body.with_covariance(wrong, np.diag(sd[wrong] ** 2))


def with_chain_in_doubt(body: Body) -> Body:
    """The belief with the doubt of the second fit, where few rows left the chain as it is drawn.

    Such models of 16 rows of two joints took a third of unchanged arms for drifted, of 60 none.
    """
    second = body.second
    if second is None or body.rows >= FIT.guarded_rows:
        return body
    chain = indices_of(body.structure, body.structure.chain_blocks)
    fitted = np.intersect1d(chain, second.active)
    if np.isin(fitted, body.active).all():
        return body
    curves = indices_of(body.structure, ("curve",))
    is_chain = ~np.isin(second.active, curves)
    active = second.active[is_chain]
    apart = (second.beta - body.beta)[active]
    root = np.column_stack([second.root[is_chain], apart])
    return replace(body, active=active, root=root)


def as_drawn(body: Body) -> Body:
    """The belief that all but the joints' zeros and the sensor's frame is as the model has it."""
    body = as_built(body)
    groups = [
        g for g in body.structure.groups if g == "offset" or is_sensors(g)
    ]
    loose = np.isin(body.active, indices_of(body.structure, groups))
    root = root_of(body.covariance[np.ix_(loose, loose)])
    return replace(body, active=body.active[loose], root=root, second=None)


def _sd_of_arm(
    body: Body,
    size: Callable[[Group], float],
    curve: float,
    link: float | None = None,
) -> Array:
    """Standard deviation (d,) of the arm's own parameters, but of what a free frame does."""
    groups = [g for g in body.structure.groups if not is_sensors(g)]
    sd = _sd_of_groups(body, groups, size, curve, link)
    sd[frame_twin(body)] = 0.0
    return sd


def _sd_of_groups(
    body: Body,
    groups: Iterable[str],
    size: Callable[[Group], float],
    curve: float = 0.0,
    link: float | None = None,
) -> Array:
    """Standard deviation (d,) of the parameters of some groups by their sizes, else 0.

    curve : that of the joints' curves, over their prior's
    link : what lengths are counted in, the mean of the links where not given
    """
    structure = body.structure
    extent = float(structure.extents[0])
    lengths = indices_of(structure, ("length",))
    links = np.abs(body.beta[lengths])
    # what is tilted is the chain, in its own unit: a log may be in another
    chain = float(links.sum()) or extent
    if link is None:
        link = float(links.mean()) if len(links) else 1.0
    units = {"view.shift": extent, "view.tilt": 1.0 / chain, "length": link}
    sd = np.zeros(structure.size)
    for name in groups:
        indices = indices_of(structure, (name,))
        if name.startswith("curve"):
            sd[indices] = curve * structure.prior((name,)).sd[indices]
        elif name in GROUPS:
            sd[indices] = size(GROUPS[name]) * units.get(name, 1.0)
        if name == "offset":
            slides = [structure.labels[k].unit != "rad" for k in indices]
            sd[indices[slides]] *= SHIFT / TURN  # [m]
        if isinstance(structure, SpatialStructure) and name == "placement":
            # A chain without a drawing has flat priors of its joint origins.  What was learned has
            # taken their place: shares of them let origins creep by a tenth of the reach.
            is_turn = np.isin(indices, structure.turns)
            most = np.where(is_turn, TURN, SHIFT)
            prior = structure.prior((name,)).sd[indices]
            sd[indices] *= np.minimum(prior, most)
    # what a free frame already covers: the first length
    loose = np.isin(lengths, body.active)
    if loose[1:].any() and not loose[0]:
        sd[lengths[0]] = 0.0
    return sd
