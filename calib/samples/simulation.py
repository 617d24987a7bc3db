"""The simulated arm and sensor, changed as typed (`elbow.length=+20%`): what the sensor reads."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike

from ..common.arrays import Array
from ..common.checks import LARGEST
from ..errors import OptionError

if TYPE_CHECKING:
    from ..arm.arm import Arm

_RELATIVE = ("length", "gear", "scale")  # +20% means times 1.2
_ANGLES = ("offset", "noise", "backlash", "lock")  # of a joint that is typed in degrees
_PAIRS = (("tip", "offset"), ("sensor", "shift"))  # of two numbers

_Rule = tuple[str, Callable[[float], bool]]
_FORMS: dict[tuple[str, str], _Rule] = {
    ("joint", "length"): ("+20% or 0.3 [m], above zero", lambda value: value > 0),
    ("joint", "offset"): ("0.05 [rad or m]", math.isfinite),
    ("joint", "gear"): ("1.02, not 0 (lock holds a joint)", bool),
    ("joint", "noise"): ("0.01 [rad or m], not negative", lambda value: value >= 0),
    ("joint", "backlash"): ("0.01 [rad or m], not negative", lambda value: value >= 0),
    ("joint", "lock"): ("1.0 [rad or m]", math.isfinite),
    ("tip", "offset"): ("0.01,0.02 [m]", math.isfinite),
    ("sensor", "mirror"): ("x or y", lambda _: False),
    ("sensor", "scale"): ("1.05, above zero", lambda value: value > 0),
    ("sensor", "rotate"): ("0.14 [rad]", math.isfinite),
    ("sensor", "shift"): ("0.03,-0.02 [m]", math.isfinite),
    ("sensor", "outliers"): ("5%, a share of the rows below 1", lambda value: 0 <= value < 1),
}
"""What can change, a value of each, and which values are possible."""

JOINT_CHANGES = tuple(what for part, what in _FORMS if part == "joint")
SENSOR_CHANGES = tuple(what for part, what in _FORMS if part == "sensor")
_CHOICES = f"JOINT.{'|'.join(JOINT_CHANGES)}, tip.offset, sensor.{'|'.join(SENSOR_CHANGES)}"


@dataclass(frozen=True)
class Change:
    """One change of the simulated arm or sensor."""

    part: Literal["joint", "tip", "sensor"]
    joint: str  # the joint's name; empty for the tip and the sensor
    # `length`, `offset`, ...: one of `JOINT_CHANGES`, `SENSOR_CHANGES`; the tip has `offset`
    what: str
    # one number, or two for `tip.offset` and `sensor.shift` [rad, m or 1]. For `sensor.mirror` the
    # factors of x and y, such as (-1, 1). Where `relative`, the factor itself: 1.2 for +20%.
    values: tuple[float, ...]
    relative: bool
    text: str  # the change as typed

    def __str__(self) -> str:
        return self.text

    @property
    def value(self) -> float:
        """The first or only number."""
        return self.values[0]


def parse_change(text: str, *, degrees: Collection[str] = ()) -> Change:
    """Read one change, such as `elbow.length=+20%`, `tip.offset=0.01,0.02` or `sensor.mirror=x`.

    The last dot before the last `=` divides the name from what is changed, so a joint's
    name may hold dots, and a joint may even be called `sensor` or `tip`: a joint's
    changes differ from a sensor's, and the tip's offset has two numbers.  Offset, noise, backlash
    and lock of the joints in `degrees` are typed in degrees; the answer is in SI units.

    Raises OptionError if the text is no change or its value is impossible.

    Examples
    --------
    >>> change = parse_change("left.elbow.length=+20%")
    >>> change.joint, change.what, change.value, change.relative
    ('left.elbow', 'length', 1.2, True)
    """
    name, _, value = text.strip().rpartition("=")
    target, _, what = name.strip().rpartition(".")
    value = value.strip()
    part: Literal["joint", "tip", "sensor"] = "joint"
    if target == "sensor" and what in SENSOR_CHANGES:
        part = "sensor"
    elif target == "tip" and what == "offset" and "," in value:
        part = "tip"
    if not target or not value or (part, what) not in _FORMS:
        raise OptionError(
            f"change {text!r} is not WHO.WHAT=VALUE such as elbow.length=+20%; choices: {_CHOICES}"
        )
    values = _values(part, what, value)
    form, possible = _FORMS[part, what]
    if values is None or not (what == "mirror" or all(map(possible, values))):
        raise OptionError(f"change {text!r}: expected a value such as {form}")
    joint = target if part == "joint" else ""
    if joint and joint in degrees and what in _ANGLES:
        values = (math.radians(values[0]),)
        text = f"{target}.{what}={values[0]!r}"
    relative = value.endswith("%") and what in _RELATIVE
    return Change(part, joint, what, values, relative, text.strip())


def parse_changes(
    changes: Iterable[str | Change], *, degrees: Collection[str] = ()
) -> tuple[Change, ...]:
    """Read several changes; the same thing changed twice is refused. See `parse_change`."""
    if isinstance(changes, str):
        changes = (changes,)
    parsed: dict[tuple[str, str, str], Change] = {}
    for item in changes:
        change = item if isinstance(item, Change) else parse_change(item, degrees=degrees)
        before = parsed.setdefault((change.part, change.joint, change.what), change)
        if before is not change:
            raise OptionError(
                f"change {change.text!r} comes after {before.text!r}: give one of the two"
            )
    return tuple(parsed.values())


def _values(part: str, what: str, value: str) -> tuple[float, ...] | None:
    """The numbers of a change as typed; None if they are none of its kind."""
    if what == "mirror":
        return {"x": (-1.0, 1.0), "y": (1.0, -1.0)}.get(value)
    percent, signed = value.endswith("%"), value[0] in "+-"
    try:
        values = tuple(float(number) for number in value.removesuffix("%").split(","))
    except ValueError:
        return None
    if len(values) != 1 + ((part, what) in _PAIRS) or not all(abs(v) < LARGEST for v in values):
        return None
    if percent:
        if what not in (*_RELATIVE, "outliers") or (what == "length" and not signed):
            return None
        # +20% is 1.2 and -20% is 0.8, but 105% without a sign 1.05, and a share of rows itself
        share = values[0] / 100.0
        values = (1.0 + share if signed and what != "outliers" else share,)
    return values


_IN_SPACE = ("scale", "outliers")  # changes of the sensor that an arm in space can have
_BOX_SAMPLES = 4096  # enough to know the extent of the workspace to a few percent


@dataclass(frozen=True, eq=False)
class Simulation:
    """An arm and a sensor, altered by changes, that can be measured.

    A joint's encoder reads q. The joint itself stands at `gear * q + offset`, less the
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
        number = isinstance(noise, (int, float, np.number)) and not isinstance(noise, bool)
        if not number or not 0.0 <= noise < LARGEST:
            raise OptionError(f"noise is {noise!r}, expected zero or more, below {LARGEST:g} [m]")
        object.__setattr__(self, "noise", float(noise))
        object.__setattr__(self, "changes", parse_changes(self.changes))
        for change in self.changes:
            self._check(change)
        _ = self.true_arm  # a change of geometry that is impossible is told here

    @cached_property
    def true_arm(self) -> Arm:
        """The arm with its lengths and its tip as changed."""
        arm = self.arm
        for change in self._of("joint", "length"):
            usual = self.arm.link_lengths[change.joint] if change.relative else 1.0
            arm = arm.with_link_length(change.joint, change.value * usual)
        for change in self._of("tip", "offset"):
            arm = arm.with_tip_offset(*change.values)
        return arm

    def draw(self, n: int, rng: Generator) -> Array:
        """Draw what the encoders read (n, dof) [rad or m], uniformly from the arm's range."""
        low, high = np.asarray(self.arm.lower), np.asarray(self.arm.upper)
        return np.clip(rng.uniform(low, high, size=(n, len(low))), low, high)  # it may round up

    def exact(self, q: ArrayLike) -> Array:
        """Return what the sensor would read without noise, backlash and outliers.

        Positions (n, 2) or (2,) [m] for encoders that read `q` (n, dof) or (dof,) [rad or m].
        """
        return self._see(self._joints(np.asarray(q, dtype=np.float64)))

    def measure(self, q: ArrayLike, rng: Generator) -> Array:
        """Return what the sensor reads while the arm goes through `q`, row by row; see `exact`.

        Noise of the joints, noise of the sensor and outliers have streams of their own, children of
        `rng`: more of one leaves the others as they are. Backlash depends on the order of the
        rows. An outlier is a point anywhere in the box around the workspace.
        """
        q = np.asarray(q, dtype=np.float64)
        joint_noise, sensor_noise, outliers = rng.spawn(3)
        x = self._see(self._moved(np.atleast_2d(q), joint_noise))
        if self.noise > 0.0:
            x += self.noise * sensor_noise.standard_normal(x.shape)
        for change in self._of("sensor", "outliers"):
            wrong = outliers.random(len(x)) < change.value
            low, high = self._box
            x[wrong] = outliers.uniform(low, high, size=x.shape)[wrong]
        return x if q.ndim == 2 else x[0]

    @property
    def hidden(self) -> bool:
        """Whether something that no encoder reads moves the tip: backlash, joint noise."""
        return bool(self._of("joint", "backlash") or self._of("joint", "noise"))

    def true(self, q: ArrayLike, rng: Generator) -> Array:
        """Return where the tip truly is while the arm goes through `q`, row by row.

        As `measure`, without the sensor's noise and outliers: what a bound has to cover.
        """
        return self._see(self._moved(np.atleast_2d(np.asarray(q, float)), rng.spawn(1)[0]))

    def to_json(self) -> dict[str, Any]:
        """Return the noise and the changes as plain data; the arm is stored elsewhere."""
        return {"noise": self.noise, "changes": [change.text for change in self.changes]}

    @classmethod
    def from_json(cls, arm: Arm, data: Mapping[str, Any]) -> Simulation:
        """Rebuild what `to_json` returned, with the arm as it was described."""
        return cls(arm, noise=data["noise"], changes=parse_changes(data["changes"]))

    def _joints(self, q: Array) -> Array:
        """Where the joints stand when their encoders read `q`, without noise and backlash."""
        theta = np.array(q, dtype=np.float64)
        for k, gear in self._each("gear"):
            theta[..., k] *= gear
        for k, offset in self._each("offset"):
            theta[..., k] += offset
        return self._held(theta)

    def _moved(self, rows: Array, joint_noise: Generator) -> Array:
        """Where the joints stand one after the other, with backlash and noise."""
        theta = self._joints(rows)
        for k, play in self._each("backlash"):
            theta[:, k] = _play(theta[:, k], play)
        if noisy := self._each("noise"):
            noise = joint_noise.standard_normal(theta.shape)
            for k, size in noisy:
                theta[:, k] += size * noise[:, k]
        return self._held(theta)

    def _held(self, theta: Array) -> Array:
        """With joints that are locked where they are, against all else."""
        for k, value in self._each("lock"):
            theta[..., k] = value
        return theta

    def _see(self, theta: Array) -> Array:
        """Tip positions in the sensor's frame for the joints' true values."""
        x = np.array(self.true_arm.forward(theta), dtype=np.float64)
        for change in self._of("sensor", "mirror"):
            x *= change.values
        for change in self._of("sensor", "scale"):
            x *= change.value
        for change in self._of("sensor", "rotate"):
            c, s = math.cos(change.value), math.sin(change.value)
            x = x @ np.array([[c, s], [-s, c]])
        for change in self._of("sensor", "shift"):
            x += change.values
        return x

    @cached_property
    def _box(self) -> tuple[Array, Array]:
        """Lower and upper corner of what the sensor sees of the workspace [m]."""
        x = self.exact(self.draw(_BOX_SAMPLES, np.random.default_rng(0)))
        return x.min(axis=0), x.max(axis=0)

    def _of(self, part: str, what: str) -> list[Change]:
        return [c for c in self.changes if c.part == part and c.what == what]

    def _each(self, what: str) -> list[tuple[int, float]]:
        """Columns of the joints that a change concerns, and its values."""
        return [(self.arm.joint_names.index(c.joint), c.value) for c in self._of("joint", what)]

    def _check(self, change: Change) -> None:
        names = self.arm.joint_names
        if change.part == "joint" and change.joint not in names:
            choices = f"choices: {', '.join(names)}, sensor, tip"
            raise OptionError(f"change {change.text!r}: no joint {change.joint!r}; {choices}")
        if change.part != "joint" and self.arm.outputs == 3 and change.what not in _IN_SPACE:
            raise OptionError(
                f"change {change.text!r} is for planar arms; of an arm in space the joints, "
                f"{' and '.join(f'sensor.{what}' for what in _IN_SPACE)} can change"
            )


def _play(theta: Array, width: float) -> Array:
    """Let a joint (n,) follow its motor (n,), in the order of motion, with play [rad or m]."""
    half = width / 2.0
    followed = accumulate(
        theta.tolist(), lambda at, motor: min(max(at, motor - half), motor + half)
    )
    return np.fromiter(followed, dtype=np.float64)
