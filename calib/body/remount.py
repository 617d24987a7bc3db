"""Remounting: an arm that was calibrated, seen by a sensor or with a tool in a new place.

The old posterior is the prior of the arm itself, a little loosened because arms drift between
two series; the sensor's frame and the tool start from nothing. Ten rows and more place them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from .belief import Body
from .fit import maximise
from .held_out import FEW, leave_blocks_out
from .normal import Factor
from .packing import pack, unpack
from .spatial import SpatialStructure
from .spatial_prior import frame_groups
from .spatial_start import frame
from .structure import Array, Prior

if TYPE_CHECKING:
    from .structure import Indices

#: How far an arm drifts between two series: origins [m], their turns and offsets [rad],
#: elasticity [rad], curves [rad].
DRIFT = {"shift": 5e-5, "turn": 5e-5, "elastic": 2e-4, "curve": 3e-6}
#: A frame that is free may move by so many extents, or turn by so many radians.
FREE = 1e3


def remount(body: Body, q: Array, z: Array, structure: SpatialStructure | None = None) -> Body:
    """Return the body of a calibrated arm in a new frame, from a few rows.

    Parameters
    ----------
    body : Body
        Of a spatial arm.
    q : (n, dof) array [rad or m]
    z : (n, m) array
        What the sensor sees now.
    structure : SpatialStructure, optional
        The structure with another view; by default the body's own.

    Returns
    -------
    Body
        With sensor and tool from the rows, and what they say of the arm added to what was known.
    """
    old = body.structure
    if not isinstance(old, SpatialStructure):
        raise TypeError("remount needs the body of a spatial arm")
    new = old if structure is None else structure
    free = frame_groups(new)
    frames = np.concatenate([new.groups[group] for group in free])
    kept = np.setdiff1d(body.active, np.concatenate([new.groups[g] for g in frame_groups(old)]))
    active = np.union1d(kept, frames)
    beta = frame(new, q, z, body.beta)
    mean, precision = beta.copy(), np.zeros((len(active), len(active)))
    mean[kept] = body.beta[kept]
    place = np.searchsorted(active, kept)
    rows = np.searchsorted(body.active, kept)
    covariance = body.covariance[np.ix_(rows, rows)].copy()
    covariance[np.diag_indices(len(kept))] += _drift(new, kept) ** 2
    precision[np.ix_(place, place)] = Factor(covariance).inverse()
    flat = np.searchsorted(active, frames)
    precision[flat, flat] += _flat(new, frames) ** -2.0
    sd = np.zeros(new.size)
    sd[active] = _flat(new, active)
    floor = np.maximum(body.noise, 1e-12)
    # What the old body could not know of this series is noise of these rows.
    fit = maximise(
        new, q, z, beta, Prior(mean, sd, known=precision), nu=body.nu, floor=floor, noise=floor
    )
    # The new rows calibrate the bound, down too: the old log's drift made its spread wide.
    ratio = leave_blocks_out(fit).ratio() if len(q) > FEW else body.kappa
    packed = pack(min(ratio, 1.0) ** 2 * fit.covariance)
    return replace(
        body,
        structure=new,
        beta=fit.beta,
        active=active,
        covariance=unpack(packed, len(active)),
        packed=packed,
        noise=fit.noise,
        kappa=max(ratio, 1.0),
        rows=body.rows + len(q),
        second=None,
    )


def _drift(structure: SpatialStructure, indices: Indices) -> Array:
    """Sd (k,) by which each parameter of an arm drifts between two series."""
    sd = np.zeros(structure.size)
    layout, groups = structure.layout, structure.groups
    sd[layout.shifts], sd[layout.turns] = DRIFT["shift"], DRIFT["turn"]
    sd[groups["offset"]], sd[groups["gain"]] = DRIFT["turn"], DRIFT["turn"]
    sd[groups["elastic"]] = DRIFT["elastic"]
    for k in range(structure.dof):
        sd[groups[f"curve.{k}"]] = DRIFT["curve"]
    return np.asarray(sd[indices])


def _flat(structure: SpatialStructure, indices: Indices) -> Array:
    """Sd (k,) of the parameters of a frame of which nothing is known."""
    prior = structure.prior(frame_groups(structure))
    sd = prior.sd[indices]
    return np.asarray(np.where(sd > 0, sd, FREE))
