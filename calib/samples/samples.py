"""Samples: what the arm did and what the sensor saw, measured or babbled in simulation."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..arm.arm import Arm
from ..arm.plane import Plane
from ..common.arrays import Array, Document, Index, frozen
from ..common.inputs import LARGEST, column_names, number_rows, whole
from ..common.scale import Scale
from ..errors import LogError, OptionError
from .camera import Camera, camera_of
from .motion import Motion, RowArrays, directions, pose_index
from .simulation import Change, Simulation, parse_changes
from .sockets import Touches

POSITION = ("x", "y", "z")


@dataclass(frozen=True, eq=False)
class Readings(RowArrays):
    """What a sensor read of the tip, row by row."""

    x: Array  # (n, 2) or (n, 3), tip positions in the sensor's plane, or in space [unit]
    _: KW_ONLY
    unit: str = "m"  # of the positions: "m", "sensor", or what the user stated
    # its name where there are several; "" is the first one of a model
    sensor: str = ""
    plane: Plane | None = None  # that was fitted to x, y and z
    camera: Camera | None = None  # of pixels of an arm in space
    orientation: Array | None = None  # (n, 4), qx, qy, qz, qw
    # (n, 6, 6), of position [unit] and a small turn [rad] about the sensor's axes
    covariance: Array | None = None
    touch: Touches | None = None  # sockets, where no sensor measured a position

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of a position's coordinates: x and y, and z in space."""
        return POSITION[: self.x.shape[1]]


@dataclass(frozen=True, eq=False, kw_only=True)
class LogFile(RowArrays):
    """Facts on a log's file, or on the pictures from which its rows were made."""

    # (n,), numbers of the rows, by default counted below the header from 1
    rows: Index = field(default_factory=lambda: np.empty(0, np.intp))
    # columns that have other names than what they hold
    columns: Mapping[str, str] = field(default_factory=dict)
    degrees: bool = False  # whether turning joints are in degrees there
    source: Document = field(default_factory=dict)  # its description of itself
    in_time: bool = False  # whether the user stated how late positions are
    # (n,), names of what each row was made of
    pictures: NDArray[np.str_] | None = None
    pixels: Array | None = None  # (n, 2), of a tag in them [px]
    dropped: int = 0  # rows that missed a value
    # rows without what a sensor saw: zeros, or no orientation
    left_out: int = 0
    notes: tuple[str, ...] = ()  # notes for the user, one line each

    @property
    def common_sd(self) -> float:
        """Standard deviation along each axis that all rows share [unit].

        Where a camera sees a board, that is how well the board was found.
        """
        noise = self.source.get("noise_of_reference", 0.0)
        is_noise = isinstance(noise, (int, float)) and 0.0 <= noise < LARGEST
        return float(noise) if is_noise else 0.0


