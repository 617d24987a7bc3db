"""Fit the body of a planar arm to rows: structure, start, gate, bound."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..errors import LogError, OptionError
from .belief import Body, Second
from .fit import Fit, maximise
from .gate import Passed, Tried, choose_member
from .held_out import HeldOut, leave_blocks_out
from .nominal import Nominal
from .packing import pack, unpack
from .planar import PlanarStructure
from .starts import best_start
from .structure import Array, Hyper, Prior, Structure
from .telling import warnings_of

VIEWS = ("auto", "base", "rigid", "similarity", "affine", "homography")

METRES = {"m": 1.0, "cm": 100.0, "mm": 1000.0, "um": 1e6, "in": 1 / 0.0254}
"""Units per metre of the units that are lengths."""

ROWS = 3000
"""Rows that the gate and the evidence use; the rest enters the final step."""

LOG_FLOOR, SIMULATED_FLOOR = 1e-4, 1e-7
"""Least noise, as a share of the extents."""

STUDENT = 6.0

MISFIT = 0.02
"""Share of the extent beyond which a nominal geometry is doubted."""

NO_CURVES = 8.0
"""Nats against joint curves from which the bound needs no second fit with large ones."""

WIDE = (200.0, 3e-3)
"""Pseudo-observations of the curves' wider hyperprior, and their rms [rad]."""


@dataclass(frozen=True)
class BodyFit:
    """A fitted body and how it was found.

    Attributes
    ----------
    body : Body
    held_out : (n, m) array
        Residuals of contiguous blocks predicted from the others.
    row_weight : (n,) array
        Weight of each row, 1 or more for a common row, near 0 for an outlier.
    info : tuple of Tried
        The gate's members with their held-out errors.
    notes : tuple of str
        What the rows cannot tell.
    """

    body: Body
    held_out: Array
    row_weight: Array
    info: tuple[Tried, ...]
    notes: tuple[str, ...]


def fit_body(
    q: Array,
    z: Array,
    *,
    joint_names: Sequence[str],
    revolute: Sequence[bool],
    nominal: Nominal | None = None,
    view: str = "auto",
    lens: bool | None = None,
    unit: str = "m",
    simulated: bool = False,
    lower: Array | None = None,
    upper: Array | None = None,
    seed: int = 0,
) -> BodyFit:
    """Fit the body of a planar arm.

    Parameters
    ----------
    q : (n, dof) array
        Joint values as they are logged [rad or m].
    z : (n, 2) array
        Positions that the sensor saw [unit].
    joint_names, revolute : sequences
        Names of the joints and which of them turn.
    nominal : Nominal, optional
        Geometry of a URDF as prior; with logs only.
    view : {"auto", "base", "rigid", "similarity", "affine", "homography"}
        ``auto`` is rigid for lengths, homography for pixels, similarity otherwise.
    lens : bool, optional
        Whether the gate may fit a lens; by default where the view is a homography.
    unit : str
        Unit of positions.
    simulated : bool
        Whether the rows are samples of a simulation: Gaussian weights, a lower noise floor.
    lower, upper : (dof,) array, optional
        Joint ranges, for what the rows cannot tell.
    seed : int
        Chooses the rows of the gate where there are more than 3,000.

    Raises
    ------
    LogError
        If a value is not finite or the shapes do not fit.
    OptionError
        If the view is unknown or needs a nominal geometry.
    """
    q, z = np.asarray(q, dtype=float), np.asarray(z, dtype=float)
    template = planar_structure(q, z, joint_names, revolute, nominal, view, lens, unit, simulated)
    notes = warnings_of(q, template.joint_names, template.revolute, z, lower, upper)
    fitted = fit_structure(template, q, z, seed=seed, notes=notes)
    if nominal is None or view == "base":
        return fitted
    error = _typical(fitted.held_out)
    if error < MISFIT * template.extent:
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
    q: Array,
    z: Array,
    joint_names: Sequence[str],
    revolute: Sequence[bool],
    nominal: Nominal | None,
    view: str,
    lens: bool | None,
    unit: str,
    simulated: bool,
) -> PlanarStructure:
    """The structure that the rows and options ask for, signs and mirror still open."""
    names, turns = tuple(joint_names), tuple(bool(r) for r in revolute)
    if q.ndim != 2 or z.shape != (len(q), 2) or len(q) < 1:
        raise LogError(f"rows of shapes {q.shape} and {z.shape}, expected (n, dof) and (n, 2)")
    if not (len(names) == len(turns) == q.shape[1]):
        raise LogError(
            f"{q.shape[1]} columns of joints, {len(names)} names, {len(turns)} kinds; expected "
            "one name and one kind for each column"
        )
    if not (np.isfinite(q).all() and np.isfinite(z).all()):
        raise LogError("a joint value or a position is not finite; leave such rows out")
    if view not in VIEWS:
        raise OptionError(f"view {view!r}, expected one of {', '.join(VIEWS)}")
    if view == "base" and nominal is None:
        raise OptionError("view 'base' needs the nominal geometry of a robot; give nominal")
    if nominal is not None and len(nominal.lengths) != len(names):
        raise OptionError(f"nominal has {len(nominal.lengths)} joints, the log {len(names)}")
    if view == "auto":
        view = "rigid" if unit in METRES else "homography" if unit == "px" else "similarity"
    centre = z.mean(axis=0)
    extent = float(np.sqrt(((z - centre) ** 2).sum(axis=1).mean()))
    extent = max(extent, 1e-9 * (1e-3 + float(np.abs(z).max())))
    return PlanarStructure(
        names,
        turns,
        view,
        unit,
        METRES.get(unit, 1.0),
        view == "homography" if lens is None else lens,
        nominal.signs if nominal else (1,) * len(names),
        1,
        extent,
        (float(centre[0]), float(centre[1])),
        nominal,
        simulated,
    )


