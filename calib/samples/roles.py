"""Roles: which column of a log is which joint, position or part of an orientation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..arm.rotations import QUATERNION
from ..common.arrays import Array
from ..common.rows import row_lengths
from ..common.wording import by_name, listing
from ..errors import LogError, OptionError
from .column_units import find_column
from .samples import POSITION, Samples
from .tables import Source

if TYPE_CHECKING:
    from ..arm.arm import Arm


PIXELS = {"x": "u", "y": "v"}
"""Columns of pixels, where a log has no x, y or z."""

ANGLES = ("roll", "pitch", "yaw")
SOCKET = ("setup", "point")
"""Columns that name the socket that the tip touched; the first may be missing."""

_POSE = (*POSITION, "rx", "ry", "rz")
COVARIANCE = tuple(
    f"cov_{a}_{b}" for k, a in enumerate(_POSE) for b in _POSE[k:]
)
"""Columns of a pose's covariance: its upper triangle, row by row, of position [unit] and of a small
turn [rad] about the sensor's axes, `cov_x_x`, `cov_x_y`, .. `cov_rz_rz`."""

FURTHER = ("time", "episode")
"""Columns with the time and the series of a row."""


@dataclass(frozen=True)
class Roles:
    """What a log is read for, by the usual names of columns."""

    joints: tuple[str, ...]  # base to tip
    # `("x", "y")` or `("x", "y", "z")`; none in a log of touches alone
    axes: tuple[str, ...]
    orientation: tuple[str, ...]  # `QUATERNION`, `ANGLES`, or nothing
    # names that columns have in the file where they differ
    column_of: Mapping[str, str]
    pixels: bool  # whether x and y are columns u and v
    touched: bool  # whether rows name the socket that the tip was in

    @property
    def names(self) -> tuple[str, ...]:
        """All numbers in their order."""
        return (*self.joints, *self.axes, *self.orientation)

    def columns(self, names: Sequence[str]) -> list[str]:
        """Return what names are called in the file."""
        return [self.column_of.get(name, name) for name in names]


def find_roles(
    source: Source,
    arm: Arm | None,
    joints: Sequence[str] | None,
    columns: Mapping[str, str],
) -> Roles:
    """Decide what to read; or raise the choices that there are.

    The joints are those of the arm, or else `joints`; `columns` are other names of columns. z is
    among the axes where the log has one.
    """
    names = joint_names(source, arm, joints)
    # locked joints are named for `locked_joint_values`
    locked = () if arm is None else tuple(arm.locked)
    _check_names(columns, (*POSITION, *names, *locked))
    column_of = _columns_by_name(source.header, names, columns)
    present = {*source.header, *column_of} - {*names}
    pixels = not {*POSITION} & present and {*PIXELS.values()} <= present
    if pixels:
        for name, pixel in PIXELS.items():
            column_of[name] = column_of.get(pixel, pixel)
        present |= {*PIXELS}
    touched = "point" in present
    if not {*POSITION} & present and not touched:
        raise LogError(
            f"{source.label} has no positions: expected columns x, y and z [m] of a tracker, "
            "u and v of a camera, or point of sockets that the tip touched; columns: "
            f"{listing(map(repr, source.header))}",
            hint="if they have other names, give `columns={'x': 'OTHER', 'y': ..}`",
            parameter="columns",
        )
    axes: tuple[str, ...] = POSITION if "z" in present else POSITION[:2]
    if touched and not {*POSITION} <= present:
        axes = ()
    orientation: tuple[str, ...] = ()
    if "z" in present and not touched and (arm is None or arm.outputs == 3):
        orientation = _orientation_columns(present, {*columns})
    roles = Roles(names, axes, orientation, column_of, pixels, touched)
    _refuse_repeats(roles.columns(roles.names))
    return roles


def _check_names(columns: Mapping[str, str], choices: Sequence[str]) -> None:
    """Raise OptionError if what a column is to be is nothing that is read."""
    for name, column in columns.items():
        if name not in (*choices, *QUATERNION, *ANGLES, *SOCKET, *FURTHER):
            raise OptionError(
                f"columns {name}={column}: {name!r} is neither a position nor a joint; "
                f"choices: {', '.join(choices)}",
                parameter="columns",
                value=name,
            )


def _orientation_columns(present: set[str], typed: set[str]) -> tuple[str, ...]:
    """The columns of an orientation, of a quaternion where there are both forms.

    A form that is typed in part is one, too: `Source.read` reports what it misses.
    """
    for parts in (QUATERNION, ANGLES):
        if present.issuperset(parts) or {*parts} & typed:
            return parts
    return ()


