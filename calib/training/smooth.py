"""The smooth part of a model: the body of the samples, which is fitted before the maps learn."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..body.body_fit import BodyFit, fit_sensors
from ..body.row_notes import warnings_of
from ..body.sensor_pose import doubtful_depth
from ..body.views import is_camera
from ..common.arrays import Array, Index
from ..common.rows import row_lengths
from ..maps.association import Association
from ..maps.model_selection import misfit
from ..maps.predictor import BodyInBox
from ..samples.samples import Samples
from .learn import Progress, TrainingOptions, associate, unit_box
from .settings import LEARNING
from .template import Template


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
    templates = {
        name: Template.of(samples, options) for name, samples in logs.items()
    }
    structures = {name: made.structure for name, made in templates.items()}
    rows = {name: made.rows for name, made in templates.items()}
    fits = fit_sensors(structures, rows, seed=options.seed)
    return {
        name: _smooth_part(samples, templates[name], fits[name])
        for name, samples in logs.items()
    }


def find_smooth_part(samples: Samples, options: TrainingOptions) -> SmoothPart:
    """Fit the body of the samples of one sensor."""
    return find_smooth_parts({"": samples}, options)[""]


def _smooth_part(
    samples: Samples, template: Template, fit: BodyFit
) -> SmoothPart:
    """The body of a fit, with notes on what its rows cannot tell."""
    q = template.rows.q
    view = fit.body.structure.view
    travel = samples.upper - samples.lower
    notes = [
        *warnings_of(q, samples.joint_names, samples.revolute, travel),
        *fit.notes,
    ]
    if is_camera(view):
        notes += doubtful_depth(fit.body, q)
    if view == "base target":
        notes.append(
            "the orientations are of a target that is turned against the tip: its turn cannot be "
            f"told from the offset of {samples.joint_names[-1]}"
        )
    notes += template.notes
    if template.rows.z.shape[1] == 6:
        fit = fit.of_positions()
    part = SmoothPart.of(samples, fit, template.index)
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


def wrong_around(part: SmoothPart, samples: Samples, u: Array) -> Array | None:
    """How wrong (k,) the body is around points `u` (k, dof) of the unit box, None within noise."""
    scale = part.smooth.scale
    learned = scale.to_unit(samples.q[part.rows])
    extent = part.extent(samples)
    return misfit(scale, learned, part.fit.held_out, extent, u)


def maps_of(
    samples: Samples,
    part: SmoothPart | None,
    options: TrainingOptions,
    rows: slice | Index = slice(None),
    progress: Progress | None = None,
) -> Association:
    """Maps and links of some rows of the samples, and of what the body of `part` imagines."""
    scale = unit_box(samples)
    u = scale.to_unit(samples.q[rows])
    x = samples.x[rows]
    if part is None:
        return associate(scale, u, x, options, None, progress)
    # a log may leave parts of the joints' range out, a simulation only has too few samples
    nodes = math.prod(options.shapes[0])
    if samples.simulation is None or len(samples) < nodes:
        every = -(-len(u) // LEARNING.most_rows)
        rng = np.random.default_rng(options.stream("imagined"))
        drawn = rng.random((LEARNING.imagined * nodes, u.shape[1]))
        u = np.concatenate([u[::every], drawn])
        x = np.concatenate([x[::every], part.smooth.value(drawn)])
    wrong = wrong_around(part, samples, u)
    return associate(scale, u, x, options, wrong, progress)
