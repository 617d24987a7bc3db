"""Sockets: touches as positions, so that they are compared with a model like those of a sensor.

Where the sockets are, nobody measured.  They are found with the model's belief as prior, as it is
and with what may have changed; where the evidence speaks clearly for a change they are where the
changed arm has them, else where the model does.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..body.fit import maximise
from ..body.parameters import Prior
from ..body.settings import STUDENT
from ..body.spatial import SpatialStructure
from ..body.spatial_view import InSpace
from ..body.touch import Touch, restated
from ..errors import LogError
from ..model.model import Model
from ..samples.samples import Samples
from ..training.evaluate import in_sockets

_FREED = {"offset": np.radians(2.0), "tool": 5e-3, "placement": 2e-3}
"""What may have changed, and by how much: a servo put on anew, a bent tip, origins [rad or m]."""

_NATS = 5.0  # of evidence for a change
_GAUGE = 1e-6  # [m or rad] of what no touch tells, and of what the belief holds for exact


def as_positions(model: Model, log: Samples) -> tuple[Samples, list[str]]:
    """A log of touches with its sockets as positions, and what is told of them.

    Raises LogError if the model is not of an arm in space.
    """
    body, touch, rows = model.body, log.touch, len(log)
    assert touch is not None  # noqa: S101 - a log of touches
    structure = None if body is None else body.structure
    if body is None or not isinstance(structure, SpatialStructure) or structure.outputs != 3:
        raise LogError("the log holds touches: expected a model of an arm in space with a body")
    log, _ = in_sockets(model, log, touch)  # where the model has them
    gone = f"{rows - len(log)} touches in no socket of theirs are left out"
    touch, q, noise = log.touch or touch, model.about.joints_of(log), float(body.noise[0])
    number, known, own = touch.renumbered()
    tip = structure.measurement
    assert isinstance(tip, InSpace)  # noqa: S101 - three outputs
    view = "touch" if structure.view == "base" else "touch and rigid"
    seen = structure.with_view(view, reading=Touch(tip, len(own), known, noise, noise))
    belief, point = restated(body, seen), seen.groups["point"]
    at, beta, variance = belief.active, belief.beta.copy(), np.zeros((seen.size, seen.size))
    base = structure.pose(q, body.beta)[0]
    beta[point] = np.ravel([base[number == k].mean(axis=0) for k in range(len(own))])
    variance[np.ix_(at, at)] = body.kappa**2 * belief.covariance + _GAUGE**2 * np.eye(len(at))
    variance[point, point] = structure.extent**2
    fits, touches = [], seen.measurement.rows(q, number, log.x)
    for freed in ({}, _FREED):
        for group, sd in freed.items():
            variance[seen.groups[group], seen.groups[group]] += sd**2
        free, sd = np.flatnonzero(np.diag(variance)), np.sqrt(np.diag(variance))
        prior = Prior(beta, sd, known=np.linalg.inv(variance[np.ix_(free, free)]))
        fits.append(
            maximise(
                seen, touches, np.zeros((len(touches), 3)), beta, prior, nu=STUDENT,
                floor=np.full(3, 0.5 * noise), noise=np.full(3, noise), steps=8,
            )
        )  # fmt: skip
    same, other = fits
    if other.evidence - same.evidence > _NATS * other.autocorrelation:
        places = np.full((len(touch.sockets), 3), np.nan)
        places[own] = other.beta[point].reshape(-1, 3)
        if view != "touch":
            frame = structure.sensor(restated(replace(belief, beta=other.beta), structure).beta)
            places = places @ frame.rotation.T + frame.shift
        touched = touch.number >= 0
        log = replace(log, x=np.where(touched[:, None], places[touch.number], log.x))
    return replace(log, touch=None), [gone] * (len(log) < rows)
