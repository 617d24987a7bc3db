"""Sections of a header: of each part of a model the constant arrays and words of its C source."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ..body.covariance import NORMAL_95
from ..body.curves import HARMONICS
from ..body.views import LEAST_DEPTH
from ..common.arrays import Array
from ..common.rows import row_lengths, spread_rows
from ..errors import CalibError
from ..inverse.settings import SOLVER
from ..inverse.solutions import distinct
from ..kernel.arm import KernelArm, Sag
from ..kernel.compiled import MOST
from ..kernel.posterior import COMPACT, CompactPosterior
from ..maps.blend import blend_size
from ..maps.local_models import exponents
from ..maps.settings import LOCAL
from ..samples.settings import READING
from .parts import ROUNDED, ModelParts
from .space import Space
from .turns import joint_limits

Tables = dict[str, NDArray[np.generic]]
Words = Mapping[str, object]


@dataclass(frozen=True)
class StartSettings:
    """How many joints a header has, from which searches for positions start."""

    # cells of the workspace
    cells: int = 576
    # distance below which starts of a cell count as one [unit box]
    apart: float = 0.1
    # postures of redundant joints
    postures: int = 128


START = StartSettings()


@dataclass(frozen=True)
class Section:
    """Constants and arms of C by name, and words that templates are filled with."""

    tables: Mapping[str, NDArray[np.generic]] = field(default_factory=dict)
    words: Words = field(default_factory=dict)
    arms: dict[str, KernelArm] = field(default_factory=dict)


SETTINGS: Words = {
    **asdict(SOLVER),
    **asdict(MOST),
    "rounded": float(ROUNDED),
    "rounding": READING.rounded_length,
}
"""Words of every source."""


def joint_ranges(model: ModelParts) -> Section:
    """Ranges of joints, and how far positions extend."""
    scale = model.motor.scale
    limits = joint_limits(model)
    tables: Tables = {
        "lower": scale.lower,
        "span": scale.span,
        "middle": scale.lower + 0.5 * scale.span,
        "periodic": scale.periodic.astype(int),
        "least": limits[:, 0],
        "most": limits[:, 1],
    }
    extent = float(model.solver.extent)
    return Section(tables, {"dof": len(scale.span), "extent": extent})


def body_arm(arm: KernelArm) -> Section:
    """The body's chain and view, with lens, curves, coupling and bending where it has them."""
    tables: Tables = {
        "turns": np.array(arm.chain.revolute, int),
        "view": arm.view.ravel(),
        "shift": arm.shift,
    }
    arms = {"body": arm}
    if arm.lens is not None:
        tables["lens"] = arm.lens
    if arm.curves.any():
        tables |= _curves(arm)
    if arm.sag is not None and arm.sag.elastic.any():
        tables |= _sag(arm.sag)
        arms["drawn"] = arm.drawn
    length = float(row_lengths(arm.frames.strides[1:]).sum())
    words = {
        "out": arm.outputs,
        "chain": arm.chain.joints,
        "harmonics": HARMONICS,
        "bends": int(arm.bends),
        "lever": max(length, 1e-9),
        "least_depth": LEAST_DEPTH,
        "step_cost": SOLVER.bent_steps if arm.bends else 1,
    }
    return Section(tables, words, arms)


def _curves(arm: KernelArm) -> Tables:
    """The error curves of the joints of an arm, and how these move those of the chain."""
    waves = arm.curves.reshape(-1, 2, HARMONICS)
    order = np.arange(1.0, HARMONICS + 1)
    cosines = waves[:, 0]
    sines = waves[:, 1]
    rates = [order * sines, -order * cosines]
    return {
        "curve": np.vstack([cosines, sines]).T,
        "curve_rate": np.vstack(rates).T,
        "coupling": arm.chain.coupling,
    }


def _sag(sag: Sag) -> Tables:
    """Gravity, and the masses and moments that bend the joints of an arm."""
    return {"gravity": sag.gravity, "bending": sag.bending}


def placed_arm(model: ModelParts, arm: KernelArm) -> list[Section]:
    """The arm in its base frame, for poses; none where that frame is not known."""
    if arm.outputs != 3:
        return []
    try:
        space = Space.of(model)
    except CalibError:
        return []
    placed = KernelArm.of(space.structure, space.body.beta)
    if placed.chain.joints != arm.chain.joints:
        return []
    rotation, shift, scale = space.sensor
    root = np.vstack([rotation.T, shift / scale])
    placed = replace(placed, root=root)
    words = {"placed": True, "scale": scale}
    return [Section(words=words, arms={"placed": placed})]


def motor_nodes(model: ModelParts) -> Section:
    """The motor map's nodes, between which values are blended."""
    nodes = model.motor.size
    near = min(blend_size(len(model.about.lower)), nodes - 1)
    node = model.motor.scale.from_unit(model.motor.units)
    return Section({"node": node}, {"nodes": nodes, "near": near})


