"""Template: the structure that a log's body has, and the rows that it is fitted to."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from ..arm.arm import SpatialArm
from ..arm.rotations import logarithm, matrix_of
from ..body.drawing import PlanarDrawing
from ..body.planar import planar_structure
from ..body.rows import Rows
from ..body.spatial import structure_of, unknown_structure
from ..body.structure import Structure
from ..body.views import is_camera
from ..common.arrays import Array, Index
from ..common.choices import VIEWS
from ..common.scale import METRES
from ..errors import OptionError
from ..samples.samples import Samples
from .learn import TrainingOptions

_VIEWS: tuple[str, ...] = (
    "auto",
    "base",
    "rigid",
    "similarity",
)  # of positions in space
_POSED = {
    "rigid": "pose",
    "base": "base pose",
}  # the same views of positions and orientations


@dataclass(frozen=True, eq=False)
class Template:
    """What a body is fitted to and begins from."""

    structure: Structure
    rows: Rows
    notes: tuple[str, ...] = ()

    @staticmethod
    def of(samples: Samples, rows: Index, options: TrainingOptions) -> Template:
        """The template of some rows of samples.

        Raises OptionError if the view is not one of such samples, or no drawing is to be trusted.
        """
        view = options.view
        if _in_space(samples, view):
            template = _in_space_template(samples, rows, view)
            drawn = isinstance(samples.arm, SpatialArm)
        else:
            template = _in_plane_template(samples, rows, view)
            drawn = getattr(template.structure, "nominal", None) is not None
        if options.free == "all":
            return template
        if not drawn or samples.simulation is not None:
            raise OptionError(
                "free 'offsets' trusts the drawing of a robot: give `robot` and a measured log",
                parameter="free",
                value=options.free,
            )
        structure = template.structure.changed(zeros_alone=True)
        return replace(template, structure=structure)


def _in_space(samples: Samples, view: str) -> bool:
    """Whether samples are of an arm in space; OptionError if `view` is not one of such samples."""
    pixels = samples.camera is not None and isinstance(samples.arm, SpatialArm)
    positions = not pixels and samples.x.shape[1] == 3
    kinds = _VIEWS
    if not positions:
        kinds = tuple(
            kind
            for kind in VIEWS
            if kind == "auto" or is_camera(kind) == pixels
        )
    if view not in kinds:
        message = f"view {view!r}: expected one of {', '.join(kinds)} for these samples"
        raise OptionError(message, parameter="view", value=view)
    return pixels or positions


def _in_plane_template(samples: Samples, rows: Index, view: str) -> Template:
    """The template of a planar arm, a log's with its URDF as prior."""
    simulated = samples.simulation is not None
    drawing: PlanarDrawing | None = None
    if samples.arm is not None and not simulated:
        # a joint out of the plane has no prior: the rows have to tell
        with suppress(OptionError):
            drawing = PlanarDrawing.of(samples.arm)
    if view == "base" and drawing is None:
        raise OptionError(
            "view 'base' needs a measured log and the planar robot that it is of: give both, or "
            "another view"
        )
    x = samples.x[rows]
    structure = planar_structure(
        x,
        samples.joint_names,
        samples.revolute,
        drawing,
        view,
        samples.unit,
        simulated,
    )
    return Template(structure, Rows(samples.q[rows], x))


def _in_space_template(samples: Samples, rows: Index, view: str) -> Template:
    """The template of an arm in space; only a log's URDF is a prior."""
    q = samples.q[rows]
    x = samples.x[rows]
    arm = samples.arm
    if not isinstance(arm, SpatialArm):
        unknown = unknown_structure(
            samples.joint_names,
            samples.revolute,
            _extent(x),
            samples.unit,
            METRES.get(samples.unit, 1.0),
            samples.simulation is not None,
        )
        note = (
            "orientations are used together with the robot's URDF: give `robot`"
        )
        return Template(unknown, Rows(q, x), _unless_positions(samples, note))
    if samples.camera is not None and x.shape[1] == 2:
        lens = samples.camera.lens
        sd = samples.camera.lens_sd
        pinhole = structure_of(
            arm, "pinhole", unit="px", extent=_extent(x), lens=lens, lens_sd=sd
        )
        return Template(pinhole, Rows(q, x))
    if view == "auto":
        view = "rigid" if samples.unit in METRES else "similarity"
    if samples.simulation is not None:
        view = "base"
    structure = structure_of(
        arm,
        view,
        unit=samples.unit,
        metre=METRES.get(samples.unit, 1.0),
        extent=_extent(x),
    )
    if samples.simulation is not None:
        # the drawing is where the search begins, and no prior
        structure = replace(structure, informed=False, simulated=True)
        measured = Rows(q, x, noise=samples.simulation.noise or None)
        note = "orientations are not used of a simulation"
        return Template(structure, measured, _unless_positions(samples, note))
    if samples.orientation is not None and view in _POSED:
        poses = np.hstack([x, logarithm(matrix_of(samples.orientation[rows]))])
        return Template(structure.with_view(_POSED[view]), Rows(q, poses))
    note = f"orientations are not used with the view {view!r}"
    return Template(structure, Rows(q, x), _unless_positions(samples, note))


def _unless_positions(samples: Samples, note: str) -> tuple[str, ...]:
    """A note on orientations, where there are any."""
    return () if samples.orientation is None else (note,)


def _extent(x: Array) -> float:
    """Root mean square distance [unit] of positions (n, m) from their mean."""
    return float(np.sqrt(((x - x.mean(axis=0)) ** 2).sum(axis=1).mean()))
