"""Whether joints are what they are said to be: how well other readings explain the pictures."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ..body.spatial import SpatialStructure
from ..common.arrays import Array
from ..common.rows import thinned
from ..errors import LogError
from ..samples.diagnosis import Finding, readings
from ..samples.settings import DIAGNOSIS
from .board import Pattern
from .rigid import rigid
from .start import BoardPoses, find_start

# of the misfit: another reading of the joints explains the pictures better
_CLEAR = 0.4
_FAR = np.radians(1.5)  # misfit beyond which other readings are tried
_TRIED = 10  # pictures that these are tried on
_MISSAID = 0.05  # of a board's size, that no print is off by


def refuse_readings(
    structure: SpatialStructure, q: Array, seen: BoardPoses, board: Pattern
) -> None:
    """Refuse joints, an eye or a board of which another reading explains the pictures far better.

    q : (p, dof), joint values of the pictures [rad or m]
    """
    base = structure.with_view("base")
    neutral = structure.neutral()

    def misfit(values: Array, sight: BoardPoses) -> tuple[float, float]:
        places, turns = base.pose(values, neutral)
        start = find_start(rigid(turns, places), sight, "m")
        return start.misfit, start.size

    own, size = misfit(q, seen)
    if own < _FAR and abs(np.expm1(size)) < _MISSAID:
        return
    some = thinned(len(q), _TRIED)
    few = seen.take(some)
    best = own
    words = ""
    hint = ""
    for values, finding in _others(structure, q, seen):
        sight = (
            replace(few, in_hand=not few.in_hand)
            if finding.kind == "eye"
            else few
        )
        there, _ = misfit(values[some], sight)
        if there < _CLEAR * best:
            best = there
            words = finding.words
            hint = finding.hint
            if finding.kind == "exchanged":
                hint = "correct the header of the joints"
    if words:
        raise LogError(
            f"the pictures fit the joints only if {words}", hint=hint
        )
    if abs(np.expm1(size)) > _MISSAID and len(structure.joint_names) > 2:
        side = f"{1e3 * board.points().max():.4g} mm"
        raise LogError(
            "by the arm's motions the board's squares measure otherwise than said, by more than "
            f"any print is off (corners span {side} as said)",
            hint="degrees, order, signs, rows late and the eye were tried: check the board's "
            "squares, the focal length, that it is this robot, and that the joints are angles and "
            "no shares of the motors' range",
        )


def _others(
    structure: SpatialStructure, q: Array, seen: BoardPoses
) -> Iterator[tuple[Array, Finding]]:
    """Other readings of the joints, the simplest first."""
    names = structure.joint_names
    eye, where = (
        ("base", "stands still") if seen.in_hand else ("hand", "is in the hand")
    )
    yield q, Finding("eye", f"the camera {where}", f"give `eye={eye!r}`")
    late = Finding(
        "late",
        "they are a row late or early",
        "check which row is of which picture",
    )
    units, orders, one, two = readings(
        q,
        names,
        structure.revolute,
        any_order=len(names) <= DIAGNOSIS.most_ordered,
    )
    yield from units
    for by in (-1, 1):
        yield np.roll(q, by, axis=0), late
    for group in (one, two, orders):
        yield from group
