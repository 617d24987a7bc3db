"""Problem: from pictures and motions to what is fitted, with starts and priors."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import radians

import numpy as np

from ..arm.arm import SpatialArm
from ..arm.description import parse_robot
from ..body.spatial import structure_of
from ..common.arrays import Array, Index, Mask
from ..common.scale import METRES
from ..common.wording import listing
from ..errors import LogError
from ..samples.motion import label_numbers, pose_index
from .board import LEAST_PICTURES
from .board_pictures import View
from .bundle import Bundle, CornerLayout, Motions, Unknowns, shape_slopes
from .fit import CornerFit, CornerPrior, Noise, PriorScale, fit_corners
from .joint_motions import JointMotions
from .pose_files import FlangeTable
from .readings import Choice, choose
from .refusals import refuse_mirrored, refuse_poses, refuse_readings
from .start import RigStart, board_misfits, find_start


@dataclass(frozen=True)
class Priors:
    """Initial sds of a fit, and the limits between which the evidence finds them."""

    corner: float = 1.0  # [px]
    # bends [half diagonals of a board]: start, lowest, highest; paper bends by 1 to 2 mm
    bent: tuple[float, float, float] = (5e-3, 1e-5, 5e-2)
    # stretch and shear [half diagonals]: start, lowest, highest
    stretched: tuple[float, float, float] = (5e-4, 1e-6, 5e-3)
    # log of the board's size over the stated one: lowest, highest
    printed: tuple[float, float] = (3e-3, 0.5)
    # turn [rad] and shift [m] of a motion.  A turn's sd that begins too small stays small, and
    # shifts and corners explain the errors instead: with five poses this happened in 26 of 30
    # worlds from 3e-4, in 3 from 3e-3.  Shifts that begin at 1e-2 hid 6 of 20 lenses that were 2 %
    # off, those at 1e-3 hid two.
    motion: tuple[float, float] = (3e-3, 1e-3)
    focus: float = 2e-3  # log of the focal length, from picture to picture
    # parameters of a stated lens, over their highest sd.  From .03 and .01 the noise of corners
    # explained lenses that were 2 % off (55 and 27 of 64 were detected, 60 from .1); from .3 a lens
    # that zoomed was missed.
    stated: float = 0.1
    # angle [rad] at which a camera sees the boards of two pictures at one pose apart, beyond which
    # one of them has another's row
    apart: float = radians(1.0)


PRIORS = Priors()


@dataclass(frozen=True, eq=False)
class Problem:
    """All pictures, the prior, and where the fit begins."""

    # with boards numbered from the same end; their rows are indices of motions
    views: Sequence[View]
    bundle: Bundle
    prior: CornerPrior
    start: CornerFit
    arm: SpatialArm | None = None
    choice: Choice | None = None  # the convention of flange poses

    @property
    def count(self) -> int:
        """Number n of motions."""
        return self.bundle.motions.count

    @property
    def frames(self) -> tuple[str, str]:
        """Names of the arm's base and of its tip or flange."""
        if self.arm is None:
            return "base", "flange"
        return parse_robot(self.arm.urdf).root, self.arm.tip

    @property
    def names(self) -> tuple[str, ...]:
        """Name of a picture at each motion."""
        names: dict[int, str] = {}
        for view in reversed(self.views):
            names |= zip(view.rows.tolist(), view.names, strict=True)
        return tuple(names[motion] for motion in sorted(names))

    def pictures_at(self, motions: Mask) -> tuple[str, ...]:
        """Names of the pictures that were taken at some motions (n,)."""
        names: dict[str, None] = {}
        for view in self.views:
            chosen = np.flatnonzero(motions[view.rows])
            names |= dict.fromkeys(view.names[k] for k in chosen)
        return tuple(names)

    def solve(
        self, motions: Index, start: CornerFit, *, learn: bool = True
    ) -> CornerFit:
        """The fit to the pictures of some motions."""
        start = replace(
            start, unknowns=start.unknowns.with_zero_errors(len(motions))
        )
        return fit_corners(
            self.bundle.at_motions(motions), self.prior, start, learn=learn
        )

    def predict(self, fit: CornerFit) -> Array:
        """Pixels (N, 2) of all corners at motions without errors."""
        return self.bundle.predict(
            fit.unknowns.with_zero_errors(self.count)
        ).pixels


