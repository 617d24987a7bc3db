"""Touches: logs whose rows say in which socket the tip was, where no sensor measured a position."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from ..common.scale import METRES
from ..common.wording import listed
from ..errors import LogError
from .columns import Source, read_columns, read_texts
from .joint_values import check_joint_values
from .samples import Samples
from .sockets import Known, Touches

if TYPE_CHECKING:
    from ..arm.arm import Arm

_LEAST = 8  # rows that tell a socket well
_ALIKE = 0.05  # joints that moved less [rad or m] show one posture


def read_touches(
    source: Source,
    names: Sequence[str],
    arm: Arm | None,
    columns: Mapping[str, str],
    *,
    revolute: Sequence[bool],
    degrees: bool = False,
    unit: str | None = None,
) -> Samples:
    """Read a log of touches: the joints' columns, `point`, and optionally `setup` and x, y, z.

    x, y, z [unit, m by default] are known coordinates of the point in its fixture's frame, which
    tell all its distances; in a row without a point they are what a sensor measured of the tip.
    The samples' positions are where the drawing says that each socket is, zeros without a robot; a
    fit replaces them.
    Raises LogError if there are no rows, the robot moves in a plane, or the joints are in degrees.
    """
    if arm is not None and arm.outputs != 3:
        raise LogError(f"{source.label} holds touches: expected a robot that moves in space")
    q = read_columns(source, [columns.get(name, name) for name in names], lenient=True)
    place = [columns.get(name, name) for name in ("setup", "point")]
    texts = read_texts(source, [name for name in place if name in source.header])
    given = [texts[name].to_list() if name in texts.columns else [""] * len(q) for name in place]
    pairs = [(str(a or ""), str(b or "")) for a, b in zip(*given, strict=True)]
    stated, axes = np.full((len(q), 3), np.nan), [columns.get(axis, axis) for axis in "xyz"]
    if all(axis in source.header for axis in axes):
        if (unit := unit or "m") not in METRES:
            words = f"{source.label}: x, y, z of touches in {unit}"
            raise LogError(f"{words}, expected {listed(METRES)}")
        stated = read_columns(source, axes, lenient=True) / METRES[unit]
    q = np.where(revolute, np.deg2rad(q), q) if degrees else q
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
    touches, names_of = Touches(number, sockets, known), [" ".join(s).strip() for s in sockets]
    few = [name for k, name in enumerate(names_of) if (number == k).sum() < _LEAST]
    alike = [
        name for k, name in enumerate(names_of) if np.ptp(q[number == k], axis=0).max() < _ALIKE
    ]
    doubts = {
        f"fewer than {_LEAST} postures touch {listed(few)}: 20 and more, with the wrist turned "
        "each way, tell much more": bool(few),
        f"the postures at {listed(alike)} are all alike, which tells nothing there": bool(alike),
        "one socket tells little of the arm elsewhere: touch another, at a known distance": (
            len(sockets) == 1
        ),
    }
    notes = [words for words, doubted in doubts.items() if doubted]
    lower, upper, x = q.min(axis=0) - 1e-9, q.max(axis=0) + 1e-9, np.zeros((len(q), 3))
    if arm is not None:
        lower, upper = np.minimum(arm.lower, lower), np.maximum(arm.upper, upper)
        x = touches.means(arm.forward(q))[number]
    x[~touched] = stated[~touched]
    return Samples(
        q, x, tuple(names), lower, upper,
        tuple(revolute), "m", dropped=int((~good).sum()), arm=arm, touch=touches,
        notes=tuple(notes), columns=dict(columns), degrees=degrees,
        rows=np.flatnonzero(good) + 1,
    )  # fmt: skip
