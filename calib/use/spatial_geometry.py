"""The geometry of a spatial arm that fits a model best: joint offsets, joint origins and the tip.

`calib urdf` writes it into a copy of the URDF.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arm.arm import Arm, SpatialArm
from ..arm.urdf import parse_urdf
from ..body.belief import Body
from ..body.fit import Fit, maximise
from ..body.normal import Factor, with_prior
from ..body.parameters import Prior
from ..body.settings import SHIFT
from ..body.spatial import SpatialStructure, structure_of
from ..body.spatial_start import frame
from ..common.arrays import Array
from ..common.scale import METRES

_NU = 6.0  # degrees of freedom of the residuals: a few rows may be grossly wrong
_FLOOR = 1e-7  # of the extent: a residual below is rounding
_STEPS = 15
_LEFT_OUT = ("gain", "elastic", "curve")  # what a body has and no URDF can say


@dataclass(frozen=True, eq=False)
class SpatialGeometry:
    """A fitted geometry of a spatial arm."""

    arm: Arm  # the nominal arm
    structure: SpatialStructure  # its chain and view
    # (d,), parameters and their posterior standard deviations, 0 where nothing was fitted
    beta: Array
    sd: Array
    # whether the sensor's frame was fitted; the first joint's offset and place are nominal then, by
    # convention
    free: bool
    # whether the tip's fitted place belongs to the arm; else it is the sensor's: a probe, a tag
    move_tip: bool
    # [m; px], root mean square distance that this geometry, and the nominal one, do not explain,
    # each with the sensor and the tip where they fit best
    residual: float
    before: float
    reach: float  # [m; px], furthest distance of the tip from the middle of its positions

    @property
    def unit(self) -> str:
        """Unit of `residual`, `before` and `reach`."""
        return self.structure.unit if self.structure.camera else "m"

    @cached_property
    def places(self) -> tuple[str, ...]:
        """Joints whose origins are fitted, mimic joints included, as the URDF names them."""
        path = parse_urdf(self.arm.urdf).path(self.arm.tip)
        return tuple(j.name for j in path if j.movable and j.name not in self.arm.locked)

    def moved(self, joint: str) -> tuple[Array, Array, float]:
        """How far a joint's origin is from where the URDF has it, with all joints at zero.

        As a shift (3,) [m] and a rotation vector (3,) [rad] in the root link's axes, and what the
        joint's own motion is [rad or m]: its offset. Zeros of a joint that is not fitted.
        """
        if joint not in self.places:
            return np.zeros(3), np.zeros(3), 0.0
        k, structure = self.places.index(joint), self.structure
        value = self.structure.chain.coupling[k] @ self.beta[self.structure.groups["offset"]]
        return self.beta[structure.shifts[k]], self.beta[structure.turns[k]], float(value)

    def tip(self) -> tuple[Array, Array]:
        """What is written of the tip: a shift (3,) [m] in the root's axes, a turn in its own."""
        groups, written = self.structure.groups, float(self.move_tip)
        shift = self.structure.chain.rotation @ self.beta[groups["tool"]]
        return written * shift, written * self.beta[groups["tool.rotation"]]

    def to_json(self) -> dict[str, Any]:
        """Plain data; intervals are half widths of 95 %."""
        groups = self.structure.groups
        places = zip(self.places, self.structure.shifts, self.structure.turns, strict=True)
        return {
            "offsets": self.offsets(),
            "places": {n: {"shift": self.told(s), "turn": self.told(t)} for n, s, t in places},
            "tip": {
                "shift": self.told(groups["tool"]),
                "turn": self.told(groups["tool.rotation"]),
                "written": self.move_tip,
            },
            **self.sizes(),
        }

    def told(self, index: Any) -> dict[str, Any]:
        """Some parameters and the half widths of their 95 % intervals."""
        return {"value": self.beta[index].tolist(), "interval": (1.96 * self.sd[index]).tolist()}

    def offsets(self) -> dict[str, Any]:
        """Where the nominal arm stands when joints read zero [rad or m], as `told`."""
        joints = zip(self.arm.joint_names, self.structure.groups["offset"], strict=True)
        return {name: self.told(k) for name, k in joints}

    def sizes(self) -> dict[str, Any]:
        """What any geometry tells of its fit."""
        return {
            "frame_fitted": self.free,
            "residual": self.residual,
            "before": self.before,
            "reach": self.reach,
        }


def rms(rows: Array) -> float:
    """Root mean square length of rows (n, m)."""
    return float(np.sqrt((rows**2).sum(axis=1).mean()))


