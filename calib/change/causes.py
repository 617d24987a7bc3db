"""Causes: what may have changed between a belief and a log, by how much, and in which words.

They refer to an arm only by the groups of its structure's parameters: one table serves all arms.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from ..body.belief import Body
from ..body.covariance import root_of
from ..body.parameters import Indices
from ..body.settings import DRAWN_SHIFT_SD, DRAWN_TURN_SD, FIT
from ..body.spatial import SpatialStructure
from ..body.structure import Structure
from ..common.arrays import Array

CREEP_WAVES = 0.01  # sd of a joint's curve that may creep between two logs, over that of its prior
BUILT_CURVE = 0.3  # sd of the curves of a simulated arm once it is built, over that of their prior
LEAST_MISFIT = 1e-4
"""Least residual sd of an arm that may have changed, beyond the noise [extents]: also of samples
without noise."""
# Factor on the sd of a free frame that makes it about one radian and one extent
ANYWHERE = 20.0
CALM_WAVES = 0.7  # largest sd of waves that an unchanged arm may show, over that of their prior
# Size of waves of an arm exactly as it was simulated, without the tolerances of making it
AS_SIMULATED = 0.0
WAVE_SIZES = (CREEP_WAVES, CALM_WAVES, 4.0)
"""Sizes of joints' waves that a log may show besides any change: sd of their curves, over that of
their prior.  With the smallest alone, waves of 2 mrad along a line were taken for lengths and a
lens.  All are equally likely a priori: uniform in the logarithm of the size (Jeffreys).  An
unchanged arm may show calm ones: a model of 400 rows had not learned waves of .25 mrad of a real
UR10, and taking these for a change did harm.  With a larger smooth residual as well (4 times the
usual) the error on rows of another day was .64 mm instead of .29."""

FRAME = ("view.rotation", "view.shift")
"""Groups that change when the sensor is put elsewhere; they are always free together."""


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
        """The cause with a 95 % interval of this half-width around its value."""
        middle = self.value or 0.0
        return replace(self, interval=(middle - half, middle + half))

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        document = asdict(self)
        if self.interval is not None:
            document["interval"] = list(self.interval)
        return document


class Group(NamedTuple):
    """Standard deviations by which the parameters of a group move, and the group's words."""

    change_sd: float  # by a change
    creep_sd: float = 0.0  # between two logs of an arm that has not changed
    tolerance_sd: float = 0.0  # of a built arm, from its drawing
    # in the list of what an adaptation kept; "" where that omits the group
    name: str = ""
    template: str = "{name} changed by {size}"  # sentence on a change
    whole: bool = False  # whether all of its parameters are one cause


