"""The smooth part of a model: the body of the samples, which is fitted before the maps learn."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from ..arm.arm import SpatialArm
from ..arm.rotations import logarithm, matrix_of
from ..body.fitting import BodyFit, fit
from ..body.nominal import nominal_of
from ..body.planar import planar_structure
from ..body.rows import Rows
from ..body.sensor import doubtful_depth
from ..body.spatial import structure_of, unknown_structure
from ..body.telling import warnings_of
from ..body.views import is_camera
from ..common.arrays import Array, Index
from ..common.choices import VIEWS
from ..common.scale import METRES
from ..errors import OptionError
from ..maps.model_selection import misfit
from ..maps.predictor import BodyInBox
from ..samples.samples import Samples
from .learn import TrainingOptions, unit_box

NO_ARM = 0.02
"""Share of the extent: a body that is further off explains nothing."""

_VIEWS = ("auto", "base", "rigid", "similarity")  # of positions in space
_LEARNED_ROWS = 50_000  # rows of a log that the smooth part and the local models rest on
_IMAGINED = 5  # samples for each motor node


@dataclass(frozen=True, eq=False)
class SmoothPart:
    """What stands under the local models."""

    smooth: BodyInBox  # the body, of the joints' unit box
    fit: BodyFit
    rows: Index  # (k,), rows of the samples that it rests on

    @staticmethod
    def of(samples: Samples, fit: BodyFit, rows: Index) -> SmoothPart:
        """The body of a fit in the unit box of the samples."""
        return SmoothPart(BodyInBox(fit.body, unit_box(samples)), fit, rows)

    @property
    def error(self) -> float:
        """Mean distance of held-out rows from the body [unit]."""
        return float(np.linalg.norm(self.fit.held_out, axis=1).mean())


def find_smooth_part(samples: Samples, *, view: str = "auto", seed: int) -> SmoothPart:
    """Fit the body of the samples; `view` says what the sensor measures."""
    rows = np.arange(0, len(samples), -(-len(samples) // _LEARNED_ROWS))
    q, x = samples.q[rows], samples.x[rows]
    kind = _fit_in_space if _in_space(samples, view) else _fit_in_plane
    found = kind(samples, rows, view, seed)
    travel = samples.upper - samples.lower
    told = warnings_of(q, samples.joint_names, samples.revolute, travel)
    found = replace(found, notes=(*told, *found.notes))
    part = SmoothPart.of(samples, found, rows)
    extent = float(np.linalg.norm(np.ptp(x, axis=0)))
    if part.error <= NO_ARM * extent or samples.simulation is not None:
        return part
    planar = "planar " * (x.shape[1] == 2 and samples.arm is None)
    doubt = (
        f"no {planar}arm explains the positions: held-out rows are missed by "
        f"{100 * part.error / extent:.2g} % of their extent; check that `joints` names all that "
        "moved, base to tip, that each row's joints and position are of one moment, and give the "
        "URDF of an arm in space; maps and links alone learn what is no arm: `body='none'`"
    )
    return replace(part, fit=replace(found, notes=(*found.notes, doubt)))


def wrong_around(part: SmoothPart, samples: Samples, u: Array) -> Array | None:
    """How wrong (k,) the body is around points `u` (k, dof) of the unit box, None within noise."""
    q, extent = samples.q[part.rows], float(np.linalg.norm(np.ptp(samples.x[part.rows], axis=0)))
    scale = part.smooth.scale
    return misfit(scale, scale.to_unit(q), part.fit.held_out, extent, u)


def to_learn(
    samples: Samples,
    part: SmoothPart | None,
    options: TrainingOptions,
    rows: slice | Index = slice(None),
) -> tuple[Array, Array, Array | None]:
    """What the maps learn from: some rows of the samples, and what the body of `part` imagines.

    Returns u, x : (k, dof), (k, m), joints in the unit box and positions
    Returns wrong : (k,), how wrong the body is there, None within noise
    """
    u, x = unit_box(samples).to_unit(samples.q[rows]), samples.x[rows]
    if part is None:
        return u, x, None
    # a log may leave parts of the joints' range out, a simulation only has too few samples
    if samples.simulation is None or len(samples) < math.prod(options.shapes[0]):
        every = -(-len(u) // _LEARNED_ROWS)
        rng = np.random.default_rng(options.stream("imagined"))
        drawn = rng.random((_IMAGINED * math.prod(options.shapes[0]), u.shape[1]))
        u = np.concatenate([u[::every], drawn])
        x = np.concatenate([x[::every], part.smooth.value(drawn)])
    return u, x, wrong_around(part, samples, u)


def _in_space(samples: Samples, view: str) -> bool:
    """Whether samples are of an arm in space; OptionError if `view` is not one of such samples."""
    pixels = samples.camera is not None and isinstance(samples.arm, SpatialArm)
    positions = not pixels and samples.x.shape[1] == 3
    kinds = _VIEWS if positions else [v for v in VIEWS if v == "auto" or is_camera(v) == pixels]
    if view not in kinds:
        told = f"view {view!r}: expected one of {', '.join(kinds)} for these samples"
        raise OptionError(told, parameter="view", value=view)
    return pixels or positions


def _fit_in_plane(samples: Samples, rows: Index, view: str, seed: int) -> BodyFit:
    """Fit the body of a planar arm to some rows of samples, a log's with its URDF as prior."""
    simulated, nominal = samples.simulation is not None, None
    if samples.arm is not None and not simulated:
        # a joint out of the plane has no prior: the rows have to tell
        with suppress(OptionError):
            known = samples.lower, samples.upper, samples.revolute
            nominal = nominal_of(samples.arm.forward, *known)
    if view == "base" and nominal is None:
        raise OptionError(
            "view 'base' needs a measured log and the planar robot that it is of: give both, or "
            "another view"
        )
    x, names, turns = samples.x[rows], samples.joint_names, samples.revolute
    structure = planar_structure(x, names, turns, nominal, view, samples.unit, simulated)
    return fit(structure, [Rows(samples.q[rows], x)], seed=seed)


