"""The space of poses: what the joints may do and what is expected to be seen there."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ..arm.arm import Arm
from ..arm.ranges import Range, checked_range, travel
from ..arm.urdf import parse_urdf
from ..common.arrays import Array
from ..common.scale import Scale
from ..common.wording import quoted, suggestion
from ..errors import OptionError
from ..model.model import Model

LARGEST_MARGIN = math.radians(1.0)
"""Default distance [rad or m] that a pose keeps from a joint's mechanical limit, ..."""
SHARE = 0.02
"""... or this share of the joint's range, if that is less."""


@dataclass(frozen=True, eq=False)
class Space:
    """A box of joint values, and where the tip is expected for them."""

    joint_names: tuple[str, ...]  # joints from base to tip
    # (dof,) [rad or m], the box. It is convex: a straight move between two of its poses never
    # leaves it.
    lower: Array
    upper: Array
    scale: Scale  # the whole range of each joint, without margins, as the unit box
    revolute: tuple[bool, ...]  # whether each joint turns (rad) or slides (m)
    # joint values (n, dof) to expected tip positions (n, 2); NaN where nothing is known
    position: Callable[[Array], Array]
    unit: str  # unit of the positions

    @property
    def dof(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    @cached_property
    def corners(self) -> tuple[Array, Array]:
        """The box in units of the joints' ranges, its lower and its upper end."""
        span = self.scale.span
        return (self.lower - self.scale.lower) / span, (self.upper - self.scale.lower) / span

    def joints(self, q: ArrayLike, what: str) -> Array:
        """Check joint values (dof,) that were given, such as those of a start.

        They may lie within the margins, but not beyond the joints' ranges.
        """
        try:
            values = np.asarray(q, dtype=float)
        except (TypeError, ValueError):
            values = np.full(0, np.nan)
        if values.shape != (self.dof,) or not np.isfinite(values).all():
            raise OptionError(
                f"{what} {q!r}: expected {self.dof} finite joint values, one each for "
                f"{', '.join(self.joint_names)}"
            )
        ends = zip(self.scale.lower.tolist(), self.scale.span.tolist(), strict=True)
        for name, value, (low, span) in zip(self.joint_names, values.tolist(), ends, strict=True):
            if not low - 1e-9 <= value <= low + span + 1e-9:
                raise OptionError(
                    f"{what}: {name} = {value:.6g} is outside of its range {low:.6g} to "
                    f"{low + span:.6g}"
                )
        return values


def space_of(
    source: Arm | Model,
    margin: float | Sequence[float] | None = None,
    ranges: Mapping[str, Range] | None = None,
) -> Space:
    """Return the space of an arm, or of what a model has learned.

    source : an arm predicts with its kinematics, a model with what it has learned
    margin : [rad or m], distance from the joints' mechanical limits, for all or for each joint.
        Without it 1 deg (17 mm for a slide), or 2 % of the range if that is less. A model of a log
        without a robot knows no limits: its range is what was measured.
    ranges : [rad or m], part of a joint's range to plan in
    Raises OptionError if a joint is unknown, a range is outside of what there is, or the margins
    leave nothing.
    """
    space, limits = _whole(source)
    lower, upper = space.lower.copy(), space.upper.copy()
    for name, chosen in (ranges or {}).items():
        if name not in space.joint_names:
            raise OptionError(
                f"`ranges`: {quoted(name)} is no joint here",
                hint=suggestion(name, space.joint_names),
                parameter="ranges",
                value=name,
            )
        k = space.joint_names.index(name)
        own = float(space.lower[k]), float(space.upper[k])
        lower[k], upper[k] = checked_range(name, chosen, own, "rad" if space.revolute[k] else "m")
    kept = _margins(space, margin)
    for k, (low, high) in enumerate(limits):
        lower[k], upper[k] = max(lower[k], low + kept[k]), min(upper[k], high - kept[k])
        if not lower[k] < upper[k]:
            raise OptionError(
                f"margin {kept[k]:g}: no room is left in {space.joint_names[k]}'s range "
                f"{space.lower[k]:.6g} to {space.upper[k]:.6g}; expected a smaller one"
            )
    return replace(space, lower=lower, upper=upper)


def _whole(source: Arm | Model) -> tuple[Space, tuple[Range, ...]]:
    """All of the space, and the joints' mechanical limits as far as they are known."""
    about = source if isinstance(source, Arm) else source.about
    box = about.joint_names, about.lower, about.upper
    if isinstance(source, Arm):
        scale = Scale.of_range(source.lower, source.upper, source.revolute)
        return Space(*box, scale, about.revolute, source.forward, "m"), source.limits
    own, limits = source.about, ((-math.inf, math.inf),) * len(source.about.joint_names)
    if own.urdf:
        known = {j.name: travel(j) for j in parse_urdf(own.urdf, own.robot).joints}
        limits = tuple(known[name] for name in own.joint_names)
    return Space(*box, source.motor.scale, own.revolute, source.forward, own.unit), limits


def _margins(space: Space, margin: float | Sequence[float] | None) -> Array:
    """Return the margin of each joint [rad or m]."""
    if margin is None:
        return np.minimum(LARGEST_MARGIN, SHARE * space.scale.span)
    try:
        kept = np.broadcast_to(np.asarray(margin, dtype=float), (space.dof,))
    except (TypeError, ValueError):
        kept = np.full(space.dof, np.nan)
    if not (np.isfinite(kept).all() and (kept >= 0).all()):
        raise OptionError(
            f"margin {margin!r}: expected a number, zero or more, or one for each of "
            f"{', '.join(space.joint_names)} [rad or m]"
        )
    return np.asarray(kept, dtype=float)