_DEGREE = float(np.radians(1.0))
GROUPS = {
    # [rad] and [extents], about the frame that fits the log best
    "view.rotation": Group(change_sd=0.05, name="the sensor's frame"),
    "view.shift": Group(change_sd=0.05),
    "view.scale": Group(
        change_sd=0.3,
        name="the sensor's scale",
        template="the sensor's scale changed by {size}",
        whole=True,
    ),
    "view.shear": Group(
        change_sd=0.1,
        template="the sensor's axes are stretched or sheared",
        whole=True,
    ),
    # [1 / length of the chain]
    "view.tilt": Group(
        change_sd=0.3,
        name="the camera's tilt",
        template="the camera is tilted",
        whole=True,
    ),
    "lens": Group(
        change_sd=0.2,
        name="the lens",
        template="the sensor's frame is bent, as by a lens",
        whole=True,
    ),
    # [mean length of a link], the tolerance [m]
    "length": Group(
        change_sd=0.15,
        creep_sd=1e-4,
        tolerance_sd=1e-3,
        name="the links' lengths",
        template="the link of {joint} is {share} ({length}) {longer}",
    ),
    "offset": Group(
        change_sd=5 * _DEGREE,
        creep_sd=0.02 * _DEGREE,
        tolerance_sd=0.1 * _DEGREE,
        name="the joints' offsets",
        template="{joint} is off by {size}",
    ),
    "gain": Group(
        change_sd=0.03,
        creep_sd=1e-4,
        tolerance_sd=1e-3,
        name="the joints' gains",
        template="{joint} moves {size} further than its encoder reads",
    ),
    "coupling": Group(
        change_sd=0.03,
        creep_sd=1e-4,
        tolerance_sd=1e-3,
        name="the joints' coupling",
        template="{joint} moves with the joint before it, by {size} more",
    ),
    "elastic": Group(
        change_sd=0.02,
        creep_sd=2e-5,
        tolerance_sd=1e-4,
        name="elasticity",
        template="{joint} bends under load, by up to {most} deg",
        whole=True,
    ),
    "payload": Group(
        change_sd=0.02,
        creep_sd=2e-5,
        tolerance_sd=1e-4,
        name="the payload",
        template="a payload bends {joint}, by up to {most} deg",
        whole=True,
    ),
    # [prior sd of a drawing]
    "placement": Group(
        change_sd=5.0,
        creep_sd=0.1,
        tolerance_sd=1.0,
        name="the joints' placements",
        template="{joint} sits elsewhere, {name} by {size}",
    ),
    # [rad], of both parameters of a wave
    "curve": Group(
        change_sd=0.02,
        template="{joint} errs by a wave of {size}, {order} a turn: a gear, or its encoder's disc",
    ),
    "tool": Group(
        change_sd=0.1, creep_sd=1e-4, tolerance_sd=1e-3, name="the tool"
    ),  # [m]
    "tool.rotation": Group(
        change_sd=0.3, creep_sd=0.02 * _DEGREE, tolerance_sd=0.1 * _DEGREE
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
"""Groups of each cause of the sensor; it has a cause if it has the first of its groups."""

SETS = (
    ("offset",),
    ("offset", "length"),
    _ARM,
    (*_ARM, *FRAME),
    (*_ARM, *_CAMERA, "lens", *FRAME),
)
"""Sets of groups of which all parameters may have changed together."""


def single_causes(
    structure: Structure,
    cause: str | None = None,
    waves: Indices | None = None,
    *,
    by_touch: bool = False,
) -> dict[str, Indices]:
    """Return the parameters of each cause that may occur alone.

    cause : {"sensor", "joints", "offsets"}, where only these may have changed; "offsets" are the
        joints' zeros and the frame
    waves : parameters of joints' waves that a log shows
    by_touch : whether all rows are touches, which show no sensor, and neither offset nor origin of
        the first joint
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
            continue  # the sensor's frame moves it as well
        if label.group in ("elastic", "payload") and label.unit == "m":
            continue  # the load on a slide hardly depends on the posture: it is an offset
        name = f"{cause_kind(label.group)}:{label.joint}"
        if label.joint is None or label.group in ("elastic", "payload"):
            name = label.group  # a payload bends all joints at once
        others = causes.get(name, np.zeros(0, np.intp))
        causes[name] = np.append(others, index)
    if by_touch:
        for name in (f"offset:{first}", f"placement:{first}", "sensor"):
            causes.pop(name, None)
    return causes


def frame_twin(body: Body) -> Indices:
    """The first joint's offset (k,), where a free sensor frame has its effect, else none (0,)."""
    first = indices_of(body.structure, ("offset",))[:1]
    return first[~np.isin(first, body.active)]


def cause_kind(group: str) -> str:
    """The kind of cause of a group of parameters; "curve" for the curve of any joint."""
    return "curve" if group.startswith("curve.") else group


def is_sensors(group: str) -> bool:
    """Whether a group of parameters is the sensor's."""
    return group.startswith("view.") or group == "lens"


def indices_of(structure: Structure, groups: Iterable[str]) -> Indices:
    """Parameters (k,) of some groups, as far as the structure has them; "curve" is all curves."""
    parts = [np.zeros(0, np.intp)]
    for group in groups:
        for name, indices in structure.groups.items():
            if name == group or (group == "curve" and name.startswith(group)):
                parts.append(indices)
    return np.concatenate(parts)


def sd_if_changed(body: Body) -> Array:
    """Standard deviation (d,) by which parameters may have changed."""
    return _sd_of_groups(
        body, body.structure.groups, lambda group: group.change_sd
    )


def sd_of_creep(body: Body, wave_size: float = CREEP_WAVES) -> Array:
    """Standard deviation (d,) by which the arm's own parameters may have crept.

    wave_size : sd of the joints' curves over that of their prior; beyond `CREEP_WAVES` the curves
        that the belief leaves out creep, too
    """
    sd = _sd_of_arm(body, lambda group: group.creep_sd, wave_size)
    creeping = body.active
    if wave_size > CREEP_WAVES:
        curves = indices_of(body.structure, ("curve",))
        creeping = np.union1d(creeping, curves)
    crept = np.zeros_like(sd)
    crept[creeping] = sd[creeping]
    return crept


def as_built(body: Body) -> Body:
    """The belief before a change; that of a simulated arm has the tolerances of a built one."""
    structure = body.structure
    least = LEAST_MISFIT * np.asarray(structure.extents)
    body = replace(body, tau=np.maximum(body.tau, least))
    if not body.simulated:
        return body
    sd = _sd_of_arm(
        body, lambda group: group.tolerance_sd, BUILT_CURVE, link=1.0
    )
    # the sensor's frame moves the first origin
    if isinstance(structure, SpatialStructure):
        sd[structure.shifts[0]] = 0.0
        sd[structure.turns[0]] = 0.0
    # added to the covariance, whose correlations matter: along the gauge of a chain without a
    # drawing, sds alone are radians, as if nothing had been learned
    uncertain = np.flatnonzero(sd)
    body = replace(body, second=None)
    return body.with_covariance(uncertain, np.diag(sd[uncertain] ** 2))


def with_chain_in_doubt(body: Body) -> Body:
    """The belief with the covariance of the second fit, where few rows left the chain as drawn.

    Without it, models of 16 rows of two joints took a third of unchanged arms for drifted; of 60
    rows none.
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
    difference = (second.beta - body.beta)[active]
    root = np.column_stack([second.root[is_chain], difference])
    return replace(body, active=active, root=root)


def as_drawn(body: Body) -> Body:
    """The belief with only the joints' zeros and the sensor's frame uncertain."""
    body = as_built(body)
    groups = [
        g for g in body.structure.groups if g == "offset" or is_sensors(g)
    ]
    is_free = np.isin(body.active, indices_of(body.structure, groups))
    root = root_of(body.covariance[np.ix_(is_free, is_free)])
    return replace(body, active=body.active[is_free], root=root, second=None)


def _sd_of_arm(
    body: Body,
    size: Callable[[Group], float],
    curve: float,
    link: float | None = None,
) -> Array:
    """Standard deviation (d,) of the arm's own parameters, except what a free frame covers.

    The arguments are those of `_sd_of_groups`.
    """
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
    """Standard deviation (d,) of the parameters of some groups, 0 of all others.

    size : which standard deviation of a `Group`
    curve : sd of the joints' curves, over that of their prior
    link : unit of the sizes of lengths, by default the mean length of the links
    """
    structure = body.structure
    extent = float(structure.extents[0])
    lengths = indices_of(structure, ("length",))
    links = np.abs(body.beta[lengths])
    # a tilt is per length of the chain, which may have another unit than the log
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
            sd[indices[slides]] *= DRAWN_SHIFT_SD / DRAWN_TURN_SD  # [m]
        if isinstance(structure, SpatialStructure) and name == "placement":
            # not by the flat priors of a chain without a drawing: shares of these let origins creep
            # by a tenth of the reach
            is_turn = np.isin(indices, structure.turns)
            most = np.where(is_turn, DRAWN_TURN_SD, DRAWN_SHIFT_SD)
            prior = structure.prior((name,)).sd[indices]
            sd[indices] *= np.minimum(prior, most)
    # a free frame already covers the first length
    is_free = np.isin(lengths, body.active)
    if is_free[1:].any() and not is_free[0]:
        sd[lengths[0]] = 0.0
    return sd
