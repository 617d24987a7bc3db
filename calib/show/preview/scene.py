"""Scene: an arm with what stands around it, its rows, its bound and its maps, in layers."""

import base64
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ...common.arrays import Array
from ...common.rows import thinned
from ...common.wording import sized
from ...maps.lattice import Lattice
from ...model.about import Photo
from ...model.model import Model
from ...model.nominal import moves_in_space
from ...recording.rigid import rigid
from ...samples.samples import Samples
from ...use.evaluate import simulation_of
from ..error_scale import UNKNOWN, ErrorScale
from ..placement import Placement, place_model
from ..robot import Robot
from ..settings import SETTINGS
from ..setup import Thing, things_of
from ..study import StudiedRows, Study, studies_of
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
NO_ARM = "the arm is not drawn: no URDF came with this model, or its maps stand alone"


class Motion(NamedTuple):
    """What the arm does when the page is opened."""

    q: Array  # (frames, dof)
    # (frames, m) [unit], where the tip should be, or was measured
    target: Array
    reached: Array  # (frames, m) [unit], where it is
    names: tuple[str, str]  # of both
    step: int  # frames of the page from one to the next


class SeenRows(NamedTuple):
    """Rows of a sensor where they are in the scene."""

    layer: str
    rows: StudiedRows
    points: Array  # (n, 3) [m]


