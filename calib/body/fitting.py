"""Fit the body of a planar arm to rows: structure, start, gate, bound."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..common.arrays import Array
from ..common.scale import METRES
from ..errors import OptionError
from .nominal import Nominal
from .planar import PlanarStructure
from .posterior import BodyFit, fit_structure
from .settings import DOUBTED
from .telling import warnings_of
from .views import PLANAR

__all__ = ["BodyFit", "fit_body", "fit_structure", "planar_structure"]


def fit_body(
    q: Array,
    z: Array,
    *,
    joint_names: Sequence[str],
    revolute: Sequence[bool],
    nominal: Nominal | None = None,
    view: str = "auto",
    unit: str = "m",
    simulated: bool = False,
    lower: Array | None = None,
    upper: Array | None = None,
    seed: int = 0,
) -> BodyFit:
    """Fit the body of a planar arm.

    q : (n, dof), joint values as they are logged [rad or m]
    z : (n, 2), positions that the sensor saw [unit]
    joint_names, revolute : names of the joints and which of them turn
    nominal : geometry of a URDF as prior; with logs only
    view : {"auto", "base", "rigid", "similarity", "affine", "homography"}, ``auto`` is rigid for
        lengths, homography otherwise
    unit : unit of positions
    simulated : whether the rows are samples of a simulation: Gaussian weights, a lower noise floor
    lower, upper : (dof,), joint ranges, for what the rows cannot tell
    seed : chooses the rows of the gate where there are more than 3,000
    Raises OptionError if the view is unknown or needs a nominal geometry.
    """
    q, z = np.asarray(q, dtype=float), np.asarray(z, dtype=float)
    template = planar_structure(z, joint_names, revolute, nominal, view, unit, simulated)
    notes = warnings_of(q, template.joint_names, template.revolute, z, lower, upper)
    fitted = fit_structure(template, q, z, seed=seed, notes=notes)
    if nominal is None or view == "base":
        return fitted
    error = _typical(fitted.held_out)
    if error < DOUBTED * template.extent:
        return fitted
    free = fit_structure(replace(template, nominal=None), q, z, seed=seed)
    if not _typical(free.held_out) < error / 2:
        return fitted
    note = "the nominal geometry does not fit the rows, even with its frame free: it is not used"
    return replace(free, notes=(*notes, note))


def _typical(residual: Array) -> float:
    """Median length of residuals (n, m)."""
    return float(np.median(np.linalg.norm(residual, axis=1)))


def planar_structure(
    z: Array,
    joint_names: Sequence[str],
    revolute: Sequence[bool],
    nominal: Nominal | None,
    view: str,
    unit: str,
    simulated: bool,
) -> PlanarStructure:
    """The structure that the rows and options ask for, signs and mirror still open."""
    names, turns = tuple(joint_names), tuple(bool(r) for r in revolute)
    if view not in ("auto", *PLANAR):
        raise OptionError(f"view {view!r}, expected one of auto, {', '.join(PLANAR)}")
    if view == "base" and nominal is None:
        raise OptionError("view 'base' needs the nominal geometry of a robot; give nominal")
    if view == "auto":
        view = "rigid" if unit in METRES else "homography"
    centre = z.mean(axis=0)
    extent = float(np.sqrt(((z - centre) ** 2).sum(axis=1).mean()))
    extent = max(extent, 1e-9 * (1e-3 + float(np.abs(z).max())))
    return PlanarStructure(
        names, turns, view, unit, METRES.get(unit, 1.0), PLANAR[view].lens,
        signs=nominal.signs if nominal else (1,) * len(names), mirror=1, extent=extent,
        centre=(float(centre[0]), float(centre[1])), nominal=nominal, simulated=simulated,
    )  # fmt: skip