def fit_spatial(
    arm: SpatialArm,
    body: Body | None,
    q: Array,
    x: Array,
    *,
    unit: str,
    free: bool,
    probe: bool,
    move_base: bool,
    move_tip: bool,
) -> SpatialGeometry:
    """Fit offsets, joint origins and the tip to positions `x` (n, m) at joints `q` (n, dof).

    With `probe` the sensed point may be anywhere on the last link; else it is the tip, as in a
    simulation, and moves only with `move_tip`.  The prior is that of a body: joint origins to 1 mm
    and 0.1 deg, or as many times that as the evidence takes. What the rows do not tell apart is
    within the intervals.
    """
    structure = _structure(arm, body, x, unit, free)
    groups, shifts = structure.frame_groups, structure.shifts
    tool, none = structure.groups["tool"], shifts[0][:0]
    still = none if probe else tool
    prior = _held(structure.prior(groups), still)
    nominal = _known(body, structure)
    nominal = frame(structure, q, x) if nominal is None and probe else nominal
    nominal = structure.neutral() if nominal is None else nominal
    if len(prior.active):
        nominal = fit_prior(structure, q, x, nominal, prior).beta
    prior = structure.prior((*groups, "placement", "offset"))
    if not probe:  # a simulation's point is the tip, as sure as any other place
        prior.sd[tool] = SHIFT
        still = none if move_tip else tool
    first = np.concatenate([shifts[0], structure.turns[0]])
    prior = _held(prior, np.concatenate([still, none if move_base else first]))
    fitted = fit_prior(structure, q, x, nominal, prior)
    sd = deviations(fitted, q)
    metre = 1.0 if structure.camera else structure.metre
    reach = float(np.linalg.norm(x - x.mean(axis=0), axis=1).max())
    misfit = structure.residual(x, structure.predict(q, nominal))
    sizes = (rms(fitted.residual) / metre, rms(misfit) / metre, reach / metre)
    return SpatialGeometry(arm, structure, fitted.beta, sd, free, move_tip, *sizes)


def _structure(
    arm: SpatialArm, body: Body | None, x: Array, unit: str, free: bool
) -> SpatialStructure:
    """The nominal arm as the model's sensor sees it."""
    own = None if body is None else body.structure
    if isinstance(own, SpatialStructure) and own.informed:
        view = own.view if free else "base"
        return replace(own, view="rigid" if view == "pose" else view)
    view = "base" if not free else "rigid" if unit in METRES else "similarity"
    return structure_of(
        arm, view, unit=unit, metre=METRES.get(unit, 1.0), extent=rms(x - x.mean(axis=0))
    )


def _known(body: Body | None, structure: SpatialStructure) -> Array | None:
    """The body's own parameters, where they are of this structure."""
    own = None if body is None else body.structure
    if body is None or not isinstance(own, SpatialStructure) or not own.informed:
        return None
    return body.beta if own.view == structure.view else None


def _held(prior: Prior, still: NDArray[np.intp]) -> Prior:
    """The prior with some parameters held at their mean."""
    sd = prior.sd.copy()
    sd[still] = 0.0
    hypers = []
    # offsets first: what an offset explains, turned and shifted origins would explain too
    for hyper in sorted(prior.hypers, key=lambda h: not h.name.startswith("offset")):
        kept = ~np.isin(hyper.indices, still)
        if kept.any():
            hypers.append(replace(hyper, indices=hyper.indices[kept], shape=hyper.shape[kept]))
    return Prior(prior.mean, sd, tuple(hypers))


def fit_prior(
    structure: SpatialStructure, q: Array, x: Array, beta: Array, prior: Prior, error: float = 0.0
) -> Fit:
    """The most probable parameters from `beta` on; `error` is the least noise [unit]."""
    floor = np.maximum(_FLOOR * structure.extents, error)
    return maximise(structure, q, x, beta, prior, nu=_NU, floor=floor, steps=_STEPS, tolerance=1e-3)


def deviations(fit: Fit, q: Array) -> Array:
    """Standard deviations (d,) of a geometry fitted to rows at joints `q` (n, dof).

    Gains, elasticity and joint curves that it leaves out bend it by ``P X' W Xc c`` (Schmidt's
    "consider" covariance), with c as the rows and the priors of an arm leave them.  As noise alone,
    waves of 1 mrad left 1 of 4 displacements within its interval.
    """
    structure, active = fit.structure, fit.active
    usual = structure.prior(_LEFT_OUT).sd
    usual[active] = 0.0
    both = np.union1d(active, np.flatnonzero(usual))
    own = np.isin(both, active)
    x = structure.derivative(q, fit.beta, both)[1]
    weight = fit.weight / fit.noise**2
    gram = x.gram(weight)
    free = fit.told * gram
    free[np.ix_(own, own)] = with_prior(free[np.ix_(own, own)], fit.sd, fit.known)
    free[~own, ~own] += usual[both[~own]] ** -2.0
    spread = Factor(free).inverse()[np.ix_(~own, ~own)]
    mean = spread @ (fit.told * x.moment(weight * fit.residual)[~own])
    bent = Factor(fit.precision).solve(gram[np.ix_(own, ~own)])
    total = fit.covariance + bent @ (spread + np.outer(mean, mean)) @ bent.T
    sd = np.zeros(structure.size)
    sd[active] = np.sqrt(np.diag(total))
    return sd
