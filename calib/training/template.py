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
from ..common.arrays import Index
from ..common.choices import VIEWS
from ..common.scale import METRES
from ..errors import OptionError
from ..samples.samples import Samples
from .learn import TrainingOptions
from .settings import LEARNING

_POSED = {
    "rigid": "pose",
    "base": "base pose",
}  # the same views of positions and orientations


@dataclass(frozen=True, eq=False)
class Template:
    """What a body is fitted to and begins from."""

    structure: Structure
    rows: Rows
    index: Index  # (k,), of these rows in the samples
    notes: tuple[str, ...] = ()

    @staticmethod
    def of(samples: Samples, options: TrainingOptions) -> Template:
        """The template of samples, or of evenly spread ones of very many.

        Raises OptionError if the view is not one of such samples, or no drawing is to be trusted.
        """
        arm = samples.arm
        drawn = isinstance(arm, SpatialArm)
        pixels = samples.camera is not None and drawn
        in_space = not pixels and samples.x.shape[1] == 3
        kinds = [
            kind
            for kind in VIEWS
            if kind == "auto" or is_camera(kind) == pixels
        ]
        if in_space:
            kinds = ["auto", "base", "rigid", "similarity"]
        view = options.view
        if view not in kinds:
            raise OptionError(
                f"view {view!r}: expected one of {', '.join(kinds)} for these samples",
                parameter="view",
                value=view,
            )
        every = -(-len(samples) // LEARNING.most_rows)
        index = np.arange(0, len(samples), every)
        if pixels or in_space:
            template = _in_space_template(samples, index, view)
        else:
            template = _in_plane_template(samples, index, view)
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
    return Template(structure, Rows(samples.q[rows], x), rows)


def _in_space_template(samples: Samples, rows: Index, view: str) -> Template:
    """The template of an arm in space; only a log's URDF is a prior."""
    arm = samples.arm
    unit = samples.unit
    metre = METRES.get(unit, 1.0)
    simulation = samples.simulation
    measured = Rows(samples.q[rows], samples.x[rows])
    # root mean square distance of positions from their mean
    off = measured.z - measured.z.mean(axis=0)
    extent = float(np.sqrt((off**2).sum(axis=1).mean()))
    notes: tuple[str, ...] = ()
    if not isinstance(arm, SpatialArm):
        simulated = simulation is not None
        structure = unknown_structure(
            samples.joint_names,
            samples.revolute,
            extent,
            unit,
            metre,
            simulated,
        )
        if samples.orientation is not None:
            words = "orientations are used together with the robot's URDF"
            notes = (f"{words}: give `robot`",)
        return Template(structure, measured, rows, notes)
    if samples.camera is not None and measured.z.shape[1] == 2:
        pinhole = structure_of(
            arm,
            "pinhole",
            unit="px",
            extent=extent,
            lens=samples.camera.lens,
            lens_sd=samples.camera.lens_sd,
        )
        return Template(pinhole, measured, rows)
    if view == "auto":
        view = "rigid" if unit in METRES else "similarity"
    if simulation is not None:
        view = "base"
    structure = structure_of(arm, view, unit=unit, metre=metre, extent=extent)
    if simulation is not None:
        # the drawing is where the search begins, and no prior
        structure = replace(structure, informed=False, simulated=True)
        measured = replace(measured, noise=simulation.noise or None)
    elif samples.orientation is not None and view in _POSED:
        structure = structure.with_view(_POSED[view])
        turns = logarithm(matrix_of(samples.orientation[rows]))
        measured = replace(measured, z=np.hstack([measured.z, turns]))
    elif samples.orientation is not None:
        notes = (f"orientations are not used with the view {view!r}",)
    return Template(structure, measured, rows, notes)