def fit_structure(
    template: Structure,
    q: Array,
    z: Array,
    *,
    simulated: bool | None = None,
    seed: int = 0,
    notes: Sequence[str] = (),
) -> BodyFit:
    """Fit any structure: start, gate, final step over all rows, second fit, bound.

    Parameters
    ----------
    template : Structure
        Signs and mirror are found by its starts.
    q : (n, dof) array
    z : (n, m) array
    simulated : bool, optional
        As in `fit_body`; by default what the template says, else False.
    seed : int
    notes : sequence of str
        Passed on.
    """
    simulated = bool(getattr(template, "simulated", False)) if simulated is None else simulated
    floor = (SIMULATED_FLOOR if simulated else LOG_FLOOR) * template.extents
    nu = np.inf if simulated else STUDENT
    members = template.members()
    chain = next((free for name, free in members if name == "chain"), members[0][1])
    structure, beta, _ = best_start(template, q, z, chain)
    rows = _subset(len(q), seed)
    sub_q, sub_z = (q, z) if rows is None else (q[rows], z[rows])
    tolerance = 1e-3 if simulated else 1e-2

    def fit(free: tuple[str, ...]) -> Fit:
        nonlocal beta
        made = maximise(
            structure,
            sub_q,
            sub_z,
            beta,
            structure.prior(free),
            nu=nu,
            floor=floor,
            tolerance=tolerance,
            steps=20 if simulated else 10,
        )
        beta = made.beta
        return made

    def enough(made: Fit) -> bool:
        return simulated and bool((made.noise <= 1.5 * floor).all())

    passed = choose_member(members, fit, enough)
    whole, held = passed.fit, passed.held_out
    if rows is not None:
        whole = _over_all_rows(passed, q, z, floor)
        held = leave_blocks_out(whole)
    body = _body(whole, held, passed.name, simulated)
    if not simulated and passed.against("curves") < NO_CURVES:
        body = replace(body, second=_second(passed, sub_q, sub_z, floor))
    # Where the other blocks determine nothing, they predict their mean.
    residual = np.where(np.isfinite(held.residual), held.residual, z - z.mean(axis=0))
    return BodyFit(body, residual, whole.weight[:, 0].copy(), passed.tried, tuple(notes))


def _subset(n: int, seed: int) -> Array | None:
    """Rows of the gate where there are too many: a draw in the order of the log."""
    if n <= ROWS:
        return None
    return np.sort(np.random.default_rng(seed).permutation(n)[:ROWS])


def _fixed(prior: Prior, fit: Fit) -> Prior:
    """The prior with the scales that the evidence chose, no longer moving."""
    sd = np.zeros(len(prior.sd))
    sd[fit.active] = fit.sd
    return Prior(prior.mean, sd)


def _over_all_rows(passed: Passed, q: Array, z: Array, floor: Array) -> Fit:
    """The member's fit carried on over all rows, with its prior scales kept."""
    fit = passed.fit
    prior = _fixed(fit.structure.prior(passed.free), fit)
    return maximise(
        fit.structure,
        q,
        z,
        fit.beta,
        prior,
        nu=fit.nu,
        floor=floor,
        noise=fit.noise,
        steps=2 if len(fit.active) > 60 else 10,
        tolerance=1e-2,
    )


def _body(fit: Fit, held: HeldOut, member: str, simulated: bool) -> Body:
    """The belief of a fit."""
    structure = fit.structure
    packed = pack(fit.covariance)
    return Body(
        structure,
        fit.beta,
        fit.active,
        unpack(packed, len(fit.active)),
        fit.noise,
        held.kappa(),
        held.tau(fit.noise, structure.blocks),
        np.zeros(structure.outputs),
        fit.nu,
        fit.autocorrelation,
        {k: float(v) for k, v in fit.scales.items()},
        len(fit.residual),
        simulated,
        member,
        packed=packed,
    )


def _second(passed: Passed, q: Array, z: Array, floor: Array) -> Second:
    """The member with curves under a wider hyperprior, fitted to the same rows."""
    fit = passed.fit
    prior = fit.structure.prior((*passed.free, "curve"))
    sd = prior.sd.copy()
    sd[fit.active] = fit.sd
    curves = tuple(h for h in prior.hypers if h.name.startswith("curve"))
    hypers = _wider(curves, getattr(fit.structure, "wide", WIDE))
    for h in hypers:
        sd[h.indices] = h.scale * np.sqrt(h.shape)
    made = maximise(
        fit.structure,
        q,
        z,
        fit.beta,
        Prior(prior.mean, sd, hypers),
        nu=fit.nu,
        floor=floor,
        noise=fit.noise,
        steps=4,
    )
    packed = pack(made.covariance)
    return Second(made.beta, made.active, unpack(packed, len(made.active)), made.noise, packed)


def _wider(hypers: tuple[Hyper, ...], wide: tuple[float, float]) -> tuple[Hyper, ...]:
    """The hyperpriors with many pseudo-observations of a large curve."""
    pseudo, rms = wide
    return tuple(replace(h, pseudo=pseudo, scale=rms / np.sqrt(len(h.indices))) for h in hypers)