def data_of_model(model: Model, log: Samples | None) -> dict[str, object]:
    """Plain data for the page: what is drawn, legend, labels, links, camera and notes."""
    about = model.about
    studies = studies_of(model, log)
    placed = model.body is not None or about.unit == "m"
    robot = Robot.of(about) if placed else None
    placements = [place_model(study.model, robot) for study in studies]
    placement = placements[0]
    seen = []
    if log is not None or model.rows is not None:  # a simulation has none
        seen = _seen_rows(studies, placements)
    motion = _through(model, seen[0].rows) if seen else _loop(model)
    poses = {} if robot is None else robot.poses(motion.q)
    things = [thing for study in studies for thing in things_of(study.model)]
    nodes = placement.lift(model.sensory.weights)
    x, bound = bound_field(model)
    errors = [
        *node_errors(model),
        bound,
        *(part.rows.distance for part in seen),
    ]
    scale = ErrorScale.of(np.concatenate(errors), about.unit, extent(model))

    working = [frames[:, :3, 3] for frames in poses.values()]
    working.append(seen[0].points if seen else nodes)
    size = float(np.ptp(np.vstack(working), axis=0).max())
    around = [*working, *standing(things)]
    frame = frame_of_view(placement, downwards=about.unit == "px")
    # a little way to the eye: at equal depth the one would be drawn, or the other
    front = 0.006 * size * frame[2]
    canvas = Canvas(size)
    photo = model.photo if len(model.axes) == 2 else None
    if photo is not None:
        around.append(_draw_photo(canvas, photo, placement, front))
    dof = model.motor.units.shape[1]
    panel = Panel.beside(frame, np.vstack([*around, nodes]), 0.75 * size, dof)
    if not moves_in_space(model):  # with room for words at each side
        corners = panel.lift([[-0.3, -0.2, 0.0], [1.1, 1.15, 0.0]])
        around += [nodes, corners]
    camera = camera_onto(np.vstack(around), frame)

    if robot is not None:
        _draw_robot(canvas, robot.links, poses)
        draw_things(canvas, things, robot.links[-1])
    draw_maps(canvas, model, nodes, panel, scale)
    # in space it would hide rows and cameras
    shown = moves_in_space(model) and not seen
    canvas.layer("Reach", "scale", "bound on the true position", shown=shown)
    tints = scale.colours(bound)
    canvas.add("Reach/points", "points", tints, placement.lift(x), size=0.005)
    for part in seen:
        draw_points(
            canvas, part.layer, part.points + front, part.rows.distance, scale
        )
    _draw_motion(canvas, motion, placement, about.unit, front)
    measure = about.bound_of if about.source == "log" else "true position"
    middle = motion.target[len(motion.target) // 2]
    return canvas.data(
        scale,
        camera,
        title=about.robot or "learned from a log",
        bound=f"95 % bound on the distance to the {measure}; rows: their error",
        links=links_of(model, int(model.sensory.winners(middle)[0])),
        step=motion.step,
        notes=[] if robot is not None else [NO_ARM],
    )


def _seen_rows(
    studies: Sequence[Study], placements: Sequence[Placement]
) -> list[SeenRows]:
    """Measured rows of each sensor."""
    seen = []
    for study, placement in zip(studies, placements, strict=True):
        if study.rows is not None:
            layer = f"Rows {study.model.about.sensor}".strip()
            points = placement.lift(study.rows.x)
            seen.append(SeenRows(layer, study.rows, points))
    return seen


def _through(model: Model, rows: StudiedRows) -> Motion:
    """Through the rows of a log in their order."""
    some = thinned(len(rows.q), SETTINGS.played)
    q = rows.q[some]
    names = ("Measured tip", "Predicted tip")
    return Motion(q, rows.x[some], model.forward(q), names, step=15)


def _loop(model: Model, frames: int = 180, swing: float = 0.25) -> Motion:
    """Joints that the inverse map answers with on a closed path.

    swing : of the ranges about their middles
    """
    t = np.linspace(0.0, 2 * np.pi, frames + 1)[:, None]
    k = np.arange(len(model.about.joint_names))
    # cosines and sines of one and two turns: a closed loop in which no joint follows another
    wave = np.cos((1 + k // 2) * t - (k % 2) * np.pi / 2 + 0.7 * k)
    q = model.motor.scale.from_unit(0.5 + swing * wave)
    q = q[np.isfinite(model.forward(q)).all(axis=1)]
    if not len(q):  # a log with a hole in its middle: stay at a node
        q = model.motor.weights[[int(np.argmax(model.visited))] * 2]
    target = model.forward(q)
    answer = model.solve(target, q)
    reached = answer.position
    simulation = simulation_of(model)
    if simulation is not None:
        reached = simulation.exact(answer.q)
    names = ("Target path", "Reached path")
    return Motion(answer.q, target, reached, names, step=1)


def _draw_photo(
    canvas: Canvas,
    photo: Photo,
    placement: Placement,
    front: Array,
    cells: int = 16,
) -> Array:
    """Draw the photo as a grid that a tilted camera's picture is bent with; return its points."""
    canvas.layer("Photo", UNKNOWN, "by the camera that measured the arm")
    left, right, low, high = photo.box
    grid = Lattice((cells + 1, cells + 1))
    uv = grid.positions() / cells
    corner = np.array([left, low])
    points = placement.lift(corner + uv * [right - left, high - low])
    numbers = np.arange(grid.size).reshape(grid.shape)[:-1, :-1].ravel()
    # of two triangles
    corners = np.array([0, 1, cells + 1, 1, cells + 2, cells + 1])
    drawn = canvas.add(
        "Photo/picture",
        "image",
        "#ffffff",
        points - 1.7 * front,
        numbers[:, None] + corners,
        opacity=0.999,
    )
    jpeg = base64.b64encode(photo.jpeg).decode("ascii")
    drawn["image"] = f"data:image/jpeg;base64,{jpeg}"
    drawn["uv"] = packed(uv, np.float32)
    return points


def draw_points(
    canvas: Canvas, layer: str, points: Array, errors: Array, scale: ErrorScale
) -> None:
    """Draw measured points (n, 3) in the colour of their errors (n,)."""
    some = thinned(len(points), SETTINGS.points)
    canvas.layer(
        layer, "scale", f"{len(some):,}, in the colour of their errors"
    )
    tints = scale.colours(errors[some])
    canvas.add(f"{layer}/positions", "points", tints, points[some], size=0.014)


def _draw_motion(
    canvas: Canvas,
    motion: Motion,
    placement: Placement,
    unit: str,
    front: Array,
) -> None:
    """Draw the paths of a loop, and the balls that run along."""
    apart = np.linalg.norm(motion.reached - motion.target, axis=1)
    texts = ("", f"{sized(apart.mean(), unit)} off on average")
    along = np.arange(len(motion.q) - 1)[:, None] + [0, 1]
    # the two may coincide: the target is a glass ball around the tip
    balls = (
        (motion.target, _TARGET, 0.022, 0.45),
        (motion.reached, _REACHED, 0.012, 1.0),
    )
    for order, (x, colour, radius, opacity) in enumerate(balls):
        name = motion.names[order]
        canvas.layer(name, colour, texts[order])
        points = placement.lift(x)
        if motion.step == 1:
            canvas.add(f"{name}/line", "lines", colour, points + front, along)
        ball = f"{name}/ball"
        canvas.add(
            ball,
            "marker",
            colour,
            size=radius,
            opacity=opacity,
            order=order + 1,
        )
        track = np.tile(np.eye(4), (len(points), 1, 1))
        track[:, :3, 3] = points
        canvas.place(ball, track)


def _draw_robot(
    canvas: Canvas, links: Sequence[str], poses: Mapping[str, Array]
) -> None:
    """Draw links as capsules from joint to joint, moving through poses (n, 4, 4)."""
    from scipy.spatial.transform import Rotation

    canvas.layer(ARM, "", "its joints and links, as its URDF describes them")
    for link in links:
        canvas.add(f"{ARM}/{link}/joint", "sphere", _JOINT, size=[0.025])
        canvas.place(f"{ARM}/{link}", poses[link])
    for link, following in pairwise(links):
        # in the frame of the link that carries it, so that it moves along
        end = (np.linalg.inv(poses[link][0]) @ poses[following][0])[:3, 3]
        length = float(np.linalg.norm(end)) / canvas.size
        if length > 0.001:
            turn, _ = Rotation.align_vectors([end], [[0.0, 1.0, 0.0]])
            path = f"{ARM}/{link}/bone"
            canvas.add(path, "cylinder", _BONE, size=[0.02, length])
            canvas.place(path, rigid(turn.as_matrix(), end / 2))


def standing(things: Sequence[Thing]) -> list[Array]:
    """Points (n, 3) of what is not carried."""
    return [thing.placed(np.eye(4)) for thing in things if not thing.carried]


def draw_things(canvas: Canvas, things: Sequence[Thing], tip: str) -> None:
    """Draw camera, board, sockets, frames; what is carried moves along with the link `tip`."""
    if not things:
        return
    kinds = dict.fromkeys(thing.kind for thing in things)
    canvas.layer("Setup", _THING, ", ".join(kinds))
    for thing in things:
        above = f"{ARM}/{tip}" if thing.carried else "Setup"
        path = f"{above}/{thing.name}"
        canvas.add(f"{path}/lines", "lines", _THING, thing.points, thing.pairs)
        canvas.place(path, thing.frame)
        if not thing.carried:
            canvas.label("Setup", thing.name, thing.frame[:3, 3])
