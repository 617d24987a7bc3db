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
from ...common.wording import length_in_words
from ...model.model import Model
from ...model.nominal import moves_in_space
from ...samples.samples import Samples
from ...training.evaluate import simulation_of
from ..error_scale import STOPS, UNKNOWN, ErrorScale, colours
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
    # (frames, m) [unit], where the tip should be, or was measured
    target: Array
    reached: Array  # (frames, m) [unit], where it is
    step: int  # frames of the page from one to the next


@dataclass(frozen=True, eq=False)
class Scene:
    """A model that is to be drawn, with a log."""

    model: Model
    log: Samples | None = None

    @cached_property
    def robot(self) -> Robot | None:
        """The robot, None without a URDF, and where maps alone do not tell where it stands."""
        about = self.model.about
        placed = self.model.body is not None or about.unit == "m"
        return Robot.of(about) if placed else None

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
        notes = [
            placement.note for placement in self.placements if placement.note
        ]
        if self.robot is None:
            notes.insert(
                0,
                "the arm is not drawn: no URDF came with this model, or its maps stand alone",
            )
        return list(dict.fromkeys(notes))

    @cached_property
    def poses(self) -> dict[str, Array]:
        """Transforms (frames, 4, 4) of the robot's links during the motion."""
        return {} if self.robot is None else self.robot.poses(self.motion.q)

    @cached_property
    def things(self) -> list[Thing]:
        """What stands around the arm, as each sensor tells of it."""
        return [
            thing for study in self.studies for thing in things_of(study.model)
        ]

    @cached_property
    def nodes(self) -> Array:
        """Nodes (n, 3) of the sensory map."""
        return self.placements[0].lift(self.model.sensory.weights)

    @cached_property
    def photo(self) -> Array:
        """Corners (4, 3) of the model's photo, its lower left first; none without one."""
        photo = self.model.photo
        if photo is None or len(self.model.axes) == 3:
            return np.empty((0, 3))
        left, right, low, high = photo.box
        corners = [[left, low], [right, low], [right, high], [left, high]]
        return self.placements[0].lift(corners)

    @cached_property
    def working_points(self) -> Array:
        """Joints of the arm and its tip's rows, or nodes where there are none (n, 3)."""
        points = [frames[:, :3, 3] for frames in self.poses.values()]
        points.append(self._rows(0)[0] if self.measured else self.nodes)
        return np.vstack(points)

    @cached_property
    def size(self) -> float:
        """Longest side of what the arm works in [m]."""
        return float(np.ptp(self.working_points, axis=0).max())

    @cached_property
    def front(self) -> Array:
        """A little way (3,) to the eye: at equal depth the one would be drawn, or the other."""
        return np.asarray(0.006 * self.size * self.frame[2])

    @cached_property
    def panel(self) -> Panel:
        """The box of the joints, beside all else."""
        still = [
            thing.placed(np.eye(4))
            for thing in self.things
            if not thing.carried
        ]
        around = np.vstack(
            [self.working_points, self.nodes, self.photo, *still]
        )
        dof = self.model.motor.units.shape[1]
        return Panel.beside(self.frame, around, 0.75 * self.size, dof)

    @property
    def camera(self) -> dict[str, object]:
        """From where all is seen; with a photo of a camera, from where it was taken."""
        eye = self.placements[0].eye
        if len(self.photo) and eye is not None:
            return camera_onto(self.photo, self.frame, eye)
        around = [
            thing.placed(np.eye(4))
            for thing in self.things
            if not thing.carried
        ]
        around += [self.working_points, self.photo]
        if not moves_in_space(self.model):  # with room for words at each side
            around.append(self.nodes)
            around.append(
                self.panel.lift([[-0.3, -0.2, 0.0], [1.1, 1.15, 0.0]])
            )
        return camera_onto(np.vstack(around), self.frame)

    @cached_property
    def field(self) -> tuple[Array, Array]:
        """Positions all over the reach, and the bound on them."""
        return bound_field(self.model)

    @cached_property
    def scale(self) -> ErrorScale:
        """Colours of bounds and errors."""
        errors = [*node_errors(self.model), self.field[1]]
        if self.measured:
            errors += [
                study.rows.distance for study in self.studies if study.rows
            ]
        unit = self.model.about.unit
        return ErrorScale.of(np.concatenate(errors), unit, extent(self.model))

    @cached_property
    def data(self) -> dict[str, object]:
        """Plain data for the page: what is drawn, legend, labels, links, camera and notes."""
        about = self.model.about
        canvas = Canvas()
        self._draw_photo(canvas)
        if self.robot is not None:
            _draw_robot(canvas, self.robot, self.poses, 0.02 * self.size)
            draw_things(canvas, self.things, self.robot.links[-1])
        draw_maps(
            canvas, self.model, self.nodes, self.panel, self.scale, self.size
        )
        self._draw_reach(canvas)
        self._draw_rows(canvas)
        self._draw_motion(canvas)
        canvas.place("Axes", np.diag([*[0.3 * self.size] * 3, 1.0]))
        measure = (
            "true position" if about.source == "simulation" else about.bound_of
        )
        winners = np.unique(self.model.sensory.winners(self.motion.target))
        normal = self.frame[2].tolist()
        return {
            **vars(canvas),
            "title": about.robot or "learned from a log",
            "bound": f"95 % bound on the distance to the {measure}; rows: their error",
            "ticks": self.scale.ticks(),
            "stops": STOPS[:1] if self.scale.empty else STOPS,
            "camera": self.camera,
            "links": links_of(self.model, winners),
            "target": _TARGET,
            "step": self.motion.step,
            "panel": {
                name: part.tolist() for name, part in vars(self.panel).items()
            },
            # in which a target is dragged; in space it goes through the middle of the map
            "plane": {
                "point": self.nodes.mean(axis=0).tolist(),
                "normal": normal,
            },
            "size": self.size,
            "notes": self.notes,
        }

    def _rows(self, sensor: int) -> tuple[Array, Array]:
        """Measured rows of a sensor in the scene (n, 3), and their errors (n,)."""
        rows = self.studies[sensor].rows
        if rows is None:
            return np.empty((0, 3)), np.empty(0)
        some = thinned(len(rows.x), SETTINGS.points)
        return self.placements[sensor].lift(rows.x[some]), rows.distance[some]

    def _draw_photo(self, canvas: Canvas, cells: int = 16) -> None:
        """Draw the photo as a grid that a tilted camera's picture is bent with."""
        photo = self.model.photo
        if photo is None or not len(self.photo):
            return
        canvas.layer("Photo", UNKNOWN, "by the camera that measured the arm")
        left, right, low, high = photo.box
        share = np.linspace(0.0, 1.0, cells + 1)
        uv = np.stack(np.meshgrid(share, share), axis=-1).reshape(-1, 2)
        points = self.placements[0].lift(
            [left, low] + uv * [right - left, high - low]
        )
        numbers = np.arange(len(uv)).reshape(cells + 1, cells + 1)
        first = numbers[:-1, :-1].ravel()
        corners = (0, 1, cells + 1, 1, cells + 2, cells + 1)  # of two triangles
        triangles = first[:, None] + np.array(corners)
        points = points - 1.7 * self.front
        drawn = canvas.add(
            "Photo/picture",
            "image",
            "#ffffff",
            points,
            triangles,
            opacity=0.999,
        )
        jpeg = base64.b64encode(photo.jpeg).decode("ascii")
        drawn["image"] = f"data:image/jpeg;base64,{jpeg}"
        drawn["uv"] = packed(uv, np.float32)

    def _draw_reach(self, canvas: Canvas) -> None:
        """Draw reachable points in the colour of the bound; they would hide rows and cameras."""
        shown = moves_in_space(self.model) and not self.measured
        canvas.layer(
            "Reach", "scale", "bound on the true position", shown=shown
        )
        x, bound = self.field
        points = self.placements[0].lift(x)
        tints = colours(self.scale.share(bound))
        canvas.add(
            "Reach/points", "points", tints, points, size=0.005 * self.size
        )

    def _draw_rows(self, canvas: Canvas) -> None:
        """Draw rows of each sensor as points in the colour of their errors."""
        if not self.measured:
            return
        for sensor, study in enumerate(self.studies):
            points, errors = self._rows(sensor)
            name = f"Rows {study.model.about.sensor}".strip()
            canvas.layer(
                name, "scale", f"{len(points):,}, in the colour of their errors"
            )
            points = points + self.front
            tints = colours(self.scale.share(errors))
            path = f"{name}/positions"
            canvas.add(path, "points", tints, points, size=0.014 * self.size)

    def _draw_motion(self, canvas: Canvas) -> None:
        """Draw the paths of a loop, and the balls that run along."""
        motion = self.motion
        off = float(
            np.linalg.norm(motion.reached - motion.target, axis=1).mean()
        )
        mean = f"{length_in_words(off, self.model.about.unit)} off on average"
        names = (
            ("Target path", "asked for"),
            ("Reached path", f"by the arm: {mean}"),
        )
        if self.measured:
            names = (
                ("Measured tip", "as measured, row by row"),
                ("Predicted tip", f"as predicted, {mean}"),
            )
        along = np.arange(len(motion.q) - 1)[:, None] + [0, 1]
        # the two may coincide: the target is a glass ball around the tip
        balls = (
            (motion.target, _TARGET, 0.022, 0.45),
            (motion.reached, _REACHED, 0.012, 1.0),
        )
        for order, (x, colour, radius, opacity) in enumerate(balls):
            name, text = names[order]
            canvas.layer(name, colour, text)
            points = self.placements[0].lift(x)
            if not self.measured:
                canvas.add(
                    f"{name}/line", "lines", colour, points + self.front, along
                )
            ball = f"{name}/ball"
            canvas.add(
                ball,
                "marker",
                colour,
                size=radius * self.size,
                opacity=opacity,
                order=order + 1,
            )
            track = np.tile(np.eye(4), (len(points), 1, 1))
            track[:, :3, 3] = points
            canvas.place(ball, track)


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
    reached = (
        answer.position if simulation is None else simulation.exact(answer.q)
    )
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
        path = (
            f"{ARM}/{tip}/{thing.name}"
            if thing.carried
            else f"Setup/{thing.name}"
        )
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
