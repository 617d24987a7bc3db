"""Fit the body of an arm in space: from positions, poses or a camera's pixels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..arm.arm import SpatialArm
from ..arm.rotations import logarithm, matrix_of
from ..body.misfit import refuse_pixels, refuse_turns
from ..body.poses import positions_of
from ..body.posterior import BodyFit, fit_structure
from ..body.sensor import doubtful_depth
from ..body.spatial import structure_of
from ..body.spatial_random import unknown_structure
from ..body.telling import warnings_of
from ..body.views import is_camera
from ..common.scale import METRES
from ..errors import OptionError
from ..samples.samples import Samples

_VIEWS = ("auto", "base", "rigid", "similarity")


def sees_from_anywhere(samples: Samples, view: str) -> bool:
    """Whether samples are pixels of an arm in space, seen by a pinhole camera.

    Raises OptionError if `view` asks for that and the samples are others, or the other way round.
    """
    fits = samples.camera is not None and isinstance(samples.arm, SpatialArm)
    if is_camera(view) and not fits:
        raise OptionError(
            f"view {view!r} needs a log of pixels u, v and the robot that they are of, which moves "
            "in space",
            hint="for planar arms give `view='homography'`",
            parameter="view",
            value=view,
        )
    if fits and not (view == "auto" or is_camera(view)):
        raise OptionError(
            f"view {view!r} is not that of pixels of an arm in space: expected pinhole",
            parameter="view",
            value=view,
        )
    return fits


def fit_in_space(samples: Samples, rows: NDArray[np.intp], view: str, seed: int) -> BodyFit:
    """Fit the body of an arm in space to some rows of samples.

    A log's URDF is the prior of its geometry; without one, and in simulation, a chain of
    which only the joints are known is found from the rows.
    """
    q, x = samples.q[rows], samples.x[rows]
    extent = float(np.sqrt(((x - x.mean(axis=0)) ** 2).sum(axis=1).mean()))  # of the noise's floor
    notes = warnings_of(q, samples.joint_names, samples.revolute, x, samples.lower, samples.upper)
    arm, camera = samples.arm, samples.camera
    if camera is not None and isinstance(arm, SpatialArm) and x.shape[1] == 2:
        kind = "pinhole" if view == "auto" else view
        template = structure_of(
            arm, kind, unit="px", extent=extent, lens=camera.lens, lens_sd=camera.lens_sd
        )
        fit = fit_structure(template, q, x, seed=seed, notes=notes)
        refuse_pixels(fit, q, x)
        doubts = doubtful_depth(fit.body, q, samples.lower, samples.upper)
        return replace(fit, notes=(*fit.notes, *doubts))
    if view not in _VIEWS:
        raise OptionError(
            f"view {view!r} is for planar arms; for x, y, z expected one of {', '.join(_VIEWS)}",
            parameter="view",
            value=view,
        )
    metre = METRES.get(samples.unit, 1.0)
    simulated = samples.simulation is not None
    if isinstance(arm, SpatialArm) and not simulated:
        kind = {"auto": "rigid" if samples.unit in METRES else "similarity"}.get(view, view)
        template = structure_of(arm, kind, unit=samples.unit, metre=metre, extent=extent)
        if samples.orientation is not None and kind == "rigid":
            turns = samples.orientation[rows]
            refuse_turns(template, q, x, turns)
            poses = np.hstack([x, logarithm(matrix_of(turns))])
            found = fit_structure(template.with_view("pose"), q, poses, seed=seed, notes=notes)
            return positions_of(found)
        if samples.orientation is not None:
            notes = (*notes, f"orientations are not used with the view {kind!r}")
    else:
        if samples.orientation is not None:
            notes = (*notes, "orientations are used together with the robot's URDF: give `robot`")
        template = unknown_structure(
            samples.joint_names, samples.revolute, extent, samples.unit, metre
        )
    return fit_structure(template, q, x, simulated=simulated, seed=seed, notes=notes)
