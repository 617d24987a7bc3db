"""Refusals: joints and poses that are not those of the pictures, with the remedy.

Joints whose unit, order or sign is another than stated are refused, and so are an eye or a board
that the pictures contradict, and rows of poses that are those of other pictures.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations
from math import radians
from operator import attrgetter

import numpy as np

from ..arm.rigid import rigid, turn_of
from ..arm.rotations import logarithm, nearest_rotation
from ..body.spatial import SpatialStructure
from ..common.arrays import Array
from ..common.rows import spread_rows
from ..common.wording import two_digits
from ..errors import LogError
from ..samples.findings import ONLY_IF, Finding, interpretations
from ..samples.settings import DIAGNOSIS
from .board_pictures import View
from .pose_files import FlangeTable
from .readings import Choice, choose
from .start import RigStart, find_start, find_starts


@dataclass(frozen=True)
class RefusalLimits:
    """Limits beyond which joints or poses are refused."""

    # misfit of other rows, or of another reading of joints, over the stated ones', below which they
    # are the right ones
    clear: float = 0.4
    # rms turn about a second axis that flange poses need [deg]
    turn: float = 1.0
    # misfit of the median picture, beyond which poses are not of the pictures [rad]
    misfit: float = radians(5.0)
    few: int = 10  # most pictures of which each two poses are tried exchanged
    # misfit of two exchanged poses, over the stated ones', below which they are refused: of many
    # pairs one always fits somewhat better (2.6 to 3.9 times where the hand turned about one axis
    # alone), the right one 30 to 500 times
    exchanged: float = 0.1
    # misfit beyond which other readings of joints are tried [rad], and on how many pictures
    far: float = radians(1.5)
    tried: int = 10
    # largest misfit of a reading of joints that explains the pictures: the right one left up to
    # 5.3 deg, the best one of joints that are wrong in two ways 11 deg and more
    unexplained: float = radians(8.0)
    most: float = 4 * np.pi  # angle that no joint reaches [rad]
    size: float = 0.05  # largest relative error of a print's size


REFUSAL_LIMITS = RefusalLimits()


def refuse_readings(structure: SpatialStructure, view: View) -> None:
    """Refuse joints, an eye or a board of which another reading explains the pictures far better.

    structure : of the arm as it is drawn
    """
    base = structure.with_sensor(view="base")
    neutral = structure.neutral()
    q = view.q

    def flanges(values: Array) -> Array:
        places, turns = base.pose(values, neutral)
        return rigid(turns, places)

    usual = find_start(flanges(q), view)
    is_board = abs(np.expm1(usual.size)) < REFUSAL_LIMITS.size
    if usual.misfit < REFUSAL_LIMITS.far and is_board:
        return

    # the reading that explains some of the pictures far better
    rows = spread_rows(len(q), REFUSAL_LIMITS.tried)
    thinned = replace(view, boards=view.boards[rows])
    other_eye = replace(thinned, eye=view.other_eye)
    others = list(_others(structure, view))
    values = np.concatenate([joints[rows] for joints, _ in others])
    poses = flanges(values).reshape(len(others), len(rows), 4, 4)
    starts = find_starts(poses[:1], other_eye, "m")  # the eye is the first
    starts += find_starts(poses[1:], thinned, "m")
    least = usual.misfit
    best = None
    for start, (_, finding) in zip(starts, others, strict=True):
        # values of many turns are degrees, whatever else is wrong
        is_sure = (
            finding.kind == "degrees" and np.abs(q).max() > REFUSAL_LIMITS.most
        )
        explains = start.misfit < REFUSAL_LIMITS.unexplained or is_sure
        if explains and start.misfit < REFUSAL_LIMITS.clear * least:
            least = start.misfit
            best = finding
    if best is not None:
        hint = best.hint
        if best.kind == "exchanged":
            hint = "correct the header of the joints"
        words = best.words.removeprefix(ONLY_IF)
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
    """Other readings of the joints, the simplest first: joints (p, dof) and what they mean."""
    q = view.q
    names = structure.joint_names
    where = "stands still" if view.in_hand else "is in the hand"
    hint = f"give `eye={view.other_eye!r}`"
    yield q, Finding("eye", f"the camera {where}", hint)
    late = Finding(
        "late",
        "they are a row late or early",
        "check which row is of which picture",
    )
    units, orders, one, two = interpretations(
        q,
        names,
        structure.revolute,
        any_order=len(names) <= DIAGNOSIS.most_ordered,
    )
    yield from units
    for k in np.flatnonzero(structure.revolute):
        mixed = q.copy()
        mixed[:, k] = np.deg2rad(q[:, k])
        words = f"{names[k]} alone is in degrees"
        yield mixed, Finding("degrees", words, "convert its column to rad")
    for by in (-1, 1):
        yield np.roll(q, by, axis=0), late
    for group in (one, two, orders):
        yield from group


def refuse_poses(table: FlangeTable, choice: Choice, view: View) -> None:
    """Refuse poses that are mirrored, of other rows, not of the pictures, or about one axis."""
    start = choice.start
    refuse_mirrored(view, start)
    flange = choice.reading.flange[view.rows]
    shifted = np.stack([np.roll(flange, by, axis=0) for by in (1, -1)])
    best = min(find_starts(shifted, view, start.unit), key=attrgetter("misfit"))
    words = "late or early: those of the row before or behind"
    is_better = best.misfit < REFUSAL_LIMITS.clear * start.misfit
    is_doubtful = is_better or start.misfit > REFUSAL_LIMITS.misfit
    # of few pictures no fit leaves some out
    if is_doubtful and len(flange) <= REFUSAL_LIMITS.few:
        pair, exchanged = _exchanged(table, view)
        least = min(best.misfit, start.misfit)
        if exchanged.misfit < REFUSAL_LIMITS.exchanged * least:
            best = exchanged
            is_better = True
            words = (
                f"exchanged: those of {' and '.join(pair)}, each at the other,"
            )
    if is_better:
        raise LogError(
            f"the rows of poses are {words} fit each picture "
            f"{two_digits(start.misfit / best.misfit)} times better",
            hint="check which row is of which picture",
        )
    _refuse_one_axis(flange)
    if is_doubtful:
        raise LogError(
            "no convention explains the pictures: the rows of poses are not those of the "
            "pictures, perhaps a row late or early, or camera or board moved (misfit "
            f"{np.degrees(start.misfit):.2g} deg)"
        )


def _exchanged(table: FlangeTable, view: View) -> tuple[list[str], RigStart]:
    """The two pictures whose poses, exchanged, fit best, and where that begins."""
    starts: dict[tuple[int, int], RigStart] = {}
    for one, other in combinations(range(len(view.rows)), 2):
        rows = view.rows.copy()
        rows[[one, other]] = rows[[other, one]]
        starts[one, other] = choose(table, replace(view, rows=rows)).start
    pair = min(starts, key=lambda numbers: starts[numbers].misfit)
    return [view.names[k] for k in pair], starts[pair]


def refuse_mirrored(view: View, start: RigStart) -> None:
    """Refuse a board that the closed form puts behind the camera."""
    if start.size == -np.inf:
        raise LogError(
            f"the pictures of {view.name} are mirrored, or the poses' axes left-handed: turn that "
            "off in the camera's settings"
        )


def _refuse_one_axis(flange: Array) -> None:
    """Refuse poses (n, 4, 4) that turn about no second axis."""
    sizes = np.degrees(turning(flange)[0])
    if sizes[1] < REFUSAL_LIMITS.turn:
        words = "does not turn"
        if sizes[0] > REFUSAL_LIMITS.turn:
            words = "turns about one axis alone"
        raise LogError(
            f"the hand {words} (by {sizes[0]:.2g} deg, by {sizes[1]:.2g} about a second axis): "
            "where camera and board are is open",
            hint="add two pictures with the hand turned by 30 deg about each of two other axes",
        )


def turning(poses: Array) -> tuple[Array, Array]:
    """Rms turns (3,) [rad] of poses (n, 4, 4) about three axes (3, 3) of theirs, largest first."""
    turns = turn_of(poses)
    vectors = logarithm(nearest_rotation(turns.sum(axis=0)).T @ turns)
    vectors -= vectors.mean(axis=0)
    _, sizes, axes = np.linalg.svd(vectors, full_matrices=False)
    return sizes / np.sqrt(len(vectors)), axes
