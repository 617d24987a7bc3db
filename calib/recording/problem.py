"""Problem: from pictures and motions to what is fitted, with starts and priors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..arm.arm import SpatialArm
from ..arm.rotations import logarithm, nearest_rotation
from ..body.spatial import structure_of
from ..common.arrays import Array, Index
from ..common.scale import METRES
from ..errors import LogError
from .agreement import Problem
from .bundle import Bundle, FlangePoses, Motions, Unknowns
from .conventions import Choice, Reading, choose, readings
from .fit import Estimate, Noise, Prior, Scale
from .flange_table import FlangeTable
from .joint_motions import JointMotions
from .readings import refuse_readings
from .start import MISSAID, Start, find_start
from .view import View


@dataclass(frozen=True)
class Priors:
    """Where sizes begin, and between which limits the evidence finds them."""

    corner: float = 1.0  # [px]
    # half diagonals of a board: paper bends by 1 to 2 mm
    bent: float = 5e-3
    bent_within: tuple[float, float] = (1e-5, 5e-2)
    stretched: float = 5e-4
    stretched_within: tuple[float, float] = (1e-6, 5e-3)
    # of its size that a print is off by; beyond, as the evidence says
    printed: float = 3e-3
    printed_within: tuple[float, float] = (3e-3, 0.5)
    controller: tuple[float, float] = (
        3e-4,
        1e-3,
    )  # of a controller's poses [rad, m]
    joints: tuple[float, float] = (3e-5, 3e-5)  # of joints [rad, m]
    focus: float = 2e-3  # of the focal length, from picture to picture


PRIORS = Priors()
LEAST_TURN = float(np.radians(1.0))
"""Rms turn about a second axis [rad] that flange poses need."""


@dataclass(frozen=True, eq=False)
class Setting:
    """What is fitted, and what its motions mean."""

    views: tuple[View, ...]  # with the boards numbered alike
    rows: Index  # (n,), of joints or poses that some camera has a picture of
    problem: Problem
    start: Start  # of the first camera
    arm: SpatialArm | None = None
    choice: Choice | None = None  # of poses

    @property
    def names(self) -> list[str]:
        """What the motions' pictures are called."""
        names = [""] * len(self.rows)
        for view in self.views:
            for place, name in zip(
                np.searchsorted(self.rows, view.rows),
                view.shots.names,
                strict=True,
            ):
                names[place] = names[place] or name
        return names


def of_joints(arm: SpatialArm, views: Sequence[View]) -> Setting:
    """The problem of joints and a drawn arm."""
    rows = _rows(views)
    q = np.zeros((len(rows), arm.dof))
    for view in views:
        q[np.searchsorted(rows, view.rows)] = view.shots.q
    motions = JointMotions(structure_of(arm, "pose"), q)
    first = views[0]
    refuse_readings(
        motions.structure, first.shots.q, first.boards, first.shots.board
    )
    return replace(_setting(views, rows, motions, PRIORS.joints), arm=arm)


def of_poses(
    table: FlangeTable,
    views: Sequence[View],
    unit: str | None,
    rotation: str | None,
    degrees: bool | None,
) -> Setting:
    """The problem of flange poses, whose convention is found.

    Raises LogError where they turn about one axis alone, or are not of the pictures.
    """
    most = max(views, key=lambda view: len(view.rows))
    _refuse_one_axis(most)
    ways = readings(table.numbers, table.named)
    choice = choose(ways, most.rows, most.boards, unit, rotation, degrees)
    _refuse_others(choice, ways, most)
    flange = choice.reading.flange.copy()
    flange[:, :3, 3] /= METRES[choice.convention["unit"]]
    rows = _rows(views)
    motions = FlangePoses(flange[rows])
    return replace(
        _setting(views, rows, motions, PRIORS.controller), choice=choice
    )


def _rows(views: Sequence[View]) -> Index:
    return np.unique(np.concatenate([view.rows for view in views]))


