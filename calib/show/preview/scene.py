"""Scene: an arm with what stands around it, its rows, its bound and its maps, in layers."""

from __future__ import annotations

import base64
import json
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from string import Template
from typing import Any, NamedTuple

import numpy as np

from ...common.arrays import Array
from ...common.rows import thinned
from ...model.model import Model
from ...samples.samples import Samples
from ...training.evaluate import simulation_of
from ..error_scale import STOPS, ErrorScale, colours, number, unit_for
from ..judged import JudgedRows, rows_of
from ..robot import Robot
from ..settings import AMOUNTS
from ..setup import things_of
from ..workspace import bound_field, extent, node_errors, outline
from .canvas import LAYER, Canvas, draw_robot
from .maps import Panel, draw_maps, labels, links_of
from .placement import Placement, camera_onto, place_model

_BORDER = "#2a9d8f"
_TARGET = "#1c7ed6"
_REACHED = "#e8590c"
_THING = "#0c8599"
_SWINGS = (0.36, 0.25, 0.15, 0.08)  # of the joints about their middle, of their range


class Motion(NamedTuple):
    """What the arm does when the page is opened."""

    q: Array  # (frames, dof)
    target: Array  # (frames, m) [unit], where the tip should be, or was measured
    reached: Array  # (frames, m) [unit], where it is
    step: int  # frames of the page from one to the next


