"""Scene: an arm with what stands around it, its rows, its bound and its maps, in layers."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ...common.arrays import Array
from ...common.rows import thinned
from ...model.model import Model
from ...model.nominal import moves_in_space
from ...samples.samples import Samples
from ...training.evaluate import simulation_of
from ..error_scale import STOPS, UNKNOWN, ErrorScale, colours, number, unit_for
from ..placement import Placement, place_model
from ..robot import Robot
from ..settings import SETTINGS
from ..setup import Thing, things_of
from ..study import Study, studies_of
from ..workspace import bound_field, extent, node_errors
from .camera import camera_onto, frame_of_view
from .canvas import Canvas, packed
from .maps import Panel, draw_maps, links_of

ARM = "Arm"
_BONE = "#e0853c"
_JOINT = "#59636e"
_TARGET = "#1c7ed6"
_REACHED = "#e8590c"
_THING = "#0c8599"


class Motion(NamedTuple):
    """What the arm does when the page is opened."""

    q: Array  # (frames, dof)
    target: Array  # (frames, m) [unit], where the tip should be, or was measured
    reached: Array  # (frames, m) [unit], where it is
    step: int  # frames of the page from one to the next


@dataclass(frozen=True, eq=False)
class Scene:
    """A model that is to be drawn, with a log."""

    model: Model
    log: Samples | None = None

    @cached_property
    def robot(self) -> Robot | None:
        """The robot, None where no URDF came with the model."""
        return Robot.of(self.model.about)

    @cached_property
    def studies(self) -> list[Study]:
        """What each sensor saw."""
        return studies_of(self.model, self.log)

    @cached_property
    def placements(self) -> list[Placement]:
        """Where each sensor's positions are."""
        return [place_model(study.model, self.robot) for study in self.studies]

    @cached_property
    def frame(self) -> Array:
        """Rows right, up and towards the eye of what is drawn (3, 3)."""
        downwards = self.model.about.unit == "px"
        return frame_of_view(self.placements[0], downwards=downwards)

    @property
    def measured(self) -> bool:
        """Whether there are measured rows; a simulation has none."""
        kept = self.log is not None or self.model.rows is not None
        return kept and self.studies[0].rows is not None

    @cached_property
    def motion(self) -> Motion:
        """Through the rows of the log in their order, else along a loop by the inverse map."""
        rows = self.studies[0].rows
        if not self.measured or rows is None:
            return _loop(self.model)
        some = thinned(len(rows.q), SETTINGS.played)
        q = rows.q[some]
        return Motion(q, rows.x[some], self.model.forward(q), step=15)

    @cached_property
    def notes(self) -> list[str]:
        """What the user should be told of the drawing."""
        notes = [placement.note for placement in self.placements if placement.note]
        if self.robot is None:
            notes.insert(0, "no URDF came with this model: the arm itself is not drawn")
        return list(dict.fromkeys(notes))

    @cached_property
    def data(self) -> dict[str, object]:
        """Plain data for the page: what is drawn, legend, labels, links, camera and notes."""
        model = self.model
        placement = self.placements[0]
        planar = not moves_in_space(model)
        nodes = placement.lift(model.sensory.weights)
        x, bound = bound_field(model)
        poses = {} if self.robot is None else self.robot.poses(self.motion.q)
        things = [thing for study in self.studies for thing in things_of(study.model)]
        # what the picture has to show: nodes or rows, the arm, what stands around it, the maps
        around = [frames[:, :3, 3] for frames in poses.values()]
        around.append(self._rows_in_space(0) if self.measured else nodes)
        size = float(np.ptp(np.vstack(around), axis=0).max())
        around += [thing.placed(np.eye(4)) for thing in things if not thing.carried]
        photo = self._corners_of_photo()
        around.append(photo)
        if planar:
            around.append(nodes)
        panel = Panel.beside(
            self.frame, np.vstack(around), 0.75 * size, model.motor.units.shape[1]
        )
        eye = placement.eye if len(photo) else None
        if eye is not None:  # the arm is seen over its photo, through the lens
            around = [photo]
        elif planar:  # with room for words at each side
            around.append(panel.lift([[-0.3, -0.2, 0.0], [1.1, 1.15, 0.0]]))
        camera = camera_onto(np.vstack(around), self.frame, eye)
        # at equal depth the graphics card would draw now the one, now the other
        front = 0.006 * size * self.frame[2]
        errors = [*node_errors(model), bound]
        if self.measured:
            errors += [study.rows.distance for study in self.studies if study.rows]
        scale = ErrorScale.of(np.concatenate(errors), model.about.unit, extent(model))

        canvas = Canvas()
        if len(photo):
            self._draw_photo(canvas, -1.7 * front)
        if self.robot is not None:
            _draw_robot(canvas, self.robot, poses, 0.02 * size)
            draw_things(canvas, things, self.robot.links[-1])
        draw_maps(canvas, model, placement, panel, scale, size)
        # dots of the whole reach would hide rows, a camera and its board
        alone = not planar and not self.measured
        canvas.layer("Reach", "scale", "bound on the true position", shown=alone)
        tints = colours(scale.share(bound))
        width = 0.005 * size
        canvas.add("Reach/points", "points", tints, placement.lift(x), size=width)
        if self.measured:
            self._draw_rows(canvas, scale, front, 0.014 * size)
        self._draw_motion(canvas, front, size)
        canvas.place("Axes", np.diag([*[0.3 * size] * 3, 1.0]))
        # a target is dragged in the drawn plane; in space in one through the middle of the map
        simulated = model.about.source == "simulation"
        measure = "true position" if simulated else model.about.bound_of
        winners = np.unique(model.sensory.winners(self.motion.target))
        return {
            **vars(canvas),
            "title": model.about.robot or "learned from a log",
            "bound": f"95 % bound on the distance to the {measure}; rows: their error",
            "ticks": scale.ticks(),
            "stops": STOPS[:1] if scale.empty else STOPS,
            "camera": camera,
            "links": links_of(model, winners),
            "target": _TARGET,
            "step": self.motion.step,
            "panel": {"corner": panel.corner.tolist(), "edges": panel.edges.tolist()},
            "plane": {
                "point": nodes.mean(axis=0).tolist(),
                "normal": self.frame[2].tolist(),
            },
            "size": size,
            "notes": self.notes,
        }

    def _rows_in_space(self, sensor: int) -> Array:
        """Measured rows (n, 3) of a sensor in the scene."""
        rows = self.studies[sensor].rows
        assert rows is not None  # noqa: S101 - the caller has looked
        some = thinned(len(rows.x), SETTINGS.points)
        return self.placements[sensor].lift(rows.x[some])

    def _corners_of_photo(self) -> Array:
        """Corners (4, 3) of the model's photo; none without one."""
        photo = self.model.photo
        if photo is None or len(self.model.axes) == 3:
            return np.empty((0, 3))
        left, right, low, high = photo.box
        corners = [[left, low], [right, low], [right, high], [left, high]]
        return self.placements[0].lift(corners)

    def _draw_photo(self, canvas: Canvas, behind: Array, cells: int = 16) -> None:
        """Draw the photo as a grid that a tilted camera's picture is bent with."""
        photo = self.model.photo
        assert photo is not None  # noqa: S101 - it has corners
        canvas.layer("Photo", UNKNOWN, "by the camera that measured the arm")
        left, right, low, high = photo.box
        share = np.linspace(0.0, 1.0, cells + 1)
        uv = np.stack(np.meshgrid(share, share), axis=-1).reshape(-1, 2)
        positions = [left, low] + uv * [right - left, high - low]
        first = np.arange(cells * (cells + 1)).reshape(cells, cells + 1)[:, :-1].ravel()
        above = first + cells + 1
        triangles = np.concatenate(
            [
                np.stack([first, first + 1, above], axis=1),
                np.stack([first + 1, above + 1, above], axis=1),
            ]
        )
        points = self.placements[0].lift(positions) + behind
        drawn = canvas.add(
            "Photo/picture", "image", "#ffffff", points, triangles, opacity=0.999
        )
        jpeg = base64.b64encode(photo.jpeg).decode("ascii")
        drawn["image"] = f"data:image/jpeg;base64,{jpeg}"
        drawn["uv"] = packed(uv, np.float32)

    def _draw_rows(
        self, canvas: Canvas, scale: ErrorScale, front: Array, width: float
    ) -> None:
        """Draw rows of each sensor as points in the colour of their errors."""
        for sensor, study in enumerate(self.studies):
            if study.rows is None:
                continue
            points = self._rows_in_space(sensor) + front
            name = f"Rows {study.model.about.sensor}".strip()
            text = f"{len(points):,} of {len(study.rows.x):,}, in the colour of their errors"
            canvas.layer(name, "scale", text)
            some = thinned(len(study.rows.x), SETTINGS.points)
            tints = colours(scale.share(study.rows.distance[some]))
            canvas.add(f"{name}/positions", "points", tints, points, size=width)

    def _draw_motion(self, canvas: Canvas, front: Array, size: float) -> None:
        """Draw the paths of a loop, and the balls that run along."""
        motion = self.motion
        off = float(np.linalg.norm(motion.reached - motion.target, axis=1).mean())
        factor, unit = unit_for(off, self.model.about.unit)
        mean = f"{number(factor * off)} {unit} off on average"
        if self.measured:
            names = "Measured tip", "Predicted tip"
            texts = "as measured, row by row", f"as predicted, {mean}"
        else:
            names = "Target path", "Reached path"
            texts = "asked for", f"by the simulated arm: {mean}"
        along = np.arange(len(motion.q) - 1)[:, None] + [0, 1]
        # the two may coincide: the target is a glass ball around the tip
        balls = (
            (motion.target, _TARGET, 0.022, 0.45),
            (motion.reached, _REACHED, 0.012, 1.0),
        )
        for order, (x, colour, radius, opacity) in enumerate(balls):
            name = canvas.layer(names[order], colour, texts[order])
            points = self.placements[0].lift(x)
            if not self.measured:
                canvas.add(f"{name}/line", "lines", colour, points + front, along)
            canvas.add(
                f"{name}/ball",
                "marker",
                colour,
                size=radius * size,
                opacity=opacity,
                order=order + 1,
            )
            track = np.tile(np.eye(4), (len(points), 1, 1))
            track[:, :3, 3] = points
            canvas.place(f"{name}/ball", track)


