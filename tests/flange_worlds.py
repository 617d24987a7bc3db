"""Cameras that see a board at flange poses of a controller, whose truth is known."""

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

import calib
from calib.recording.board import parse_board
from calib.recording.board_pictures import BoardPictures

SIZE = (1280, 720)
LENS = np.array([900.0, 903.0, 645.0, 352.0, -0.1, 0.05, 5e-4, -4e-4, 0.0])
MATRIX = np.array([[900.0, 0.0, 645.0], [0.0, 903.0, 352.0], [0.0, 0.0, 1.0]])


def motion(turn, shift):
    """A rigid motion (4, 4)."""
    out = np.eye(4)
    out[:3, :3] = turn.as_matrix()
    out[:3, 3] = shift
    return out


@dataclass
class World:
    """A camera, a board and an arm that repeats to .3 mm and .02 deg."""

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
        rng = np.random.default_rng(self.seed)
        self.pattern = parse_board(self.board)
        points = self.pattern.points()
        near, far = rng.normal(0.0, 0.06, 3), rng.normal(0.0, 0.6, 3)
        one = Rotation.random(random_state=self.seed)
        other = Rotation.random(random_state=self.seed + 1000)
        self.camera = motion(one, near if self.in_hand else far)
        self.placed = motion(other, far if self.in_hand else near)
        self.apart = motion(Rotation.from_rotvec([0.0, 0.1, 0.02]), [0.08, 0.0, 0.0])
        cameras = [self.camera]
        if self.second:
            cameras.append(self.camera @ self.apart)
        self.cameras = cameras
        self.rng = rng
        count, self.count = self.count, 0
        self.flange = np.zeros((0, 4, 4))
        self.corners = [[] for _ in cameras]
        while self.count < count:
            vector = np.radians(self.spread) * np.array(self.axes) * rng.uniform(-1.5, 1.5, 3)
            turn = Rotation.from_rotvec(vector)
            place = rng.uniform([-0.12, -0.07, 0.3], [0.12, 0.07, 0.6])
            seen = motion(turn, place - turn.apply(points.mean(axis=0)))
            moved = self.camera @ seen @ np.linalg.inv(self.placed)
            flange = np.linalg.inv(moved) if self.in_hand else moved
            self.take_picture(flange)

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
    def eye(self):
        return "hand" if self.in_hand else "base"

    def shots(self, number=0, turned=()):
        """The corners as if they were found in pictures, some from the board's other end."""
        found = []
        for k, corners in enumerate(self.corners[number]):
            corners = corners[::-1] if k in turned else corners
            found.append(dict(enumerate(corners)))
        names = tuple(f"{k:02d}.png" for k in range(self.count))
        none = np.zeros((self.count, 0))
        return BoardPictures(self.pattern, (), names, none, tuple(found), SIZE, self.count, ())

    def solve(self, table=None, turned=(), shots=None, **options):
        table = self.flange if table is None else table
        shots = self.shots(turned=turned) if shots is None else shots
        return calib.handeye(pictures=shots, poses=table, eye=self.eye, **options)


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