@dataclass(frozen=True, eq=False, repr=False)
class Samples(LogFile, Readings, Motion):
    """Joint values and the tip positions measured with them: a motion, its readings, their file.

    Positional arguments are q, x, joint_names, lower, upper and revolute: fields of the last base
    come first, and all others are keywords.
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

    joint_names: tuple[str, ...]
    # (dof,), range that was babbled (the arm's limits or narrower), or for a log without a robot
    # the extremes of its data, which stand where it is empty [rad or m]
    lower: Array = field(default_factory=lambda: np.empty(0))
    upper: Array = field(default_factory=lambda: np.empty(0))
    # whether each turns (rad) or slides (m), all if empty
    revolute: tuple[bool, ...] = ()
    _: KW_ONLY
    arm: Arm | None = None  # with these joints and ranges
    simulation: Simulation | None = None  # draws fresh exact samples

    not_by_row: ClassVar[tuple[str, ...]] = ("lower", "upper")

    def __post_init__(self) -> None:
        names = tuple(self.joint_names)
        revolute = tuple(self.revolute) or (True,) * len(names)
        if not 0 < len({*names}) == len(names) == len(revolute):
            raise LogError(
                f"samples need one or more joints of different names, not {names}, each of which "
                f"turns or slides: {revolute}"
            )
        q = _sound("q", self.q, names)
        x = _sound("x", self.x, POSITION if _in_space(self.x) else POSITION[:2])
        lower = self.lower if np.size(self.lower) else q.min(axis=0) - 1e-9
        upper = self.upper if np.size(self.upper) else q.max(axis=0) + 1e-9
        values: dict[str, object] = {
            "joint_names": names,
            "revolute": revolute,
            "notes": tuple(self.notes),
            **self._arrays(q, x, lower, upper),
        }
        in_space = self.arm is not None and self.arm.outputs == 3
        if in_space and x.shape[1] == 2 and self.camera is None:
            values["camera"] = camera_of(self.source, x)
        if np.shape(self.rows) != (len(q),):  # not stated, or of other rows
            values["rows"] = np.arange(1, len(q) + 1)
        for name, value in values.items():
            object.__setattr__(self, name, value)
        if self.time is not None and not np.isfinite(self.time).all():
            raise LogError("time is not finite in every row: leave it out")
        for joint, low, high in zip(names, self.lower, self.upper, strict=True):
            if not -np.inf < low < high < np.inf:
                raise LogError(
                    f"joint {joint!r} has the range {low:g}:{high:g}, expected low:high"
                )

    def _arrays(
        self, q: Array, x: Array, lower: Array, upper: Array
    ) -> dict[str, Array]:
        """The arrays that are known, as read-only copies.  Raises LogError for another shape."""
        n, dof = q.shape
        side = directions(q) if self.side is None else self.side
        shaped = {
            "q": (q, (n, dof)),
            "x": (x, (n, x.shape[1])),
            "lower": (lower, (dof,)),
            "upper": (upper, (dof,)),
            "side": (side, (n, dof)),
            "orientation": (self.orientation, (n, 4)),
            "covariance": (self.covariance, (n, 6, 6)),
            "time": (self.time, (n,)),
            "clock_sd": (self.clock_sd, (n, dof)),
            "episode": (self.episode, (n,)),
        }
        arrays = {}
        for name, (array, shape) in shaped.items():
            if array is None:
                continue
            if np.shape(array) != shape:
                raise LogError(
                    f"{name} has shape {np.shape(array)}, expected {shape}"
                )
            arrays[name] = frozen(np.array(array, float))
        return arrays

    def __repr__(self) -> str:
        return f"Samples({len(self)} rows of {', '.join(self.joint_names)})"

    @property
    def dof(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    @property
    def unit_box(self) -> Scale:
        """The box of the joints' ranges."""
        return Scale.of_range(self.lower, self.upper, self.revolute)

    @cached_property
    def pose_index(self) -> Index:
        """Number of the pose of each row, (n,): rows at one pose share it."""
        return np.arange(len(self)) if self.simulation else pose_index(self.q)

    @property
    def poses(self) -> int:
        """Number of poses: repeated rows count once."""
        return int(self.pose_index.max()) + 1

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
        assert self.side is not None  # noqa: S101 - as it was made
        return replace(
            self,
            q=self.q[:, order],
            side=self.side[:, order],
            joint_names=tuple(names),
            lower=self.lower[order],
            upper=self.upper[order],
            revolute=tuple(self.revolute[k] for k in order),
        )


def _sound(name: str, values: object, columns: Sequence[str]) -> Array:
    """Return the finite rows of numbers that samples need; LogError where they are none."""
    rows, _ = number_rows(values, columns, name, LogError)
    if len(rows) == 0:
        raise LogError("no rows: samples need at least one")
    sound = (np.abs(rows) < LARGEST).all(axis=1)
    if not sound.all():
        row = int(np.argmin(sound))
        raise LogError(
            f"{name} of row {row + 1} is {rows[row].tolist()}: leave out rows whose values are "
            f"missing, not finite or beyond {LARGEST:g}"
        )
    return rows


def _in_space(x: Any) -> bool:
    """Whether positions have a z, by their names, or by their number."""
    names = column_names(x)
    with suppress(ValueError):  # of rows of different lengths
        return "z" in names if names else np.shape(x)[-1:] == (3,)
    return False


def babble(
    arm: Arm,
    n: int = 20_000,
    *,
    seed: int = 0,
    noise: float = 0.0,
    changes: Iterable[str | Change] = (),
) -> Samples:
    """Move the simulated arm at random through its range and record joints and positions.

    arm : the arm, from `calib.load_arm`; `arm.with_range` has a part of its range
    n : number of samples
    seed : of the random numbers. Joint values, noise and outliers draw from separate streams,
        so that other noise leaves the joint values as they are.
    noise : standard deviation of the sensor along each axis [m]
    changes : what differs from the arm as described, such as `"elbow.length=+20%"`
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
