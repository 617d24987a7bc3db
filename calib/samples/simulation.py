"""The simulated arm and sensor, with what changed, as typed: `elbow.length=+20%`."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike

from ..common.arrays import Array, Document
from ..common.inputs import LARGEST
from ..errors import OptionError

if TYPE_CHECKING:
    from ..arm.arm import Arm


class Rule(NamedTuple):
    """A value that can change."""

    form: str  # what is typed
    possible: Callable[[float], bool]
    relative: bool = False  # whether it may be typed as a change in percent
    numbers: int = 1
    angle: bool = False  # whether it is typed in degrees where the joint is


OF_JOINT = {
    "length": Rule(
        "+20% or 0.3 [m], above zero", lambda value: value > 0, relative=True
    ),
    "offset": Rule("0.05 [rad or m]", math.isfinite, angle=True),
    "gear": Rule("1.02, not 0 (lock holds a joint)", bool, relative=True),
    "noise": Rule(
        "0.01 [rad or m], not negative", lambda value: value >= 0, angle=True
    ),
    "backlash": Rule(
        "0.01 [rad or m], not negative", lambda value: value >= 0, angle=True
    ),
    "lock": Rule("1.0 [rad or m]", math.isfinite, angle=True),
}
OF_SENSOR = {
    "mirror": Rule("x or y", math.isfinite, numbers=2),
    "scale": Rule("1.05, above zero", lambda value: value > 0, relative=True),
    "rotate": Rule("0.14 [rad]", math.isfinite),
    "shift": Rule("0.03,-0.02 [m]", math.isfinite, numbers=2),
    "outliers": Rule(
        "5%, a share of the rows below 1", lambda value: 0 <= value < 1
    ),
}
PARTS = {
    "tip": {"offset": Rule("0.01,0.02 [m]", math.isfinite, numbers=2)},
    "sensor": OF_SENSOR,
}
"""What can change besides the joints."""

IN_SPACE = ("scale", "outliers")
"""Changes of the sensor that an arm in space can have."""

_CHOICES = (
    f"JOINT.{'|'.join(OF_JOINT)}, tip.offset, sensor.{'|'.join(OF_SENSOR)}"
)
_MIRRORS = {"x": (-1.0, 1.0), "y": (1.0, -1.0)}


@dataclass(frozen=True)
class Change:
    """One change of the simulated arm or sensor."""

    part: str  # a joint's name, "tip" or "sensor"
    what: str  # `length`, `offset`, ...
    # one number, or two for `tip.offset` and `sensor.shift` [rad, m or 1]. For `sensor.mirror` the
    # factors of x and y, such as (-1, 1). Where `relative`, the factor itself: 1.2 for +20%.
    values: tuple[float, ...]
    relative: bool
    text: str  # the change as typed


def parse_change(text: str, *, degrees: Collection[str] = ()) -> Change:
    """Read one change, such as `elbow.length=+20%`, `tip.offset=0.01,0.02` or `sensor.mirror=x`.

    The last dot before the last `=` divides the name from what is changed, so a joint's name may
    hold dots.  Offset, noise, backlash and lock of the joints in `degrees` are typed in degrees;
    the answer is in SI units.

    Raises OptionError if the text is no change or its value is impossible.

    Examples
    --------
    >>> change = parse_change("left.elbow.length=+20%")
    >>> change.part, change.what, change.values, change.relative
    ('left.elbow', 'length', (1.2,), True)
    """
    name, _, value = (piece.strip() for piece in text.rpartition("="))
    part, _, what = name.rpartition(".")
    rules = PARTS.get(part, OF_JOINT)
    if not part or not value or what not in rules:
        raise OptionError(
            f"change {text!r} is not WHO.WHAT=VALUE such as elbow.length=+20%; choices: {_CHOICES}"
        )
    rule = rules[what]
    relative = rule.relative and value[0] in "+-" and value.endswith("%")
    values = _values(what, value, relative)
    possible = all(
        abs(number) < LARGEST and rule.possible(number) for number in values
    )
    if len(values) != rule.numbers or not possible:
        raise OptionError(
            f"change {text!r}: expected a value such as {rule.form}"
        )
    if part in degrees and rule.angle:
        values = (math.radians(values[0]),)
        text = f"{part}.{what}={values[0]!r}"
    return Change(part, what, values, relative, text.strip())


def parse_changes(
    changes: Iterable[str | Change], *, degrees: Collection[str] = ()
) -> tuple[Change, ...]:
    """Read several changes; the same thing changed twice is refused. See `parse_change`."""
    parsed: dict[tuple[str, str], Change] = {}
    for item in (changes,) if isinstance(changes, str) else changes:
        change = item
        if not isinstance(change, Change):
            change = parse_change(change, degrees=degrees)
        before = parsed.setdefault((change.part, change.what), change)
        if before is not change:
            raise OptionError(
                f"change {change.text} comes after {before.text}: give one of the two"
            )
    return tuple(parsed.values())


def _values(what: str, value: str, relative: bool) -> tuple[float, ...]:
    """The numbers of a change as typed, +20% as 1.2; none where there are no such numbers."""
    if what == "mirror":
        return _MIRRORS.get(value, ())
    whole = 1.0
    if value.endswith("%") and (relative or what == "outliers"):
        value = value.removesuffix("%")
        whole = 100.0
    first = 1.0 if relative else 0.0
    try:
        return tuple(first + float(text) / whole for text in value.split(","))
    except ValueError:
        return ()


@dataclass(frozen=True, eq=False)
class Simulation:
    """An arm and a sensor, altered by changes, that can be measured.

    A joint's encoder reads q. The joint itself is at `gear * q + offset`, less the
    backlash, or wherever `lock` holds it, and trembles by its `noise`. The sensor sees
    the tip mirrored, scaled, rotated and shifted, in that order, about the plane's origin.

    Examples
    --------
    >>> import calib, numpy as np
    >>> arm = calib.load_arm("two_link")
    >>> turned = calib.Simulation(arm, noise=1e-3, changes=("sensor.mirror=x",))
    >>> rng = np.random.default_rng(0)
    >>> turned.measure(turned.draw(5, rng), rng).shape
    (5, 2)
    """

    arm: Arm  # as it is described, without the changes
    noise: float = 0.0  # standard deviation of the sensor along each axis [m]
    changes: tuple[Change, ...] = ()  # what differs from the description

    def __post_init__(self) -> None:
        noise = self.noise
        number = isinstance(noise, int | float | np.number)
        if not number or noise is True or not 0.0 <= noise < LARGEST:
            raise OptionError(
                f"noise is {noise!r}, expected zero or more, below {LARGEST:g} [m]"
            )
        object.__setattr__(self, "noise", float(noise))
        object.__setattr__(self, "changes", parse_changes(self.changes))
        names = self.arm.joint_names
        for change in self.changes:
            words = f"change {change.text!r}"
            if change.part not in (*names, *PARTS):
                choices = f"choices: {', '.join(names)}, sensor, tip"
                raise OptionError(
                    f"{words}: no joint {change.part!r}; {choices}"
                )
            planar = change.part in PARTS and change.what not in IN_SPACE
            if planar and self.arm.outputs == 3:
                possible = " and ".join(f"sensor.{what}" for what in IN_SPACE)
                raise OptionError(
                    f"{words} is for planar arms; of an arm in space the joints, {possible} can "
                    "change"
                )
        _ = self.true_arm  # an impossible change of geometry is refused here

    @cached_property
    def true_arm(self) -> Arm:
        """The arm with its lengths and its tip as changed."""
        arm = self.arm
        for change in self.changes:
            value = change.values[0]
            if change.what == "length":
                if change.relative:
                    value *= self.arm.link_lengths[change.part]
                arm = arm.with_link_length(change.part, value)
            if change.part == "tip":
                arm = arm.with_tip_offset(*change.values)
        return arm

    @property
    def has_outliers(self) -> bool:
        """Whether some of the sensor's readings are wrong."""
        return bool(self._values("sensor", "outliers"))

    def draw(self, n: int, rng: Generator) -> Array:
        """Draw what the encoders read (n, dof) [rad or m], uniformly from the arm's range."""
        arm = self.arm
        return rng.uniform(arm.lower, arm.upper, (n, len(arm.lower)))

    def exact(self, q: ArrayLike) -> Array:
        """Return what the sensor would read without noise, backlash and outliers.

        Positions (n, m) or (m,) [m] for encoders that read `q` (n, dof) or (dof,) [rad or m].
        """
        return self._see(self._behind_gears(q))

    def true(self, q: ArrayLike, rng: Generator) -> Array:
        """Return where the tip truly is while the arm goes through `q` (n, dof), row by row.

        As `measure`, without the sensor's noise and outliers: what a bound has to cover.
        """
        theta = self._behind_gears(q)
        noise = rng.spawn(1)[0].standard_normal(theta.shape)
        for k, width in enumerate(self._by_joint("backlash")):
            if width:
                theta[:, k] = _behind_play(theta[:, k], width)
        return self._see(theta + self._by_joint("noise") * noise)

    def measure(self, q: ArrayLike, rng: Generator) -> Array:
        """Return what the sensor reads while the arm goes through `q`, row by row; see `exact`.

        Noise of the joints, noise of the sensor and outliers have separate streams, children of
        `rng`: more of one leaves the others as they are. Backlash depends on the order of the
        rows. An outlier is a point anywhere in the box around the workspace.
        """
        rows = np.atleast_2d(np.asarray(q, dtype=np.float64))
        x = self.true(rows, rng)
        sensor_noise, outliers = rng.spawn(2)
        x += self.noise * sensor_noise.standard_normal(x.shape)
        for share in self._values("sensor", "outliers"):
            wrong = outliers.random(len(x)) < share
            # enough rows to know the extent of the workspace to a few percent
            workspace = self.exact(self.draw(4096, np.random.default_rng(0)))
            low = workspace.min(axis=0)
            high = workspace.max(axis=0)
            x[wrong] = outliers.uniform(low, high, size=x.shape)[wrong]
        return x if np.ndim(q) == 2 else x[0]

    @property
    def hidden(self) -> bool:
        """Whether something that no encoder reads moves the tip: backlash, joint noise."""
        moves = self._by_joint("backlash") + self._by_joint("noise")
        return bool(moves.any())

    def to_json(self) -> dict[str, object]:
        """Return the noise and the changes as plain data; the arm is stored elsewhere."""
        return {
            "noise": self.noise,
            "changes": [change.text for change in self.changes],
        }

    @classmethod
    def from_json(cls, arm: Arm, data: Document) -> Simulation:
        """Rebuild what `to_json` returned, with the arm as it was described."""
        return cls(arm, data["noise"], data["changes"])

    def _behind_gears(self, q: ArrayLike) -> Array:
        """The joints' true values when their encoders read `q`."""
        theta = np.asarray(q, dtype=np.float64)
        return theta * self._by_joint("gear", 1.0) + self._by_joint("offset")

    def _see(self, theta: Array) -> Array:
        """Tip positions in the sensor's frame; locked joints stay, against all else."""
        lock = self._by_joint("lock", np.nan)
        theta = np.where(np.isnan(lock), theta, lock)
        x = np.array(self.true_arm.forward(theta), dtype=np.float64)
        x *= self._values("sensor", "mirror", 1.0)
        x *= self._values("sensor", "scale", 1.0)
        for angle in self._values("sensor", "rotate"):
            c = math.cos(angle)
            s = math.sin(angle)
            x = x @ np.array([[c, s], [-s, c]])
        x += self._values("sensor", "shift", 0.0)
        return x

    def _values(self, part: str, what: str, *usual: float) -> tuple[float, ...]:
        """What a part is changed by, `usual` where it is not."""
        for change in self.changes:
            if (change.part, change.what) == (part, what):
                return change.values
        return usual

    def _by_joint(self, what: str, usual: float = 0.0) -> Array:
        """What each joint is changed by, (dof,), `usual` of those that are not."""
        names = self.arm.joint_names
        return np.array([self._values(name, what, usual)[0] for name in names])


def _behind_play(theta: Array, width: float) -> Array:
    """Let a joint (n,) follow its motor (n,), in the order of motion, with play [rad or m]."""
    half = width / 2.0
    motors = theta.tolist()
    joint = motors[:1]
    for motor in motors[1:]:
        joint.append(min(max(joint[-1], motor - half), motor + half))
    return np.array(joint)