def problem_of_joints(arm: SpatialArm, views: Sequence[View]) -> Problem:
    """The problem of joints and a drawn arm.

    Raises LogError where the pictures are of other joints, or show that the joints are not these.
    """
    views, rows = _with_row_indices(views)
    q = np.zeros((len(rows), arm.dof))
    for view in views:
        names = view.joint_names
        if names != arm.joint_names:
            raise LogError(
                f"the pictures of {view.name} are of the joints {listing(names)}, expected "
                f"{listing(arm.joint_names)}, those of {arm.name} up to {arm.tip}"
            )
        # joints at each row that has a picture
        q[view.rows] = view.q
    views, first = _by_pose(views, q)
    motions = JointMotions(q[first], structure_of(arm, "pose"))
    refuse_readings(motions.structure, views[0])
    return replace(_problem(views, motions), arm=arm)


def problem_of_poses(table: FlangeTable, views: Sequence[View]) -> Problem:
    """The problem of flange poses, whose convention is found.

    Raises LogError where they turn about one axis alone, or are not of the pictures.
    """
    # the convention under which the camera with most pictures agrees with the poses
    fullest = max(views, key=lambda view: len(view.rows))
    choice = choose(table, fullest)
    flange = choice.reading.flange.copy()
    refuse_poses(table, choice, fullest)

    # poses in metres, at each row that has a picture
    flange[:, :3, 3] /= METRES[choice.convention["unit"]]
    views, rows = _with_row_indices(views)
    flange = flange[rows]
    views, first = _by_pose(views, flange[:, :3].reshape(-1, 12))
    problem = _problem(views, Motions(flange[first]))
    return replace(problem, choice=choice)


def _with_row_indices(views: Sequence[View]) -> tuple[list[View], Index]:
    """The views, whose rows become indices of the rows (n,) of which some camera has a picture."""
    rows = np.unique(np.concatenate([view.rows for view in views]))
    placed = [
        replace(view, rows=np.searchsorted(rows, view.rows)) for view in views
    ]
    return placed, rows


def _by_pose(views: Sequence[View], poses: Array) -> tuple[list[View], Index]:
    """The views with one row for all pictures at one pose, where the arm's error is the same.

    A picture that shows the board elsewhere than others at its pose keeps a row of its own.

    poses : (n, k), joints or flange at the views' rows [rad or m]
    Returns the first row (m,) of each pose too.  Raises LogError where too few poses are left.
    """
    pose = pose_index(poses)
    first = np.unique(pose, return_index=True)[1]
    elsewhere = np.zeros(len(pose), bool)
    for view in views:
        elsewhere[view.rows] |= _are_elsewhere(view, first[pose])
    pose[elsewhere] = len(pose) + np.flatnonzero(elsewhere)
    pose = label_numbers(pose)
    first = np.unique(pose, return_index=True)[1]
    if len(first) < LEAST_PICTURES:
        raise LogError(
            f"the pictures are of {len(first)} poses of the arm: expected {LEAST_PICTURES} or more",
            hint="add pictures with the hand turned by 30 deg about each of two other axes",
        )
    return [replace(view, rows=pose[view.rows]) for view in views], first


def _are_elsewhere(view: View, first: Index) -> Mask:
    """Which pictures (p,) show the board elsewhere than the first picture at their pose.

    first : (n,), the first row at the pose of each row
    """
    # by row; not a number where this camera has no picture
    boards = np.full((len(first), 4, 4), np.nan)
    boards[view.rows] = view.boards
    expected = boards[first[view.rows]]
    points = view.board.points()
    gaps = board_misfits(expected, view.boards, points)
    half_turn = view.board.half_turn
    if half_turn is not None:
        other_end = board_misfits(expected @ half_turn, view.boards, points)
        gaps = np.minimum(gaps, other_end)
    return gaps > PRIORS.apart


def _problem(views: Sequence[View], motions: Motions) -> Problem:
    """The problem, which begins at a closed form of each camera."""
    starts = _starts(views, motions)
    numbered = [
        view.turned(start.turned)
        for view, start in zip(views, starts, strict=True)
    ]
    bundle = _bundle(numbered, motions)
    layout = bundle.layout
    # of each board the first camera that sees it
    boards = [
        starts[bundle.boards.index(k)] for k in sorted(set(bundle.boards))
    ]

    prior = _prior(numbered, boards, motions, layout)
    values = np.zeros(layout.size)
    values[layout.lenses] = [view.first_lens.parameters for view in views]
    for start, shape in zip(boards, layout.shapes, strict=True):
        values[shape[-1]] = start.size
    frames = [start.camera for start in starts]
    frames += [start.board for start in boards]
    exact = np.zeros((motions.count, layout.errors))
    noise = Noise(
        corner=np.full(len(views), PRIORS.corner),
        error=np.repeat([*PRIORS.motion, PRIORS.focus], [3, 3, len(views)]),
        prior=prior.sizes,
    )
    unknowns = Unknowns(np.array(frames), values, exact)
    fit = CornerFit(unknowns, noise, np.zeros((0, 0)))
    return Problem(numbered, bundle, prior, fit)


