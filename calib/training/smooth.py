"""Smooth part: the body of the samples, which is fitted before the maps learn what it leaves over.

A rigid arm explains positions smoothly over the whole workspace; local models learn the rest.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..body.body_fit import BodyFit, fit_sensors
from ..body.row_notes import warnings_of
from ..body.rows import Rows
from ..body.structure import Structure
from ..common.arrays import Index
from ..common.rows import row_lengths
from ..common.scale import Scale
from ..maps.predictor import BodyInBox
from ..samples.samples import Samples
from .options import TrainingOptions
from .settings import LEARNING
from .template import template_of


@dataclass(frozen=True, eq=False)
class SmoothPart:
    """A fitted body, which stands under the local models."""

    fit: BodyFit
    rows: Index  # (k,), rows of the samples that it was fitted to
    scale: Scale  # the joints' unit box

    @property
    def smooth(self) -> BodyInBox:
        """The body, as a function of the joints' unit box."""
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
    """Fit one body to what several sensors saw of one arm; return it in the frame of each of them.

    logs : samples of each sensor by its name, of the same joints; the first one's drawing counts
    """
    index: dict[str, Index] = {}
    structures: dict[str, Structure] = {}
    rows: dict[str, Rows] = {}
    for name, samples in logs.items():
        every = -(-len(samples) // LEARNING.most_rows)  # rounded up
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
    warnings = warnings_of(samples.q[rows], names, samples.revolute, travel)
    notes = [*warnings, *fit.notes]
    if fit.held_out.shape[1] == 6:
        fit = fit.of_positions()
    part = SmoothPart(fit, rows, samples.unit_box)
    share = part.error / part.extent(samples)
    if samples.simulation is None and share > LEARNING.no_arm:
        notes.append(_no_arm(samples, share))
    return replace(part, fit=replace(fit, notes=tuple(notes)))


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
