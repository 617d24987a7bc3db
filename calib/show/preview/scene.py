"""Scene: a model drawn in layers, both lattices too, with what the page around has to know."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...common.arrays import Array
from ...common.rows import thinned
from ...common.wording import filled, for_people, length_in_words
from ...model.model import Model
from ...samples.samples import Samples
from ...training.evaluate import simulation_of
from ..error_scale import STOPS, ErrorScale, colours
from ..workspace import drawn_edges, extent, node_errors, outline
from .canvas import LAYER, Canvas, DrawnArm, packed
from .placement import Placement, camera_onto, place_model

_BORDER, _SAMPLE, _TARGET, _REACHED = "#2a9d8f", "#6c7a89", "#1c7ed6", "#e8590c"
_MOST_SAMPLES = 5000
_FRAMES = 180
_SWINGS = (0.36, 0.25, 0.15, 0.08)  # of the joints about their middle, of their range
_POSTURES = 3_000  # of the cloud in space
_LINK, _FRAME = "#2f9e44", "#8b97a3"
_LINKS, _FEWEST, _MOST = 120_000, 6, 24  # in all, and of one node
_OFF = 0.06  # of the panel's side, from its edge to the words


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
        canvas.layer("Hebbian links", _LINK, "of one node; click the sensory map for another")
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
            "link": _LINK,
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


@dataclass(frozen=True, eq=False)
class Panel:
    """The box beside the workspace in which the joints' ranges are drawn."""

    corner: Array  # (3,), where every joint is at the lower end of its range
    edges: Array  # (k, 3), where the first two or three joints lead, over their whole range

    @staticmethod
    def beside(frame: Array, points: Array, size: float, dof: int) -> Panel:
        """A panel of side `size` at the right of points (n, 3), in a plane of `frame` (3, 3)."""
        seen = points @ frame.T
        low, high = seen.min(axis=0), seen.max(axis=0)
        middle = (low[1] + high[1] - size) / 2
        corner = np.array([high[0] + 0.22 * size, middle, np.median(seen[:, 2])])
        return Panel(corner @ frame, size * frame[: min(dof, 3)])

    def lift(self, u: Array) -> Array:
        """Points (n, 3) of the scene for joints (n, dof) in their unit box."""
        return np.asarray(self.corner + np.asarray(u)[:, : len(self.edges)] @ self.edges)

    def outline(self) -> tuple[Array, NDArray[np.intp]]:
        """Corners (n, 3) and pairs of them (m, 2) that the box is drawn with."""
        corners = np.array(list(np.ndindex(*(2,) * len(self.edges))), dtype=float)
        i, j = np.triu_indices(len(corners), 1)
        near = np.abs(corners[i] - corners[j]).sum(axis=1) == 1
        return self.lift(corners), np.stack([i[near], j[near]], axis=1)


def draw_maps(
    canvas: Canvas, model: Model, placement: Placement, panel: Panel, scale: ErrorScale, size: float
) -> None:
    """Draw both maps, coloured by their errors, in a scene of this size."""
    few = "over the joints' ranges" if len(model.about.joint_names) < 4 else "over three joints"
    sensory, motor = placement.lift(model.sensory.weights), panel.lift(model.motor.units)
    dot = 0.12 if len(model.axes) == 3 else 0.5
    for name, part, points, text, errors in (
        ("Sensory map", model.sensory, sensory, "where they stand", node_errors(model)[1]),
        ("Motor map", model.motor, motor, few, node_errors(model)[0]),
    ):
        tint, shape = colours(scale.share(errors)), part.lattice.shape
        edges = drawn_edges(part)
        if len(shape) == 3:  # all edges would hide the arm, and each other
            place = np.indices(shape).reshape(3, -1).T
            middle = place == np.array(shape) // 2
            edges = edges[(middle[edges[:, 0]] & middle[edges[:, 1]]).any(axis=1)]
            text += ", edges of the middle sheets"
        canvas.layer(name, "scale", f"{'x'.join(map(str, shape))} nodes {text}")
        canvas.add(f"{name}/lattice", "lines", tint, points, edges)
        apart = np.median(np.linalg.norm(np.diff(points[edges], axis=1)[:, 0], axis=1))
        width = dot * max(float(apart), 0.003 * size)
        canvas.add(f"{name}/nodes", "points", tint, points, size=width)
    canvas.add("Motor map/range", "lines", _FRAME, *panel.outline())


def packed_links(model: Model) -> dict[str, Any]:
    """Strongest motor partners of each sensory node, for the page.

    Returns "each", how many of each node, and "partners", the strongest first, the largest number
    where there are fewer.
    """
    links = model.links.T.tocsr()
    width = min(_MOST, max(_FEWEST, _LINKS // links.shape[0]))
    partners = np.full((links.shape[0], width), -1, dtype=np.int64)
    for row, (start, end) in zip(partners, pairwise(links.indptr), strict=True):
        best = np.argsort(-links.data[start:end], kind="stable")[:width]
        row[: len(best)] = links.indices[start:end][best]
    return {"each": width, "partners": packed(partners.astype(np.uint32), np.uint32)}


def telling_node(model: Model, among: NDArray[np.intp]) -> int:
    """Sensory node of some whose partners spread the furthest: it shows every branch."""
    links, units = model.links.tocsc(), model.motor.units
    parts = (units[links.indices[slice(*links.indptr[k : k + 2])]] for k in among)
    return int(among[np.argmax([float(np.ptp(u, axis=0).sum()) if len(u) else 0.0 for u in parts])])


def labels(model: Model, placement: Placement, panel: Panel) -> Iterator[tuple[str, str, Array]]:
    """Yield layer, text and place (3,) of the names of both maps and of the joints' ranges."""
    about, up = model.about, placement.frame[1]
    points = placement.lift(model.sensory.weights)
    size = extent(model) * float(np.linalg.norm(placement.axes[1]))
    yield "Sensory map", "sensory map", points[np.argmax(points @ up)] + _OFF * size * up
    yield "Motor map", "motor map", panel.lift(np.array([[0.5, 1.0 + 1.5 * _OFF, 0.0]]))[0]
    for axis in range(len(panel.edges)):
        factor, unit = for_people(about.units_of_joints[axis])
        low, high = (f"{factor * v[axis]:.4g} {unit}" for v in (about.lower, about.upper))
        for share, text in ((0.0, low), (0.5, about.joint_names[axis]), (1.0, high)):
            # the third along the other side, where no other joint's words are
            at = np.array([-2 * _OFF, -_OFF, 0.0] if axis < 2 else [1.0 + _OFF, 0.0, 0.0])
            at[axis] = share
            yield "Motor map", text, panel.lift(at[None])[0]
