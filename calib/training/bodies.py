"""Bodies: what is fitted to the samples of each sensor before the maps learn what it leaves over.

A rigid arm explains positions smoothly over the whole workspace; local models learn the rest.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ..body.body_fit import BodyFit, fit_sensors
from ..body.row_notes import warnings_of
from ..body.rows import Rows
from ..body.structure import Structure
from ..common.arrays import Index
from ..common.rows import row_lengths
from ..samples.samples import Samples
from .options import TrainingOptions
from .settings import LEARNING
from .template import template_of


def fit_bodies(
    logs: Mapping[str, Samples], options: TrainingOptions
) -> dict[str, BodyFit]:
    """Fit one body to what several sensors saw of one arm; return it in the frame of each of them.

    logs : a row for each pose of each sensor by its name, of the same joints; the first one's
        drawing counts
    """
    structures: dict[str, Structure] = {}
    rows: dict[str, Rows] = {}
    for name, samples in logs.items():
        structures[name], rows[name] = template_of(
            samples, _fitted_rows(samples), options
        )
    fits = fit_sensors(structures, rows, seed=options.seed)
    return {
        name: _with_notes(fits[name], samples) for name, samples in logs.items()
    }


def fit_body(samples: Samples, options: TrainingOptions) -> BodyFit:
    """Fit the body of a row for each pose of one sensor."""
    return fit_bodies({"": samples}, options)[""]


def mean_error(fit: BodyFit) -> float:
    """Mean distance of held-out rows from the body [unit]."""
    return float(row_lengths(fit.held_out).mean())


def _fitted_rows(samples: Samples) -> Index:
    """Rows (k,) of samples that a body is fitted to: of a long log every so many-eth."""
    every = -(-len(samples) // LEARNING.most_rows)  # rounded up
    return np.arange(0, len(samples), every)


def _with_notes(fit: BodyFit, samples: Samples) -> BodyFit:
    """A fit to samples, of positions alone, with notes on what these cannot tell."""
    rows = _fitted_rows(samples)
    names = samples.joint_names
    travel = samples.upper - samples.lower
    warnings = warnings_of(samples.q[rows], names, samples.revolute, travel)
    notes = [*warnings, *fit.notes]
    if fit.held_out.shape[1] == 6:
        fit = fit.of_positions()
    extent = float(np.linalg.norm(np.ptp(samples.x[rows], axis=0)))
    share = mean_error(fit) / extent
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
