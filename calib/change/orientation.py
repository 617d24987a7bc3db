"""Orientation: whether the tool of a log is turned otherwise than the model's, and what follows.

Positions of a tool that is bent about its own tip stay as they were; only orientations tell.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.special import chdtri

from ..arm.rotations import exponential, logarithm, matrix_of
from ..body.belief import Body
from ..body.covariance import autocorrelation_time, root_of
from ..body.normal import Factor
from ..body.poses import knows_orientation
from ..common.arrays import Array
from ..common.rows import thinned
from .cause import Cause
from .comparison import Comparison
from .rows import UPDATED_ROWS
from .settings import FALSE_ALARM

_STEPS, _NU = 8, 6.0


def turned_tool(found: Comparison) -> tuple[float, tuple[Cause, ...], list[str]]:
    """Compare the orientations of a log with those that the model predicts.

    Returns score : statistic over its threshold; 0 where nothing can be compared
    Returns causes : the turned tool, where the score is above 1
    Returns notes : why orientations were not compared
    """
    if found.orientation is None:
        return 0.0, (), []
    if not knows_orientation(found.body):
        return 0.0, (), ["orientations are not compared: the model was learned without them"]
    changed = found.changed and found.explained
    structure: Any = found.reference.structure if changed else found.body.structure
    beta = found.explanations[0].beta if changed else found.body.beta
    predicted = exponential(structure.with_view("pose").predict(found.q, beta)[:, 3:])
    back = np.swapaxes(predicted, 1, 2)
    turns = logarithm(back @ matrix_of(found.orientation))
    # seen = exp(x) predicted exp(y): a sensor turned by x, which only a change frees, a tool by y
    own = np.broadcast_to(np.eye(3), back.shape)
    design = np.concatenate([back, own], axis=2) if changed else own
    weight, noise = np.ones(len(turns)), 1.0
    for _ in range(_STEPS):
        gram = np.einsum("nij,nik,n->jk", design, design, weight)
        moved = np.linalg.pinv(gram) @ np.einsum("nij,ni,n->j", design, turns, weight)
        residual = turns - design @ moved
        square = (residual**2).sum(axis=1)
        noise = max(float((weight * square).sum()) / (3 * len(turns)), 1e-18)
        weight = (_NU + 3) / (_NU + square / noise)
    # rows that err together count once, and the model knows its own tool as well as it does
    covariance = noise * autocorrelation_time(residual) * np.linalg.pinv(gram)[-3:, -3:]
    body = found.body
    held = np.searchsorted(body.active, body.structure.groups["tool.rotation"])
    covariance += body.kappa**2 * body.covariance[np.ix_(held, held)]
    tool, size = moved[-3:], float(np.linalg.norm(moved[-3:]))
    score = float(tool @ np.linalg.solve(covariance, tool)) / float(chdtri(3, FALSE_ALARM))
    # what the chain leaves over differs between regions of the workspace by about its scatter
    score = min(score, size / float(np.sqrt(3 * noise)))
    if score <= 1.0:
        return score, (), []
    half = 1.96 * float(np.sqrt(tool @ covariance @ tool)) / size
    words = f"the tool is turned by {np.degrees(size):.3g} deg (its orientation, not its position)"
    cause = Cause.measured("tool", "tool.rotation", words, size, half, "rad")
    return score, (cause,), []


def with_orientations(body: Body, q: Array, quaternions: Array, bent: bool) -> Body:
    """Update a belief by the orientations of a log, after its positions.

    Gauss-Newton steps of all parameters with Student noise, whose size is that of these rows: the
    body keeps that of positions alone. Rows that err together count once.

    body : of an arm in space that was learned from orientations too
    q : (n, dof)
    quaternions : (n, 4), qx, qy, qz, qw
    bent : whether the tool is turned otherwise: its old orientation then tells nothing
    """
    structure: Any = body.structure
    posed, rows = structure.with_view("pose"), thinned(len(q), UPDATED_ROWS)
    q, seen = q[rows], matrix_of(quaternions[rows])
    prior = body.kappa**2 * body.covariance
    tool = np.searchsorted(body.active, structure.groups["tool.rotation"])
    prior[tool, tool] += float(bent)  # rad^2
    known, beta = Factor(prior).inverse(), body.beta
    moved, weight = np.zeros(len(prior)), np.ones(len(q))
    for step in range(_STEPS + 1):
        predicted, x = posed.linearise(q, beta, body.active)
        residual = logarithm(seen @ np.swapaxes(exponential(predicted[:, 3:]), 1, 2))
        square, x = (residual**2).sum(axis=1), x[:, 3:]
        noise = max(float((weight * square).sum()) / (3 * len(q)), 1e-18)
        weight = (_NU + 3) / (_NU + square / noise)
        each = weight / (noise * autocorrelation_time(residual))
        factor = Factor(np.einsum("nij,nik,n->jk", x, x, each, optimize=True) + known)
        if step == _STEPS:
            break
        delta = np.zeros(structure.size)
        delta[body.active] = factor.solve(
            np.einsum("nij,ni,n->j", x, residual, each) - known @ moved
        )
        beta, moved = structure.retract(beta, delta), moved + delta[body.active]
    # the bound inflates by kappa what is kept here without it
    return replace(body, beta=beta, root=root_of(factor.inverse()) / body.kappa)