def _refuse_repeats(columns: Sequence[str]) -> None:
    """Raise OptionError if a column is read for two things."""
    if len({*columns}) < len(columns):
        raise OptionError(
            f"columns {listing(columns)}: one is taken twice; each joint and position needs "
            "a column and a name of its own",
            parameter="columns",
            value=columns,
        )


def _columns_by_name(
    header: Sequence[str], joints: Sequence[str], typed: Mapping[str, str]
) -> dict[str, str]:
    """Return columns that have other names than what they hold, as typed or by `find_column`."""
    columns = dict(typed)
    rest = [*header]
    further = (*POSITION, *PIXELS.values(), *QUATERNION, *ANGLES, *FURTHER)
    for name in (*joints, *further):
        column = find_column(rest, columns.get(name, name))
        if column is None:
            continue
        if column != name:
            columns[name] = column
        if name in joints:
            rest.remove(column)
    return columns


def joint_names(
    source: Source, arm: Arm | None, joints: Sequence[str] | None
) -> tuple[str, ...]:
    """Names of a log's joints, base to tip.  Raises OptionError if there are none."""
    if isinstance(joints, str):
        joints = [name.strip() for name in joints.split(",")]
    names = tuple(joints or ()) if arm is None else tuple(arm.joint_names)
    if arm is not None and joints is not None and {*joints} != {*names}:
        raise OptionError(
            f"joints {list(joints)}: the arm was loaded with {list(names)}"
        )
    if not names:
        others = listing(
            repr(name) for name in source.header if name not in POSITION
        )
        raise OptionError(
            f"{source.label}: which columns are the joints, base to tip? choices: {others}",
            hint="name them in `joints`",
            parameter="joints",
        )
    return names


def parse_columns(text: str) -> dict[str, str]:
    """Read other names of columns as typed, such as `x=cam_u,y=cam_v`."""
    mapping: dict[str, str] = {}
    for item in text.split(","):
        name, equals, column = (part.strip() for part in item.partition("="))
        if not (name and equals and column) or name in mapping:
            raise OptionError(
                f"columns {text!r}: expected NAME=COLUMN, each name once, such as x=cam_u,y=cam_v"
            )
        mapping[name] = column
    return mapping


def log_columns(samples: Samples) -> dict[str, Array]:
    """Columns of a log by name: joints, positions, and what else is known of the rows."""
    columns = by_name(samples.joint_names, samples.q.T)
    columns |= by_name(samples.axes, samples.x.T)
    if len(columns) < samples.dof + len(samples.axes):
        raise OptionError(
            f"joints {listing(samples.joint_names)} have the names of positions: rename them"
        )
    if samples.orientation is not None:
        columns |= by_name(QUATERNION, samples.orientation.T)
    if samples.covariance is not None:
        row, column = np.triu_indices(6)
        triangle = samples.covariance[:, row, column]
        columns |= by_name(COVARIANCE, triangle.T)
    for name, further in zip(
        FURTHER, (samples.time, samples.episode), strict=True
    ):
        if further is not None:
            columns[name] = further
    return columns


def from_angles(angles: Array) -> Array:
    """Unit quaternions (n, 4) of roll, pitch and yaw (n, 3) [rad].

    As in URDF: turns about the fixed x, then y, then z axis.
    Raises LogError if they are beyond a turn: they are in degrees.
    """
    most = float(np.abs(angles).max(initial=0.0))
    if most > 2 * np.pi + 0.1:
        raise LogError(
            f"roll, pitch and yaw reach {most:.4g}, in rad more than a turn",
            hint="convert them to rad, or give `degrees=True` if all angles are in degrees",
            parameter="degrees",
        )
    from scipy.spatial.transform import Rotation

    quaternion: Array = Rotation.from_euler("xyz", angles).as_quat(True)
    return quaternion


def quaternions(values: Array, *, degrees: bool) -> Array:
    """Unit quaternions (n, 4) with qw not negative, of such as a file rounds them, or of angles.

    values : (n, 4), qx, qy, qz, qw; or (n, 3), roll, pitch and yaw [rad, or degrees]
    """
    if values.shape[1] == len(ANGLES):
        return from_angles(np.deg2rad(values) if degrees else values)
    unit = values / row_lengths(values)[:, None]
    return np.asarray(np.where(unit[:, 3:] < 0, -unit, unit))
