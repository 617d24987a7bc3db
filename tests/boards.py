"""Cameras that see a board, in the hand of an arm or before it, whose truth is known."""

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

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
LENS = np.array([900.0, 903.0, 645.0, 352.0, -0.1, 0.05, 5e-4, -4e-4, 0.0])
MATRIX = np.array([[900.0, 0.0, 645.0], [0.0, 903.0, 352.0], [0.0, 0.0, 1.0]])


def motion(turn, shift):
    """A rigid motion (4, 4)."""
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = turn.as_matrix(), shift
    return out


def pictures_of(board, corners, q=None, joints=()):
    """Corners (p, n, 2) [px] as if they were found in pictures, at joints (p, dof)."""
    count = len(corners)
    names = tuple(f"{k:02d}.png" for k in range(count))
    numbered = tuple(dict(enumerate(each)) for each in corners)
    q = np.zeros((count, 0)) if q is None else q
    return BoardPictures(board, joints, names, q, numbered, SIZE, count, (), np.arange(count))


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
        self.eye = "hand" if self.in_hand else "base"
        self.arm = arm = calib.load_arm("six_axis")
        self.lens = (1000.0 + 60 * rng.standard_normal(), 645.0, 352.0, -0.08)
        self.structure = s = structure_of(arm, "pose")
        self.beta = b = s.neutral()
        b[s.groups["lens"]] = self.lens
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
        self.q, self.rows = q, np.repeat(np.arange(len(q)), len(BOARD))
        exact = self.as_seen(self.beta)
        self.seen = exact + self.noise * rng.standard_normal(exact.shape)

    def _place(self, rng, q) -> None:
        """Put what stands still where what is in the hand sees it."""
        s, b, middle = self.structure, self.beta, BOARD.mean(axis=0)
        (p,), (hand,) = s.with_sensor(view="base").pose(q, b)
        facing = hand @ exponential(0.1 * rng.standard_normal(3))  # OpenCV's: z runs into the board
        there = p + hand @ middle - 0.6 * facing[:, 2]
        if self.in_hand:
            there = p + 0.4 * hand[:, 2] - facing @ middle
        b[s.groups["view.rotation"]] = logarithm(facing.T[None])[0]
        b[s.groups["view.shift"]] = -facing.T @ there
        self.base = there, facing

    def _poses(self, rng, lower, upper):
        found, middle = [], BOARD.mean(axis=0)
        while len(found) < self.pictures:
            q = rng.uniform(lower, upper, (4000, self.arm.dof))
            z = self.structure.predict(q, self.beta)
            turn = exponential(z[:, 3:])
            s = turn @ middle + z[:, :3]
            if self.in_hand:
                s = np.einsum("nji,nj->ni", turn, middle - z[:, :3])
            near = (s[:, 2] > 0.3) & (s[:, 2] < (0.6 if self.in_hand else 1.0))
            inside = abs(s[:, :2]) < s[:, 2:] * (0.42, 0.22)
            found += list(q[near & inside.all(axis=1) & (turn[:, 2, 2] > 0.7)])
        return np.array(found[: self.pictures])

    def hand(self, beta):
        """Position and rotation of the camera or board in the tip's frame."""
        groups = self.structure.groups
        return beta[groups["tool"]], exponential(beta[groups["tool.rotation"]])

    @property
    def glass(self):
        """The true lens."""
        f, u, v, k1 = self.lens
        return Lens(SIZE, np.array([f, f]), np.array([u, v]), np.array([k1, 0, 0, 0, 0]))

    def shots(self, seen=None, q=None, board=SPEC):
        """The corners as if they were found in pictures, at other pixels, joints or squares."""
        seen, q = self.seen if seen is None else seen, self.q if q is None else q
        corners = seen.reshape(len(self.q), -1, 2)
        return pictures_of(parse_board(board), corners, q, self.arm.joint_names)

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


