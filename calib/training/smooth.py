"""The smooth part of a model: the body of the samples, which is fitted before the maps learn."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from ..arm.arm import SpatialArm
from ..arm.rotations import logarithm, matrix_of
from ..body.body_fit import BodyFit, fit_sensors
from ..body.drawing import PlanarDrawing
from ..body.planar import planar_structure
from ..body.row_notes import warnings_of
from ..body.rows import Rows
from ..body.spatial import structure_of, unknown_structure
from ..body.structure import Structure
from ..body.views import is_camera
from ..common.arrays import Index
from ..common.choices import VIEWS
from ..common.rows import row_lengths
from ..common.scale import METRES, Scale
from ..errors import OptionError
from ..maps.predictor import BodyInBox
from ..samples.samples import Samples
from .options import TrainingOptions
from .settings import LEARNING

_POSED = {
    "rigid": "pose",
    "base": "base pose",
}  # the same views of positions and orientations


Template = tuple[Structure, Rows]
"""What a body begins from, and what it is fitted to."""


def template_of(
    samples: Samples, rows: Index, options: TrainingOptions
) -> Template:
    """The template of some rows of samples.

    Raises OptionError if the view is not one of such samples, or no drawing is to be trusted.
    """
    arm = samples.arm
    drawn = isinstance(arm, SpatialArm)
    pixels = samples.camera is not None and drawn
    in_space = not pixels and samples.x.shape[1] == 3
    kinds = [
        kind for kind in VIEWS if kind == "auto" or is_camera(kind) == pixels
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
    if pixels or in_space:
        structure, measured = _in_space_template(samples, rows, view)
    else:
        structure, measured = _in_plane_template(samples, rows, view)
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
    return structure, Rows(samples.q[rows], x)


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
        return structure, measured
    if samples.camera is not None and measured.z.shape[1] == 2:
        pinhole = structure_of(
            arm,
            "pinhole",
            unit="px",
            extent=extent,
            lens=samples.camera.lens,
            lens_sd=samples.camera.lens_sd,
        )
        return pinhole, measured
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
        structure = structure.with_sensor(view=_POSED[view])
        turns = logarithm(matrix_of(samples.orientation[rows]))
        measured = replace(measured, z=np.hstack([measured.z, turns]))
    return structure, measured


@dataclass(frozen=True, eq=False)
class SmoothPart:
    """What stands under the local models."""

    fit: BodyFit
    rows: Index  # (k,), rows of the samples that it rests on
    scale: Scale  # the joints' unit box

    @property
    def smooth(self) -> BodyInBox:
        """The body, of the joints' unit box."""
        return BodyInBox(self.fit.body, self.scale)

    @property
    def error(self) -> float:
        """Mean distance of held-out rows from the body [unit]."""
        return float(row_lengths(self.fit.held_out).mean())

    def extent(self, samples: Samples) -> float:
        """Diagonal of the workspace of the samples [unit]."""
        return float(np.linalg.norm(np.ptp(samples.x[self.rows], axis=0)))


Fit = Callable[[Samples], SmoothPart]
"""Finds the smooth part of samples."""


def find_smooth_parts(
    logs: Mapping[str, Samples], options: TrainingOptions
) -> dict[str, SmoothPart]:
    """Fit one body to what each sensor saw of one arm; it is told as each of them sees it.

    logs : samples of each sensor by its name, of the same joints; the first one's drawing counts
    """
    index: dict[str, Index] = {}
    structures: dict[str, Structure] = {}
    rows: dict[str, Rows] = {}
    for name, samples in logs.items():
        every = -(-len(samples) // LEARNING.most_rows)
        index[name] = np.arange(0, len(samples), every)
        template = template_of(samples, index[name], options)
        structures[name], rows[name] = template
    fits = fit_sensors(structures, rows, seed=options.seed)
    return {
        name: _smooth_part(samples, index[name], fits[name])
        for name, samples in logs.items()
    }


def find_smooth_part(samples: Samples, options: TrainingOptions) -> SmoothPart:
    """Fit the body of the samples of one sensor."""
    return find_smooth_parts({"": samples}, options)[""]


def _smooth_part(samples: Samples, rows: Index, fit: BodyFit) -> SmoothPart:
    """The body of a fit to some rows, with notes on what these cannot tell."""
    names = samples.joint_names
    travel = samples.upper - samples.lower
    notes = [
        *warnings_of(samples.q[rows], names, samples.revolute, travel),
        *fit.notes,
    ]
    if fit.held_out.shape[1] == 6:
        fit = fit.of_positions()
    part = SmoothPart(fit, rows, samples.unit_box)
    share = part.error / part.extent(samples)
    if samples.simulation is None and share > LEARNING.no_arm:
        planar = samples.x.shape[1] == 2 and samples.arm is None
        notes.append(
            f"no {'planar ' if planar else ''}arm explains the positions: held-out rows are missed "
            f"by {100 * share:.2g} % of their extent; check that `joints` names all "
            "that moved, base to tip, that each row's joints and position are of one moment, and "
            "give the URDF of an arm in space; maps and links alone learn what is no arm: "
            "`body='none'`"
        )
    return replace(part, fit=replace(fit, notes=tuple(notes)))
