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
from ..error_scale import STOPS, ErrorScale, colours
from ..workspace import extent, motor_errors, outline, sensory_errors, training_rows
from . import arm as arm_layer
from .arm import DrawnArm
from .canvas import POINT, Canvas
from .cloud import Cloud, cloud
from .lattices import LINK, draw_links, draw_maps, labels, panel_beside
from .motion import FPS, TARGET, Loop, draw_motion, drive
from .placement import Placement, Viewpoint, place_model

BORDER, SAMPLE, ARROW = "#2a9d8f", "#6c7a89", "#e8590c"
_MOST_SAMPLES = 5000
_REPETITIONS = 3


@dataclass(frozen=True, eq=False)
class Scene:
    """A drawn model."""

    canvas: Canvas
    camera: Viewpoint  # from where they are seen
    page: dict[str, Any]  # plain data for the page: title, legend, layers, labels, links
    notes: tuple[str, ...]  # what the user should be told
    placement: Placement  # where the sensor's positions are
    motion: Loop  # the path of the animation
    scale: ErrorScale  # what the nodes' colours mean


def draw(model: Model, *, samples: Samples | None = None, meshes: Path | None = None) -> Scene:
    """Draw a model.

    samples : measured samples to show; without them a simulated model's are drawn again
    meshes : the folder that the URDF's mesh files may be taken from
    """
    return _Drawing(model, samples, meshes).run()