def _loop(model: Model, frames: int = 180) -> Motion:
    """Joints that the inverse map answers with on a closed path."""
    t = np.linspace(0.0, 2 * np.pi, frames + 1)[:, None]
    k = np.arange(len(model.about.joint_names))
    # cosines and sines of one and two turns: a closed loop in which no joint follows another
    wave = np.cos((1 + k // 2) * t - (k % 2) * np.pi / 2 + 0.7 * k)
    for swing in (0.36, 0.25, 0.15, 0.08):  # of the ranges about their middles
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
    return Motion(answer.q, target, reached, step=1)


def _draw_robot(
    canvas: Canvas, robot: Robot, poses: Mapping[str, Array], radius: float
) -> None:
    """Draw links as capsules from joint to joint, moving through poses (n, 4, 4)."""
    from scipy.spatial.transform import Rotation

    canvas.layer(ARM, "", "its joints and links, as its URDF describes them")
    for link in robot.links:
        joint = f"{ARM}/{link}/joint"
        canvas.add(joint, "sphere", _JOINT, size=[1.25 * radius])
        canvas.place(f"{ARM}/{link}", poses[link])
    for link, following in pairwise(robot.links):
        # in the frame of the link that carries it, so that it moves along
        end = (np.linalg.inv(poses[link][0]) @ poses[following][0])[:3, 3]
        length = float(np.linalg.norm(end))
        if length > 0.05 * radius:
            bone = np.eye(4)
            along, _ = Rotation.align_vectors([end], [[0.0, 1.0, 0.0]])
            bone[:3, :3] = along.as_matrix()
            bone[:3, 3] = end / 2
            path = f"{ARM}/{link}/bone"
            canvas.add(path, "cylinder", _BONE, size=[radius, length])
            canvas.place(path, bone)


def draw_things(canvas: Canvas, things: list[Thing], tip: str) -> None:
    """Draw camera, board, sockets, frames; what is carried moves along with the link `tip`."""
    if not things:
        return
    kinds = dict.fromkeys(thing.kind for thing in things)
    canvas.layer("Setup", _THING, ", ".join(kinds))
    for thing in things:
        path = f"{ARM}/{tip}/{thing.name}" if thing.carried else f"Setup/{thing.name}"
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
            canvas.label("Setup", thing.name, thing.frame[:3, 3])
