"""Several sensors of one arm: what a second one is worth.

Two trackers with frames of their own (.1 mm of noise, 40 rows each), and two cameras that see one
tag (.3 px, 40 pictures each), of a six-axis arm that is built as drawings are off: joint origins by
.5 mm and .1 deg, zeros by .3 deg.  The sensors see different poses.  Errors are those of fresh
poses in the frame of the first sensor, or of the camera's tag in the base frame up to what no
picture tells.

    python benchmarks/sensors.py --worlds 5
"""

from __future__ import annotations

import argparse

import numpy as np

import calib
from calib.arm.rotations import exponential, logarithm, similarity
from calib.body.body_fit import BodyFit, fit, fit_sensors
from calib.body.rows import Rows
from calib.body.spatial import SpatialStructure, structure_of
from calib.common.arrays import Array

ROWS = 40
FRESH = 500
TRACKER_NOISE = 1e-4  # [m]
CAMERA_NOISE = 0.3  # [px]
LENS = (900.0, 640.0, 360.0, 0.0)  # [px], focal length and centre; radial
KNOWN = (0.0, 0.0, 0.0, 0.0)  # sd of the lens
TOOL = (0.01, -0.005, 0.02)  # [m], where the first marker is


def built(structure: SpatialStructure, rng: np.random.Generator) -> Array:
    """Parameters (d,) of an arm that is off its drawing."""
    beta = structure.neutral()
    beta[structure.shifts] = rng.normal(0.0, 5e-4, structure.shifts.shape)
    beta[structure.turns] = rng.normal(0.0, np.radians(0.1), structure.turns.shape)
    offset = structure.groups["offset"]
    beta[offset] = rng.normal(0.0, np.radians(0.3), len(offset))
    beta[offset[0]] = 0.0
    return beta


def rms(distances: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(distances**2)))


def trackers(rng: np.random.Generator) -> tuple[float, float]:
    """Error [m] of the first tracker's frame, with its own rows alone and with the second's."""
    arm = calib.load_arm("six_axis")
    structures: dict[str, SpatialStructure] = {}
    rows: dict[str, Rows] = {}
    structure = structure_of(arm, "rigid")
    truth = built(structure, rng)
    fresh = rng.uniform(arm.lower, arm.upper, (FRESH, len(arm.lower)))
    for name in ("left", "right"):
        beta = truth.copy()
        beta[structure.groups["view.rotation"]] = rng.normal(0.0, 1.0, 3)
        beta[structure.groups["view.shift"]] = rng.normal(0.0, 1.0, 3)
        marker = np.zeros(3) if name == "left" else rng.normal(0.0, 0.02, 3)
        beta[structure.groups["tool"]] = np.asarray(TOOL) + marker
        q = rng.uniform(arm.lower, arm.upper, (ROWS, len(arm.lower)))
        seen = structure.predict(q, beta)
        if name == "left":
            expected = structure.predict(fresh, beta)
        extent = float(np.sqrt(((seen - seen.mean(axis=0)) ** 2).sum(axis=1).mean()))
        structures[name] = structure.with_sensor(extent=extent)
        rows[name] = Rows(q, seen + rng.normal(0.0, TRACKER_NOISE, seen.shape))
    alone = fit(structures["left"], [rows["left"]])
    both = fit_sensors(structures, rows)["left"]
    misses = [
        rms(np.linalg.norm(found.body.predict(fresh) - expected, axis=1)) for found in (alone, both)
    ]
    return misses[0], misses[1]


def cameras(rng: np.random.Generator) -> tuple[float, float, float]:
    """Error [m] of the tag in the base frame: the first camera alone, the second one, and both."""
    arm = calib.load_arm("six_axis")
    structure = structure_of(arm, "pinhole", unit="px", lens=LENS, lens_sd=KNOWN)
    truth = built(structure, rng)
    truth[structure.groups["tool"]] = rng.normal(0.0, 1e-3, 3)
    fresh = rng.uniform(arm.lower, arm.upper, (FRESH, len(arm.lower)))
    expected = structure.pose(fresh, truth)[0]
    structures: dict[str, SpatialStructure] = {}
    rows: dict[str, Rows] = {}
    for name, turn in (("left", 0.0), ("right", 2.0)):
        beta = truth.copy()
        upright = exponential([np.pi / 2, 0.0, 0.0])
        beta[structure.groups["view.rotation"]] = logarithm(upright @ exponential([0.0, 0.0, turn]))
        beta[structure.groups["view.shift"]] = (0.0, 0.3, 1.6)
        q, pixels = in_picture(structure, beta, arm.lower, arm.upper, rng)
        extent = float(np.sqrt(((pixels - pixels.mean(axis=0)) ** 2).sum(axis=1).mean()))
        structures[name] = structure.with_sensor(extent=extent)
        rows[name] = Rows(q, pixels + rng.normal(0.0, CAMERA_NOISE, pixels.shape))
    errors = [fit(structures[name], [rows[name]]) for name in structures]
    errors.append(fit_sensors(structures, rows)["left"])
    left, right, both = (placed_error(found, fresh, expected) for found in errors)
    return left, right, both


def in_picture(
    structure: SpatialStructure, beta: Array, lower: Array, upper: Array, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Joints (n, dof) whose tips a camera sees, and their pixels (n, 2)."""
    q = rng.uniform(lower, upper, (20 * ROWS, len(lower)))
    pixels = structure.predict(q, beta)
    inside = ((pixels > 0.0) & (pixels < (1280.0, 720.0))).all(axis=1)
    return q[inside][:ROWS], pixels[inside][:ROWS]


def placed_error(found: BodyFit, q: Array, expected: Array) -> float:
    """Rms error of tips (n, 3) [m] but for a place of the base and the arm's size."""
    structure = found.body.structure
    assert isinstance(structure, SpatialStructure)
    tips = structure.pose(q, found.body.beta)[0]
    turn, shift, factor = similarity(tips, expected)
    return rms(np.linalg.norm(factor * tips @ turn.T + shift - expected, axis=1))


def main() -> None:
    """Print medians over worlds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--worlds", type=int, default=5)
    worlds = parser.parse_args().worlds
    tracked = np.array([trackers(np.random.default_rng(seed)) for seed in range(worlds)])
    alone, both = 1e3 * np.median(tracked, axis=0)
    share = np.median(tracked[:, 1] / tracked[:, 0])
    print(f"trackers: {alone:.3f} mm alone, {both:.3f} together, ratio {share:.2f} (median)")
    seen = np.array([cameras(np.random.default_rng(seed)) for seed in range(worlds)])
    left, right, both = 1e3 * np.median(seen, axis=0)
    print(f"cameras: {left:.2f} and {right:.2f} mm alone, {both:.2f} together")


if __name__ == "__main__":
    main()
