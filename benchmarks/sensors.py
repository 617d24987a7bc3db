"""Several sensors of one arm: what a second one is worth.

Two trackers with frames of their own (.1 mm of noise, 40 rows each), and two cameras that see one
tag (.3 px, 40 pictures each), of a six-axis arm that is built as drawings are off: joint origins by
.5 mm and .1 deg, zeros by .3 deg.  The sensors see different poses.  Errors are those of fresh
poses in the frame of the first sensor, or of the camera's tag in the base frame up to what no
picture tells.  Of the trackers also through `calib.train([left, right])`; of the cameras also the
least error that their rows allow: that of the exact posterior, whose prior is how worlds are drawn.

    python benchmarks/sensors.py --worlds 5
"""

from __future__ import annotations

import numpy as np
from tables import typed

import calib
from calib.arm.rotations import exponential, logarithm, similarity
from calib.body.body_fit import fit, fit_sensors
from calib.body.rows import Rows
from calib.body.spatial import SpatialStructure, structure_of
from calib.body.structure import Structure
from calib.common.arrays import Array

ROWS = 40
FRESH = 500
DRAWS = 60
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


def rms_of_worlds(errors: Array) -> Array:
    """Root mean square over the rows of errors (worlds, k)."""
    return np.sqrt(np.mean(errors**2, axis=0))


def trackers(rng: np.random.Generator) -> list[float]:
    """Errors [m] in the first tracker's frame: its rows alone, with the second's; by `train`."""
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
    logs = [
        calib.Samples(
            some.q, some.z, arm.joint_names, arm.lower, arm.upper, arm.revolute,
            arm=arm, sensor=name,
        )
        for name, some in rows.items()
    ]  # fmt: skip
    trained = [calib.train(logs[0], size=4), calib.train(logs, size=4)]
    answers = [found.body.predict(fresh) for found in (alone, both)]
    answers += [model.forward(fresh) for model in trained]
    return [rms(np.linalg.norm(answer - expected, axis=1)) for answer in answers]


def cameras(rng: np.random.Generator) -> list[float]:
    """Error [m] of the tag in the base frame: the first camera alone, the second one, and both.

    Then the least errors of the same three.
    """
    arm = calib.load_arm("six_axis")
    structure = structure_of(arm, "pinhole", unit="px", lens=LENS, lens_sd=KNOWN)
    truth = built(structure, rng)
    truth[structure.groups["tool"]] = rng.normal(0.0, 1e-3, 3)
    fresh = rng.uniform(arm.lower, arm.upper, (FRESH, len(arm.lower)))
    expected = structure.pose(fresh, truth)[0]
    structures: dict[str, SpatialStructure] = {}
    rows: dict[str, Rows] = {}
    infos: list[Array] = []
    for name, turn in (("left", 0.0), ("right", 2.0)):
        beta = truth.copy()
        upright = exponential([np.pi / 2, 0.0, 0.0])
        beta[structure.groups["view.rotation"]] = logarithm(upright @ exponential([0.0, 0.0, turn]))
        beta[structure.groups["view.shift"]] = (0.0, 0.3, 1.6)
        q, pixels = in_picture(structure, beta, arm.lower, arm.upper, rng)
        extent = float(np.sqrt(((pixels - pixels.mean(axis=0)) ** 2).sum(axis=1).mean()))
        structures[name] = structure.with_sensor(extent=extent)
        rows[name] = Rows(q, pixels + rng.normal(0.0, CAMERA_NOISE, pixels.shape))
        infos.append(information(structure, q, beta))
    errors = [fit(structures[name], [rows[name]]) for name in structures]
    errors.append(fit_sensors(structures, rows)["left"])
    measured = [
        placed_error(found.body.structure, found.body.beta, fresh, expected) for found in errors
    ]
    told = (*infos, infos[0] + infos[1])
    least = [least_error(structure, truth, some, fresh, expected) for some in told]
    return [*measured, *least]


def arm_prior(structure: SpatialStructure) -> tuple[Array, Array]:
    """Parameters (k,) of the arm and its tag, and the sd of each in the worlds."""
    groups = structure.groups
    sizes = {
        5e-4: structure.shifts[1:],
        np.radians(0.1): structure.turns[1:],
        np.radians(0.3): groups["offset"][1:],
        1e-3: groups["tool"],
    }
    indices = np.concatenate([some.ravel() for some in sizes.values()])
    return indices, np.concatenate([np.full(some.size, sd) for sd, some in sizes.items()])


def information(structure: SpatialStructure, q: Array, beta: Array) -> Array:
    """What pixels at joints (n, dof) tell of the arm (k, k), wherever their camera stands."""
    arm, _ = arm_prior(structure)
    view = np.r_[structure.groups["view.rotation"], structure.groups["view.shift"]]
    _, slope = structure.linearise(q, beta, np.r_[arm, view])
    columns = slope.reshape(-1, len(arm) + len(view)) / CAMERA_NOISE
    beside = columns[:, len(arm) :]
    columns = columns[:, : len(arm)]
    return columns.T @ (columns - beside @ np.linalg.lstsq(beside, columns)[0])


def least_error(
    structure: SpatialStructure, truth: Array, told: Array, q: Array, expected: Array
) -> float:
    """Rms error of tips [m] over draws of the exact posterior."""
    arm, sd = arm_prior(structure)
    root = np.linalg.cholesky(np.linalg.inv(told + np.diag(sd**-2.0)))
    rng = np.random.default_rng(1)
    errors = []
    for _ in range(DRAWS):
        step = np.zeros(structure.size)
        step[arm] = root @ rng.normal(size=len(arm))
        drawn = structure.retract(truth, step)
        errors.append(placed_error(structure, drawn, q, expected))
    return rms(np.array(errors))


def in_picture(
    structure: SpatialStructure, beta: Array, lower: Array, upper: Array, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Joints (n, dof) whose tips a camera sees, and their pixels (n, 2)."""
    q = rng.uniform(lower, upper, (20 * ROWS, len(lower)))
    pixels = structure.predict(q, beta)
    inside = ((pixels > 0.0) & (pixels < (1280.0, 720.0))).all(axis=1)
    return q[inside][:ROWS], pixels[inside][:ROWS]


def placed_error(structure: Structure, beta: Array, q: Array, expected: Array) -> float:
    """Rms error of tips (n, 3) [m] but for a place of the base and the arm's size."""
    assert isinstance(structure, SpatialStructure)
    tips = structure.pose(q, beta)[0]
    turn, shift, factor = similarity(tips, expected)
    return rms(np.linalg.norm(factor * tips @ turn.T + shift - expected, axis=1))


def main() -> None:
    """Print medians of the trackers, root mean squares of the cameras over worlds."""
    options = typed(__doc__, worlds=5)
    tracked = np.array([trackers(np.random.default_rng(seed)) for seed in range(options.worlds)])
    for way, errors in (("the fit", tracked[:, :2]), ("train", tracked[:, 2:])):
        alone, both = 1e3 * np.median(errors, axis=0)
        share = np.median(errors[:, 1] / errors[:, 0])
        print(f"trackers by {way}: {alone:.3f} mm alone, {both:.3f} together, ratio {share:.2f}")
    seen = np.array([cameras(np.random.default_rng(seed)) for seed in range(options.worlds)])
    for what, errors in (("measured", seen[:, :3]), ("least", seen[:, 3:])):
        left, right, both = 1e3 * rms_of_worlds(errors)
        print(f"cameras, {what}: {left:.2f} and {right:.2f} mm alone, {both:.2f} together")


if __name__ == "__main__":
    main()
