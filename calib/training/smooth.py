"""The smooth part of a model: the body of the samples, which is fitted before the maps learn."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..body.body_fit import BodyFit, fit, fit_sensors
from ..body.row_notes import warnings_of
from ..body.sensor_pose import doubtful_depth
from ..body.views import is_camera
from ..common.arrays import Array, Index
from ..maps.model_selection import misfit
from ..maps.predictor import BodyInBox
from ..samples.samples import Samples
from .learn import TrainingOptions, unit_box
from .template import Template

NO_ARM = 0.02
"""Share of the extent: a body that is further off explains nothing."""

# rows of a log that the smooth part and the local models rest on
_LEARNED_ROWS = 50_000
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
    rows = _learned_rows(samples)
    template = Template.of(samples, rows, view)
    found = fit(template.structure, [template.rows], seed=seed)
    return _smooth_part(samples, rows, template, found)


def find_smooth_parts(
    logs: Mapping[str, Samples], *, view: str = "auto", seed: int
) -> dict[str, SmoothPart]:
    """Fit one body to what several sensors saw of one arm; it is told as each of them sees it.

    logs : samples of each sensor by its name, of the same joints; the first one's drawing counts
    """
    rows = {name: _learned_rows(samples) for name, samples in logs.items()}
    templates = {name: Template.of(logs[name], rows[name], view) for name in logs}
    fits = fit_sensors(
        {name: template.structure for name, template in templates.items()},
        {name: template.rows for name, template in templates.items()},
        seed=seed,
    )
    return {
        name: _smooth_part(logs[name], rows[name], templates[name], fits[name])
        for name in logs
    }


def _learned_rows(samples: Samples) -> Index:
    return np.arange(0, len(samples), -(-len(samples) // _LEARNED_ROWS))


def _smooth_part(
    samples: Samples, rows: Index, template: Template, found: BodyFit
) -> SmoothPart:
    """The body of a fit, with notes on what its rows cannot tell."""
    q = samples.q[rows]
    x = samples.x[rows]
    travel = samples.upper - samples.lower
    notes = [
        *warnings_of(q, samples.joint_names, samples.revolute, travel),
        *found.notes,
    ]
    view = found.body.structure.view
    if is_camera(view):
        notes += doubtful_depth(found.body, q)
    if view == "base target":
        notes.append(
            "the orientations are of a target that is turned against the tip: its turn cannot be "
            f"told from the offset of {samples.joint_names[-1]}"
        )
    notes += template.notes
    if template.rows.z.shape[1] == 6:
        found = found.of_positions()
    part = SmoothPart.of(samples, replace(found, notes=tuple(notes)), rows)
    extent = float(np.linalg.norm(np.ptp(x, axis=0)))
    if part.error <= NO_ARM * extent or samples.simulation is not None:
        return part
    planar = "planar " if x.shape[1] == 2 and samples.arm is None else ""
    notes.append(
        f"no {planar}arm explains the positions: held-out rows are missed by "
        f"{100 * part.error / extent:.2g} % of their extent; check that `joints` names all that "
        "moved, base to tip, that each row's joints and position are of one moment, and give the "
        "URDF of an arm in space; maps and links alone learn what is no arm: `body='none'`"
    )
    return replace(part, fit=replace(part.fit, notes=tuple(notes)))


def wrong_around(part: SmoothPart, samples: Samples, u: Array) -> Array | None:
    """How wrong (k,) the body is around points `u` (k, dof) of the unit box, None within noise."""
    q = samples.q[part.rows]
    extent = float(np.linalg.norm(np.ptp(samples.x[part.rows], axis=0)))
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
    u = unit_box(samples).to_unit(samples.q[rows])
    x = samples.x[rows]
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
