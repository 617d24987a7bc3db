"""Answers: links between the maps, branches of the inverse, a path on each branch."""

from __future__ import annotations

from functools import cache

import numpy as np

import calib
from calib.model.model import Model

from .style import FAINT, FIRST, INK, SCALE, SECOND, lattice, panels, plane, save

TARGET = np.array([0.27, 0.30])  # [m]
WAYPOINTS = np.array([[0.24, 0.40], [0.38, 0.34], [0.33, 0.26], [0.24, 0.40]])  # [m]
LENGTH = 0.30  # of the upper arm, for the drawing alone [m]
BRANCHES = (SECOND, FIRST)


@cache
def full() -> Model:
    """Return a model of an arm whose elbow bends both ways."""
    return calib.train(calib.babble(calib.load_arm("two_link_full"), 20_000, seed=0), size=40)


def links() -> None:
    """One node of the sensory map, and the motor nodes that it is linked to."""
    model = full()
    node = int(np.linalg.norm(model.sensory.weights - TARGET, axis=1).argmin())
    strength = model.links.toarray()[:, node]
    linked = strength > 0
    figure, (left, right) = panels(2, 3.6)
    lattice(left, model.motor, float(np.degrees(1)), color=FAINT)
    dots = left.scatter(
        *np.degrees(model.motor.weights[linked]).T,
        c=strength[linked] / strength.max(),
        cmap=SCALE.reversed(),
        s=26,
        zorder=3,
    )
    left.set(xlabel="shoulder [deg]", ylabel="elbow [deg]", title="motor map: its partners")
    figure.colorbar(dots, ax=left, label="strength of the link")
    lattice(right, model.sensory, 1e3, color=FAINT)
    right.plot(
        *(1e3 * model.sensory.weights[node]), "o", color=INK, markersize=9, markeredgecolor="white"
    )
    plane(right, "sensory map: one node")
    save(figure, "links")


def maps() -> None:
    """Both maps, and the two ways to reach one point."""
    model, arm = full(), calib.load_arm("two_link_full")
    figure, (left, right) = panels(2, 3.8)
    for ax, network, factor in ((left, model.motor, np.degrees(1)), (right, model.sensory, 1e3)):
        shade = network.edges[:, 0] / network.size
        lattice(ax, network, float(factor), array=shade, cmap=SCALE, color=None, alpha=0.75)
    left.set(xlabel="shoulder [deg]", ylabel="elbow [deg]", title="motor map")
    plane(right, "sensory map")
    answers = sorted(model.inverse_all(TARGET)[0], key=lambda q: -q[1])
    for q, colour in zip(answers, ("#0b7285", INK), strict=True):
        left.plot(*np.degrees(q), "o", color=colour, markersize=10, markeredgecolor="white")
        motion = arm.chain.state(q[None])
        stops = np.vstack([motion.places[..., 0], motion.position.T])
        skeleton = 1e3 * arm.plane.project(stops)
        right.plot(*skeleton.T, "-o", color=colour, linewidth=3.5, markersize=6)
    right.plot(
        *(1e3 * TARGET), "*", color="white", markeredgecolor="black", markersize=16, zorder=5
    )
    save(figure, "maps")


def path() -> None:
    """A triangle followed on both branches of the arm."""
    model = full()
    starts = sorted(model.inverse_all(WAYPOINTS[0])[0], key=lambda q: -q[1])
    figure, (space, joints) = panels(2, 3.7, width_ratios=[1, 1.3])
    for start, name, colour in zip(starts, ("elbow > 0", "elbow < 0"), BRANCHES, strict=True):
        found = model.path(WAYPOINTS, start=start)
        if len(found.jumps):
            raise SystemExit(f"{name}: jumps at the rows {found.jumps}")
        for q in found.q[:: max(1, len(found.q) // 12)]:
            elbow = LENGTH * np.array([np.cos(q[0]), np.sin(q[0])])
            points = 1e3 * np.array([[0.0, 0.0], elbow, model.forward(q)])
            space.plot(*points.T, color=colour, linewidth=0.8, alpha=0.5, marker="o", markersize=2)
        steps = np.linalg.norm(np.diff(found.target, axis=0), axis=1)
        way = 1e3 * np.concatenate([[0.0], np.cumsum(steps)])
        for k, (joint, dash) in enumerate((("shoulder", "--"), ("elbow", "-"))):
            degrees = np.degrees(found.q[:, k])
            joints.plot(way, degrees, dash, color=colour, linewidth=1.6)
            joints.annotate(
                f"{joint},\n{name}",
                (way[-1], degrees[-1]),
                xytext=(6, 0),
                textcoords="offset points",
                va="center",
                color=colour,
                fontsize=9,
            )
    space.plot(*(1e3 * WAYPOINTS.T), color=INK, linewidth=2, marker="s", markersize=5, zorder=5)
    plane(space, "arm along the path")
    joints.set(xlabel="way of the tip [mm]", ylabel="joint [deg]", title="joints: no jumps")
    joints.set_xlim(0, way[-1] * 1.3)
    for ax in (space, joints):
        ax.grid(alpha=0.6, linewidth=0.5, color=FAINT)
    save(figure, "path")
