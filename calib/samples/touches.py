"""Touches: logs whose rows say in which socket the tip was, where no sensor measured a position."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from ..common.arrays import Array, Index
from ..common.rows import finite_rows
from ..common.scale import METRES
from ..common.wording import listed
from ..errors import LogError
from .joint_values import check_joint_values
from .roles import joint_names
from .samples import POSITION, Samples
from .sockets import Known, Touches
from .tables import Source

if TYPE_CHECKING:
    from ..arm.arm import Arm

_LEAST = 8  # rows that tell a socket well


def read_touches(
    source: Source,
    arm: Arm | None,
    joints: Sequence[str] | None,
    column_of: Mapping[str, str],
    *,
    degrees: bool = False,
    unit: str = "m",
) -> Samples:
    """Read a log of touches: the joints' columns, `point`, and optionally `setup` and x, y, z.

    x, y, z [unit] are known coordinates of the point in its fixture's frame, which tell all its
    distances; in a row without a point they are what a sensor measured of the tip.  The samples'
    positions are where the drawing says that each socket is, zeros without a robot; a fit replaces
    them.
    Raises LogError if there are no rows, the robot moves in a plane, or the joints are in degrees.
    """
    if arm is not None and arm.outputs != 3:
        raise LogError(
            f"{source.label} holds touches: expected a robot that moves in space"
        )
    names = joint_names(source, arm, joints)
    revolute = arm.revolute if arm is not None else (True,) * len(names)
    q, rows = source.numbers([column_of.get(name, name) for name in names])
    if degrees:
        q = np.where(revolute, np.deg2rad(q), q)
    pairs = _setups_and_points(source, column_of, len(q))
    coordinates = _coordinates(source, column_of, len(q), unit)
    touched = np.array([bool(point) for _, point in pairs])
    measured = finite_rows(coordinates)
    sound = finite_rows(q) & (touched | measured)
    if not (sound & touched).any():
        raise LogError(f"{source.label} has no row with all joints and a point")
    lower = q[sound].min(axis=0) - 1e-9
    upper = q[sound].max(axis=0) + 1e-9
    if arm is not None:
        limits = (arm.joint_names, arm.lower, arm.upper, arm.revolute)
        check_joint_values(q, *limits, degrees=degrees, label=source.label)
        lower = np.minimum(arm.lower, lower)
        upper = np.maximum(arm.upper, upper)
    sockets = tuple(
        sorted({pairs[row] for row in np.flatnonzero(sound & touched)})
    )
    place = {socket: number for number, socket in enumerate(sockets)}
    number = np.array([place.get(pair, -1) for pair in pairs], dtype=np.intp)[
        sound
    ]
    q = q[sound]
    coordinates = coordinates[sound]
    touches = Touches(
        number, sockets, _fixture_distances(sockets, number, coordinates)
    )
    x = (
        np.zeros((len(q), 3))
        if arm is None
        else touches.means(arm.forward(q))[number]
    )
    few = [
        touches.name(socket)
        for socket in range(len(sockets))
        if np.count_nonzero(number == socket) < _LEAST
    ]
    notes = [f"fewer than {_LEAST} postures touch {listed(few)}"] if few else []
    if len(sockets) == 1:
        notes.append(
            "one socket tells little of the arm elsewhere: touch another, far from it"
        )
    return Samples(
        q,
        np.where(touches.touched[:, None], x, coordinates),
        names,
        lower,
        upper,
        tuple(revolute),
        arm=arm,
        touch=touches,
        rows=rows[sound],
        columns=dict(column_of),
        degrees=degrees,
        dropped=int((~sound).sum()),
        notes=tuple(notes),
    )


def _setups_and_points(
    source: Source, column_of: Mapping[str, str], count: int
) -> list[tuple[str, str]]:
    """Return setup and point of each row, empty where the table has none."""
    texts = []
    for name in ("setup", "point"):
        column = column_of.get(name, name)
        if column in source.header:
            cells = source.read([column])[column].fill_null("")
            texts.append([str(cell) for cell in cells])
        else:
            texts.append([""] * count)
    return list(zip(*texts, strict=True))


def _coordinates(
    source: Source, column_of: Mapping[str, str], count: int, unit: str
) -> Array:
    """Return x, y, z of each row (n, 3) [m], NaN where the table has none."""
    axes = [column_of.get(axis, axis) for axis in POSITION]
    if not {*axes} <= {*source.header}:
        return np.full((count, 3), np.nan)
    if unit not in METRES:
        raise LogError(
            f"{source.label}: x, y, z of touches in {unit}, expected {listed(METRES)}"
        )
    return source.numbers(axes)[0] / METRES[unit]


def _fixture_distances(
    sockets: Sequence[tuple[str, str]], number: Index, coordinates: Array
) -> tuple[Known, ...]:
    """Return the distances of points whose coordinates are stated, within each setup."""
    distances = []
    for i, j in combinations(range(len(sockets)), 2):
        apart = coordinates[number == i][0] - coordinates[number == j][0]
        if sockets[i][0] == sockets[j][0] and np.isfinite(apart).all():
            distances.append(Known((i, j), float(np.linalg.norm(apart))))
    return tuple(distances)