def _refuse_one_axis(view: View) -> None:
    """Refuse boards that turn about one axis alone: no place along it is told."""
    poses = view.poses
    half = view.shots.board.half_turn
    if half is not None:  # of both ends the one that is turned less
        first = poses[0, :3, :3]
        against = np.einsum("ij,nij->n", first, poses[:, :3, :3])
        other = np.einsum("ij,nij->n", first, (poses @ half)[:, :3, :3])
        poses = np.where((other > against)[:, None, None], poses @ half, poses)
    sizes, _ = turning(poses)
    if sizes[1] < LEAST_TURN:
        raise LogError(
            f"the hand turns about one axis alone (by {np.degrees(sizes[0]):.2g} deg, by "
            f"{np.degrees(sizes[1]):.2g} about a second): where camera and board are along it is "
            "open",
            hint="add two pictures with the hand turned by 30 deg about each of two other axes",
        )


def turning(poses: Array) -> tuple[Array, Array]:
    """Rms turns (3,) [rad] of poses (n, 4, 4) about three axes (3, 3) of theirs, largest first."""
    turns = poses[:, :3, :3]
    vectors = logarithm(nearest_rotation(turns.sum(axis=0)).T @ turns)
    _, sizes, axes = np.linalg.svd(
        vectors - vectors.mean(axis=0), full_matrices=False
    )
    return np.asarray(sizes / np.sqrt(len(vectors))), axes


def _refuse_others(choice: Choice, ways: Sequence[Reading], view: View) -> None:
    """Refuse mirrored pictures, and poses that fit far better a row late, early, or not at all."""
    misfit = choice.start.misfit
    flange = choice.reading.flange[view.rows]
    if (
        choice.start.size == -np.inf
    ):  # lengths along the picture count the other way
        unit = choice.convention["unit"]
        sized = find_start(flange, view.boards, unit=unit, sized=True)
        if sized.misfit > max(3.0 * misfit, np.radians(2.0)):
            raise LogError(
                "the pictures are mirrored: turn that off in the camera's settings"
            )
    if misfit < np.radians(2.0):
        return
    for by, word in ((-1, "late"), (1, "early")):
        moved = choose(
            ways, (view.rows - by) % len(choice.reading.flange), view.boards
        )
        if moved.start.misfit < 0.3 * misfit:
            raise LogError(
                f"the pictures fit the poses only if these are a row {word}",
                hint="check which row is of which picture",
            )
    rng = np.random.default_rng(0)
    shuffled = [
        find_start(rng.permutation(flange), view.boards) for _ in range(8)
    ]
    usual = float(np.median([start.misfit for start in shuffled]))
    if misfit > 0.2 * usual:
        raise LogError(
            "no convention explains the pictures: the rows of poses are not those of the "
            f"pictures, or camera or board moved (misfit {np.degrees(misfit):.2g} deg; of "
            f"shuffled rows {np.degrees(usual):.2g})"
        )


