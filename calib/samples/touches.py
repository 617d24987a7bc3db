"""Touches: logs whose rows say in which socket the tip was, where no sensor measured a position."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Mask
from ..common.wording import listed
from ..errors import LogError
from .columns import Source, read_columns, read_texts
from .samples import Samples
from .sockets import Known, Touches

if TYPE_CHECKING:
    from ..arm.arm import Arm

_LEAST = 8  # rows that tell a socket well


def is_touches(header: Sequence[str], columns: Mapping[str, str]) -> bool:
    """Whether a log's columns are those of touches."""
    return "point" in {*header, *columns}


def read_touches(
    source: Source,
    names: Sequence[str],
    arm: Arm | None,
    columns: Mapping[str, str],
    *,
    revolute: Sequence[bool],
    degrees: bool = False,
) -> Samples:
    """Read a log of touches: the joints' columns, `point`, and optionally `setup` and x, y, z.

    x, y, z [m] are known coordinates of the point in its fixture's frame: all its distances.
    The samples' positions are where the drawing says that each socket is, zeros without a robot; a
    fit replaces them.
    Raises LogError if there are no rows, or the robot moves in a plane.
    """
    if arm is not None and arm.outputs != 3:
        raise LogError(f"{source.label} holds touches: expected a robot that moves in space")
    q = read_columns(source, [columns.get(name, name) for name in names], lenient=True)
    place = [columns.get(name, name) for name in ("setup", "point")]
    texts = read_texts(source, [name for name in place if name in source.header])
    given = [texts[name].to_list() if name in texts.columns else [""] * len(q) for name in place]
    pairs = [(str(a or ""), str(b or "")) for a, b in zip(*given, strict=True)]
    q = np.where(revolute, np.deg2rad(q), q) if degrees else q
    good = np.isfinite(q).all(axis=1) & np.array([bool(point) for _, point in pairs])
    if not good.any():
        raise LogError(f"{source.label} has no row with all joints and a point")
    pairs, q = [pair for pair, stays in zip(pairs, good, strict=True) if stays], q[good]
    sockets = tuple(sorted(dict.fromkeys(pairs)))
    number = np.array([sockets.index(pair) for pair in pairs], dtype=np.intp)
    touches = Touches(number, sockets, _coordinates(source, columns, good, number, sockets))
    lower, upper, x = q.min(axis=0) - 1e-9, q.max(axis=0) + 1e-9, np.zeros((len(q), 3))
    if arm is not None:
        lower, upper = np.minimum(arm.lower, lower), np.maximum(arm.upper, upper)
        x = touches.means(arm.forward(q))[number]
    rows = np.flatnonzero(good) + 1
    return Samples(
        q, x, tuple(names), lower, upper,
        tuple(revolute), "m", dropped=int((~good).sum()), arm=arm, touch=touches,
        notes=tuple(_doubts(touches)), columns=dict(columns), degrees=degrees, rows=rows,
    )  # fmt: skip


def _coordinates(
    source: Source,
    columns: Mapping[str, str],
    good: Mask,
    number: NDArray[np.intp],
    sockets: Sequence[tuple[str, str]],
) -> tuple[Known, ...]:
    """Distances of the points whose coordinates a log states, within each setup."""
    axes = [columns.get(axis, axis) for axis in "xyz"]
    if not all(axis in source.header for axis in axes):
        return ()
    stated = read_columns(source, axes, lenient=True)[good]
    place = {k: stated[number == k][0] for k in range(len(sockets))}
    return tuple(
        Known((i, j), float(np.linalg.norm(place[i] - place[j])))
        for i, j in combinations(range(len(sockets)), 2)
        if sockets[i][0] == sockets[j][0] and np.isfinite([place[i], place[j]]).all()
    )


def _doubts(touches: Touches) -> list[str]:
    """What some sockets hardly tell."""
    counts = np.bincount(touches.number, minlength=len(touches.sockets))
    few = [" ".join(s).strip() for s, n in zip(touches.sockets, counts, strict=True) if n < _LEAST]
    notes = []
    if few:
        notes.append(
            f"fewer than {_LEAST} postures touch {listed(few)}: 20 and more, with the wrist turned "
            "each way, tell much more"
        )
    if len(touches.sockets) == 1:
        notes.append(
            "one socket tells little of the arm elsewhere: touch another, at a known distance"
        )
    return notes
