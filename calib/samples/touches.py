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
_ALIKE = 0.05  # joints that moved less [rad or m] show one posture


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
        raise LogError(f"{source.label} holds touches: expected a robot that moves in space")
    names = joint_names(source, arm, joints)
    revolute = arm.revolute if arm is not None else (True,) * len(names)
    columns = [called.get(name, name) for name in names]
    axes, texts = ([called.get(n, n) for n in some] for some in (POSITION, ("setup", "point")))
    axes = [axis for axis in axes if {*axes} <= {*source.header}]
    q, rows = source.numbers(columns)
    table = source.read([name for name in texts if name in source.header])
    empty = [""] * len(q)
    told = [table[name].fill_null("") if name in table.columns else empty for name in texts]
    pairs = [(str(setup), str(point)) for setup, point in zip(*told, strict=True)]
    q = np.where(revolute, np.deg2rad(q), q) if degrees else q
    stated = np.full((len(q), 3), np.nan)
    if axes:
        if unit not in METRES:
            words = f"{source.label}: x, y, z of touches in {unit}"
            raise LogError(f"{words}, expected {listed(METRES)}")
        stated = source.numbers(axes)[0] / METRES[unit]
    touched = np.array([bool(point) for _, point in pairs])
    good = np.isfinite(q).all(axis=1) & (touched | np.isfinite(stated).all(axis=1))
    if not (good & touched).any():
        raise LogError(f"{source.label} has no row with all joints and a point")
    if arm is not None:
        limits = (arm.joint_names, arm.lower, arm.upper, arm.revolute)
        check_joint_values(q, *limits, degrees=degrees, label=source.label)
    q, stated, touched = q[good], stated[good], touched[good]
    pairs = [pair for pair, stays in zip(pairs, good, strict=True) if stays]
    sockets = tuple(sorted({pair for pair in pairs if pair[1]}))
    number = np.array([sockets.index(p) if p[1] else -1 for p in pairs], dtype=np.intp)
    spots = [stated[number == k][0] for k in range(len(sockets))]
    known = tuple(  # distances of points whose coordinates are stated, within each setup
        Known((i, j), float(np.linalg.norm(spots[i] - spots[j])))
        for i, j in combinations(range(len(sockets)), 2)
        if sockets[i][0] == sockets[j][0] and np.isfinite([spots[i], spots[j]]).all()
    )
    touches, own = Touches(number, sockets, known), [q[number == k] for k in range(len(sockets))]
    few = [socket for socket, rows in zip(sockets, own, strict=True) if len(rows) < _LEAST]
    alike = [s for s, rows in zip(sockets, own, strict=True) if np.ptp(rows, axis=0).max() < _ALIKE]
    doubts = {
        f"fewer than {_LEAST} postures touch": few,
        "the postures are all alike, which tells nothing, at": alike,
        "one socket tells little of the arm elsewhere: touch another, at a known distance, than": (
            sockets if len(sockets) == 1 else ()
        ),
    }
    lower, upper, x = q.min(axis=0) - 1e-9, q.max(axis=0) + 1e-9, np.zeros((len(q), 3))
    if arm is not None:
        lower, upper = np.minimum(arm.lower, lower), np.maximum(arm.upper, upper)
        x = touches.means(arm.forward(q))[number]
    x[~touched] = stated[~touched]
    return Samples(
        q, x, names, lower, upper, tuple(revolute), "m",
        dropped=int((~good).sum()), arm=arm, touch=touches, columns=dict(called), degrees=degrees,
        notes=tuple(
            f"{words} {listed(' '.join(socket).strip() for socket in some)}"
            for words, some in doubts.items() if some
        ),
        rows=rows[good],
    )  # fmt: skip
