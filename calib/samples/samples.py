"""Samples: what the arm did and what the sensor saw, measured or babbled in simulation."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arm.arm import Arm
from ..arm.plane import Plane
from ..common.arrays import Array, Index
from ..common.rows import LARGEST, column_names, number_rows, whole
from ..errors import LogError, OptionError
from .camera import Camera
from .joint_values import pose_index
from .simulation import Change, Simulation, parse_changes
from .sockets import Touches

POSITION = ("x", "y", "z")


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
    joint_names: tuple[str, ...]
    # (dof,), range of each joint that was babbled (the arm's limits or narrower), or for a log
    # without a robot the extremes of its data, which stand where it is empty [rad or m]
    lower: Array = field(default_factory=lambda: np.empty(0))
    upper: Array = field(default_factory=lambda: np.empty(0))
    revolute: tuple[
        bool, ...
    ] = ()  # whether each joint turns (rad) or slides (m); all if empty
    unit: str = "m"  # of the positions: "m", "sensor", or what the user stated
    # for simulated samples what is needed to draw fresh exact ones
    simulation: Simulation | None = field(default=None, repr=False)
    dropped: int = (
        0  # rows of a log that were left out because a value was missing or not finite
    )
    arm: Arm | None = field(
        default=None, repr=False
    )  # that the names and the ranges come from
    notes: tuple[str, ...] = ()  # what the user should be told, one line each
    # for a log of x, y, z the plane that was fitted to it
    plane: Plane | None = field(default=None, repr=False)
    # (n, 4), of an arm that moves in space the tip's orientation as qx, qy, qz, qw
    orientation: Array | None = field(default=None, repr=False)
    # (n, 6, 6), of each pose: position [unit] and a small turn [rad] about the sensor's axes
    covariance: Array | None = field(default=None, repr=False)
    # columns of the log that have other names than what they hold
    columns: Mapping[str, str] = field(default_factory=dict, repr=False)
    degrees: bool = (
        False  # whether the log has its turning joints in degrees; `q` is in rad
    )
    # of pixels of an arm that moves in space, what is known of the camera
    camera: Camera | None = field(default=None, repr=False)
    # what the log says of itself, as `calib log` writes it above the columns
    source: Mapping[str, Any] = field(default_factory=dict, repr=False)
    # which socket each row touched, where no sensor measured a position
    touch: Touches | None = field(default=None, repr=False)
    # (n,), numbers of the rows in the log's file, counted below its header from 1
    rows: NDArray[np.intp] | None = field(default=None, repr=False)
    time: Array | None = field(
        default=None, repr=False
    )  # (n,), where the log has them [s]
    episode: Array | None = field(
        default=None, repr=False
    )  # (n,), the series each row is of
    pixels: Array | None = field(
        default=None, repr=False
    )  # (n, 2), of a tag in pictures [px]
    pictures: tuple[str, ...] = field(
        default=(), repr=False
    )  # names of those it was made of
    left_out: int = 0  # rows without what a sensor saw: zeros, or no orientation
    sensor: str = (
        ""  # name of the sensor that saw the positions, where a log has several
    )
    in_time: bool = (
        False  # whether the user said how late positions are: nothing is estimated
    )

    def __post_init__(self) -> None:
        names = tuple(self.joint_names)
        dof = len(self.joint_names)
        own = {"joint_names": names, "revolute": tuple(self.revolute) or (True,) * dof}
        for name, value in {**own, "notes": tuple(self.notes)}.items():
            object.__setattr__(self, name, value)
        if not dof or len(set(names)) != dof or len(self.revolute) != dof:
            raise LogError(
                f"samples need one or more joints of different names, not {names}, each of which "
                f"turns or slides: {self.revolute}"
            )
        given = column_names(self.x)
        axes = (
            POSITION
            if "z" in given or (not given and _width(self.x) == 3)
            else POSITION[:2]
        )
        n = len(self._own("q", number_rows(self.q, names, "q", LogError)[0], dof))
        self._own("x", number_rows(self.x, axes, "x", LogError)[0], n, len(axes))
        if n == 0:
            raise LogError("no rows: samples need at least one")
        if not np.size(self.lower):
            object.__setattr__(self, "lower", self.q.min(axis=0) - 1e-9)
            object.__setattr__(self, "upper", self.q.max(axis=0) + 1e-9)
        for name, shape in {
            "lower": (dof,),
            "upper": (dof,),
            "orientation": (n, 4),
        }.items():
            if (value := getattr(self, name)) is not None:
                self._own(name, np.array(value, dtype=float), *shape)
        if self.covariance is not None:
            self._own("covariance", self.covariance, n, 6, 6)
        for name, values in (("q", self.q), ("x", self.x)):
            known = (np.abs(values) < LARGEST).all(axis=1)
            if not known.all():
                row = int(np.argmin(known))
                raise LogError(
                    f"{name} of row {row + 1} is {values[row].tolist()}: leave out rows whose "
                    f"values are missing, not finite or beyond {LARGEST:g}"
                )
        for joint, lo, hi in zip(names, self.lower, self.upper, strict=True):
            if not -np.inf < lo < hi < np.inf:
                raise LogError(
                    f"joint {joint!r} has the range {lo:g}:{hi:g}, expected low:high"
                )

    def _own(self, name: str, value: Array, *shape: int) -> Array:
        """Hold an array that nobody can write; a shape that does not fit raises LogError."""
        if value.shape[-len(shape) :] != shape:
            raise LogError(f"{name} has shape {value.shape}, expected {shape}")
        value.flags.writeable = False
        object.__setattr__(self, name, value)
        return value

    def __len__(self) -> int:
        return len(self.q)

    @property
    def dof(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    @cached_property
    def pose_index(self) -> Index:
        """Number of the pose that each row stands at, (n,): rows at one pose share it."""
        return pose_index(self.q)

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
        value = self.source.get("noise_of_reference", 0.0)
        known = isinstance(value, (int, float)) and 0.0 <= value < LARGEST
        return float(value) if known else 0.0

    def take(self, index: ArrayLike | slice) -> Samples:
        """Return the rows that `index` picks: a slice, row numbers in any order or a mask."""
        rows = index if isinstance(index, slice) else np.atleast_1d(np.asarray(index))
        if not isinstance(rows, slice) and not rows.size:
            rows = rows.astype(np.intp)  # an empty list has no type that could index
        each = (
            "q",
            "x",
            "orientation",
            "covariance",
            "rows",
            "time",
            "episode",
            "pixels",
        )
        some = {
            name: values[rows]
            for name in each
            if (values := getattr(self, name)) is not None
        }
        names = tuple(np.array(self.pictures)[rows].tolist()) if self.pictures else ()
        return replace(
            self, touch=self.touch and self.touch.take(rows), pictures=names, **some
        )


def _width(x: Any) -> int:
    try:
        return int((0, *np.shape(x))[-1])
    except ValueError:  # rows of different lengths
        return 0


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
    joints, sensor = (
        np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(2)
    )
    q = simulation.draw(n, joints)
    known = arm.joint_names, arm.lower, arm.upper, arm.revolute
    return Samples(
        q, simulation.measure(q, sensor), *known, simulation=simulation, arm=arm
    )
