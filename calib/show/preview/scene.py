"""Scene: a model drawn in layers, with what the page around them has to know."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...common.arrays import Array
from ...common.rows import thinned
from ...model.model import Model
from ...samples.samples import Samples
from ..arrows import Arrows
from ..error_scale import STOPS, ErrorScale
from ..workspace import extent, motor_errors, outline, sensory_errors, training_rows
from . import arm as arm_layer
from .arm import DrawnArm
from .canvas import Canvas
from .cloud import Cloud
from .lattices import LINK, draw_maps, labels, panel_beside, telling_node
from .motion import TARGET, Loop, draw_motion, drive
from .placement import Placement, Viewpoint, place_model

BORDER, SAMPLE, ARROW = "#2a9d8f", "#6c7a89", "#e8590c"
_MOST_SAMPLES = 5000


@dataclass(frozen=True, eq=False)
class Scene:
    """A drawn model."""

    canvas: Canvas
    camera: Viewpoint  # from where they are seen
    page: dict[str, Any]  # plain data for the page: title, legend, labels, links
    notes: tuple[str, ...]  # what the user should be told
    placement: Placement  # where the sensor's positions are
    motion: Loop  # the path of the animation
    scale: ErrorScale  # what the nodes' colours mean


def draw(model: Model, *, samples: Samples | None = None, meshes: Path | None = None) -> Scene:
    """Draw a model, its layers in the order of the legend.

    samples : measured samples to show; without them a simulated model's are drawn again
    meshes : the folder that the URDF's mesh files may be taken from
    """
    about, canvas, body = model.about, Canvas(), DrawnArm.of(model.about)
    placement, motion = place_model(model, body), drive(model)
    notes = ["no URDF came with this model: the arm itself is not drawn"] if body is None else []
    size = extent(model) * float(np.linalg.norm(placement.axes[0]))
    cloud = Cloud.of(model) if len(model.axes) == 3 else None
    line = outline(model) if cloud is None else np.empty((0, 2, 2))
    # what the picture has to show: the reach, the arm, the photo, the panel and its words
    around = [placement.lift(line.reshape(-1, 2) if len(line) else model.sensory.weights)]
    poses: dict[str, Array] = {} if body is None else body.poses(motion.q)
    if body is not None:
        around.append(placement.scale * np.array([poses[link][0, :3, 3] for link in body.way]))
    if model.photo is not None and cloud is None:
        left, right, low, high = model.photo.box
        photo = placement.lift([[left, low], [right, low], [right, high], [left, high]])
        around.append(photo)
    panel = panel_beside(
        placement.frame, np.concatenate(around), 0.75 * size, len(about.joint_names)
    )
    words = labels(model, placement, panel)
    wide = {"left": 0.12 * size * placement.frame[0]}  # what begins at the panel's edge
    ends = np.array([np.array(word["at"]) + wide.get(word["align"], 0.0) for word in words])
    around += [panel.outline[0], ends]
    camera = Viewpoint.onto(np.concatenate(around), placement.frame)
    # at equal depth the graphics card would draw now the one, now the other: lines that lie on the
    # maps are drawn a little in front of them
    front = 0.006 * size * camera.direction
    errors = [
        motor_errors(model),
        sensory_errors(model),
        *([] if cloud is None else [cloud.errors]),
    ]
    scale = ErrorScale.of(np.concatenate(errors), about.unit, extent(model))

    if model.photo is not None and cloud is None:
        canvas.layer("Photo", "", "by the camera that measured the arm")
        jpeg = base64.b64encode(model.photo.jpeg).decode("ascii")
        image, corners = f"data:image/jpeg;base64,{jpeg}", photo - 0.01 * size * camera.direction
        faces = [[0, 1, 2], [0, 2, 3]]
        # the maps are drawn after what is seen through
        canvas.add("Photo/picture", "image", "#ffffff", corners, faces, image=image, opacity=0.999)
    if body is not None:
        name = canvas.layer(arm_layer.LAYER, "", "as its URDF describes it")
        # thickness of the arm in its own metres
        drawn = extent(model) if about.unit == "m" else size / placement.scale
        notes += arm_layer.draw_arm(canvas, body, poses, drawn or size / placement.scale, meshes)
        if placement.scale != 1.0:
            canvas.place(name, np.diag([*[placement.scale] * 3, 1.0]))
    draw_maps(canvas, model, placement, panel, scale, size)
    canvas.layer("Hebbian links", LINK, "of one node; click the sensory map for another")
    if cloud is None:
        canvas.layer("Workspace border", BORDER, "of all that the learned range reaches")
        points = placement.lift(line.reshape(-1, 2)) + front
        pairs = np.arange(len(points)).reshape(-1, 2)
        canvas.add("Workspace border/line", "lines", BORDER, points, pairs)
    else:
        cloud.draw(canvas, placement, scale, 0.007 * size)
    _, x, what = training_rows(model, samples)
    if len(x):
        shown = x[thinned(len(x), _MOST_SAMPLES)]
        few = f"{len(shown):,} of {len(x):,} {what}" if len(shown) < len(x) else what
        canvas.layer("Training samples", SAMPLE, few, shown=False)
        dots = placement.lift(shown)
        canvas.add("Training samples/positions", "points", SAMPLE, dots, size=0.006 * size)
    _residuals(canvas, model, samples, placement, front, size)
    tracks = draw_motion(canvas, model, motion, placement, front, size)
    for link, transforms in poses.items():
        # links before the first joint stand still: no track for them makes the page smaller
        if np.ptp(transforms, axis=0).max() > 1e-9:
            tracks[f"{arm_layer.LAYER}/{link}"] = transforms
    canvas.animate(tracks)
    notes += [placement.note] * bool(placement.note)
    canvas.place("Axes", _axes(placement, body is not None or cloud is not None, size))
    bound = "true position" if about.source == "simulation" else about.bound_of
    # a target is dragged in the drawn plane; in space in one through the middle of the map
    middle = placement.origin if cloud is None else placement.lift(model.sensory.weights).mean(0)
    page = {
        "title": about.robot or "learned from a log",
        "legend": {
            "title": "Expected error",
            "text": f"95 % bound on the distance to the {bound}",
            "words": scale.words(),
            "ticks": scale.ticks(),
            "stops": STOPS[:1] if scale.rounding else STOPS,
        },
        "labels": words,
        "camera": camera.to_json(),
        # its links are drawn first
        "node": telling_node(model, np.unique(model.sensory.winners(motion.target))),
        "link": LINK,
        "target": TARGET,
        "panel": {"corner": panel.corner.tolist(), "edges": panel.edges.tolist()},
        "plane": {"point": middle.tolist(), "normal": placement.frame[2].tolist()},
        "size": size,
        "dot": 0.022 * size,
    }
    return Scene(canvas, camera, page, tuple(notes), placement, motion, scale)


def _residuals(
    canvas: Canvas,
    model: Model,
    samples: Samples | None,
    placement: Placement,
    front: Array,
    size: float,
) -> None:
    """Draw arrows over the photo, as lines from dots: of a log's rows or of those kept."""
    rows = samples or model.rows
    if rows is None or model.photo is None:
        return
    found = Arrows.of(model, rows.q, rows.x, model.photo.box[1] - model.photo.box[0])
    if found is None:
        return
    name, n = canvas.layer("Residuals", ARROW, found.words), len(found.seen)
    seen, ends = (placement.lift(x) + front for x in (found.seen, found.ends))
    pairs = np.arange(2 * n).reshape(2, n).T
    canvas.add(f"{name}/lines", "lines", ARROW, np.concatenate([seen, ends]), pairs)
    canvas.add(f"{name}/seen", "points", "#ffffff", seen, size=0.012 * size)


def _axes(placement: Placement, known: bool, size: float) -> Array:
    """Transform (4, 4) of the drawn axes: the robot's; of a log alone, those it counts in."""
    placed = np.diag([0.3 * size] * 3 + [1.0])
    if not known:
        x, y = placement.axes / np.linalg.norm(placement.axes, axis=1)[:, None]
        # of pixels y leads down
        placed[:3, :3] = 0.3 * size * np.stack([x, y, np.cross(x, y)], axis=1)
    return placed
