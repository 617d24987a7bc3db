"""Sockets: touches as positions, so that they are compared with a model like those of a sensor.

Where the sockets are, nobody measured.  They are found together with the arm, with the model's
belief as its prior: once as it is, and once for each part that may have changed.  Where the rows
speak clearly for a change (by the evidence, which counts what a free part could explain by
chance), the sockets are where the changed arm has them; else where the model does.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..body.fit import Fit
from ..body.parameters import Prior
from ..body.settings import STUDENT
from ..body.spatial import SpatialStructure
from ..body.spatial_view import InSpace
from ..body.touch import Touch
from ..errors import LogError
from ..model.model import Model
from ..samples.samples import Samples

_FREED = {"offset": np.radians(2.0), "tool": 5e-3, "placement": 2e-3}
"""What may have changed, and by how much: a servo put on anew, a bent tip, origins [rad or m]."""

_NATS = 5.0  # of evidence for a change
_GAUGE = 1e-6  # [m or rad] of what no touch tells, and of what the belief holds for exact


def as_positions(model: Model, log: Samples) -> tuple[Samples, list[str]]:
    """A log of touches with its sockets as positions, and what is told of them.

    Raises LogError if the model is not of an arm in space.
    """
    touch, body = log.touch, model.body
    assert touch is not None  # noqa: S101 - a log of touches
    structure = None if body is None else body.structure
    if body is None or not isinstance(structure, SpatialStructure) or structure.outputs != 3:
        raise LogError("the log holds touches: expected a model of an arm in space with a body")
    q = model.about.joints_of(log)
    tip = body.predict(q)
    gone = touch.strays(touch.about_medians(tip))
    notes = [f"{gone.sum()} touches in no socket of theirs are left out"] if gone.any() else []
    log, q, tip, touch = log.take(~gone), q[~gone], tip[~gone], touch.take(~gone)
    number, known, own = touch.renumbered()
    touched, noise = number >= 0, float(body.noise[0])
    measured = structure.measurement
    assert isinstance(measured, InSpace)  # noqa: S101 - three outputs
    reading = Touch(measured, len(own), known, noise, noise)
    view = "touch" if structure.view == "base" else "touch and rigid"
    seen = structure.with_view(view, reading=reading)
    rows, point = reading.rows(q, number, log.x), seen.groups["point"]
    names = {label.name: k for k, label in enumerate(seen.labels)}
    to = np.array([names[label.name] for label in structure.labels])
    beta = seen.neutral()
    beta[to] = body.beta
    base = structure.pose(q, body.beta)[0]
    beta[point] = np.ravel([base[number == k].mean(axis=0) for k in range(len(own))])
    variance = np.zeros((seen.size, seen.size))
    at = to[body.active]
    variance[np.ix_(at, at)] = body.kappa**2 * body.covariance + _GAUGE**2 * np.eye(len(at))
    variance[point, point] = structure.extent**2

    def fitted(group: str | None) -> Fit:
        more = variance.copy()
        if group is not None:
            more[seen.groups[group], seen.groups[group]] += _FREED[group] ** 2
        free = np.flatnonzero(np.diag(more) > 0)
        sd = np.sqrt(np.diag(more))
        prior = Prior(beta, sd, known=np.asarray(np.linalg.inv(more[np.ix_(free, free)])))
        return Fit(
            seen, rows, np.zeros((len(rows), 3)), beta, prior, nu=STUDENT,
            floor=np.full(3, 0.5 * noise), noise=np.full(3, noise),
        ).maximise(steps=8)  # fmt: skip

    same = fitted(None)
    fits = [fitted(group) for group in _FREED]
    best = max(fits, key=lambda fit: fit.evidence)
    changed = best.evidence - same.evidence > _NATS * best.autocorrelation
    places = np.full((len(touch.sockets), 3), np.nan)
    if changed:
        found = best.beta[point].reshape(-1, 3)
        frame = structure.sensor(best.beta[to])
        places[own] = found if view == "touch" else found @ frame.rotation.T + frame.shift
    else:
        places[own] = [tip[number == k].mean(axis=0) for k in range(len(own))]
    x = np.where(touched[:, None], places[touch.number], log.x)
    return replace(log, x=x, touch=None), notes
