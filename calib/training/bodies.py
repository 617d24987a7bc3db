"""Bodies: the fit of each sensor's samples, whose residuals the maps learn.

A rigid arm explains positions smoothly over the whole workspace; local models learn the rest.  A
fit begins from a template: the chain of the arm, how its sensor looks at it, and whether the
robot's drawing is a prior.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace

import numpy as np

from ..arm.arm import SpatialArm
from ..arm.rotations import logarithm, matrix_of
from ..body.body_fit import BodyFit, fit_sensors
from ..body.drawing import PlanarDrawing
from ..body.planar import PlanarStructure, planar_structure
from ..body.row_notes import warnings_of
from ..body.rows import Rows
from ..body.spatial import SpatialStructure, structure_of, unknown_structure
from ..body.structure import Structure
from ..body.views import is_camera
from ..common.choices import VIEWS
from ..common.rows import diagonal, rms_spread, row_lengths, thinned
from ..common.scale import METRES
from ..errors import OptionError
from ..samples.samples import Samples
from .options import TrainingOptions
from .settings import LEARNING

# the views of positions and orientations that see what these views of positions see
_POSED = {"rigid": "pose", "base": "base pose"}

Template = tuple[Structure, Rows]
"""The structure that a fit begins with, and the rows that it is fitted to."""


def fit_bodies(
    logs: Mapping[str, Samples], options: TrainingOptions
) -> dict[str, BodyFit]:
    """Fit one body to what several sensors saw of one arm; return it in the frame of each of them.

    logs : a row for each pose of each sensor by its name, of the same joints; the first one's
        drawing counts
    """
    fitted: dict[str, Samples] = {}
    structures: dict[str, Structure] = {}
    rows: dict[str, Rows] = {}
    for name, log in logs.items():
        samples = log.take(thinned(len(log), LEARNING.most_rows))
        fitted[name] = samples
        structures[name], rows[name] = _template_of(samples, options)
    fits = fit_sensors(structures, rows, seed=options.seed)
    return {
        name: _with_notes(fits[name], samples)
        for name, samples in fitted.items()
    }


def fit_body(samples: Samples, options: TrainingOptions) -> BodyFit:
    """Fit the body of a row for each pose of one sensor."""
    return fit_bodies({"": samples}, options)[""]


def mean_error(fit: BodyFit) -> float:
    """Mean distance of held-out rows from the body [unit]."""
    return float(row_lengths(fit.held_out).mean())


def _with_notes(fit: BodyFit, samples: Samples) -> BodyFit:
    """A fit to samples, of positions alone, with notes on what these cannot determine."""
    names = samples.joint_names
    travel = samples.upper - samples.lower
    warnings = warnings_of(samples.q, names, samples.revolute, travel)
    notes = [*warnings, *fit.notes]
    if fit.held_out.shape[1] == 6:
        fit = fit.of_positions()
    elif samples.orientation is not None and samples.x.shape[1] == 3:
        notes.append(
            "the orientations are not used: they are of an arm whose URDF is given, in a frame "
            "of its size (view rigid or base)"
        )
    share = mean_error(fit) / diagonal(samples.x)
    if samples.simulation is None and share > LEARNING.no_arm:
        notes.append(_no_arm(samples, share))
    return replace(fit, notes=tuple(notes))


def _no_arm(samples: Samples, share: float) -> str:
    """The note that a body misses held-out rows by this share of their extent."""
    planar = samples.x.shape[1] == 2 and samples.arm is None
    return (
        f"no {'planar ' if planar else ''}arm explains the positions: held-out rows are missed "
        f"by {100 * share:.2g} % of their extent; check that `joints` names all "
        "that moved, base to tip, that each row's joints and position are of one moment, and "
        "give the URDF of an arm in space; maps and links alone learn what is no arm: "
        "`body='none'`"
    )


def _template_of(samples: Samples, options: TrainingOptions) -> Template:
    """The template of samples.

    Raises OptionError if the view is not one of such samples, or no drawing is to be trusted.
    """
    is_spatial = isinstance(samples.arm, SpatialArm)
    pixels = samples.camera is not None and is_spatial
    in_space = not pixels and samples.x.shape[1] == 3
    _check_view(options.view, pixels=pixels, in_space=in_space)
    if pixels or in_space:
        structure, measured = _in_space(samples, options.view)
    else:
        structure, measured = _in_plane(samples, options.view)
    if options.free == "all":
        return structure, measured
    if not _is_drawn(structure) or samples.simulation is not None:
        raise OptionError(
            "free 'offsets' trusts the drawing of a robot: give `robot` and a measured log",
            parameter="free",
            value=options.free,
        )
    return structure.with_fields(zeros_alone=True), measured


def _is_drawn(structure: Structure) -> bool:
    """Whether the robot's drawing is the prior of a structure."""
    if isinstance(structure, PlanarStructure):
        return structure.nominal is not None
    return isinstance(structure, SpatialStructure) and structure.informed


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


def _in_plane(samples: Samples, view: str) -> Template:
    """The template of a planar arm, a log's with its URDF as prior."""
    simulated = samples.simulation is not None
    drawing: PlanarDrawing | None = None
    if samples.arm is not None and not simulated:
        # a joint out of the plane has no prior: the rows alone count
        with suppress(OptionError):
            drawing = PlanarDrawing.of(samples.arm)
    if view == "base" and drawing is None:
        raise OptionError(
            "view 'base' needs a measured log and the planar robot that it is of: give both, or "
            "another view"
        )
    structure = planar_structure(
        samples.x,
        samples.joint_names,
        samples.revolute,
        nominal=drawing,
        view=view,
        unit=samples.unit,
        simulated=simulated,
    )
    return structure, Rows(samples.q, samples.x)


def _in_space(samples: Samples, view: str) -> Template:
    """The template of an arm in space: only a log's URDF is a prior, a simulation's a start."""
    arm = samples.arm
    simulation = samples.simulation
    measured = Rows(samples.q, samples.x)
    extent = rms_spread(measured.z)
    unit = samples.unit
    if not isinstance(arm, SpatialArm):
        unknown = unknown_structure(
            samples.joint_names,
            samples.revolute,
            extent=extent,
            unit=unit,
            simulated=simulation is not None,
        )
        return unknown, measured
    camera = samples.camera
    if camera is not None and measured.z.shape[1] == 2:
        lens = {"lens": camera.lens, "lens_sd": camera.lens_sd}
        seen = structure_of(arm, "pinhole", unit="px", extent=extent, **lens)
        return seen, measured
    if simulation is not None:
        view = "base"
    elif view == "auto":
        view = "rigid" if unit in METRES else "similarity"
    metre = METRES.get(unit, 1.0)
    structure = structure_of(arm, view, unit=unit, metre=metre, extent=extent)
    if simulation is not None:
        structure = replace(structure, informed=False, simulated=True)
        return structure, replace(measured, noise=simulation.noise or None)
    if samples.orientation is None or view not in _POSED:
        return structure, measured
    rotvec = logarithm(matrix_of(samples.orientation))
    poses = replace(measured, z=np.hstack([measured.z, rotvec]))
    return structure.with_sensor(view=_POSED[view]), poses