@dataclass
class World:
    """A camera and a board at flange poses of a controller, which repeats to .3 mm and .02 deg."""

    seed: int = 0
    in_hand: bool = True
    count: int = 16
    board: str = "10x7:22mm"
    printed: float = 1.0  # true size over the said one
    shift: float = 3e-4  # [m], of the arm's poses
    turn: float = np.radians(0.02)
    spread: float = 25.0  # of the turns [deg]
    axes: tuple[float, float, float] = (1.0, 1.0, 1.0)
    second: bool = False  # whether another camera sees the same
    focus: float = 0.0  # sd of the focal length from picture to picture, as a share
    stretch: float = 0.0  # by which the board is longer along x and shorter along y, as a share

    def __post_init__(self):
        self.eye = "hand" if self.in_hand else "base"
        self.rng = rng = np.random.default_rng(self.seed)
        self.pattern = parse_board(self.board)
        near, far = rng.normal(0.0, 0.06, 3), rng.normal(0.0, 0.6, 3)
        one, other = (Rotation.random(random_state=self.seed + k) for k in (0, 1000))
        self.camera = motion(one, near if self.in_hand else far)
        self.placed = motion(other, far if self.in_hand else near)
        self.apart = motion(Rotation.from_rotvec([0.0, 0.1, 0.02]), [0.08, 0.0, 0.0])
        self.cameras = [self.camera, self.camera @ self.apart][: 1 + self.second]
        count, self.count = self.count, 0
        self.flange = np.zeros((0, 4, 4))
        self.corners = [[] for _ in self.cameras]
        while self.count < count:
            vector = np.radians(self.spread) * np.array(self.axes) * rng.uniform(-1.5, 1.5, 3)
            place = rng.uniform([-0.12, -0.07, 0.3], [0.12, 0.07, 0.6])
            self.show(Rotation.from_rotvec(vector), place)

    def show(self, turn, place):
        """See the board so turned, with its middle at a place before the camera."""
        seen = motion(turn, place - turn.apply(self.pattern.points().mean(axis=0)))
        moved = self.camera @ seen @ np.linalg.inv(self.placed)
        self.take_picture(np.linalg.inv(moved) if self.in_hand else moved)

    def take_picture(self, flange):
        """See the board at a flange pose (4, 4), if it is in view of all cameras."""
        rng = self.rng
        moved = np.linalg.inv(flange) if self.in_hand else flange
        pictures = []
        for camera in self.cameras:
            there = np.linalg.inv(camera) @ moved @ self.placed
            board = self.printed * self.pattern.points() * (1 + self.stretch, 1 - self.stretch, 1)
            at = board @ there[:3, :3].T + there[:3, 3]
            lens = MATRIX.copy()
            focus = np.random.default_rng([self.seed, self.count]).normal()
            lens[[0, 1], [0, 1]] *= 1.0 + self.focus * focus
            pixels = cv2.projectPoints(at, np.zeros(3), np.zeros(3), lens, LENS[4:])[0]
            pictures.append(pixels[:, 0])
        if (np.array(pictures) < 10).any() or (np.array(pictures) > np.array(SIZE) - 10).any():
            return
        said = flange @ motion(Rotation.from_rotvec(rng.normal(0.0, self.turn, 3)), np.zeros(3))
        said[:3, 3] += rng.normal(0.0, self.shift, 3)
        self.flange = np.concatenate([self.flange, said[None]])
        for own, pixels in zip(self.corners, pictures, strict=True):
            own.append(pixels + rng.normal(0.0, 0.15, pixels.shape))
        self.count += 1

    @property
    def boards(self):
        """The board before the camera in the hand, as the controller says (n, 4, 4) [m]."""
        return np.linalg.inv(self.camera) @ np.linalg.inv(self.flange) @ self.placed

    def shots(self, number=0, turned=()):
        """The corners as if they were found in pictures, some from the board's other end."""
        corners = self.corners[number]
        ends = [c[::-1] if k in turned else c for k, c in enumerate(corners)]
        return pictures_of(self.pattern, ends)

    def solve(self, table=None, turned=(), shots=None, **options):
        table = self.flange if table is None else table
        shots = self.shots(turned=turned) if shots is None else shots
        return calib.handeye(pictures=shots, poses=table, eye=self.eye, **options)

    def misses(self, rig):
        """Errors over their intervals (12,) of what is in the hand and of what stands still."""
        places = (self.camera, self.placed)[:: 1 if self.in_hand else -1]
        found = zip((rig.hand, rig.base), places, strict=True)
        return np.concatenate([misses(place, true) for place, true in found])


def misses(place, true):
    """Errors of a place over its intervals (6,): shift and turn."""
    shift = np.subtract(place["position"], true[:3, 3]) / place["position_95"]
    turn = Rotation.from_quat(place["quaternion"]) * Rotation.from_matrix(true[:3, :3]).inv()
    return np.abs(np.concatenate([shift, turn.as_rotvec() / place["rotation_95"]]))


CONVENTIONS = {
    "xyzw": lambda turns: turns.as_quat(),
    "wxyz": lambda turns: np.roll(turns.as_quat(), 1, axis=1),
    "vector": lambda turns: turns.as_rotvec(degrees=True),
    "rpy": lambda turns: turns.as_euler("xyz"),
    "kuka": lambda turns: turns.as_euler("ZYX", degrees=True),
    "ZYZ": lambda turns: turns.as_euler("ZYZ", degrees=True),
    "transposed": lambda turns: np.swapaxes(turns.as_matrix(), 1, 2).reshape(-1, 9),
}
