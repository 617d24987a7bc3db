"""Draw the README's picture: both maps of an arm and two inverse answers.

python docs/make_pictures.py            # writes docs/img/maps.png
"""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

import calib
from calib.maps.map import Map

TARGET = (0.27, 0.30)
INK, SOFT = "#1b3a4b", "#7a8b99"
BRANCHES = ("#d1495b", "#2e86ab")


def draw_lattice(ax: Axes, network: Map, factor: float) -> None:
    """Nodes' lattice lines, shaded along the first lattice axis."""
    points = network.weights * factor
    lines = points[network.edges]
    shade = network.edges[:, 0] / network.size
    ax.add_collection(LineCollection(lines, array=shade, cmap="viridis", linewidths=0.6))
    ax.autoscale()


def main() -> None:
    """Train two_link_full, ask for one position, draw."""
    arm = calib.load_arm("two_link_full")
    model = calib.train(calib.babble(arm, 20_000, seed=0), size=40)
    answers = model.inverse_all(TARGET)[0]

    plt.rcParams.update({"font.size": 9, "axes.edgecolor": SOFT, "text.color": INK})
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 4.1), dpi=110)
    draw_lattice(left, model.motor, float(np.rad2deg(1)))
    left.set(xlabel="shoulder [deg]", ylabel="elbow [deg]", title="motor map")
    draw_lattice(right, model.sensory, 1000)
    right.set(xlabel="x [mm]", ylabel="y [mm]", title="sensory map", aspect="equal")
    for q, colour in zip(answers, BRANCHES, strict=False):
        left.plot(*np.rad2deg(q), "o", color=colour, markersize=9, markeredgecolor="white")
        skeleton = 1000 * arm.plane.project(arm.points(q[None])[0])
        right.plot(*skeleton.T, "-o", color=colour, linewidth=3.5, markersize=6, alpha=0.9)
    right.plot(1000 * TARGET[0], 1000 * TARGET[1], "*", color="#f4a259", markersize=15, zorder=5)
    for ax in (left, right):
        ax.spines[["top", "right"]].set_visible(False)
    figure.tight_layout()
    out = Path(__file__).parent / "img"
    out.mkdir(exist_ok=True)
    figure.savefig(out / "maps.png", metadata={"Software": None})


if __name__ == "__main__":
    main()
