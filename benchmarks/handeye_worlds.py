"""Hand-eye from flange poses in worlds of a known truth: intervals, conventions, cameras, squares.

    python benchmarks/handeye_worlds.py [--worlds 20] [--part coverage|conventions|cameras|..]

Poses with .3 mm and .02 deg of noise, corners with .15 px, 16 pictures of a chessboard a world;
every other world has its camera in the hand.
"""

import sys
from pathlib import Path
from time import process_time

import numpy as np
from scipy.spatial.transform import Rotation
from tables import typed

from calib.recording.pose_files import FlangeTable

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from boards import CONVENTIONS, World, misses

NAMED = {**CONVENTIONS, "matrix": lambda turns: turns.as_matrix().reshape(-1, 9)}
UNITS = {"m": 1.0, "mm": 1000.0}


def coverage(worlds: int) -> None:
    """How often the truth is within the intervals."""
    inside, lens, square, seconds = [], [], [], []
    for seed in range(worlds):
        world = World(seed, seed % 2 == 0)
        began = process_time()
        rig = world.solve()
        seconds.append(process_time() - began)
        inside.append(world.misses(rig) < 1.0)
        lens.append(abs(rig.lens["focal"] - 901.5) < rig.lens["focal_95"])
        low, high = rig.square["interval"]
        square.append(low < rig.square["said"] < high)
    rows = np.array(inside).reshape(-1, 2, 2, 3)
    shifts, turns = rows[:, :, 0].mean(), rows[:, :, 1].mean()
    print(
        f"coverage: shifts {100 * shifts:.0f} %, turns {100 * turns:.0f} %, focal length "
        f"{100 * np.mean(lens):.0f} %, square {100 * np.mean(square):.0f} % of {worlds}; "
        f"{np.mean(seconds):.2f} s a fit"
    )


def squares(worlds: int) -> None:
    """Squares that are 2 % smaller than said."""
    told = inside = 0
    covered = []
    for seed in range(worlds):
        world = World(seed, seed % 2 == 0, printed=0.98)
        rig = world.solve()
        low, high = rig.square["interval"]
        told += any("squares measure" in note for note in rig.notes)
        inside += low < 0.98 * rig.square["said"] < high
        covered.append(world.misses(rig) < 1.0)
    print(f"squares: told in {told} of {worlds}, right size within its interval in {inside}; "
          f"places {100 * np.mean(covered):.0f} %")  # fmt: skip


def conventions(worlds: int) -> None:
    """Tables in each convention: unit, degrees, flange in base or the inverse by turns."""
    for name, numbers in NAMED.items():
        right = tied = 0
        ratios = []
        for seed in range(worlds):
            world = World(seed, seed % 2 == 0, count=12)
            unit = ("m", "mm")[seed // 2 % 2]
            is_inverse = seed % 3 == 2
            flange = np.linalg.inv(world.flange) if is_inverse else world.flange
            turns = numbers(Rotation.from_matrix(flange[:, :3, :3]))
            table = np.column_stack([UNITS[unit] * flange[:, :3, 3], turns])
            rig = world.solve(FlangeTable("flange.csv", table, None))
            reading = rig.convention
            same = (reading["rotation"], reading["unit"]) == (name, unit)
            right += same and reading["inverse"] == is_inverse
            tied += any("not told apart" in note for note in rig.notes)
            ratios.append(reading["ratio"])
        print(f"{name}: right {right}, ties told {tied} of {worlds}; next reading "
              f"{min(ratios):.3g} to {max(ratios):.3g} times worse", flush=True)  # fmt: skip


def cameras(worlds: int) -> None:
    """Two cameras in one fit beside each alone: rms of where each is, and between them."""
    alone, both, between = [], [], []
    for seed in range(worlds):
        world = World(seed, seed % 2 == 0, second=True)
        truth = [world.camera, world.camera @ world.apart]
        shots = [world.shots(k) for k in (0, 1)]
        one = [world.solve(shots=shots[k]).cameras[0] for k in (0, 1)]
        rig = world.solve(shots={"left": shots[0], "right": shots[1]})
        eye = rig.eye
        for k in (0, 1):
            alone.append(np.subtract(one[k][eye]["position"], truth[k][:3, 3]))
            both.append(np.subtract(rig.cameras[k][eye]["position"], truth[k][:3, 3]))
        between.append(misses(rig.cameras[1]["from_first"], world.apart) < 1.0)
    rms = [1e3 * np.sqrt(np.mean(np.square(part))) for part in (alone, both)]
    better = np.linalg.norm(both, axis=1) < np.linalg.norm(alone, axis=1)
    print(f"cameras: alone {rms[0]:.3f} mm rms, both {rms[1]:.3f}, better in {better.sum()} of "
          f"{better.size}; between them covered {100 * np.mean(between):.0f} %")  # fmt: skip


PARTS = {part.__name__: part for part in (coverage, squares, conventions, cameras)}


def main() -> None:
    """Print a line for each part."""
    options = typed(__doc__, worlds=20, part=tuple(PARTS))
    for name, part in PARTS.items():
        if options.part in (None, name):
            part(options.worlds)


if __name__ == "__main__":
    main()
