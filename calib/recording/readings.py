"""Readings: refuse joints that explain the pictures better in another unit, order or sign."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ..body.spatial import SpatialStructure
from ..common.arrays import Array
from ..common.rows import spread_rows
from ..errors import LogError
from ..samples.diagnosis import Finding, readings
from ..samples.settings import DIAGNOSIS
from .rigid import rigid
from .start import Start, find_start
from .view import View

# of the misfit: another reading of the joints explains the pictures better
_CLEAR = 0.4
_FAR = np.radians(1.5)  # misfit beyond which other readings are tried
_TRIED = 10  # pictures that these are tried on
_MISSAID = 0.05  # of a board's size, that no print is off by


def refuse_readings(structure: SpatialStructure, view: View) -> None:
    """Refuse joints, an eye or a board of which another reading explains the pictures far better.

    structure : of the arm as it is drawn
    """
    base = structure.with_sensor(view="base")
    neutral = structure.neutral()
    q = view.shots.q

    def start(values: Array, seen: View) -> Start:
        places, turns = base.pose(values, neutral)
        return find_start(rigid(turns, places), seen, "m")

    usual = start(q, view)
    is_board = abs(np.expm1(usual.size)) < _MISSAID
    if usual.misfit < _FAR and is_board:
        return
    some = spread_rows(len(q), _TRIED)
    few = replace(view, poses=view.poses[some])
    other_eye = replace(few, in_hand=not view.in_hand)
    best = usual.misfit
    words = ""
    hint = ""
    for values, finding in _others(structure, view):
        seen = other_eye if finding.kind == "eye" else few
        there = start(values[some], seen).misfit
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
    if not is_board and len(structure.joint_names) > 2:
        stated = 1e3 * view.board.side
        measured = stated * np.exp(usual.size)
        raise LogError(
            f"by the arm's motions the board's squares measure {measured:.3g} mm, {stated:.4g} mm "
            "as said: more than any print is off",
            hint="degrees, order, signs, rows late and the eye were tried: check the board's "
            "squares, the focal length, that it is this robot, the joints' zeros, and that joints "
            "are angles and no shares of the motors' range",
        )


def _others(
    structure: SpatialStructure, view: View
) -> Iterator[tuple[Array, Finding]]:
    """Other readings of the joints, the simplest first."""
    q = view.shots.q
    names = structure.joint_names
    eye = "hand"
    where = "is in the hand"
    if view.in_hand:
        eye = "base"
        where = "stands still"
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