def _prior(
    views: Sequence[View],
    boards: Sequence[RigStart],
    motions: Motions,
    layout: CornerLayout,
) -> CornerPrior:
    """What is known of lenses, boards and the arm before the pictures."""
    mean = np.zeros(layout.size)
    scales: list[PriorScale] = []
    for view, lens in zip(views, layout.lenses, strict=True):
        mean[lens] = view.first_lens.parameters
        if view.stated_lens is None:
            mean[lens[4:]] = 0.0
        scales += _lens_scales(view, lens)
    lowest, highest = PRIORS.printed
    for start, shape in zip(boards, layout.shapes, strict=True):
        size = abs(start.size)  # that may be another than stated
        scales += [
            PriorScale(shape[:-3], *PRIORS.bent),
            PriorScale(shape[-3:-1], *PRIORS.stretched),
            PriorScale(
                shape[-1:], max(size, lowest), lowest, max(size, highest)
            ),
        ]
    if isinstance(motions, JointMotions):
        scales += motions.scales(layout.arm)
    return CornerPrior(mean, scales)


def _starts(views: Sequence[View], motions: Motions) -> list[RigStart]:
    """The start of each camera and its board, which cameras of one eye number from one end."""
    flange = motions.poses(np.zeros(motions.size))
    starts: list[RigStart] = []
    firsts: dict[bool, RigStart] = {}
    for view in views:
        start = find_start(flange[view.rows], view)
        refuse_mirrored(view, start)
        first = firsts.setdefault(view.in_hand, start)
        starts.append(_from_same_end(start, first, view.board.half_turn))
    return starts


def _from_same_end(
    start: RigStart, other: RigStart, half_turn: Array | None
) -> RigStart:
    """A start with its board numbered from the same end as another camera's."""
    if half_turn is None:
        return start
    board = start.board @ half_turn
    plain = np.linalg.norm(start.board - other.board)
    if np.linalg.norm(board - other.board) < plain:
        return replace(start, board=board, turned=~start.turned)
    return start


def _bundle(views: Sequence[View], motions: Motions) -> Bundle:
    """The corners of all pictures."""
    points: list[Array] = []
    bends: list[Array] = []
    pixels: list[Array] = []
    labels: list[tuple[int, int]] = []
    for number, view in enumerate(views):
        outline = view.board.points()
        bent = shape_slopes(outline)
        for k in np.argsort(view.rows, kind="stable"):
            corners = view.corners[k]
            shown = list(corners)
            points.append(outline[shown])
            bends.append(bent[shown])
            pixels.append(np.array([*corners.values()]))
            labels += [(number, view.rows[k])] * len(shown)
    camera, motion = np.array(labels).T
    return Bundle(
        motions=motions,
        in_hand=[view.in_hand for view in views],
        points=np.concatenate(points),
        bends=np.concatenate(bends),
        pixels=np.concatenate(pixels),
        camera=camera,
        motion=motion,
    )


def _lens_scales(view: View, indices: Index) -> Iterator[PriorScale]:
    """Priors of a lens; focal length and centre of one that is fitted follow from the pictures."""
    focal = float(view.first_lens.focal.mean())
    # tangent of the angle at which the corners of the picture appear
    edge = float(np.hypot(*view.size)) / 2 / focal
    groups = (
        (slice(0, 2), 0.3 * focal),
        (slice(2, 4), 0.1 * edge * focal),
        (slice(4, 5), edge**-2),
        (slice(5, 6), edge**-4),
        (slice(6, 8), 0.05 / edge),
        (slice(8, 9), edge**-6),
    )
    for numbers, highest in groups:
        lowest = 1e-6 * highest
        start = 0.3 * highest
        if view.stated_lens is not None:
            variances = np.diag(view.stated_lens.covariance)[numbers]
            lowest = max(float(np.sqrt(variances.max())), lowest)
            start = max(PRIORS.stated * highest, lowest)
        elif numbers.stop <= 4:
            start = highest
            lowest = highest
        yield PriorScale(indices[numbers], start, lowest, highest)
