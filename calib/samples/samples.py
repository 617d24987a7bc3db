"""Samples: what the arm did and what the sensor saw, measured or babbled in simulation."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..arm.arm import Arm
from ..arm.plane import Plane
from ..common.arrays import Array, Index, Mask, frozen
from ..common.rows import LARGEST, column_names, number_rows, whole
from ..errors import LogError, OptionError
from .camera import Camera
from .changes import Change, parse_changes
from .motion import Motion, directions
from .poses import pose_index
from .simulation import Simulation
from .sockets import Touches

POSITION = ("x", "y", "z")

_OF_ROWS = (
    "q",
    "x",
    "side",
    "time",
    "episode",
    "orientation",
    "covariance",
    "pixels",
    "rows",
)
"""Fields with an entry for each row."""


@dataclass(frozen=True, eq=False)
class Samples:
    """Joint values and the tip positions measured with them.

    The arrays are checked when made, C-contiguous copies and read-only.

    Raises
    ------
    LogError
        If the shapes do not fit each other or a value is not finite.

    Examples
    --------
    >>> s = Samples([[0.0], [1.0]], [[1, 0], [0, 1]], ("hinge",), [0.0], [1.0], (True,))
    >>> len(s), s.dof, s.take([1]).x.tolist()
    (2, 1, [[0.0, 1.0]])
    """

    q: Array  # (n, dof), joint values, columns from base to tip [rad or m]
    x: Array  # (n, 2) or (n, 3), tip positions in the sensor's plane, or in space [unit]
    # joints: names; (dof,), range that was babbled (the arm's limits or narrower), or for a log
    # without a robot the extremes of its data, which stand where it is empty [rad or m]; whether
    # each turns (rad) or slides (m), all if empty
    joint_names: tuple[str, ...]
    lower: Array = field(default_factory=lambda: np.empty(0))
    upper: Array = field(default_factory=lambda: np.empty(0))
    revolute: tuple[bool, ...] = ()
    unit: str = "m"  # of the positions: "m", "sensor", or what the user stated
    arm: Arm | None = field(
        default=None, repr=False
    )  # with these joints and ranges
    # of simulated samples what is needed to draw fresh exact ones
    simulation: Simulation | None = field(default=None, repr=False)

    # the motion: (n, dof), from which side each joint came, 1, -1 or 0 if unknown (by the order of
    # the rows where it is not given); (n,), times [s]; (n,), the series each row is of
    side: Array | None = field(default=None, repr=False)
    time: Array | None = field(default=None, repr=False)
    episode: Array | None = field(default=None, repr=False)
    in_time: bool = False  # whether the user said how late positions are

    # the sensor: its name where there are several; of x, y, z the plane that was fitted; of pixels
    # of an arm in space what is known of the camera
    sensor: str = ""
    plane: Plane | None = field(default=None, repr=False)
    camera: Camera | None = field(default=None, repr=False)
    # further readings: (n, 4), orientations as qx, qy, qz, qw; (n, 6, 6), covariances of position
    # [unit] and a small turn [rad] about the sensor's axes; touched sockets, where no sensor
    # measured a position; (n, 2), pixels of a tag in pictures [px]
    orientation: Array | None = field(default=None, repr=False)
    covariance: Array | None = field(default=None, repr=False)
    touch: Touches | None = field(default=None, repr=False)
    pixels: Array | None = field(default=None, repr=False)

    # the file: numbers of its rows (n,), counted below its header from 1; columns that have other
    # names than what they hold; whether turning joints are in degrees there; what it says of itself
    rows: Index | None = field(default=None, repr=False)
    columns: Mapping[str, str] = field(default_factory=dict, repr=False)
    degrees: bool = False
    source: Mapping[str, Any] = field(default_factory=dict, repr=False)
    pictures: tuple[str, ...] = field(
        default=(), repr=False
    )  # that rows were made of
    dropped: int = 0  # rows that missed a value
    # rows without what a sensor saw: zeros, or no orientation
    left_out: int = 0
    notes: tuple[str, ...] = ()  # what the user should be told, one line each

    def __post_init__(self) -> None:
        names = tuple(self.joint_names)
        turns = tuple(self.revolute) or (True,) * len(names)
        if not 0 < len({*names}) == len(names) == len(turns):
            raise LogError(
                f"samples need one or more joints of different names, not {names}, each of which "
                f"turns or slides: {turns}"
            )
        axes = POSITION if _in_space(self.x) else POSITION[:2]
        q, _ = number_rows(self.q, names, "q", LogError)
        x, _ = number_rows(self.x, axes, "x", LogError)
        if len(q) == 0:
            raise LogError("no rows: samples need at least one")
        for name, numbers in (("q", q), ("x", x)):
            sound = (np.abs(numbers) < LARGEST).all(axis=1)
            if not sound.all():
                row = int(np.argmin(sound))
                raise LogError(
                    f"{name} of row {row + 1} is {numbers[row].tolist()}: leave out rows whose "
                    f"values are missing, not finite or beyond {LARGEST:g}"
                )
        lower = self.lower
        upper = self.upper
        if not np.size(lower):
            lower = q.min(axis=0) - 1e-9
            upper = q.max(axis=0) + 1e-9
        side = directions(q) if self.side is None else self.side
        n = len(q)
        arrays: dict[str, tuple[Array | None, tuple[int, ...]]] = {
            "q": (q, q.shape),
            "x": (x, (n, len(axes))),
            "lower": (lower, (len(names),)),
            "upper": (upper, (len(names),)),
            "side": (side, q.shape),
            "orientation": (self.orientation, (n, 4)),
            "covariance": (self.covariance, (n, 6, 6)),
        }
        fields: dict[str, object] = {
            "joint_names": names,
            "revolute": turns,
            "notes": tuple(self.notes),
        }
        for name, (values, shape) in arrays.items():
            if values is None:
                continue
            array = np.array(values, dtype=float)
            if array.shape != shape:
                raise LogError(
                    f"{name} has shape {array.shape}, expected {shape}"
                )
            fields[name] = frozen(array)
        for name, value in fields.items():
            object.__setattr__(self, name, value)
        for joint, low, high in zip(names, self.lower, self.upper, strict=True):
            if not -np.inf < low < high < np.inf:
                raise LogError(
                    f"joint {joint!r} has the range {low:g}:{high:g}, expected low:high"
                )

    def __len__(self) -> int:
        return len(self.q)

    @property
    def dof(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    @property
    def motion(self) -> Motion:
        """What the joints did, row by row."""
        return Motion(self.q, self.side, self.time)

    @cached_property
    def pose_index(self) -> Index:
        """Number of the pose that each row stands at, (n,): rows at one pose share it."""
        return np.arange(len(self)) if self.simulation else pose_index(self.q)

    @property
    def poses(self) -> int:
        """Number of poses: repeated rows count once."""
        return int(self.pose_index.max()) + 1

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of a position's coordinates: x and y, and z in space."""
        return POSITION[: self.x.shape[1]]

    @property
    def shared(self) -> float:
        """Standard deviation along each axis that all rows share [unit].

        Where a camera sees a board, that is how well the board was found.
        """
        noise = self.source.get("noise_of_reference", 0.0)
        is_noise = isinstance(noise, (int, float)) and 0.0 <= noise < LARGEST
        return float(noise) if is_noise else 0.0

    def reordered(self, names: Sequence[str]) -> Samples:
        """Return the samples with the joints in another order.

        Raises LogError if the log is of other joints.
        """
        if sorted(names) != sorted(self.joint_names):
            raise LogError(
                f"the log's joints are {', '.join(self.joint_names)}, the model's are "
                f"{', '.join(names)}: give a log of the same arm"
            )
        order = [self.joint_names.index(name) for name in names]
        return replace(
            self,
            q=self.q[:, order],
            side=None if self.side is None else self.side[:, order],
            joint_names=tuple(names),
            lower=self.lower[order],
            upper=self.upper[order],
            revolute=tuple(self.revolute[k] for k in order),
        )

    def take(self, index: Index | Mask | Sequence[int] | slice) -> Samples:
        """Return the rows that `index` picks: a slice, row numbers in any order or a mask."""
        picked = np.atleast_1d(np.arange(len(self))[index])
        of_rows: dict[str, Any] = {}
        for name in _OF_ROWS:
            values = getattr(self, name)
            if values is not None:
                of_rows[name] = values[picked]
        if self.pictures:
            of_rows["pictures"] = tuple(self.pictures[row] for row in picked)
        if self.touch is not None:
            of_rows["touch"] = self.touch.take(picked)
        return replace(self, **of_rows)