def _setting(
    views: Sequence[View],
    rows: Index,
    motions: Motions,
    errors: tuple[float, float],
) -> Setting:
    """The problem, which begins at a closed form of each camera; `errors` are the motions'."""
    flange = motions.poses(np.zeros(motions.size))
    starts: list[Start] = []
    numbered: list[View] = []
    boards: dict[bool, Start] = {}
    for view in views:
        start = _start(flange[np.searchsorted(rows, view.rows)], view)
        board = boards.setdefault(view.in_hand, start)
        start = _from_same_end(start, board, view.shots.board.half_turn)
        starts.append(start)
        numbered.append(view.turned(start.turned))
    bundle = Bundle(tuple(view.corners(rows) for view in numbered), motions)
    layout = bundle.layout
    mean = np.zeros(layout.size)
    begin = np.zeros(layout.size)
    sizes = np.full(layout.size, np.inf)
    scales: list[Scale] = []
    for number, view in enumerate(numbered):
        lens = layout.lens(number)
        begin[lens] = view.lens.parameters
        mean[lens] = view.lens.parameters
        if view.given is None:
            mean[lens[4:]] = 0.0
        sizes[lens] = _lens_sizes(view)
        scales += _lens_scales(view, lens)
    for number, in_hand in enumerate(layout.boards):
        shape = layout.shape(number)
        size = float(np.clip(boards[in_hand].size, -MISSAID, MISSAID))
        if not layout.arm:
            begin[shape[-1]] = size
        sizes[shape[:-3]] = PRIORS.bent
        sizes[shape[-3:-1]] = PRIORS.stretched
        sizes[shape[-1]] = max(abs(size), PRIORS.printed)
        scales.append(Scale("heights", shape[:-3], *PRIORS.bent_within))
        scales.append(Scale("stretch", shape[-3:-1], *PRIORS.stretched_within))
        scales.append(Scale("square", shape[-1:], *PRIORS.printed_within))
    if isinstance(motions, JointMotions):
        arm_scales, sizes[layout.arm_values] = motions.scales(layout)
        scales += arm_scales
    frames = [start.camera for start in starts]
    frames += [boards[in_hand].board for in_hand in layout.boards]
    none = np.zeros((motions.count, layout.errors))
    noise = Noise(
        corner=np.full(len(views), PRIORS.corner),
        turn=errors[0],
        shift=errors[1],
        focus=np.full(len(views), PRIORS.focus),
        prior=sizes,
    )
    estimate = Estimate(Unknowns(np.array(frames), begin, none), noise)
    problem = Problem(bundle, Prior(mean, tuple(scales)), estimate)
    return Setting(tuple(numbered), rows, problem, starts[0])


def _start(flange: Array, view: View) -> Start:
    start = find_start(flange, view.boards, unit="m")
    if abs(start.size) > MISSAID:  # the motions do not tell lengths
        start = find_start(flange, view.boards, unit="m", sized=True)
    return start


def _from_same_end(
    start: Start, other: Start, half_turn: Array | None
) -> Start:
    """A start with its board numbered from the end that another camera's is."""
    if half_turn is None or start is other:
        return start
    board = start.board @ half_turn
    if np.linalg.norm(board - other.board) > np.linalg.norm(
        start.board - other.board
    ):
        return start
    return replace(start, board=board, turned=~start.turned)


def _reach(view: View) -> float:
    """Tangent of the angle at which the corners of the picture appear."""
    return float(np.hypot(*view.shots.size)) / 2 / float(view.lens.focal.mean())


LENS_GROUPS = {
    "focal": slice(0, 2),
    "centre": slice(2, 4),
    "k1": slice(4, 5),
    "k2": slice(5, 6),
    "tangential": slice(6, 8),
    "k3": slice(8, 9),
}
"""Numbers of a lens that share a prior sd."""


def _lens_scales(view: View, places: Index) -> list[Scale]:
    """Priors of a lens whose sizes the evidence finds."""
    focal = float(view.lens.focal.mean())
    edge = _reach(view)
    most = [
        0.3 * focal,
        0.1 * edge * focal,
        edge**-2,
        edge**-4,
        0.05 / edge,
        edge**-6,
    ]
    sure = np.zeros(len(places))
    if view.given is not None:
        sure = np.sqrt(np.maximum(np.diag(view.given.covariance), 0.0))
    scales = []
    for (name, part), highest in zip(LENS_GROUPS.items(), most, strict=True):
        lowest = max(float(sure[part].max()), 1e-6 * highest)
        scales.append(Scale(name, places[part], lowest, highest))
    # the pictures alone tell focal length and centre of a lens that is not given
    return scales if view.given is not None else scales[2:]


def _lens_sizes(view: View) -> Array:
    """Prior sd (9,) of a lens, where they begin."""
    if view.given is not None:
        sizes = np.zeros(9)
        for scale in _lens_scales(view, np.arange(9)):
            sizes[scale.indices] = max(scale.lowest, 1e-2 * scale.highest)
        return sizes
    focal = 0.3 * float(view.lens.focal.mean())
    centre = 0.05 * view.shots.size[0]
    edge = _reach(view)
    bent = [
        0.3 * edge**-2,
        0.3 * edge**-4,
        0.02 / edge,
        0.02 / edge,
        0.3 * edge**-6,
    ]
    return np.array([focal, focal, centre, centre, *bent])
