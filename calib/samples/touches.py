"""Touches: logs whose rows say in which socket the tip was, where no sensor measured a position."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

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
    called: Mapping[str, str],
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
    q, rows = source.numbers([called.get(name, name) for name in names])
    q = np.where(revolute, np.deg2rad(q), q) if degrees else q
    texts, axes = (
        [called.get(n, n) for n in some] for some in (("setup", "point"), POSITION)
    )
    table = source.read([name for name in texts if name in source.header]).fill_null("")
    told = [table[n] if n in table.columns else [""] * len(q) for n in texts]
    pairs = [(str(setup), str(point)) for setup, point in zip(*told, strict=True)]
    stated = np.full((len(q), 3), np.nan)
    if {*axes} <= {*source.header}:
        if unit not in METRES:
            words = f"{source.label}: x, y, z of touches in {unit}"
            raise LogError(f"{words}, expected {listed(METRES)}")
        stated = source.numbers(axes)[0] / METRES[unit]
    touched = np.array([bool(point) for _, point in pairs])
    good = np.isfinite(q).all(axis=1) & (touched | np.isfinite(stated).all(axis=1))
    if not (good & touched).any():
        raise LogError(f"{source.label} has no row with all joints and a point")
    lower = q[good].min(axis=0) - 1e-9
    upper = q[good].max(axis=0) + 1e-9
    if arm is not None:
        limits = (arm.joint_names, arm.lower, arm.upper, arm.revolute)
        check_joint_values(q, *limits, degrees=degrees, label=source.label)
        lower = np.minimum(arm.lower, lower)
        upper = np.maximum(arm.upper, upper)
    sockets = tuple(sorted({pairs[k] for k in np.flatnonzero(good & touched)}))
    number = np.array(
        [sockets.index(p) if p in sockets else -1 for p in pairs], dtype=np.intp
    )
    q = q[good]
    stated = stated[good]
    number = number[good]
    spots = [stated[number == k][0] for k in range(len(sockets))]
    known = (
        tuple(  # distances of points whose coordinates are stated, within each setup
            Known((i, j), float(np.linalg.norm(spots[i] - spots[j])))
            for i, j in combinations(range(len(sockets)), 2)
            if sockets[i][0] == sockets[j][0]
            and np.isfinite([spots[i], spots[j]]).all()
        )
    )
    touches = Touches(number, sockets, known)
    few = [
        " ".join(s).strip()
        for k, s in enumerate(sockets)
        if (number == k).sum() < _LEAST
    ]
    notes = [f"fewer than {_LEAST} postures touch {listed(few)}"] if few else []
    if len(sockets) == 1:
        notes.append(
            "one socket tells little of the arm elsewhere: touch another, far from it"
        )
    x = np.zeros((len(q), 3)) if arm is None else touches.means(arm.forward(q))[number]
    x = np.where((number >= 0)[:, None], x, stated)
    return Samples(
        q,
        x,
        names,
        lower,
        upper,
        tuple(revolute),
        dropped=int((~good).sum()),
        arm=arm,
        touch=touches,
        columns=dict(called),
        degrees=degrees,
        notes=tuple(notes),
        rows=rows[good],
    )