def _in_space(x: Any) -> bool:
    """Whether positions have a z, by their names, or by their number."""
    names = column_names(x)
    if names:
        return "z" in names
    try:
        return bool(np.shape(x)[-1:] == (3,))
    except ValueError:  # rows of different lengths
        return False


def babble(
    arm: Arm,
    n: int = 20_000,
    *,
    seed: int = 0,
    noise: float = 0.0,
    changes: Iterable[str | Change] = (),
    ranges: Mapping[str, tuple[float, float]] | None = None,
) -> Samples:
    """Move the simulated arm at random through its range and record joints and positions.

    arm : the arm, from `calib.load_arm`
    n : number of samples
    seed : of the random numbers. Joint values, noise and outliers draw from streams of their own,
        so that other noise leaves the joint values as they are.
    noise : standard deviation of the sensor along each axis [m]
    changes : what differs from the arm as described, such as `"elbow.length=+20%"`
    ranges : babble only this part of a joint's range [rad or m]
    Raises OptionError if an argument is outside of what is possible.

    Examples
    --------
    >>> import calib
    >>> log = calib.babble(calib.load_arm("two_link"), 1000, seed=1)
    >>> log.q.shape, log.x.shape
    ((1000, 2), (1000, 2))
    """
    if not isinstance(arm, Arm):
        raise OptionError(
            f"arm {arm!r}: expected an arm, as `calib.load_arm` returns it"
        )
    n = whole("samples", n, 1, 10_000_000)
    seed = whole("seed", seed, 0, 2**63 - 1)
    if ranges:
        arm = arm.with_range(dict(ranges))
    simulation = Simulation(arm, noise=noise, changes=parse_changes(changes))
    streams = np.random.SeedSequence(seed).spawn(2)
    joints, sensor = (np.random.default_rng(stream) for stream in streams)
    q = simulation.draw(n, joints)
    return Samples(
        q,
        simulation.measure(q, sensor),
        arm.joint_names,
        arm.lower,
        arm.upper,
        arm.revolute,
        arm=arm,
        simulation=simulation,
    )