def _fit_in_space(samples: Samples, rows: Index, view: str, seed: int) -> BodyFit:
    """Fit the body of an arm in space to some rows; only a log's URDF is a prior."""
    q, x, arm, camera = samples.q[rows], samples.x[rows], samples.arm, samples.camera
    extent = float(np.sqrt(((x - x.mean(axis=0)) ** 2).sum(axis=1).mean()))  # of the noise's floor
    orientation, simulated = samples.orientation, samples.simulation is not None
    if camera is not None and isinstance(arm, SpatialArm) and x.shape[1] == 2:
        lens, sd = camera.lens, camera.lens_sd
        template = structure_of(arm, "pinhole", unit="px", extent=extent, lens=lens, lens_sd=sd)
        found = fit(template, [Rows(q, x)], seed=seed)
        return replace(found, notes=(*found.notes, *doubtful_depth(found.body, q)))
    metre, unused = METRES.get(samples.unit, 1.0), ""
    if isinstance(arm, SpatialArm) and not simulated:
        kind = {"auto": "rigid" if samples.unit in METRES else "similarity"}.get(view, view)
        template = structure_of(arm, kind, unit=samples.unit, metre=metre, extent=extent)
        posed = {"rigid": "pose", "base": "base pose"}.get(kind)
        if orientation is not None and posed:
            poses = np.hstack([x, logarithm(matrix_of(orientation[rows]))])
            found = fit(template.with_view(posed), [Rows(q, poses)], seed=seed)
            if found.body.structure.view == "base target":
                last = f"its turn cannot be told from the offset of {samples.joint_names[-1]}"
                turned = f"the orientations are of a target that is turned against the tip: {last}"
                found = replace(found, notes=(*found.notes, turned))
            return found.of_positions()
        unused = f"orientations are not used with the view {kind!r}"
    elif isinstance(arm, SpatialArm):  # the drawing is a start, and no prior
        template = structure_of(arm, "base", unit=samples.unit, metre=metre, extent=extent)
        nothing = np.zeros(0)
        weightless = replace(template.chain, masses=nothing, centres=nothing.reshape(0, 3))
        template = replace(template, chain=weightless, informed=False, simulated=True)
    else:
        names, turns = samples.joint_names, samples.revolute
        template = unknown_structure(names, turns, extent, samples.unit, metre, simulated)
        unused = "orientations are used together with the robot's URDF: give `robot`"
    found = fit(template, [Rows(q, x)], seed=seed)
    return found if orientation is None else replace(found, notes=(*found.notes, unused))
