"""Train on a URDF for free, then adapt to the real arm with the few poses one can afford.

    python examples/urdf_then_real.py

The "real" arm is simulated here: its forearm is 4 mm longer than the URDF says, its elbow
encoder is off by 1.5 degrees, and the camera that measures it stands turned, in its own
frame, with 0.5 mm noise and a wrong detection now and then.  With an arm of your own,
replace `measured` by `calib.read_log("log.csv", arm)`.
"""

from __future__ import annotations

import numpy as np

import calib

REAL = [
    "elbow.length=0.254",
    "elbow.offset=0.0262",
    "sensor.rotate=0.3",
    "sensor.shift=0.4,-0.1",
    "sensor.outliers=0.03",
]


def main() -> None:
    """Babble the URDF, adapt with 60 poses, and show what that gave."""
    arm = calib.load_arm("two_link")
    nominal = calib.train(calib.babble(arm, 20_000, seed=0))

    measured = calib.babble(arm, 60, seed=1, noise=5e-4, changes=REAL)
    drift = calib.check(nominal, measured)
    print(f"drifted: {drift.drifted}, causes: {', '.join(cause.words for cause in drift.causes)}")

    found = calib.adapt(nominal, measured)
    print(f"corrected: {found.correction}; {found.samples} poses, {found.outliers} left out")
    for note in found.notes:
        print(f"note: {note}")
    print(f"held-out poses: {1e3 * found.before['mean']:.1f} -> {1e3 * found.after['mean']:.2f} mm")

    truth = measured.simulation
    if truth is not None:
        q = truth.draw(2000, np.random.default_rng(2))
        gap = np.linalg.norm(found.model.forward(q) - truth.exact(q), axis=1)
        print(f"whole workspace, against the truth: {1e3 * gap.mean():.2f} mm mean")
    print(f"still calibrated: {not calib.check(found.model, measured).drifted}")
    found.model.save("two_link.adapted.calib")


if __name__ == "__main__":
    main()
