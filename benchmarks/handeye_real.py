"""Hand-eye on real pictures: five folds by picture, beside OpenCV's solvers where it has them.

    python benchmarks/handeye_real.py FOLDER BOARD EYE [FOLDER BOARD EYE ..]

A folder has pictures and a table of flange poses, `flange.csv` or `tool.csv`, in any convention.
Pictures that a fit did not see are predicted from their flange pose alone: rms over their corners
in pixels.  OpenCV's solvers (4.x has them in Python) get the same corners, the lens and the
convention that calib found.
"""

import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

import calib
from calib.arm.rigid import inverse, rigid
from calib.arm.rotations import matrix_of
from calib.common.scale import METRES
from calib.recording.board_pictures import BoardPictures, find_board
from calib.recording.bundle import project
from calib.recording.pose_files import FlangeTable, read_flange_poses
from calib.recording.readings import pose_readings
from calib.recording.reference import frames_of
from calib.samples.lens import Lens

FOLDS = 5
SOLVERS = ("TSAI", "PARK", "HORAUD", "DANIILIDIS")


def frame(place: dict) -> np.ndarray:
    """A place as a matrix (4, 4)."""
    return rigid(matrix_of([place["quaternion"]]), np.array([place["position"]]))[0]


def flange_of(rig: calib.HandEye, table: FlangeTable) -> np.ndarray:
    """All flange poses (n, 4, 4) [m] as the rig reads them."""
    found = rig.convention
    names = ("rotation", "angles", "inverse")
    for reading in pose_readings(table):
        if all(getattr(reading, name) == found[name] for name in names):
            flange = reading.flange.copy()
            flange[:, :3, 3] /= METRES[found["unit"]]
            return flange
    raise ValueError(found)


def seen(eye: str, hand: np.ndarray, base: np.ndarray, flange: np.ndarray) -> np.ndarray:
    """The board before the camera (4, 4)."""
    if eye == "hand":
        return inverse(hand) @ inverse(flange) @ base
    return inverse(base) @ flange @ hand


def miss(lens: np.ndarray, points: np.ndarray, pose: np.ndarray, shown: dict) -> float:
    """Mean square (px^2) of a picture's corners, in the better of a chessboard's two orders."""
    pixels = project(lens, np.ones(len(points)), points @ pose[:3, :3].T + pose[:3, 3])[0]
    numbers = list(shown)
    corners = np.array(list(shown.values()))
    orders = (numbers, [len(points) - 1 - number for number in numbers])
    return min(float(((pixels[order] - corners) ** 2).sum(axis=1).mean()) for order in orders)


def lens_of(rig: calib.HandEye) -> np.ndarray:
    """The lens (9,)."""
    matrix = np.array(rig.lens["matrix"])
    own = [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]]
    return np.array([*own, *rig.lens["distortion"]])


def some(shots: BoardPictures, rows: np.ndarray) -> BoardPictures:
    """Some of the pictures."""
    return replace(
        shots,
        names=tuple(shots.names[k] for k in rows),
        corners=tuple(shots.corners[k] for k in rows),
        q=shots.q[rows],
        rows=shots.rows[rows],
    )


def opencv(rig: calib.HandEye, shots: BoardPictures, flange: np.ndarray, kind: str) -> tuple:
    """Hand and base (4, 4) by one of OpenCV's solvers, which get the lens and the convention."""
    lens = lens_of(rig)
    glass = Lens(shots.size, lens[:2], lens[2:4], lens[4:])
    boards = frames_of(shots.poses(glass))
    motions = flange if rig.eye == "hand" else inverse(flange)
    turn, shift = cv2.calibrateHandEye(
        motions[:, :3, :3], motions[:, :3, 3], boards[:, :3, :3], boards[:, :3, 3],
        method=getattr(cv2, f"CALIB_HAND_EYE_{kind}"),
    )  # fmt: skip
    camera = rigid(turn[None], shift.reshape(1, 3))[0]
    board = np.median(motions @ camera @ boards, axis=0)
    return (camera, board) if rig.eye == "hand" else (board, camera)


def main() -> None:
    """Print a row for each folder."""
    print("| set | pictures | " + " | ".join([*SOLVERS, "calib"]) + " | repeats | next reading |")
    for folder, board, eye in np.reshape(sys.argv[1:], (-1, 3)).tolist():
        path = Path(folder)
        table = read_flange_poses(next(path.glob("*.csv")))
        shots = find_board(path, table.joints, board)
        squares: dict[str, list[float]] = {name: [] for name in (*SOLVERS, "calib")}
        number = np.arange(len(shots.names))
        for fold in range(FOLDS):
            rest = number[number % FOLDS != fold]
            rig = calib.handeye(pictures=some(shots, rest), poses=table, eye=eye)
            flange = flange_of(rig, table)
            answers = {"calib": (frame(rig.hand), frame(rig.base))}
            for kind in SOLVERS if hasattr(cv2, "calibrateHandEye") else ():
                own = some(shots, rest)
                answers[kind] = opencv(rig, own, flange[own.rows], kind)
            for name, (hand, base) in answers.items():
                points = np.array(rig.board["points"]) if name == "calib" else shots.board.points()
                for k in number[number % FOLDS == fold]:
                    pose = seen(eye, hand, base, flange[shots.rows[k]])
                    squares[name].append(miss(lens_of(rig), points, pose, shots.corners[k]))
        rms = [f"{np.sqrt(np.mean(square)):.2f}" if square else "" for square in squares.values()]
        whole = calib.handeye(pictures=shots, poses=table, eye=eye)
        repeats = f"{1e3 * whole.repeatability['position']:.2f} mm"
        print(
            f"| {path.name} | {len(number)} | {' | '.join(rms)} | {repeats} | "
            f"{whole.convention['ratio']:.0f} times worse |",
            flush=True,
        )


if __name__ == "__main__":
    main()