class _Drawing:
    """One drawing: its layers in the order of the legend."""

    def __init__(self, model: Model, samples: Samples | None, meshes: Path | None) -> None:
        self.model, self.samples, self.meshes = model, samples, meshes
        self.canvas = Canvas()
        self.notes: list[str] = []
        self.body = DrawnArm.of(model.about)
        self.placement = place_model(model, self.body)
        self.size = extent(model) * float(np.linalg.norm(self.placement.axes[0]))
        self.in_space = len(model.axes) == 3
        self.cloud = cloud(model) if self.in_space else None

    def run(self) -> Scene:
        model, placement, canvas = self.model, self.placement, self.canvas
        motion = drive(model)
        line = np.empty((0, 2, 2)) if self.in_space else outline(model)
        around = placement.lift(line.reshape(-1, 2) if len(line) else model.sensory.weights)
        poses: dict[str, Array] = {}
        if self.body is not None:
            poses = self.body.poses(motion.q)
            stops = np.array([poses[link][0, :3, 3] for link in self.body.way])
            around = np.concatenate([around, placement.scale * stops])
        photo = self._corners()
        around = np.concatenate([around, photo])
        frame = placement.frame
        if (around @ frame[0]).max() - (around @ frame[0]).min() == 0:
            frame = np.eye(3)
        self.panel = panel_beside(frame, around, 0.75 * self.size, len(model.about.joint_names))
        self.labels = labels(model, placement, self.panel)
        wide = {"left": 0.12 * self.size * frame[0]}  # what begins at the panel's edge
        words = [np.array(each["at"]) + wide.get(each["align"], 0.0) for each in self.labels]
        camera = Viewpoint.onto(np.concatenate([around, self.panel.outline[0], words]), frame)
        # lines that lie on the maps are drawn a little in front of them
        # at equal depth the graphics card would draw now the one, now the other
        self.front = 0.006 * self.size * camera.direction
        scale = self._errors()

        if model.photo is not None and len(photo):
            canvas.layer("Photo", "", "by the camera that measured the arm")
            behind = 0.01 * self.size * camera.direction
            content = base64.b64encode(model.photo.jpeg).decode("ascii")
            canvas.image("Photo/picture", photo - behind, f"data:image/jpeg;base64,{content}")
        self._arm(poses)
        both = draw_maps(canvas, model, placement, self.panel, scale, self.size)
        self.node = draw_links(canvas, model, motion, both, self.size)
        if self.cloud is not None:
            self._cloud(self.cloud, scale)
        else:
            self._border(line)
        self._samples()
        self._residuals()
        tracks = draw_motion(canvas, model, motion, placement, self.front, self.size)
        for link, transforms in poses.items():
            # links before the first joint stand still: no track for them makes the page smaller
            if np.ptp(transforms, axis=0).max() > 1e-9:
                tracks[f"{arm_layer.LAYER}/{link}"] = transforms
        canvas.animate(tracks, FPS, _REPETITIONS)
        if placement.note:
            self.notes.append(placement.note)
        # meshcat's grid lies in z = 0 and cuts a tilted plane's maps
        canvas.set("Grid", "visible", False)
        canvas.place("Axes", self._axes())
        page = self._page(scale, camera)
        return Scene(canvas, camera, page, tuple(self.notes), placement, motion, scale)

    def _axes(self) -> Array:
        """Transform (4, 4) of the drawn axes: the robot's; of a log alone, those it counts in."""
        turn = np.eye(3)
        if self.body is None and not self.in_space:
            x, y = self.placement.axes / np.linalg.norm(self.placement.axes, axis=1)[:, None]
            turn = np.stack([x, y, np.cross(x, y)], axis=1)  # of pixels y leads down
        placed = np.eye(4)
        placed[:3, :3] = 0.3 * self.size * turn
        return placed

    def _errors(self) -> ErrorScale:
        model = self.model
        more = () if self.cloud is None else (self.cloud.errors,)
        return ErrorScale.of(
            np.concatenate([motor_errors(model), sensory_errors(model), *more]),
            model.about.unit,
            extent(model),
        )

    def _arm(self, poses: dict[str, Array]) -> None:
        if self.body is None:
            self.notes.append("no URDF came with this model: the arm itself is not drawn")
            return
        name = self.canvas.layer(arm_layer.LAYER, "", "as its URDF describes it")
        drawn = extent(self.model) if self.model.about.unit == "m" else 0.0
        size = drawn or self.size / self.placement.scale
        self.notes += arm_layer.draw_arm(self.canvas, self.body, poses, size, self.meshes)
        if self.placement.scale != 1.0:
            self.canvas.place(name, np.diag([*[self.placement.scale] * 3, 1.0]))

    def _border(self, line: Array) -> None:
        points = self.placement.lift(line.reshape(-1, 2)) + self.front
        self.canvas.layer("Workspace border", BORDER, "of all that the learned range reaches")
        pairs = np.arange(len(points)).reshape(-1, 2)
        self.canvas.lines("Workspace border/line", points, pairs, BORDER)

    def _cloud(self, found: Cloud, scale: ErrorScale) -> None:
        """Where the tip can be, coloured by the bound on its true position, and two cuts."""
        lift, dot = self.placement.lift, 0.007 * self.size
        name = self.canvas.layer(
            "Error cloud", "scale", "bound on the true position, over all postures"
        )
        self.canvas.points(f"{name}/points", lift(found.x), colours(scale.share(found.errors)), dot)
        points, errors = found.cuts(lift, self.placement.frame)
        name = self.canvas.layer("Slices", "scale", "the same, cut upright and level", shown=False)
        self.canvas.points(f"{name}/points", points, colours(scale.share(errors)), 1.5 * dot)

    def _samples(self) -> None:
        _, x, what = training_rows(self.model, self.samples)
        if not len(x):
            return
        shown = x[thinned(len(x), _MOST_SAMPLES)]
        few = f"{len(shown):,} of {len(x):,} {what}" if len(shown) < len(x) else what
        name = self.canvas.layer("Training samples", SAMPLE, few, shown=False)
        self.canvas.points(
            f"{name}/positions", self.placement.lift(shown), SAMPLE, 0.006 * self.size
        )

    def _corners(self) -> Array:
        """The photo's corners in the scene, (4, 3) from the lower left; (0, 3) without one."""
        if self.model.photo is None or self.in_space:
            return np.empty((0, 3))
        left, right, low, high = self.model.photo.box
        return self.placement.lift([[left, low], [right, low], [right, high], [left, high]])

    def _residuals(self) -> None:
        """Arrows over the photo, as lines that start at dots: of a log's rows or of those kept."""
        model, rows = self.model, self.samples or self.model.rows
        if rows is None or model.photo is None:
            return
        found = Arrows.of(model, rows.q, rows.x, model.photo.box[1] - model.photo.box[0])
        if found is None:
            return
        name, n = self.canvas.layer("Residuals", ARROW, found.words), len(found.seen)
        seen, ends = (self.placement.lift(x) + self.front for x in (found.seen, found.ends))
        pairs = np.arange(2 * n).reshape(2, n).T
        self.canvas.lines(f"{name}/lines", np.concatenate([seen, ends]), pairs, ARROW)
        self.canvas.points(f"{name}/seen", seen, "#ffffff", 0.012 * self.size)

    def _page(self, scale: ErrorScale, camera: Viewpoint) -> dict[str, Any]:
        about = self.model.about
        bound = "true position" if about.source == "simulation" else about.bound_of
        return {
            "title": about.robot or "learned from a log",
            "legend": {
                "title": "Expected error",
                "text": f"95 % bound on the distance to the {bound}",
                "words": scale.words(),
                "ticks": scale.ticks(),
                "stops": STOPS[:1] if scale.rounding else STOPS,
            },
            "layers": self.canvas.layers,
            "labels": self.labels,
            "camera": camera.to_json(),
            "node": self.node,
            "link": LINK,
            "target": TARGET,
            "panel": {"corner": self.panel.corner.tolist(), "edges": self.panel.edges.tolist()},
            "plane": {"point": self._middle().tolist(), "normal": self.placement.frame[2].tolist()},
            "size": self.size,
            "dot": 0.022 * self.size * POINT,
        }

    def _middle(self) -> Array:
        """A point of the plane in which a target is dragged."""
        if not self.in_space:
            return self.placement.origin
        return np.asarray(self.placement.lift(self.model.sensory.weights).mean(axis=0))
