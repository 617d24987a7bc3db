"""Template: the body that a fit begins from, and the rows that it is fitted to.

It says what is known before the fit: the chain of the arm, how its sensor looks at it, and whether
the robot's drawing is a prior.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

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
from .options import TrainingOptions

# the views of positions and orientations that see what these views of positions see
_POSED = {"rigid": "pose", "base": "base pose"}

Template = tuple[Structure, Rows]
"""What a body begins from, and what it is fitted to."""


def template_of(
    samples: Samples, rows: Index, options: TrainingOptions
) -> Template:
    """The template of some rows (k,) of samples.

    Raises OptionError if the view is not one of such samples, or no drawing is to be trusted.
    """
    is_spatial = isinstance(samples.arm, SpatialArm)
    pixels = samples.camera is not None and is_spatial
    in_space = not pixels and samples.x.shape[1] == 3
    _check_view(options.view, pixels=pixels, in_space=in_space)
    if pixels or in_space:
        drawn = is_spatial
        structure, measured = _in_space(samples, rows, options.view)
    else:
        structure, measured = _in_plane(samples, rows, options.view)
        drawn = getattr(structure, "nominal", None) is not None
    if options.free == "all":
        return structure, measured
    if not drawn or samples.simulation is not None:
        raise OptionError(
            "free 'offsets' trusts the drawing of a robot: give `robot` and a measured log",
            parameter="free",
            value=options.free,
        )
    return structure.with_fields(zeros_alone=True), measured


def _check_view(view: str, *, pixels: bool, in_space: bool) -> None:
    """Raise OptionError if a view is none of such samples."""
    kinds = [
        kind for kind in VIEWS if kind == "auto" or is_camera(kind) == pixels
    ]
    if in_space:
        kinds = ["auto", "base", "rigid", "similarity"]
    if view not in kinds:
        raise OptionError(
            f"view {view!r}: expected one of {', '.join(kinds)} for these samples",
            parameter="view",
            value=view,
        )


def _in_plane(samples: Samples, rows: Index, view: str) -> Template:
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
    return structure, Rows(samples.q[rows], x)


def _in_space(samples: Samples, rows: Index, view: str) -> Template:
    """The template of an arm in space: only a log's URDF is a prior, a simulation's a start."""
    arm = samples.arm
    simulation = samples.simulation
    measured = Rows(samples.q[rows], samples.x[rows])
    extent = _extent(measured.z)
    unit = samples.unit
    metre = METRES.get(unit, 1.0)
    if not isinstance(arm, SpatialArm):
        unknown = unknown_structure(
            samples.joint_names,
            samples.revolute,
            extent,
            unit,
            metre,
            simulation is not None,
        )
        return unknown, measured
    camera = samples.camera
    if camera is not None and measured.z.shape[1] == 2:
        structure = structure_of(
            arm,
            "pinhole",
            unit="px",
            extent=extent,
            lens=camera.lens,
            lens_sd=camera.lens_sd,
        )
        return structure, measured
    if simulation is not None:
        view = "base"
    elif view == "auto":
        view = "rigid" if unit in METRES else "similarity"
    structure = structure_of(arm, view, unit=unit, metre=metre, extent=extent)
    if simulation is not None:
        structure = replace(structure, informed=False, simulated=True)
        return structure, replace(measured, noise=simulation.noise or None)
    if samples.orientation is None or view not in _POSED:
        return structure, measured
    rotvec = logarithm(matrix_of(samples.orientation[rows]))
    poses = replace(measured, z=np.hstack([measured.z, rotvec]))
    return structure.with_sensor(view=_POSED[view]), poses


def _extent(x: Array) -> float:
    """Root mean square distance of positions (n, m) from their mean [unit]."""
    centred = x - x.mean(axis=0)
    return float(np.sqrt((centred**2).sum(axis=1).mean()))
