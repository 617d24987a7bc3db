"""From pictures and motions to the problem that is fitted: lenses, starts, priors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..arm.arm import SpatialArm
from ..arm.rotations import logarithm, nearest_rotation
from ..body.spatial import structure_of
from ..common.arrays import Array, Index, Mask
from ..common.scale import METRES
from ..errors import LogError
from .agreement import Problem, lens_scales
from .board_pictures import BoardPictures
from .bundle import (
    LENS,
    Bundle,
    GivenPoses,
    Motions,
    Noise,
    Scale,
    Shots,
    Unknowns,
    poses_of,
)
from .conventions import Convention, Reading, Seen, Start, choose, readings, solve
from .flange_table import FlangeTable
from .joint_motions import JointMotions
from .lens import Lens
from .lens_files import UNSTATED
from .readings import refuse_readings
from .reference import turns_and_shifts

_CORNER = 1.0  # [px], where the noise of corners begins
_BENT = 5e-3  # half diagonals: where the heights of a board begin,
_BENT_WITHIN = (
    1e-5,
    5e-2,
)  # and between which they are found; paper bends by 1 to 2 mm
_STRETCHED = 5e-4
_STRETCHED_WITHIN = (1e-6, 5e-3)
_PRINTED = 3e-3  # of its size that a print is off by; beyond, as the evidence says
_PRINTED_WITHIN = (3e-3, 0.5)
_LEAST_TURN = np.radians(1.0)  # rms, about a second axis
_MISSAID = 0.3  # log of a board's size over the said one, that is none
_GIVEN = np.array(
    [3e-4, 1e-3]
)  # [rad, m], where the noise of a controller's poses begins,
_JOINTED = np.array([3e-5, 3e-5])  # and that of joints


@dataclass(frozen=True, eq=False)
class View:
    """The pictures of one camera, its lens and the board before it."""

    name: str
    shots: BoardPictures
    in_hand: bool
    known: Lens | None
    lens: Lens  # where the fit begins
    boards: Array  # (p, 4, 4), before the camera, by each picture alone [m]
    rows: Index  # (p,), of the joints or poses
    doubts: tuple[str, ...] = ()

    @staticmethod
    def of(name: str, shots: BoardPictures, in_hand: bool, known: Lens | None) -> View:
        """The view, its lens calibrated by its own pictures where it is not known."""
        if known is not None and tuple(known.size) == UNSTATED:
            known = replace(known, size=shots.size)
        if known is not None and tuple(known.size) != tuple(shots.size):
            given = "{}x{}".format(*known.size)
            size = "{}x{}".format(*shots.size)
            raise LogError(
                f"the lens is of pictures of {given}, these are {size}: expected the lens of this "
                "camera at this size; leave `lens` out to have it fitted"
            )
        lens, doubts = shots.lens(known)
        boards = poses_of(*turns_and_shifts(shots.poses(lens)))
        rows = np.arange(len(boards)) if shots.rows is None else shots.rows
        return View(name, shots, in_hand, known, lens, boards, rows, doubts)

    @property
    def seen(self) -> Seen:
        """The board before the camera."""
        points = self.shots.board.points()
        low = points.min(axis=0)
        high = points.max(axis=0)
        ends = np.array(
            [[x, y, 0.0] for x in (low[0], high[0]) for y in (low[1], high[1])]
        )
        return Seen(self.boards, ends, self.shots.board.half_turn, self.in_hand)

    def turned(self, others: Mask) -> View:
        """The view with the board of some pictures numbered from its other end."""
        half = self.shots.board.half_turn
        if half is None or not others.any():
            return self
        boards = np.where(others[:, None, None], self.boards @ half, self.boards)
        return replace(self, shots=self.shots.turned(others), boards=boards)

    def corners(self, rows: Index) -> Shots:
        """The corners, for a fit of the motions at some rows."""
        places = tuple(np.array([*shown.values()]) for shown in self.shots.corners)
        motion = np.searchsorted(rows, self.rows)
        outline = self.shots.board.points()
        return Shots(tuple(self.shots.points), places, motion, self.in_hand, outline)


@dataclass(frozen=True, eq=False)
class Setting:
    """What is fitted, and what its motions mean."""

    views: tuple[View, ...]  # with the boards numbered alike
    rows: Index  # (n,), of joints or poses that some camera has a picture of
    problem: Problem
    arm: SpatialArm | None = None
    convention: Convention | None = None
    words: str = ""  # of the convention
    ties: tuple[str, ...] = ()  # conventions that fit as well
    start: Start | None = None  # the first camera's

    @property
    def motions(self) -> Motions:
        """The motions."""
        return self.problem.motions


def of_poses(
    table: FlangeTable,
    views: Sequence[View],
    unit: str | None,
    rotation: str | None,
    degrees: bool | None,
) -> Setting:
    """The problem of flange poses, whose convention is found."""
    most = max(range(len(views)), key=lambda k: len(views[k].rows))
    every = readings(table.numbers, table.named)
    own = [
        replace(reading, flange=reading.flange[views[most].rows]) for reading in every
    ]
    _refuse_one_axis(views[most])
    chosen, _, convention, ties = choose(own, views[most].seen, unit, rotation, degrees)
    flange = every[own.index(chosen)].flange.copy()
    flange[:, :3, 3] /= METRES[convention["unit"]]
    rows = _rows(views)
    setting = _setting(views, rows, GivenPoses(flange[rows]), _GIVEN)
    _refuse_late(setting, every, chosen, views[most])
    return replace(setting, convention=convention, words=chosen.words, ties=tuple(ties))


def _refuse_one_axis(view: View) -> None:
    """Refuse poses that turn about one axis alone: no place along it is told."""
    boards = view.boards
    half = view.seen.half_turn
    if (
        half is not None
    ):  # of both ends the one that is turned less against the first picture
        against = np.einsum("ij,nij->n", boards[0, :3, :3], boards[:, :3, :3])
        other = np.einsum("ij,nij->n", boards[0, :3, :3], (boards @ half)[:, :3, :3])
        boards = np.where((other > against)[:, None, None], boards @ half, boards)
    turns = boards[:, :3, :3]
    mean = nearest_rotation(turns.sum(axis=0))
    vectors = logarithm(mean.T @ turns)
    sizes = np.linalg.svd(vectors - vectors.mean(axis=0), compute_uv=False) / np.sqrt(
        len(turns)
    )
    if sizes[1] < _LEAST_TURN:
        raise LogError(
            f"the hand turns about one axis alone (by {np.degrees(sizes[0]):.2g} deg, by "
            f"{np.degrees(sizes[1]):.2g} about a second): where camera and board are along it is "
            "open",
            hint="add two pictures with the hand turned by 30 deg about each of two other axes",
        )


def of_joints(arm: SpatialArm, views: Sequence[View]) -> Setting:
    """The problem of joints and a drawn arm."""
    rows = _rows(views)
    q = np.zeros((len(rows), arm.dof))
    for view in views:
        q[np.searchsorted(rows, view.rows)] = view.shots.q
    motions = JointMotions(structure_of(arm, "pose"), q)
    first = views[0]
    refuse_readings(motions.structure, first.shots.q, first.seen, first.shots.board)
    return replace(_setting(views, rows, motions, _JOINTED), arm=arm)


def _rows(views: Sequence[View]) -> Index:
    return np.unique(np.concatenate([view.rows for view in views]))


def _refuse_late(
    setting: Setting, every: Sequence[Reading], chosen: Reading, view: View
) -> None:
    """Refuse poses that fit the pictures far better a row late or early."""
    start = setting.start
    if start is None or start.misfit < np.radians(2.0):
        return
    for by, word in ((-1, "late"), (1, "early")):
        moved = [
            replace(r, flange=np.roll(r.flange, by, axis=0)[view.rows]) for r in every
        ]
        if choose(moved, view.seen)[1].misfit < 0.3 * start.misfit:
            raise LogError(
                f"the pictures fit the poses only if these are a row {word}",
                hint="check which row is of which picture",
            )
    rng = np.random.default_rng(0)
    shuffled = [
        solve(chosen.flange[rng.permutation(len(view.rows))], view.seen).misfit
        for _ in range(8)
    ]
    usual = float(np.median(shuffled))
    if start.misfit > 0.2 * usual:
        raise LogError(
            "no convention explains the pictures: the rows of poses are not those of the "
            f"pictures, or camera or board moved (misfit {np.degrees(start.misfit):.2g} deg; of "
            f"shuffled rows {np.degrees(usual):.2g})"
        )


def _setting(
    views: Sequence[View], rows: Index, motions: Motions, noise: Array
) -> Setting:
    """The problem, from a closed form of each camera."""
    flange = motions.poses(np.zeros(motions.size))
    starts = []
    first: dict[bool, Start] = {}
    numbered = []
    for view in views:
        own = flange[np.searchsorted(rows, view.rows)]
        start = solve(own, view.seen, unit="m")
        if abs(start.size) > _MISSAID:  # the motions do not tell lengths
            start = solve(own, view.seen, unit="m", sized=True)
        half = view.seen.half_turn
        other = first.setdefault(view.in_hand, start)
        turned = start.turned
        if half is not None and other is not start:
            board = start.board @ half
            if np.linalg.norm(board - other.board) < np.linalg.norm(
                start.board - other.board
            ):
                turned = ~turned
                start = replace(start, board=board)
        starts.append(start)
        numbered.append(view.turned(turned))
    shots = [view.corners(rows) for view in numbered]
    layout = Bundle(shots, motions, ()).layout
    mean = np.zeros(layout.values)
    prior = np.zeros(layout.values)
    scales: list[Scale] = []
    begin = np.zeros(layout.values)
    for k, view in enumerate(numbered):
        lens = layout.lens(k)
        mean[lens] = view.lens.parameters
        scales += _lens_prior(k, view, prior[lens[0] : lens[0] + LENS])
        begin[lens] = view.lens.parameters
        if view.known is None:
            mean[lens[4:]] = 0.0
    for number, in_hand in enumerate(layout.boards):
        shape = layout.shape(number)
        square = np.array([layout.square(number)])
        prior[shape[:-2]] = _BENT
        prior[shape[-2:]] = _STRETCHED
        size = float(np.clip(first[in_hand].size, -_MISSAID, _MISSAID))
        prior[square] = max(abs(size), _PRINTED)
        begin[square] = size if layout.arm == 0 else 0.0
        scales.append(Scale("heights", shape[:-2], *_BENT_WITHIN))
        scales.append(Scale("stretch", shape[-2:], *_STRETCHED_WITHIN))
        scales.append(Scale("square", square, *_PRINTED_WITHIN))
    if isinstance(motions, JointMotions):
        arm, sd = motions.scales(layout)
        scales += arm
        prior[layout.arm_values] = sd
    frames = [start.camera for start in starts]
    frames += [first[in_hand].board for in_hand in layout.boards]
    unknowns = Unknowns(np.array(frames), begin, np.zeros((motions.count, 6)))
    sizes = Noise(np.full(len(views), _CORNER), noise, prior)
    problem = Problem(tuple(shots), motions, tuple(scales), unknowns, sizes, mean)
    return Setting(tuple(numbered), rows, problem, start=starts[0])


def _lens_prior(number: int, view: View, prior: Array) -> list[Scale]:
    """Fill the prior sd (9,) of a lens; the sizes that the evidence finds."""
    focal = float(view.lens.focal.mean())
    width, height = view.shots.size
    reach = float(np.hypot(width, height)) / 2
    edge = reach / focal
    if view.known is None:
        prior[:2] = 0.3 * focal
        prior[2:4] = 0.05 * width
        prior[4] = 0.3 / edge**2
        prior[5] = 0.3 / edge**4
        prior[6:8] = 0.02 / edge
        prior[8] = 0.3 / edge**6
        scales = lens_scales(number, focal, reach, np.zeros(LENS))
        return scales[2:]
    sure = np.sqrt(np.maximum(np.diag(view.known.covariance), 0.0))
    scales = lens_scales(number, focal, reach, sure)
    for scale in scales:
        places = scale.indices - LENS * number
        prior[places] = max(scale.lowest, 1e-3 * scale.highest)
    return scales
