"""Touches: logs whose rows say in which socket the tip was, where no sensor measured a position."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

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
    label = source.label
    if arm is not None and arm.outputs != 3:
        raise LogError(
            f"{label} holds touches: expected a robot that moves in space"
        )
    names = joint_names(source, arm, joints)
    q, rows = source.numbers([column_of.get(name, name) for name in names])
    revolute = arm.revolute if arm is not None else (True,) * len(names)
    if degrees:
        q = np.where(revolute, np.deg2rad(q), q)
    pairs = np.full((len(q), 2), "", dtype=object)
    for k, name in enumerate(("setup", "point")):
        column = column_of.get(name, name)
        if column in source.header:
            cells = source.read([column])[column].cast(str).fill_null("")
            pairs[:, k] = cells.to_list()
    x = np.full((len(q), 3), np.nan)
    axes = [column_of.get(axis, axis) for axis in POSITION]
    if {*axes} <= {*source.header}:
        if unit not in METRES:
            raise LogError(
                f"{label}: x, y, z of touches in {unit}, expected {listed(METRES)}"
            )
        x = source.numbers(axes)[0] / METRES[unit]
    touched = pairs[:, 1] != ""
    sound = finite_rows(q) & (touched | finite_rows(x))
    if not (sound & touched).any():
        raise LogError(f"{label} has no row with all joints and a point")
    q = q[sound]
    x = x[sound]
    lower = q.min(axis=0) - 1e-9
    upper = q.max(axis=0) + 1e-9
    if arm is not None:
        limits = (arm.joint_names, arm.lower, arm.upper, arm.revolute)
        check_joint_values(q, *limits, degrees=degrees, label=label)
        lower = np.minimum(arm.lower, lower)
        upper = np.maximum(arm.upper, upper)
    sockets = sorted(
        {(setup, point) for setup, point in pairs[sound & touched]}
    )
    place = {socket: number for number, socket in enumerate(sockets)}
    number = [place.get((setup, point), -1) for setup, point in pairs[sound]]
    touches = Touches(np.array(number, dtype=np.intp), tuple(sockets))
    # points whose coordinates are stated are apart by so much, within each setup
    stated = touches.means(x, median=True)
    facts = []
    for i, j in combinations(range(len(sockets)), 2):
        apart = float(np.linalg.norm(stated[i] - stated[j]))
        if sockets[i][0] == sockets[j][0] and np.isfinite(apart):
            facts.append(Known((i, j), apart))
    drawn = np.zeros_like(stated)
    if arm is not None:
        drawn = touches.means(arm.forward(q))
    return Samples(
        q,
        touches.placed(x, drawn),
        names,
        lower,
        upper,
        tuple(revolute),
        arm=arm,
        touch=touches.with_facts(facts),
        rows=rows[sound],
        columns=dict(column_of),
        degrees=degrees,
        dropped=int((~sound).sum()),
    )
