"""Board postures: those in which a camera sees all of a board, by the expected places of both."""

from __future__ import annotations

import numpy as np

from ..arm.arm import Arm, SpatialArm
from ..arm.rigid import inverse, rigid, shift_of, turn_of
from ..arm.rotations import exponential, logarithm
from ..body.spatial import SpatialStructure
from ..common.arrays import Array, Index
from ..errors import OptionError
from ..model.model import Model
from ..recording.board import Pattern, parse_board
from ..recording.bundle import LENS_SIZE, POSE_SIZE, SHAPE_SIZE
from ..recording.joint_motions import JointMotions
from ..recording.next_poses import Around, ExpectedRig, rig_noise
from ..recording.rig import frames_of_model
from ..samples.lens import Lens
from .pose_space import PoseSpace
from .settings import AIMING, PLANNING
from .target_postures import Candidates, chain_in_base, joints_towards

AROUND = Around(AIMING.tilt, AIMING.nearer)


def board_postures(
    source: Arm | Model,
    space: PoseSpace,
    board: Pattern | str | bool,
    eye: str,
    start: Array | None,
    rng: np.random.Generator,
) -> Candidates:
    """Postures in which a camera sees all of a board, from many sides.

    Of a model of pictures of a board, camera and board are known.  Of an arm the camera in the hand
    looks along the tip's z axis, or the board's print faces along it, and at the posture `start`
    (dof,) the camera sees the board in the middle of its picture.  These assumptions hold to some
    10 deg and a few cm (`AIMING.off_*`): postures that show the board under most of such variations
    come first.
    Raises OptionError if fewer than three are found.
    """
    structure, beta = chain_in_base(source)
    for group in ("tool", "tool.rotation"):
        beta[structure.groups[group]] = 0.0
    posed = structure.with_sensor(view="base pose")
    flange_at_start = None
    if start is not None:
        flange_at_start = _flange_at(posed, beta, start[None])[0]
    rigs = _possible_rigs(source, board, eye, flange_at_start, rng)
    rig = rigs[0]

    # joints that bring the board to a random place, and see it
    begin = rng.uniform(space.lower, space.upper, (AIMING.draws, structure.dof))
    if start is not None:
        begin[: AIMING.draws // 2] = start
    flanges = rig.draw(AIMING.draws, rng)
    targets = np.hstack([shift_of(flanges), logarithm(turn_of(flanges))])
    q, _ = joints_towards(posed, beta, begin, targets, space)
    q = np.unique(q.round(4), axis=0)
    flange = _flange_at(posed, beta, q)
    seen = rig.sees(flange)

    # first those that see it at most of the possible places of camera and board
    chance = np.zeros(len(q))
    for possible in rigs:
        chance += seen & possible.sees(flange)
    order = np.lexsort([rng.random(len(q)), -chance])
    q = q[order[: min(AIMING.most, np.count_nonzero(seen))]]
    if len(q) < 3:
        raise OptionError(
            f"handeye: the camera sees the board in {len(q)} of the postures about the start; "
            "give `start` where it does, further from the joints' limits"
        )

    def most_informative(q: Array, count: int) -> Index:
        """Rows (count,) of postures (n, dof) that are most informative about the camera."""
        motions = JointMotions(q, structure.with_sensor(view="pose"))
        return rig.most_informative(motions, count)[0]

    why = "the board in the picture from many sides, chosen to tell most of the camera"
    return Candidates(q, most_informative, why)


def _possible_rigs(
    source: Arm | Model,
    board: Pattern | str | bool,
    eye: str,
    flange: Array | None,
    rng: np.random.Generator,
) -> list[ExpectedRig]:
    """The rig of a model, or those that an arm may have, the likeliest first.

    flange : (4, 4) [m], where it is when the camera sees the middle of the board
    """
    if not isinstance(source, SpatialArm):
        return [expected_rig(source)]
    if flange is None or isinstance(board, bool):
        raise OptionError(
            "handeye: expected the board and `start`, joint values at which the camera sees it in "
            "the middle of its picture"
        )
    pattern = parse_board(board)
    rigs = [guessed_rig(flange, pattern, eye)]
    for _ in range(AIMING.guesses):
        rigs.append(guessed_rig(flange, pattern, eye, rng))
    return rigs


def _flange_at(posed: SpatialStructure, beta: Array, q: Array) -> Array:
    """The tip in the base (n, 4, 4) [m] at joints (n, dof)."""
    places, turns = posed.pose(q, beta)
    return rigid(turns, places)


def guessed_rig(
    flange: Array,
    board: Pattern,
    eye: str,
    rng: np.random.Generator | None = None,
) -> ExpectedRig:
    """The rig of a camera that sees the middle of a board where the flange is (4, 4) [m].

    rng : draws the errors of the assumptions; by default there are none
    """
    lens = Lens.of(AIMING.picture, np.array(AIMING.lens))
    facing = _facing(board, lens)
    off = np.eye(4)
    if rng is not None:
        turns = exponential(AIMING.off_turn * rng.standard_normal((2, 3)))
        middle = board.points().mean(axis=0)
        facing = facing @ rigid(turns[0], middle - turns[0] @ middle)
        facing[:3, 3] *= rng.uniform(*AIMING.off_distance)
        off = rigid(turns[1], AIMING.off_shift * rng.standard_normal(3))
    if eye == "hand":
        camera = off
        frame = flange @ off @ facing
    else:
        # the print faces along the tip's z axis, its middle at the tip
        half_turn = np.diag([1.0, -1.0, -1.0])
        middle = board.points().mean(axis=0)
        frame = off @ rigid(half_turn, -half_turn @ middle)
        camera = flange @ frame @ inverse(facing)
    sizes = np.concatenate(
        [AIMING.lens_sd, np.full(SHAPE_SIZE, AIMING.board_sd)]
    )
    return _rig(eye, np.stack([camera, frame]), lens, board, sizes)


def expected_rig(source: Arm | Model) -> ExpectedRig:
    """The rig of a model of pictures of a board; OptionError of others."""
    model = source if isinstance(source, Model) else None
    frames = None if model is None else frames_of_model(model)
    if model is None or frames is None:
        raise OptionError(
            "handeye: expected a robot that moves in space, or a model that `calib handeye -o` made"
        )
    described = model.about.options["board"]
    lens = Lens.from_json(described["lens"])
    board = parse_board(described["board"])
    eye = described["eye"]
    if eye == "base":  # the camera comes first
        frames = frames[::-1]
    return _rig(eye, frames, lens, board, np.zeros(LENS_SIZE + SHAPE_SIZE))


def _facing(board: Pattern, lens: Lens) -> Array:
    """A board (4, 4) [m] in the middle of the picture, of which it fills its share."""
    middle = board.points().mean(axis=0)
    ahead = lens.focal.mean() * max(board.size) / (AIMING.filled * lens.size[0])
    return rigid(np.eye(3), [-middle[0], -middle[1], ahead])


def _rig(
    eye: str, frames: Array, lens: Lens, board: Pattern, sizes: Array
) -> ExpectedRig:
    """The rig of frames X and Y (2, 4, 4) [m] that may be anywhere."""
    return ExpectedRig(
        eye,
        frames,
        lens,
        board.points(),
        _facing(board, lens)[None],
        AROUND,
        rig_noise(AIMING.noise, AIMING.turn, AIMING.shift),
        np.eye(2 * POSE_SIZE) / PLANNING.widest**2,
        sizes,
    )
