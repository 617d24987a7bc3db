"""Draw a path through waypoints on both branches of an arm.

python docs/make_path_picture.py        # writes docs/img/path.png
"""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np

import calib

WAYPOINTS = np.array([[0.24, 0.40], [0.38, 0.34], [0.33, 0.26], [0.24, 0.40]])  # [m]
LENGTH = 0.30  # of the upper arm, for the drawing only [m]
STYLES = (("elbow > 0", "#d1495b"), ("elbow < 0", "#2e86ab"))
INK = "#1b3a4b"


def main() -> None:
    """Train two_link_full, follow the waypoints on both branches, draw."""
    arm = calib.load_arm("two_link_full")
    model = calib.train(calib.babble(arm, 20_000, seed=0), size=40)
    starts = sorted(model.inverse_all(WAYPOINTS[0])[0], key=lambda q: -q[1])
    figure, (space, joints) = plt.subplots(
        1, 2, figsize=(9.6, 4.4), gridspec_kw={"width_ratios": [1, 1.25]}, layout="constrained"
    )
    for start, (name, color) in zip(starts, STYLES, strict=True):
        path = model.path(WAYPOINTS, start=start)
        if len(path.jumps):
            raise SystemExit(f"{name}: jumps at the rows {path.jumps}")
        for q in path.q[:: max(1, len(path.q) // 12)]:
            elbow = LENGTH * np.array([np.cos(q[0]), np.sin(q[0])])
            tip = model.forward(q)
            points = 1e3 * np.array([[0.0, 0.0], elbow, tip])
            space.plot(*points.T, color=color, lw=0.8, alpha=0.45, marker="o", ms=2)
        way = np.concatenate(
            [[0.0], np.cumsum(np.linalg.norm(np.diff(path.target, axis=0), axis=1))]
        )
        joints.plot(1e3 * way, np.degrees(path.q[:, 0]), color=color, lw=1.6, ls="--")
        joints.plot(1e3 * way, np.degrees(path.q[:, 1]), color=color, lw=1.6)
        for k, label in enumerate(("shoulder", "elbow")):
            joints.annotate(
                f"{label}, {name}",
                (1e3 * way[-1], np.degrees(path.q[-1, k])),
                xytext=(6, 0),
                textcoords="offset points",
                va="center",
                color=color,
                fontsize=9,
            )
    space.plot(*(1e3 * WAYPOINTS.T), color=INK, lw=2, marker="s", ms=5, zorder=5)
    space.set(aspect="equal", xlabel="x [mm]", ylabel="y [mm]", title="Arm along the path")
    joints.set(xlabel="way of the tip [mm]", ylabel="joint [deg]", title="Joints: no jumps")
    joints.set_xlim(0, 1e3 * way[-1] * 1.42)
    for ax in (space, joints):
        ax.spines[["top", "right"]].set_visible(False)
        ax.grid(alpha=0.25, lw=0.5)
    folder = Path(__file__).parent / "img"
    folder.mkdir(exist_ok=True)
    figure.savefig(folder / "path.png", dpi=150)


if __name__ == "__main__":
    main()
