"""Where gravity points: whether rows say another direction than the drawing's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..arm.gravity import standard
from .fit import Fit
from .gate import Passed
from .rows import Rows
from .settings import FIT
from .spatial import SpatialStructure
from .structure import loads_of


def other_direction(passed: Passed, rows: Sequence[Rows]) -> str | None:
    """What to say where gravity along another axis of the root frame explains rows far better."""
    structure = passed.fit.structure
    if not isinstance(structure, SpatialStructure) or structure.simulated:
        return None
    members = dict(structure.members())
    if "elastic" not in members or "elastic" not in passed.evidences:
        return None
    drawn = int(np.argmax(np.abs(structure.gravity)))
    fits = []
    for direction in np.eye(3):
        turned = replace(structure, gravity=standard(direction.tolist()))
        prior = turned.prior(members["elastic"])
        fit = Fit(turned, rows, passed.fit.beta, prior, nu=passed.fit.nu)
        fits.append(fit.maximise(steps=FIT.gravity_steps))
    evidence = [fit.evidence for fit in fits]
    best = int(np.argmax(evidence))
    gain = (evidence[best] - evidence[drawn]) / passed.fit.autocorrelation
    if gain < FIT.other_gravity:
        return None
    upward = _gives_way(fits[best], rows[0]) < 0.0
    axis = "xyz"[best]
    values = ["0", "0", "0"]
    values[best] = "-1" if upward else "1"
    return (
        f"the rows say that gravity points along the root's {'-' if upward else '+'}{axis} rather "
        f"than where the drawing has it: on a wall or a ceiling give `gravity={','.join(values)}`"
    )


def _gives_way(fit: Fit, rows: Rows) -> float:
    """How far the joints give way to gravity on average [rad]; negative where they move against it.

    The evidence of a direction and of its opposite is the same, and arms do not rise under a load.
    """
    structure = fit.structure
    levers = structure.loads["elastic"].levers(rows.q[:, : structure.dof])
    loads = loads_of(levers, structure.gravity_at(fit.beta))
    power = (loads**2).mean(axis=1)
    return float(fit.beta[structure.groups["elastic"]] @ power)
