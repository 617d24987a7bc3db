"""Scene: an arm or a rig with its surroundings, its rows, its bound and its maps, in layers.

`data_of_model` finds what there is, decides where the camera stands and has one function after the
other draw its layer on a `Canvas`.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from ...arm.rigid import rigid
from ...common.arrays import Array
from ...common.rows import row_lengths, spread_rows
from ...common.scale import METRES
from ...common.wording import quantity
from ...maps.lattice import Lattice
from ...model.about import Photo
from ...model.model import Model
from ...model.nominal import moves_in_space, visited_joints
from ...recording.rig import HandEye
from ...samples.samples import Samples
from ...use.plan import shortest_tour
from ..error_scale import UNKNOWN, ErrorScale
from ..placement import Placement, place_model
from ..robot import Robot
from ..settings import SETTINGS
from ..setup import Thing, things_of, things_of_rig
from ..study import StudiedRows, Study, studies_of
from ..workspace import bound_field, extent, node_errors
from .camera import OBLIQUE, camera_onto, frame_of_view
from .canvas import Canvas, packed
from .maps import Panel, draw_maps, links_of

_ARM = "Arm"
_BONE = "#e0853c"
_JOINT = "#59636e"
_MEASURED = "#1c7ed6"
_PREDICTED = "#e8590c"
_THING = "#0c8599"
NO_ARM = "the arm is not drawn: no URDF came with this model, or its maps have no body"


def data_of_model(model: Model, log: Samples | None) -> dict[str, object]:
    """Plain data for the page: what is drawn, legend, labels, links, camera and notes."""
    # the arm, and what is around it
    about = model.about
    robot = None
    if model.body is not None or about.unit == "m":
        robot = Robot.of(about)
    studies = studies_of(model, log)
    placements = [place_model(study.model, robot) for study in studies]
    placement = placements[0]
    things = [thing for study in studies for thing in things_of(study.model)]
    q, measured = _motion(model, studies[0].rows)
    poses = {} if robot is None else robot.poses(q)
    nodes = placement.lift(model.sensory.weights)
    reached = [nodes, *(frames[:, :3, 3] for frames in poses.values())]
    canvas = Canvas(float(np.ptp(np.vstack(reached), axis=0).max()))
    frame = frame_of_view(placement, downwards=about.unit == "px")
    # a little way to the eye: at equal depth the one would be drawn, or the other
    front = 0.006 * canvas.size * frame[2]

    around = [*reached, *_standing(things)]
    photo = model.photo if len(model.axes) == 2 else None
    if photo is not None:
        around.append(_draw_photo(canvas, photo, placement, front))
    dof = model.motor.units.shape[1]
    panel = Panel.beside(frame, np.vstack(around), 0.75 * canvas.size, dof)
    if not moves_in_space(model):  # with room for words at each side
        around.append(panel.lift([[-0.3, -0.2, 0.0], [1.1, 1.15, 0.0]]))
    camera = camera_onto(np.vstack(around), frame)

    # a scale that holds the errors of nodes and of rows, and the bound
    points, bound = bound_field(model)
    errors = [*node_errors(model), bound]
    in_unit = [_errors_in(about.unit, study) for study in studies]
    errors += [of_rows for of_rows in in_unit if of_rows is not None]
    scale = ErrorScale.of(np.concatenate(errors), about.unit, extent(model))
    if robot is not None:
        _draw_robot(canvas, robot.links, poses)
        _draw_things(canvas, things, robot.links[-1])
    draw_maps(canvas, model, nodes, panel, scale)
    canvas.layer("Reach", "scale", "bound on the true position", shown=False)
    places = placement.lift(points)
    tints = scale.colours(bound)
    canvas.add("Reach/points", "points", tints, places, size=0.005)
    for study, of_sensor, of_rows in zip(
        studies, placements, in_unit, strict=True
    ):
        rows = study.rows
        if rows is not None:
            layer = f"Rows {study.model.about.sensor}".strip()
            at = of_sensor.lift(rows.x) + front
            # maps of a simulation show more
            shown = study.model.about.simulation is None
            if of_rows is not None:
                _draw_points(canvas, layer, at, of_rows, scale, shown=shown)
                continue
            unit = study.model.about.unit
            own = ErrorScale.of(rows.distance, unit, extent(study.model))
            _draw_points(canvas, layer, at, rows.distance, own, shown=shown)
    _draw_motion(canvas, model, placement, q, measured)

    measure = about.bound_of if about.source == "log" else "true position"
    middle = measured[len(q) // 2]
    return canvas.data(
        scale,
        camera,
        title=about.robot or "learned from a log",
        bound=f"95 % bound on the distance to the {measure}; rows: their error",
        links=links_of(model, int(model.sensory.winners(middle)[0])),
        notes=[] if robot is not None else [NO_ARM],
    )


def _errors_in(unit: str, study: Study) -> Array | None:
    """Errors (n,) of a sensor's rows in a unit; None without rows, or of pixels and a length."""
    own = study.model.about.unit
    if study.rows is None or (own != unit and not {own, unit} <= METRES.keys()):
        return None
    factor = 1.0 if own == unit else METRES[unit] / METRES[own]
    return study.rows.distance * factor


