"""Roles: which column of a log is which joint, position or part of an orientation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..arm.rotations import exponential, quaternion_of
from ..common.arrays import Array
from ..errors import LogError, OptionError
from .columns import Source

if TYPE_CHECKING:
    from ..arm.arm import Arm

_POSITION = ("x", "y", "z")
#: Columns of pixels, where a log has no x and y.
PIXELS = {"x": "u", "y": "v"}


@dataclass(frozen=True)
class Roles:
    """The columns that a log is read from."""

    # names of the joints, base to tip; `("x", "y")` or `("x", "y", "z")`
    joints: tuple[str, ...]
    axes: tuple[str, ...]
    # the column of each joint, then of each axis and of each part of the orientation
    columns: tuple[str, ...]
    # `("qx", "qy", "qz", "qw")`, `("roll", "pitch", "yaw")`, or nothing
    turns: tuple[str, ...] = ()
    spread: tuple[str, ...] = ()  # `COVARIANCE`, or nothing


def find_roles(
    source: Source, arm: Arm | None, joints: Sequence[str] | None, columns: Mapping[str, str] | None
) -> Roles:
    """Decide which columns to read, or say which choices there are.

    The joints are those of the arm, or else `joints`; `columns` are other names of columns. z is
    among the axes where the log or `columns` has one.
    """
    names = _joint_names(source, arm, joints)
    mapping = dict(columns or {})
    locked = tuple(arm.locked) if arm is not None else ()  # mapped for `locked_from_log`
    for name in mapping:
        if name not in (*names, *_POSITION, *QUATERNION, *_ANGLES, *locked):
            raise OptionError(
                f"columns {name}={mapping[name]}: {name!r} is neither a position nor a joint; "
                f"choices: {', '.join((*_POSITION, *names, *locked))}",
                parameter="columns",
                value=name,
            )
    has_z = "z" not in names and ("z" in mapping or "z" in source.header)
    axes = _POSITION if has_z else _POSITION[:2]
    turns = _orientation(source, arm, names, mapping) if has_z else ()
    spread = COVARIANCE if turns and {*COVARIANCE} <= {*source.header} else ()
    used = tuple(mapping.get(name, name) for name in (*names, *axes, *turns, *spread))
    for column in used:
        if used.count(column) > 1:
            raise OptionError(
                f"column {column!r} is taken twice",
                hint="give each joint and position a column of its own with `columns`",
                parameter="columns",
                value=column,
            )
    return Roles(names, axes, used, turns, spread)


def _orientation(
    source: Source, arm: Arm | None, names: Sequence[str], mapping: Mapping[str, str]
) -> tuple[str, ...]:
    """The columns of an orientation, of an arm that moves in space or where there is no arm."""
    if arm is not None and arm.outputs < 3:
        return ()
    for parts in (QUATERNION, _ANGLES):
        lacking = [part for part in parts if part not in mapping and part not in source.header]
        asked = [part for part in parts if part in mapping]
        if set(parts) & set(names):
            continue
        if not lacking:
            return parts
        if asked:
            raise OptionError(
                f"columns name {', '.join(asked)} of an orientation, and {', '.join(lacking)} is "
                "missing",
                hint="name all of them with `columns`",
                parameter="columns",
                value=asked[0],
            )
    return ()


def sees_pixels(
    header: Sequence[str], columns: Mapping[str, str], joints: Sequence[str] = ()
) -> bool:
    """Whether positions are the columns u and v, because none is named x, y or z."""
    others = set(_POSITION) & {*header, *columns}
    return not others and set(PIXELS.values()) <= {*header} - {*joints}


def parse_columns(text: str) -> dict[str, str]:
    """Read other names of columns as typed, such as `x=cam_u,y=cam_v`."""
    mapping: dict[str, str] = {}
    for item in text.split(","):
        name, equals, column = (part.strip() for part in item.partition("="))
        if not (name and equals and column):
            raise OptionError(f"columns {text!r}: expected NAME=COLUMN such as x=cam_u,y=cam_v")
        if name in mapping:
            raise OptionError(f"columns {text!r}: {name!r} is given twice")
        mapping[name] = column
    return mapping


def check_names(names: Sequence[str]) -> None:
    """Refuse joints that are named twice or like a position."""
    for name in names:
        if name in _POSITION[:2]:
            raise OptionError(f"a joint named {name!r} cannot be told from the position {name!r}")
        if names.count(name) > 1:
            raise OptionError(f"joint {name!r} is given {names.count(name)} times")


def _joint_names(source: Source, arm: Arm | None, joints: Sequence[str] | None) -> tuple[str, ...]:
    if isinstance(joints, str):
        joints = [name.strip() for name in joints.split(",")]
    if arm is not None:
        names = tuple(arm.joint_names)
        if joints is not None and set(joints) != set(names):
            raise OptionError(f"joints {list(joints)}: the arm was loaded with {list(names)}")
    elif joints:
        names = tuple(joints)
    else:
        others = [repr(name) for name in source.header if name not in _POSITION]
        raise OptionError(
            f"{source.label}: which columns are the joints, base to tip? choices: "
            f"{', '.join(others) or 'none, there are only positions'}",
            hint="name them in `joints`",
            parameter="joints",
        )
    check_names(names)
    return names


QUATERNION = ("qx", "qy", "qz", "qw")
_POSE = (*_POSITION, "rx", "ry", "rz")
COVARIANCE = tuple(f"cov_{a}_{b}" for k, a in enumerate(_POSE) for b in _POSE[k:])
"""Columns of a pose's covariance: its upper triangle, row by row, of position [unit] and of a small
turn [rad] about the sensor's axes, `cov_x_x`, `cov_x_y`, .. `cov_rz_rz`."""

