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
from ..body.spatial import SpatialStructure, structure_of, unknown_structure
from ..body.structure import Structure
from ..body.views import is_camera
from ..common.arrays import Array, Index
from ..common.choices import VIEWS
from ..common.scale import METRES
from ..errors import OptionError
from ..samples.samples import Samples

_VIEWS = ("auto", "base", "rigid", "similarity")  # of positions in space
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
    def of(samples: Samples, rows: Index, view: str) -> Template:
        """The template of some rows of samples.

        Raises OptionError if `view` is not one of such samples.
        """
        if _in_space(samples, view):
            return _in_space_template(samples, rows, view)
        return _in_plane_template(samples, rows, view)


def _in_space(samples: Samples, view: str) -> bool:
    """Whether samples are of an arm in space; OptionError if `view` is not one of such samples."""
    pixels = samples.camera is not None and isinstance(samples.arm, SpatialArm)
    positions = not pixels and samples.x.shape[1] == 3
    kinds: tuple[str, ...] = _VIEWS
    if not positions:
        kinds = tuple(v for v in VIEWS if v == "auto" or is_camera(v) == pixels)
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
        x, samples.joint_names, samples.revolute, drawing, view, samples.unit, simulated
    )
    return Template(structure, Rows(samples.q[rows], x))


def _in_space_template(samples: Samples, rows: Index, view: str) -> Template:
    """The template of an arm in space; only a log's URDF is a prior."""
    q = samples.q[rows]
    x = samples.x[rows]
    arm = samples.arm
    camera = samples.camera
    extent = _extent(x)
    if camera is not None and isinstance(arm, SpatialArm) and x.shape[1] == 2:
        lens = camera.lens
        sd = camera.lens_sd
        pinhole = structure_of(
            arm, "pinhole", unit="px", extent=extent, lens=lens, lens_sd=sd
        )
        return Template(pinhole, Rows(q, x))
    metre = METRES.get(samples.unit, 1.0)
    simulated = samples.simulation is not None
    structure: SpatialStructure
    noise = None
    if isinstance(arm, SpatialArm) and not simulated:
        if view == "auto":
            view = "rigid" if samples.unit in METRES else "similarity"
        structure = structure_of(
            arm, view, unit=samples.unit, metre=metre, extent=extent
        )
        if samples.orientation is not None and view in _POSED:
            poses = np.hstack([x, logarithm(matrix_of(samples.orientation[rows]))])
            return Template(structure.with_view(_POSED[view]), Rows(q, poses))
        unused = f"orientations are not used with the view {view!r}"
    elif isinstance(
        arm, SpatialArm
    ):  # the drawing is where the search begins, and no prior
        structure = structure_of(
            arm, "base", unit=samples.unit, metre=metre, extent=extent
        )
        structure = replace(structure, informed=False, simulated=True)
        noise = samples.simulation.noise or None if samples.simulation else None
        unused = "orientations are not used of a simulation"
    else:
        names = samples.joint_names
        turns = samples.revolute
        structure = unknown_structure(
            names, turns, extent, samples.unit, metre, simulated
        )
        unused = "orientations are used together with the robot's URDF: give `robot`"
    notes = () if samples.orientation is None else (unused,)
    return Template(structure, Rows(q, x, noise=noise), notes)


def _extent(x: Array) -> float:
    """Root mean square distance [unit] of positions (n, m) from their mean."""
    return float(np.sqrt(((x - x.mean(axis=0)) ** 2).sum(axis=1).mean()))
