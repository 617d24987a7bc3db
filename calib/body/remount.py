"""Remounting: an arm that was calibrated, seen by a sensor or with a tool in a new place.

The old posterior is the prior of the arm itself, a little loosened because arms drift between
two series; the sensor's frame and the tool start from nothing. Ten rows and more place them.
Joints that now turn where they did not before have curves of which the old rows say only how they
are elsewhere: their spectrum, which is learned first.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import gaussian_filter1d

from ..common.arrays import Array
from .belief import Body
from .covariance import pack, unpack
from .curves import HARMONICS, curve_shape
from .fit import maximise
from .held_out import FEW, leave_blocks_out
from .normal import Factor, information_factor
from .priors import frame_groups
from .spatial import SpatialStructure
from .spatial_start import frame
from .structure import Prior

if TYPE_CHECKING:
    from .structure import Indices

#: How far an arm drifts between two series: origins [m], their turns and offsets [rad],
#: elasticity [rad], curves [rad].
DRIFT = {"shift": 5e-5, "turn": 5e-5, "elastic": 2e-4, "curve": 3e-6}
#: Steps of EM for the spectrum of curves, and harmonics over which it is smoothed.
LEARNED, SMOOTH = 12, 3.0
#: A frame that is free may move by so many extents, or turn by so many radians.
FREE = 1e3


def remount(body: Body, q: Array, z: Array) -> Body:
    """Return the body of a calibrated arm in a new frame, from a few rows.

    body : of a spatial arm
    q : (n, dof) [rad or m]
    z : (n, m), what the sensor sees now
    Returns Body, with sensor and tool from the rows, and what they say of the arm added to what was
    known.
    """
    new = body.structure
    if not isinstance(new, SpatialStructure):
        raise TypeError("remount needs the body of a spatial arm")
    frames = np.concatenate([new.groups[group] for group in frame_groups(new)])
    kept, active = np.setdiff1d(body.active, frames), np.union1d(body.active, frames)
    beta = frame(new, q, z, body.beta)
    mean, precision = beta.copy(), np.zeros((len(active), len(active)))
    mean[kept], covariance = _with_spectrum(body, new, kept)
    place = np.searchsorted(active, kept)
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
        beta=fit.beta,
        active=active,
        covariance=unpack(packed, len(active)),
        packed=packed,
        noise=fit.noise,
        kappa=max(ratio, 1.0),
        rows=body.rows + len(q),
        second=None,
    )


def _with_spectrum(body: Body, structure: SpatialStructure, kept: Indices) -> tuple[Array, Array]:
    """Belief in the arm's parameters, its curves' prior replaced by the spectrum that they have.

    EM for the variance of each harmonic, the same for all joints but for a scale: curves of one
    series are too few to tell that of each harmonic alone, and a width of the Gaussian that the
    prior has, chosen by evidence, gained half as much. Of 30 rows of a UR10 where the elbow and the
    pan had turned elsewhere before, the error fell by 5 %.
    """
    rows = np.searchsorted(body.active, kept)
    value, covariance = body.beta[kept], body.covariance[np.ix_(rows, rows)].copy()
    free = [group for group, index in structure.groups.items() if np.isin(index, kept).any()]
    prior = structure.prior(free)
    curves = [h for h in prior.hypers if h.name.startswith("curve") and h.name in body.scales]
    for hyper in prior.hypers:
        scale = body.scales.get(hyper.name, hyper.scale)
        prior.sd[hyper.indices] = scale * np.sqrt(hyper.shape)
    sd = prior.sd[kept]
    if not curves or not (sd > 0).all():
        return value, covariance
    soft = Factor(covariance).inverse() - np.diag(sd**-2.0)
    # the covariance counts rows that err together once, the maximum took them as they came
    rows_alone = soft * (body.autocorrelation / information_factor(structure, body.nu))
    pull = (rows_alone + np.diag(sd**-2.0)) @ (value - prior.mean[kept])
    places = [np.searchsorted(kept, h.indices) for h in curves]
    shape = curve_shape()[:HARMONICS]
    for _ in range(LEARNED):
        inverse = Factor(rows_alone + np.diag(sd**-2.0)).inverse()
        square = (inverse @ pull) ** 2 + np.diag(inverse)
        powers = np.array([square[at].reshape(2, HARMONICS).mean(axis=0) for at in places])
        common = (powers / powers.mean(axis=1, keepdims=True)).mean(axis=0)
        common = shape * gaussian_filter1d(common / shape, SMOOTH, mode="nearest")
        for at, power in zip(places, powers, strict=True):
            sd[at] = np.sqrt(np.tile(common * (power / common).mean(), 2))
    value = prior.mean[kept] + Factor(rows_alone + np.diag(sd**-2.0)).solve(pull)
    return value, Factor(soft + np.diag(sd**-2.0)).inverse()


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