def belief(posterior: CompactPosterior, *, noise: bool) -> Section:
    """The posterior's arrays: rows of directions of each part, and variances.

    noise : whether bounds are on what a sensor reads
    """
    less = np.zeros(3)
    size = len(posterior.residual)
    less[:size] = posterior.residual
    more = less.copy()
    if noise:
        more[:size] += posterior.noise
    tables: Tables = {
        "belief_scale": posterior.scale,
        "more": more,
        "less": less,
    }
    arm = posterior.arm
    arms: dict[str, KernelArm] = {}
    loads = 0
    if arm.sag is not None:
        loads = len(arm.sag.elastic)
        tables |= _sag(arm.sag)
        tables |= {
            "loaded": arm.sag.spans,
            "load": arm.sag.on_links,
            "tilt": arm.sag.tilts,
        }
        arms["drawn"] = arm.drawn
    if posterior.curves.any():
        tables |= _curves(arm)
        shape = len(posterior.curves), 2, HARMONICS, -1
        tables["by_wave"] = posterior.curves.reshape(shape)
        tables["alone"] = posterior.alone
    geometry = posterior.geometry
    parts = np.concatenate(list(geometry.values()))
    tables["by_part"] = parts.reshape(len(parts), -1)
    seen = len(geometry["view"]) + len(geometry.get("lens", ()))
    tables["coupling"] = arm.chain.coupling
    words = {
        "beliefs": len(posterior.scale),
        "ways": posterior.curves.shape[-1],
        "loads": loads,
        "parts": len(parts) - seen,
        "knots": COMPACT.knots,
        "normal": NORMAL_95,
    }
    return Section(tables, words, arms)


def local_models(model: ModelParts) -> Section:
    """Local models of the nodes, and how their monomials are made of each other."""
    models = model.predictor.models
    terms = exponents(model.motor.units.shape[1], models.degree)
    rows = {tuple(term): k for k, term in enumerate(terms.tolist())}
    along = np.argmax(terms > 0, axis=1)
    below = np.zeros(terms.shape, dtype=int)
    for joint, unit in enumerate(np.eye(terms.shape[1], dtype=int)):
        for k, term in enumerate((terms - unit).tolist()):
            below[k, joint] = rows.get(tuple(term), 0)
    flat = models.coefficients.reshape(len(models.coefficients), -1)
    tables: Tables = {
        "radius": models.radius,
        "local_terms": flat,
        "talks": flat.any(axis=1).astype(int),
        "along": along,
        "parent": below[np.arange(len(terms)), along],
        "power": terms.astype(float),
        "below": below,
    }
    words = {
        "terms": len(terms),
        "silent": LOCAL.silent,
        "full": LOCAL.full,
        "step_cost": SOLVER.bent_steps,
    }
    return Section(tables, words)


def grid_starts(model: ModelParts) -> Section:
    """Joints from which positions are sought, by cells of the workspace.

    The source grows by 20 bytes a number.
    """
    place = model.sensory.scale
    dimensions = len(place.span)
    side = max(2, int(START.cells ** (1 / dimensions)))
    corners = np.indices((side,) * dimensions).reshape(dimensions, -1).T
    step = place.span / side
    middles = place.lower + (corners + 0.5) * step
    shifts = np.indices((2,) * dimensions).reshape(dimensions, -1).T - 0.5
    around = np.vstack([np.zeros(dimensions), shifts]) * step
    places = middles[:, None] + around
    point, u = model.solver.starts.of(places.reshape(-1, dimensions))
    cell = point // len(around)
    single = distinct(model.motor.scale, cell, u, START.apart)
    count = np.bincount(cell[single], minlength=len(middles))
    grid: Tables = {
        "grid": np.full(dimensions, side),
        "grid_lower": place.lower,
        "grid_step": step,
        "cell": np.append(0, np.cumsum(count)),
        "start_q": model.motor.scale.from_unit(u[single]),
    }
    return Section(grid, {"starts": np.count_nonzero(single)})


def posture_starts(model: ModelParts) -> Section:
    """Some postures, as starts for redundant arms, which have too many solutions for a table."""
    nodes = np.flatnonzero(model.visited)
    nodes = nodes[spread_rows(len(nodes), START.postures)]
    return _starts(model, model.motor.units_in_box[nodes])


def middle_start(model: ModelParts) -> Section:
    """The middle of the ranges alone."""
    return _starts(model, np.full((1, len(model.about.lower)), 0.5))


def _starts(model: ModelParts, u: Array) -> Section:
    """Joints (k, dof) of the unit box, and where they lead."""
    tables: Tables = {
        "start_q": model.motor.scale.from_unit(u),
        "start_x": model.predictor.value(u),
    }
    words = {
        "starts": len(u),
        "tries": SOLVER.spare_tries,
        "budget": SOLVER.spare_budget,
    }
    return Section(tables, words)
