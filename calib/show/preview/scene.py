"""Scene: a model drawn in layers, with what the page around them has to know."""

from __future__ import annotations

import base64
import json
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from ...common.arrays import Array
from ...common.rows import thinned
from ...common.templates import filled
from ...common.wording import length_in_words
from ...model.model import Model
from ...samples.samples import Samples
from ...training.evaluate import simulation_of
from ..error_scale import STOPS, ErrorScale, colours
from ..workspace import extent, node_errors, outline
from .canvas import LAYER, Canvas, DrawnArm
from .maps import LINK, Panel, draw_maps, labels, packed_links, telling_node
from .placement import Placement, camera_onto, place_model

_BORDER, _SAMPLE, _TARGET, _REACHED = "#2a9d8f", "#6c7a89", "#1c7ed6", "#e8590c"
_MOST_SAMPLES = 5000
_FRAMES = 180
_SWINGS = (0.36, 0.25, 0.15, 0.08)  # of the joints about their middle, of their range
_POSTURES = 3_000  # of the cloud in space


@dataclass(frozen=True, eq=False)
class Scene:
    """A model that is to be drawn."""

    model: Model
    samples: Samples | None = None

    @cached_property
    def arm(self) -> DrawnArm | None:
        """The robot, None where no URDF came with the model."""
        return DrawnArm.of(self.model.about)

    @cached_property
    def placement(self) -> Placement:
        """Where the sensor's positions are."""
        return place_model(self.model, self.arm)

    @cached_property
    def motion(self) -> tuple[Array, Array, Array]:
        """Joints (n, dof) that the inverse map answers with on a loop, targets, where they lead."""
        model, dof = self.model, len(self.model.about.joint_names)
        scale, simulation = model.motor.scale, simulation_of(model)
        t = np.linspace(0.0, 2 * np.pi, _FRAMES + 1)[:, None]
        k = np.arange(dof)
        # cosines and sines of one and two turns: a closed loop in which no joint follows another
        wave = np.cos((1 + k // 2) * t - (k % 2) * np.pi / 2 + 0.7 * k)
        low, high = np.zeros(dof), np.ones(dof)
        if model.rows is not None and len(model.axes) == 3:  # measured postures fill but a part
            low, high = np.quantile(scale.to_unit(model.rows.q), (0.05, 0.95), axis=0)
        loops = (scale.from_unit(low + (high - low) * (0.5 + s * wave)) for s in _SWINGS)
        for q in loops:
            known = np.isfinite(model.forward(q)).all(axis=1)
            if known.all():
                break
        # a log with a hole in its middle: stay at a node
        q = q[known] if known.any() else model.motor.weights[[int(np.argmax(model.visited))] * 2]
        target = model.forward(q)
        answer = model.solve(target, q)
        reached = answer.position if simulation is None else simulation.exact(answer.q)
        return answer.q, target, reached

    def html(self, *, live: bool = False) -> str:
        """Return the page; `live` where a server answers inverse queries."""
        found = find_spec("meshcat")  # not imported, which takes a quarter of a second
        assert found is not None and found.origin is not None  # noqa: S101, PT018
        viewer = Path(found.origin).parent / "viewer" / "dist" / "main.min.js"
        text = json.dumps({**self.data, "live": live}, separators=(",", ":"), allow_nan=False)
        # a name that holds a closing tag must not end the script; the page's policy lets a browser
        # load nothing that is not in it, except from its own server
        text = text.replace("<", "\\u003c")
        script = viewer.read_text(encoding="utf-8")
        return filled(__package__, "page.html", viewer=script, data=text)

    @cached_property
    def data(self) -> dict[str, Any]:
        """Plain data for the page: what is drawn, legend, labels, links, camera and notes."""
        model, about, arm, placement = self.model, self.model.about, self.arm, self.placement
        canvas, flat, frame = Canvas(), len(model.axes) == 2, self.placement.frame
        notes = ["no URDF came with this model: the arm itself is not drawn"] if arm is None else []
        notes += [placement.note] * bool(placement.note)
        size = extent(model) * float(np.linalg.norm(placement.axes[0]))
        border = placement.lift(outline(model).reshape(-1, 2)) if flat else np.empty((0, 3))
        # what the picture has to show: the reach, the arm, the photo, the panel and its words
        around = [placement.lift(model.sensory.weights), border]
        poses = {} if arm is None else arm.poses(self.motion[0])
        around += [pose[:1, :3, 3] for pose in poses.values()]
        photo = model.photo if flat else None
        if photo is not None:
            left, right, low, high = photo.box
            corners = placement.lift([[left, low], [right, low], [right, high], [left, high]])
            around.append(corners)
        panel = Panel.beside(frame, np.concatenate(around), 0.75 * size, len(about.joint_names))
        words = list(labels(model, placement, panel))
        wide = 0.12 * size * frame[0]  # half of a long word
        around += [panel.outline()[0], *(at + side * wide for *_, at in words for side in (-1, 1))]
        camera = camera_onto(np.vstack(around), frame)
        # at equal depth the graphics card would draw now the one, now the other: lines that lie on
        # the maps are drawn a little in front of them
        front = 0.006 * size * np.array(camera["direction"])
        errors = list(node_errors(model))
        if not flat:  # postures spread evenly over the learned range
            shape = _POSTURES, len(about.lower)
            cloud = np.random.default_rng(0).uniform(about.lower, about.upper, shape)
            errors.append(model.model_error(cloud))
        scale = ErrorScale.of(np.concatenate(errors), about.unit, extent(model))

        if photo is not None:
            canvas.layer("Photo", "", "by the camera that measured the arm")
            jpeg = "data:image/jpeg;base64," + base64.b64encode(photo.jpeg).decode("ascii")
            faces, behind = [[0, 1, 2], [0, 2, 3]], corners - 1.7 * front
            # the maps are drawn after what is seen through
            more: dict[str, Any] = {"image": jpeg, "opacity": 0.999}
            canvas.add("Photo/picture", "image", "#ffffff", behind, faces, **more)
        if arm is not None:
            canvas.layer(LAYER, "", "its joints and links, as its URDF describes them")
            arm.draw(canvas, poses, size)
        draw_maps(canvas, model, placement, panel, scale, size)
        canvas.layer("Hebbian links", LINK, "of one node; click the sensory map for another")
        if flat:
            canvas.layer("Workspace border", _BORDER, "of all that the learned range reaches")
            pairs = np.arange(len(border)).reshape(-1, 2)
            canvas.add("Workspace border/line", "lines", _BORDER, border + front, pairs)
        else:
            canvas.layer("Error cloud", "scale", "bound on the true position, over all postures")
            x = model.forward(cloud)
            known = np.isfinite(x).all(axis=1)
            tints, dots = colours(scale.share(errors[-1][known])), placement.lift(x[known])
            canvas.add("Error cloud/points", "points", tints, dots, size=0.007 * size)
        measured = self.samples if self.samples is not None else model.rows
        if measured is not None:
            some = thinned(len(measured.x), _MOST_SAMPLES)
            told = f"{len(some):,} of {len(measured.x):,} rows of the log"
            canvas.layer("Training samples", _SAMPLE, told, shown=False)
            dots = placement.lift(measured.x[some])
            canvas.add("Training samples/positions", "points", _SAMPLE, dots, size=0.006 * size)
        self._draw_motion(canvas, front, size)
        canvas.place("Axes", np.diag([*[0.3 * size] * 3, 1.0]))
        bound = "true position" if about.source == "simulation" else about.bound_of
        # a target is dragged in the drawn plane; in space in one through the middle of the map
        middle = placement.origin if flat else placement.lift(model.sensory.weights).mean(axis=0)
        return {
            **vars(canvas),
            "title": about.robot or "learned from a log",
            "bound": f"95 % bound on the distance to the {bound}",
            "ticks": scale.ticks(),
            "stops": STOPS[:1] if scale.empty else STOPS,
            "labels": [{"layer": n, "text": text, "at": at.tolist()} for n, text, at in words],
            "camera": camera,
            # its links are drawn first
            "node": telling_node(model, np.unique(model.sensory.winners(self.motion[1]))),
            "links": packed_links(model),
            "link": LINK,
            "target": _TARGET,
            "panel": {"corner": panel.corner.tolist(), "edges": panel.edges.tolist()},
            "plane": {"point": middle.tolist(), "normal": frame[2].tolist()},
            "size": size,
            "notes": notes,
        }

    def _draw_motion(self, canvas: Canvas, front: Array, size: float) -> None:
        """Draw both paths, a little in front (3,) of the maps, and the balls that run along."""
        _, target, reached = self.motion
        off = float(np.linalg.norm(reached - target, axis=1).mean())
        where = "the learned map" if simulation_of(self.model) is None else "the simulated arm"
        text = f"by {where}: {length_in_words(off, self.model.about.unit)} off on average"
        along = np.stack([np.arange(len(target) - 1), np.arange(1, len(target))], axis=1)
        # the two may coincide: the target is a glass ball around the tip
        paths = (
            ("Target path", target, _TARGET, "asked for", 0.022),
            ("Reached path", reached, _REACHED, text, 0.012),
        )
        for order, (name, x, colour, words, wide) in enumerate(paths):
            canvas.layer(name, colour, words)
            points = self.placement.lift(x)
            canvas.add(f"{name}/line", "lines", colour, points + front, along)
            style: dict[str, Any] = {"opacity": 1.0 if order else 0.45, "order": order + 1}
            canvas.add(f"{name}/ball", "marker", colour, size=wide * size, **style)
            track = np.tile(np.eye(4), (len(points), 1, 1))
            track[:, :3, 3] = points
            canvas.place(f"{name}/ball", track)
