"""Arms that see a board, or hold one before a camera, whose truth is known."""

from dataclasses import dataclass

import numpy as np

import calib
from calib.arm.rotations import exponential, logarithm
from calib.body.spatial import structure_of
from calib.recording.board import parse_board
from calib.recording.board_pictures import BoardPictures
from calib.samples.lens import Lens

BOARD = np.array([[0.024 * i, 0.024 * j, 0.0] for j in range(1, 5) for i in range(1, 7)])
"""Inner corners of a board of 7x5 squares of 24 mm [m]."""

SPEC = "7x5:24mm:18mm:5x5_100"
SIZE = (1280, 720)


@dataclass
class Rig:
    """A six-joint arm off by up to .2 deg and .3 mm; a camera in its hand, or before its board."""

    in_hand: bool
    seed: int = 0
    pictures: int = 24
    noise: float = 0.1  # of a corner [px]
    known: bool = True  # whether the lens is known
    last: bool = False  # whether the last joint is off, too, which no picture tells
    half_turn: bool = False  # whether what is in the hand faces back along the tip's z axis

    def __post_init__(self) -> None:
        rng = np.random.default_rng(self.seed)
        self.arm = arm = calib.load_arm("six_axis")
        lens = (1000.0 + 60 * rng.standard_normal(), 645.0, 352.0, -0.08)
        self.lens = lens
        guess = (
            (lens, (0.0,) * 4) if self.known else ((1100.0, 640.0, 360.0, 0.0), (400, 60, 60, 0.3))
        )
        self.structure = s = structure_of(arm, "pose", lens=guess[0], lens_sd=guess[1])
        self.beta = b = s.neutral()
        b[s.groups["lens"]] = lens
        off, end = np.radians(0.2), None if self.last else -1
        own = s.groups["offset"][1:end]
        b[own] = rng.uniform(-off, off, len(own))
        b[s.shifts] = rng.uniform(-3e-4, 3e-4, s.shifts.shape)
        b[s.groups["tool"]] = (0.03, -0.05, 0.04) + 0.01 * rng.standard_normal(3)
        turn = exponential(np.array([[np.pi * self.half_turn, 0.0, 0.0]]))
        turn = exponential(0.15 * rng.standard_normal((1, 3))) @ turn
        b[s.groups["tool.rotation"]] = logarithm(turn)[0]
        lower, upper = np.maximum(arm.lower, -3), np.minimum(arm.upper, 3)
        self.start = lower + rng.uniform(0.35, 0.65, (1, arm.dof)) * (upper - lower)
        self._place(rng, self.start)
        self.look(self._poses(rng, lower, upper), rng)

    def look(self, q, rng) -> None:
        """Take a picture at each of the poses (p, dof)."""
        s, b, self.q = self.structure, self.beta, q
        self.rows = np.repeat(np.arange(len(self.q)), len(BOARD))
        exact = self.as_seen(b)
        self.seen = exact + self.noise * rng.standard_normal(exact.shape)
        self.poses = s.predict(self.q, b) + rng.normal(
            0, (2e-3,) * 3 + (1e-2,) * 3, (len(self.q), 6)
        )

    def _place(self, rng, q) -> None:
        """Put what stands still where what is in the hand sees it."""
        s, b, middle = self.structure, self.beta, BOARD.mean(axis=0)
        (p,), (hand,) = s.with_sensor(view="base").pose(q, b)
        facing = hand @ exponential(0.1 * rng.standard_normal(3))  # OpenCV's: z runs into the board
        if self.in_hand:
            there = p + 0.4 * hand[:, 2] - facing @ middle
        else:
            there = p + hand @ middle - 0.6 * facing[:, 2]
        b[s.groups["view.rotation"]] = logarithm(facing.T[None])[0]
        b[s.groups["view.shift"]] = -facing.T @ there
        self.base = there, facing

    def _poses(self, rng, lower, upper):
        found, middle = [], BOARD.mean(axis=0)
        while len(found) < self.pictures:
            q = rng.uniform(lower, upper, (4000, self.arm.dof))
            z = self.structure.predict(q, self.beta)
            turn = exponential(z[:, 3:])
            if self.in_hand:
                s = np.einsum("nji,nj->ni", turn, middle - z[:, :3])
            else:
                s = turn @ middle + z[:, :3]
            near = (s[:, 2] > 0.3) & (s[:, 2] < (0.6 if self.in_hand else 1.0))
            inside = abs(s[:, :2]) < s[:, 2:] * (0.42, 0.22)
            ok = near & inside.all(axis=1) & (turn[:, 2, 2] > 0.7)
            found += list(q[ok])
        return np.array(found[: self.pictures])

    def hand(self, beta):
        """Position and rotation of the camera or board in the tip's frame."""
        s, q = self.structure.with_sensor(view="base"), np.zeros((1, self.arm.dof))
        bare = beta.copy()
        bare[s.groups["tool"]] = bare[s.groups["tool.rotation"]] = 0.0
        (p,), (turn,) = s.pose(q, beta)
        (p0,), (turn0,) = s.pose(q, bare)
        return turn0.T @ (p - p0), turn0.T @ turn

    @property
    def eye(self):
        return "hand" if self.in_hand else "base"

    @property
    def glass(self):
        """The true lens."""
        f, u, v, k1 = self.lens
        return Lens(SIZE, np.array([f, f]), np.array([u, v]), np.array([k1, 0, 0, 0, 0]))

    def shots(self, seen=None, q=None, board=SPEC):
        """The corners as if they were found in pictures, at other pixels, joints or squares."""
        seen, q = self.seen if seen is None else seen, self.q if q is None else q
        found = tuple(dict(enumerate(seen[self.rows == k])) for k in range(len(self.q)))
        names = tuple(f"{k:02d}.png" for k in range(len(self.q)))
        joints = self.arm.joint_names
        return BoardPictures(parse_board(board), joints, names, q, found, SIZE, len(names), ())

    def solve(self, eye=None, lens=None, arm=None, **changes):
        """Hand-eye calibration of these pictures; a lens that is not known is fitted."""
        lens = self.glass if lens is None and self.known else lens
        shots = self.shots(**changes)
        return calib.handeye(arm or self.arm, shots, eye=eye or self.eye, lens=lens)

    def changed(self, **steps):
        """Parameters after steps of some of a group's, each (place, size)."""
        late = self.beta.copy()
        for group, (place, size) in steps.items():
            late[self.structure.groups[group][place]] += size
        return late

    def as_seen(self, beta):
        """Exact pixels of all corners under these parameters."""
        poses = self.structure.predict(self.q, beta)
        shift, turn = poses[:, None, :3], exponential(poses[:, 3:])
        points = BOARD @ np.swapaxes(turn, 1, 2) + shift
        if self.in_hand:  # the poses are the camera's
            points = (BOARD - shift) @ turn
        focal, *centre, k1 = beta[self.structure.groups["lens"]]
        flat = (points[:, :, :2] / points[:, :, 2:]).reshape(-1, 2)
        return focal * flat * (1 + k1 * (flat**2).sum(axis=1, keepdims=True)) + centre

    def miss(self, found):
        """How far what is in the hand is off (3,) [m], and the same over its interval."""
        off = np.abs(np.subtract(found.hand["position"], self.hand(self.beta)[0]))
        return off, off / np.array(found.hand["position_95"])
