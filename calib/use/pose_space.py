"""The space of poses: what the joints of an arm or a model may do while it is measured."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ..arm.arm import Arm
from ..arm.ranges import Range, checked_range, travel
from ..arm.urdf import parse_urdf
from ..common.arrays import Array
from ..common.rows import each_joint, number_rows
from ..common.scale import Scale
from ..common.wording import quoted, suggestion
from ..errors import OptionError
from ..model.model import Model

_LARGEST_MARGIN = math.radians(1.0)
"""Default distance [rad or m] that a pose keeps from a joint's mechanical limit, ..."""
_SHARE = 0.02
"""... or this share of the joint's range, if that is less."""


@dataclass(frozen=True, eq=False)
class PoseSpace:
    """A box of joint values."""

    joint_names: tuple[str, ...]  # joints from base to tip
    # (dof,) [rad or m], the box. It is convex: a straight move between two of its poses never
    # leaves it.
    lower: Array
    upper: Array
    scale: Scale  # the whole range of each joint, without margins, as the unit box

    @cached_property
    def corners(self) -> tuple[Array, Array]:
        """The box in units of the joints' ranges, its lower and its upper end."""
        span = self.scale.span
        return (self.lower - self.scale.lower) / span, (self.upper - self.scale.lower) / span

    def start(self, q: ArrayLike | None) -> Array:
        """Joint values (dof,) to set out from, by default zero or what comes nearest to it.

        They may lie within the margins, but not beyond the joints' ranges.
        """
        if q is None:
            return np.asarray(np.clip(0.0, self.lower, self.upper))
        values: Array = number_rows(np.ravel(q), self.joint_names, "start", OptionError)[0][0]
        low, high = self.scale.lower, self.scale.lower + self.scale.span
        for k in np.flatnonzero(~((values >= low - 1e-9) & (values <= high + 1e-9))):
            raise OptionError(
                f"start: {self.joint_names[k]} = {values[k]:.6g} is outside of its range "
                f"{low[k]:.6g} to {high[k]:.6g}"
            )
        return values


def space_of(
    source: Arm | Model,
    margin: float | Sequence[float] | None = None,
    ranges: Mapping[str, Range] | None = None,
) -> PoseSpace:
    """Return the space of an arm, or of what a model has learned.

    margin : [rad or m], distance from the joints' mechanical limits, for all or for each joint.
        Without it 1 deg (17 mm for a slide), or 2 % of the range if that is less. A model of a log
        without a robot knows no limits: its range is what was measured.
    ranges : [rad or m], part of a joint's range to plan in
    Raises OptionError if a joint is unknown, a range is outside of what there is, or the margins
    leave nothing.
    """
    about = source if isinstance(source, Arm) else source.about
    names, low, high = about.joint_names, about.lower, about.upper
    if isinstance(source, Arm):
        scale, limits = Scale.of_range(low, high, about.revolute), source.limits
    else:
        scale, limits = source.motor.scale, ((-math.inf, math.inf),) * len(names)
        if source.about.urdf:
            known = {j.name: travel(j) for j in parse_urdf(source.about.urdf, "").joints}
            limits = tuple(known[name] for name in names)
    lower, upper = low.copy(), high.copy()
    for name, chosen in (ranges or {}).items():
        if name not in names:
            raise OptionError(
                f"`ranges`: {quoted(name)} is no joint here",
                hint=suggestion(name, names),
                parameter="ranges",
                value=name,
            )
        k = names.index(name)
        own = float(low[k]), float(high[k])
        lower[k], upper[k] = checked_range(name, chosen, own, about.units_of_joints[k])
    kept = np.minimum(_LARGEST_MARGIN, _SHARE * scale.span)
    if margin is not None:
        kept = each_joint("margin", margin, names)
    for k, (least, most) in enumerate(limits):
        lower[k], upper[k] = max(lower[k], least + kept[k]), min(upper[k], most - kept[k])
        if not lower[k] < upper[k]:
            raise OptionError(
                f"margin {kept[k]:g}: no room is left in {names[k]}'s range {low[k]:.6g} to "
                f"{high[k]:.6g}; expected a smaller one"
            )
    return PoseSpace(names, lower, upper, scale)