_ANGLES = ("roll", "pitch", "yaw")
#: A quaternion's length may differ from 1 by this much: files round to a few digits.
ROUNDING = 0.01
#: Roll, pitch and yaw beyond it [rad] are in another unit.
_MOST = 2 * np.pi + 0.1


def log_columns(
    joints: Sequence[str],
    q: Array,
    x: Array,
    quaternion: Array | None = None,
    covariance: Array | None = None,
) -> dict[str, Array]:
    """Columns of a log by name: joints, positions, orientation and its covariance, if known."""
    columns = dict(zip(joints, q.T, strict=True)) | dict(zip(_POSITION, x.T, strict=False))
    if quaternion is not None:
        columns |= dict(zip(QUATERNION, quaternion.T, strict=True))
    if covariance is not None:
        row, column = np.triu_indices(6)
        columns |= dict(zip(COVARIANCE, covariance[:, row, column].T, strict=True))
    return columns


def covariances(values: Array, label: str, rows: Sequence[int]) -> Array:
    """Covariances (n, 6, 6) of their upper triangles (n, 21); `rows` are numbers in the file.

    Raises LogError if one is no covariance.
    """
    made = np.empty((len(values), 6, 6))
    row, column = np.triu_indices(6)
    made[:, row, column] = made[:, column, row] = values
    low, high = np.linalg.eigvalsh(made)[:, [0, -1]].T
    if (wrong := ~(low >= -1e-6 * np.abs(high))).any():
        raise LogError(
            f"{label}, row {rows[int(np.argmax(wrong))]}: {COVARIANCE[0]} .. {COVARIANCE[-1]} are "
            "no covariance, expected the upper triangle of a matrix without negative variances"
        )
    return made


def from_angles(angles: Array) -> Array:
    """Unit quaternions (n, 4) of roll, pitch and yaw (n, 3) [rad].

    As in URDF: turns about the fixed x, then y, then z axis.

    Raises LogError if they are beyond a turn: they are in degrees.
    """
    most = float(np.abs(angles).max(initial=0.0))
    if most > _MOST:
        raise LogError(
            f"roll, pitch and yaw reach {most:.4g}, in rad more than a turn",
            hint="convert them to rad, or give `degrees=True` if all angles are in degrees",
            parameter="degrees",
        )
    x, y, z = (exponential(angles[:, k, None] * np.eye(3)[k]) for k in range(3))
    return quaternion_of(z @ y @ x)
