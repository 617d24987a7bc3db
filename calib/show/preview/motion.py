"""Motion: a closed path that the arm is driven along with the inverse map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...common.arrays import Array
from ...model.model import Model
from ...training.evaluate import simulation_of
from ..error_scale import length_in_words
from .canvas import Canvas
from .placement import Placement

TARGET, REACHED = "#1c7ed6", "#e8590c"
_FRAMES = 180
_WIDTHS = (0.36, 0.25, 0.15, 0.08)  # swing of the joints about their middle, of their range


@dataclass(frozen=True, eq=False)
class Loop:
    """A path, the joints that the inverse map answers with, and where they lead."""

    q: Array  # (n, dof) [rad or m], answered joints; the last row is the first
    # (n, 2) [unit], what was asked for, and where the arm comes to be: the simulated arm, or for a
    # log the place where the learned map expects it
    target: Array
    reached: Array
    true: bool  # whether `reached` is the simulated arm

    @property
    def deviation(self) -> Array:
        """Distance (n,) from target to reached position [unit]."""
        return np.asarray(np.linalg.norm(self.reached - self.target, axis=1))


def drive(model: Model) -> Loop:
    """Drive the arm along a loop through its workspace.

    The targets are where a smooth loop of the joints leads, so that they can be reached
    and stay on one branch; the inverse map sees the targets alone and that branch.
    """
    scale, dof = model.motor.scale, len(model.about.joint_names)
    t = np.linspace(0.0, 2 * np.pi, _FRAMES + 1)
    # cosines and sines of one and two turns: a closed loop in which no joint follows another
    wave = np.stack(
        [np.cos((1 + k // 2) * t - (k % 2) * np.pi / 2 + 0.7 * k) for k in range(dof)], axis=1
    )
    q = target = np.empty((0, 2))
    low, high = np.zeros(dof), np.ones(dof)
    if model.rows is not None and len(model.axes) == 3:  # measured postures fill but a part
        low, high = np.quantile(scale.to_unit(model.rows.q), (0.05, 0.95), axis=0)
    for width in _WIDTHS:
        q = scale.from_unit(low + (high - low) * (0.5 + width * wave))
        target = model.forward(q)
        if np.isfinite(target).all():
            break
    known = np.isfinite(target).all(axis=1)
    q, target = q[known], target[known]
    if not len(q):  # a log with a hole in its middle: stay at a node
        node = int(np.argmax(model.visited))
        q = model.motor.weights[[node, node]]
        target = model.sensory.weights[
            model.sensory.winners(model.predictor.value(scale.to_unit(q)))
        ]
    answer = model.solve(target, q)
    simulation = simulation_of(model)
    reached = answer.position if simulation is None else simulation.exact(answer.q)
    return Loop(answer.q, target, reached, simulation is not None)


def draw_motion(
    canvas: Canvas, model: Model, motion: Loop, placement: Placement, front: Array, size: float
) -> dict[str, Array]:
    """Draw both paths, a little in front (3,) of the maps, and the balls that run along them.

    Returns transforms (frames, 4, 4) of the balls by path.
    """
    along = np.stack([np.arange(len(motion.q) - 1), np.arange(1, len(motion.q))], axis=1)
    words = length_in_words(float(motion.deviation.mean()), model.about.unit)
    where = "the simulated arm" if motion.true else "the learned map"
    text = f"by {where}: {words} off on average"
    for name, points, colour, about in (
        ("Target path", motion.target, TARGET, "asked for"),
        ("Reached path", motion.reached, REACHED, text),
    ):
        canvas.layer(name, colour, about)
        canvas.add(f"{name}/line", "lines", colour, placement.lift(points) + front, along)
    # the two may coincide: the target is a glass ball around the tip
    canvas.add("Target path/target", "marker", TARGET, size=0.022 * size, opacity=0.45, order=1)
    canvas.add("Reached path/tip", "marker", REACHED, size=0.012 * size, order=2)
    tracks = {}
    balls = {"Target path/target": motion.target, "Reached path/tip": motion.reached}
    for name, points in balls.items():
        tracks[name] = np.tile(np.eye(4), (len(points), 1, 1))
        tracks[name][:, :3, 3] = placement.lift(points)
        canvas.place(name, tracks[name][0])
    return tracks