@dataclass(frozen=True, eq=False)
class Scene:
    """A model that is to be drawn."""

    model: Model
    samples: Samples | None = None

    @cached_property
    def robot(self) -> Robot | None:
        """The robot, None where no URDF came with the model."""
        return Robot.of(self.model.about)

    @cached_property
    def placement(self) -> Placement:
        """Where the sensor's positions are."""
        return place_model(self.model, self.robot)

    @cached_property
    def rows(self) -> JudgedRows | None:
        """Rows of a log, with their errors; a simulation has none."""
        if self.samples is None and self.model.rows is None:
            return None
        return rows_of(self.model, self.samples)

    @cached_property
    def motion(self) -> Motion:
        """Through the rows of the log in their order, else along a loop by the inverse map."""
        if self.rows is None:
            return self._loop()
        some = thinned(len(self.rows.q), AMOUNTS.played)
        q = self.rows.q[some]
        return Motion(q, self.rows.x[some], self.model.forward(q), AMOUNTS.step)

    def _loop(self) -> Motion:
        """Joints that the inverse map answers with on a closed path."""
        model = self.model
        dof = len(model.about.joint_names)
        t = np.linspace(0.0, 2 * np.pi, AMOUNTS.frames + 1)[:, None]
        k = np.arange(dof)
        # cosines and sines of one and two turns: a closed loop in which no joint follows another
        wave = np.cos((1 + k // 2) * t - (k % 2) * np.pi / 2 + 0.7 * k)
        for swing in _SWINGS:
            q = model.motor.scale.from_unit(0.5 + swing * wave)
            answered = np.isfinite(model.forward(q)).all(axis=1)
            if answered.all():
                break
        q = q[answered]
        if not len(q):  # a log with a hole in its middle: stay at a node
            q = model.motor.weights[[int(np.argmax(model.visited))] * 2]
        target = model.forward(q)
        answer = model.solve(target, q)
        simulation = simulation_of(model)
        reached = answer.position if simulation is None else simulation.exact(answer.q)
        return Motion(answer.q, target, reached, 1)

    def html(self, *, live: bool = False) -> str:
        """Return the page; `live` where a server answers inverse queries."""
        package = find_spec(
            "meshcat"
        )  # not imported, which takes a quarter of a second
        assert package is not None and package.origin is not None  # noqa: S101, PT018
        viewer = Path(package.origin).parent / "viewer" / "dist" / "main.min.js"
        text = json.dumps(
            {**self.data, "live": live}, separators=(",", ":"), allow_nan=False
        )
        folder = files(__package__)
        return Template((folder / "page.html").read_text(encoding="utf-8")).substitute(
            style=(folder / "page.css").read_text(encoding="utf-8"),
            script=(folder / "page.js").read_text(encoding="utf-8"),
            viewer=viewer.read_text(encoding="utf-8"),
            # a name that holds a closing tag must not end the script
            data=text.replace("<", "\\u003c"),
        )

    @cached_property
    def data(self) -> dict[str, Any]:
        """Plain data for the page: what is drawn, legend, labels, links, camera and notes."""
        model = self.model
        placement = self.placement
        robot = self.robot
        flat = len(model.axes) == 2
        canvas = Canvas()
        size = extent(model) * float(np.linalg.norm(placement.axes[0]))
        x, bound = bound_field(model)
        border = (
            placement.lift(outline(model).reshape(-1, 2)) if flat else np.empty((0, 3))
        )
        reach = placement.lift(x)
        poses = {} if robot is None else robot.poses(self.motion.q)
        corners = self._corners_of_photo()
        # what the picture has to show: rows or the reach, the arm, what stands around it, the photo
        places = placement.lift(
            model.sensory.weights if self.rows is None else self.rows.x
        )
        around = [
            reach if flat else places[:0],
            places,
            border,
            corners,
            *(frames[:, :3, 3] for frames in poses.values()),
        ]
        for thing in things_of(model):
            if not thing.carried:
                around.append(thing.points + thing.frame[:3, 3])
        dof = model.motor.units.shape[1]
        panel = Panel.beside(placement.frame, np.concatenate(around), 0.75 * size, dof)
        words = list(labels(model, placement, panel))
        if flat:  # the maps, with room for half of a long word at each label
            half = 0.12 * size * placement.frame[0]
            around += [panel.outline()[0], placement.lift(model.sensory.weights)]
            around += [at + side * half for _, _, at in words for side in (-1, 1)]
        camera = camera_onto(np.vstack(around), placement.frame)
        # at equal depth the graphics card would draw now the one, now the other
        front = 0.006 * size * np.array(camera["direction"])
        errors = [*node_errors(model), bound]
        if self.rows is not None:
            errors.append(self.rows.distance)
        scale = ErrorScale.of(np.concatenate(errors), model.about.unit, extent(model))

        if len(corners):
            self._draw_photo(canvas, corners - 1.7 * front)
        if robot is not None:
            canvas.layer(LAYER, "", "its joints and links, as its URDF describes them")
            draw_robot(canvas, robot, poses, size)
            words += self._draw_things(canvas, robot)
        draw_maps(canvas, model, placement, panel, scale, size)
        if flat:
            canvas.layer(
                "Workspace border", _BORDER, "of all that the learned range reaches"
            )
            pairs = np.arange(len(border)).reshape(-1, 2)
            canvas.add("Workspace border/line", "lines", _BORDER, border + front, pairs)
        else:
            # dots of the whole reach would hide a camera and its board
            alone = not any(thing.faces for thing in things_of(model))
            text = "bound on the true position, over all postures"
            canvas.layer("Reach", "scale", text, shown=alone)
            tints = colours(scale.share(bound))
            canvas.add("Reach/points", "points", tints, reach, size=0.005 * size)
        self._draw_rows(canvas, scale, front, size)
        self._draw_motion(canvas, front, size)
        canvas.place("Axes", np.diag([*[0.3 * size] * 3, 1.0]))
        # a target is dragged in the drawn plane; in space in one through the middle of the map
        middle = (
            placement.origin
            if flat
            else placement.lift(model.sensory.weights).mean(axis=0)
        )
        simulated = model.about.source == "simulation"
        measure = "true position" if simulated else model.about.bound_of
        return {
            **vars(canvas),
            "title": model.about.robot or "learned from a log",
            "bound": f"95 % bound on the distance to the {measure}; rows: their error",
            "ticks": scale.ticks(),
            "stops": STOPS[:1] if scale.empty else STOPS,
            "labels": [
                {"layer": n, "text": text, "at": at.tolist()} for n, text, at in words
            ],
            "camera": camera,
            "links": links_of(
                model, np.unique(model.sensory.winners(self.motion.target))
            ),
            "target": _TARGET,
            "step": self.motion.step,
            "panel": {"corner": panel.corner.tolist(), "edges": panel.edges.tolist()},
            "plane": {"point": middle.tolist(), "normal": placement.frame[2].tolist()},
            "size": size,
            "notes": self._notes(),
        }

    def _notes(self) -> list[str]:
        """What the user should be told of the drawing."""
        notes = []
        if self.robot is None:
            notes.append("no URDF came with this model: the arm itself is not drawn")
        if self.placement.note:
            notes.append(self.placement.note)
        return notes

    def _corners_of_photo(self) -> Array:
        """Corners (4, 3) of the model's photo, its lower left first; none without one."""
        photo = self.model.photo
        if photo is None or len(self.model.axes) == 3:
            return np.empty((0, 3))
        left, right, low, high = photo.box
        return self.placement.lift(
            [[left, low], [right, low], [right, high], [left, high]]
        )

    def _draw_photo(self, canvas: Canvas, corners: Array) -> None:
        """Draw the photo between its corners (4, 3); what is seen through lets maps shine."""
        assert self.model.photo is not None  # noqa: S101 - it has corners
        canvas.layer("Photo", "", "by the camera that measured the arm")
        jpeg = base64.b64encode(self.model.photo.jpeg).decode("ascii")
        canvas.add(
            "Photo/picture",
            "image",
            "#ffffff",
            corners,
            [[0, 1, 2], [0, 2, 3]],
            image=f"data:image/jpeg;base64,{jpeg}",
            opacity=0.999,
        )

    def _draw_things(
        self, canvas: Canvas, robot: Robot
    ) -> list[tuple[str, str, Array]]:
        """Draw camera, board, sockets, frame; what is carried moves along. Returns labels."""
        things = things_of(self.model)
        words = []
        if things:
            names = dict.fromkeys(thing.name.partition(" ")[0] for thing in things)
            canvas.layer("Setup", _THING, ", ".join(names))
        for thing in things:
            layer = f"{LAYER}/{robot.links[-1]}" if thing.carried else "Setup"
            path = f"{layer}/{thing.name}"
            canvas.add(f"{path}/lines", "lines", _THING, thing.points, thing.pairs)
            if thing.faces:
                canvas.add(
                    f"{path}/faces",
                    "surface",
                    _THING,
                    thing.points,
                    thing.faces,
                    opacity=0.4,
                )
            canvas.place(path, thing.frame)
            if not thing.carried:
                words.append(("Setup", thing.name, thing.frame[:3, 3]))
        return words

    def _draw_rows(
        self, canvas: Canvas, scale: ErrorScale, front: Array, size: float
    ) -> None:
        """Draw rows as points in the colour of their errors."""
        rows = self.rows
        if rows is None:
            return
        some = thinned(len(rows.x), AMOUNTS.points)
        text = f"{len(some):,} of {len(rows.x):,}, in the colour of their errors"
        canvas.layer("Rows", "scale", text)
        tints = colours(scale.share(rows.distance[some]))
        points = self.placement.lift(rows.x[some]) + front
        canvas.add("Rows/positions", "points", tints, points, size=0.014 * size)

    def _draw_motion(self, canvas: Canvas, front: Array, size: float) -> None:
        """Draw the paths of a loop, and the balls that run along."""
        motion = self.motion
        off = float(np.linalg.norm(motion.reached - motion.target, axis=1).mean())
        factor, unit = unit_for(off, self.model.about.unit)
        mean = f"{number(factor * off)} {unit} off on average"
        along = np.stack(
            [np.arange(len(motion.q) - 1), np.arange(1, len(motion.q))], axis=1
        )
        if self.rows is not None:
            texts = ("as measured, row by row", f"as predicted, {mean}")
            names = ("Measured tip", "Predicted tip")
        else:
            texts = ("asked for", f"by the simulated arm: {mean}")
            names = ("Target path", "Reached path")
        # the two may coincide: the target is a glass ball around the tip
        for order, (x, colour) in enumerate(
            ((motion.target, _TARGET), (motion.reached, _REACHED))
        ):
            name = names[order]
            canvas.layer(name, colour, texts[order])
            points = self.placement.lift(x)
            if self.rows is None:
                canvas.add(f"{name}/line", "lines", colour, points + front, along)
            radius = (0.022 - 0.01 * order) * size
            opacity = 1.0 if order else 0.45
            canvas.add(
                f"{name}/ball",
                "marker",
                colour,
                size=radius,
                opacity=opacity,
                order=order + 1,
            )
            track = np.tile(np.eye(4), (len(points), 1, 1))
            track[:, :3, 3] = points
            canvas.place(f"{name}/ball", track)