def data_of_rig(rig: HandEye) -> dict[str, object]:
    """Plain data for the page of a preview."""
    places = rig.flange[:, :3, 3]
    things = things_of_rig(rig)
    around = np.vstack([np.zeros(3), places, *_standing(things)])
    canvas = Canvas(float(np.ptp(around, axis=0).max()))
    base, flange = rig.frames
    canvas.layer(_ARM, "", "the flange, from its base")
    canvas.add(f"{_ARM}/{base}/ball", "sphere", _BONE, size=[0.02])
    canvas.add(f"{_ARM}/{flange}/ball", "sphere", _JOINT, size=[0.015])
    canvas.place(f"{_ARM}/{flange}", rig.flange)
    canvas.label(_ARM, base, np.zeros(3))
    _draw_things(canvas, things, flange)
    scale = ErrorScale.of(rig.misses, "px", extent=1.0)
    _draw_points(canvas, "Poses", places, rig.misses, scale)
    return canvas.data(
        scale,
        camera_onto(around, OBLIQUE),
        title=f"Hand-eye: {rig.hand_item} in the hand",
        bound="corners off, rms of pictures that the fit did not see",
        links=None,
        notes=[],
    )


def _motion(model: Model, rows: StudiedRows | None) -> tuple[Array, Array]:
    """What the arm goes through when the page is opened, and where its tip was measured.

    A log's rows in their order; others, or nodes, on a short way: joints (frames, dof), positions
    (frames, m) [unit].
    """
    if rows is None:
        q = visited_joints(model, SETTINGS.played)
        measured = model.forward(q)
    else:
        spread = spread_rows(len(rows.q), SETTINGS.played)
        q = rows.q[spread]
        measured = rows.x[spread]
    if rows is None or model.about.simulation is not None:
        u = model.motor.scale.to_unit(q)
        order = shortest_tour(np.linalg.norm(u[:, None] - u, axis=2))
        q = q[order]
        measured = measured[order]
    return q, measured


def _draw_photo(
    canvas: Canvas,
    photo: Photo,
    placement: Placement,
    front: Array,
) -> Array:
    """Draw the photo as a grid that a tilted camera's picture is bent with; return its points."""
    canvas.layer("Photo", UNKNOWN, "by the camera that measured the arm")
    cells = SETTINGS.photo_cells
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


def _draw_points(
    canvas: Canvas,
    layer: str,
    points: Array,
    errors: Array,
    scale: ErrorScale,
    *,
    shown: bool = True,
) -> None:
    """Draw measured points (n, 3) in the colour of their errors (n,)."""
    spread = spread_rows(len(points), SETTINGS.points)
    words = f"{len(spread):,}, in the colour of their errors"
    canvas.layer(layer, "scale", words, shown=shown)
    tints = scale.colours(errors[spread])
    canvas.add(
        f"{layer}/positions", "points", tints, points[spread], size=0.014
    )


def _draw_motion(
    canvas: Canvas,
    model: Model,
    placement: Placement,
    q: Array,
    measured: Array,
) -> None:
    """Draw the balls that run along, where the tip was and where the model expects it."""
    predicted = model.forward(q)
    error = row_lengths(predicted - measured).mean()
    words_of_errors = f"{quantity(error, model.about.unit)} off on average"
    # the two may coincide: the measured one is a glass ball around the other
    canvas.layer("Measured tip", _MEASURED, "")
    canvas.add(
        "Measured tip/ball",
        "marker",
        _MEASURED,
        size=0.022,
        opacity=0.45,
        order=1,
    )
    _follow(canvas, "Measured tip/ball", placement.lift(measured))
    canvas.layer("Predicted tip", _PREDICTED, words_of_errors)
    canvas.add("Predicted tip/ball", "marker", _PREDICTED, size=0.012, order=2)
    _follow(canvas, "Predicted tip/ball", placement.lift(predicted))


def _follow(canvas: Canvas, name: str, places: Array) -> None:
    """Let what is drawn run through places (n, 3)."""
    track = np.tile(np.eye(4), (len(places), 1, 1))
    track[:, :3, 3] = places
    canvas.place(name, track)


def _draw_robot(
    canvas: Canvas, links: Sequence[str], poses: Mapping[str, Array]
) -> None:
    """Draw links as capsules from joint to joint, moving through poses (n, 4, 4)."""
    from scipy.spatial.transform import Rotation

    canvas.layer(_ARM, "", "its joints and links, as its URDF describes them")
    for link in links:
        canvas.add(f"{_ARM}/{link}/joint", "sphere", _JOINT, size=[0.025])
        canvas.place(f"{_ARM}/{link}", poses[link])
    for link, following in pairwise(links):
        # in the frame of the link that carries it, so that it moves along
        end = (np.linalg.inv(poses[link][0]) @ poses[following][0])[:3, 3]
        length = float(np.linalg.norm(end)) / canvas.size
        if length > 0.001:
            turn, _ = Rotation.align_vectors([end], [[0.0, 1.0, 0.0]])
            path = f"{_ARM}/{link}/bone"
            canvas.add(path, "cylinder", _BONE, size=[0.02, length])
            canvas.place(path, rigid(turn.as_matrix(), end / 2))


def _standing(things: Sequence[Thing]) -> list[Array]:
    """Points (n, 3) of what is not carried."""
    return [thing.at_tip(np.eye(4)) for thing in things if not thing.carried]


def _draw_things(canvas: Canvas, things: Sequence[Thing], tip: str) -> None:
    """Draw camera, board, sockets, frames; what is carried moves along with the link `tip`."""
    if not things:
        return
    kinds = dict.fromkeys(thing.kind for thing in things)
    canvas.layer("Setup", _THING, ", ".join(kinds))
    for thing in things:
        above = f"{_ARM}/{tip}" if thing.carried else "Setup"
        path = f"{above}/{thing.name}"
        canvas.add(f"{path}/lines", "lines", _THING, thing.points, thing.pairs)
        canvas.place(path, thing.frame)
        if not thing.carried:
            canvas.label("Setup", thing.name, thing.frame[:3, 3])
