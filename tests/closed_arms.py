"""Arms whose forward map is a closed form, and maps that are grids: for tests of the inverse."""

from __future__ import annotations

from functools import cache

import numpy as np

from calib.common.scale import Scale
from calib.inverse.newton import Newton
from calib.inverse.solver import Solver
from calib.inverse.tasks import Positions
from calib.maps.association import Association
from calib.maps.lattice import Lattice
from calib.maps.links import WIRINGS
from calib.maps.map import Map

TWO, THREE = (0.30, 0.25), (0.30, 0.25, 0.15)


class ClosedForm:
    """Links in a row, seen from the unit box of the joints; counts what it is asked."""

    def __init__(self, links, scale):
        self.links, self.scale, self.asked = np.array(links), scale, 0

    def value(self, u):
        return self.value_and_slope(u)[0]

    def value_and_slope(self, u):
        self.asked += 1
        angle = np.cumsum(self.scale.from_unit(u), axis=1)
        arms = np.stack([self.links * np.cos(angle), self.links * np.sin(angle)], axis=1)
        beyond = np.cumsum(arms[:, :, ::-1], axis=2)[:, :, ::-1]  # from each joint to the tip
        slope = np.stack([-beyond[:, 1], beyond[:, 0]], axis=1) * self.scale.span
        return arms.sum(axis=2), slope


def newton_of(links, lower, upper, extent=1.1):
    """Newton on links whose joints have these limits [rad]; a whole turn goes round."""
    lower, upper = np.array(lower, dtype=float), np.array(upper, dtype=float)
    scale = Scale.of_range(lower, upper, (True,) * len(links))
    return Newton(Positions(ClosedForm(links, scale)), scale, extent)


def around(n, dof, seed=0, margin=0.1):
    return np.random.default_rng(seed).uniform(margin, 1 - margin, (n, dof))


def elbow_of(x):
    """Elbow of the two links for a distance from the base, by the law of cosines."""
    a, b = TWO
    return np.arccos(((x**2).sum(axis=-1) - a * a - b * b) / (2 * a * b))


LOWER, UPPER = np.array([-0.5, -2.6]), np.array([1.5, 2.6])
LOWER_3, UPPER_3 = np.array([0.0, 0.26, -1.57]), np.array([1.57, 2.6, 1.57])


def grid(side, scale):
    lattice = Lattice((side,) * len(scale.span))
    return Map((lattice.positions() + 0.5) / side, lattice, scale, np.zeros((0, 4)))


@cache
def solver(dof=2, motor_side=16, sensory_side=14, turning=False):
    """Links of two grids, from samples; `turning` lets the first joint go round."""
    links, lower, upper = (TWO, LOWER, UPPER) if dof == 2 else (THREE, LOWER_3, UPPER_3)
    if turning:
        lower, upper = np.array([-np.pi, 0.3]), np.array([np.pi, 2.5])
    scale = Scale.of_range(lower, upper, (True,) * dof)
    predictor = ClosedForm(links, scale)
    u = np.random.default_rng(0).random((6000, dof))
    x = predictor.value(u)
    motor, sensory = grid(motor_side, scale), grid(sensory_side, Scale.of_data(x))
    wiring = WIRINGS["reciprocal"]
    a, b = wiring.activity(motor, u), wiring.activity(sensory, sensory.scale.to_unit(x))
    return Solver(Association(motor, sensory, wiring.link(a, b)), predictor)


def drawn(n, dof=2, seed=1, margin=0.02):
    return np.random.default_rng(seed).uniform(margin, 1 - margin, (n, dof))


def both_elbows(scale, x):
    """Every solution inside the limits, in the unit box, by the law of cosines."""
    out = []
    for sign in (1, -1):
        elbow = sign * elbow_of(x)
        ahead = np.arctan2(TWO[1] * np.sin(elbow), TWO[0] + TWO[1] * np.cos(elbow))
        shoulder = np.arctan2(x[:, 1], x[:, 0]) - ahead
        shoulder = (shoulder + np.pi) % (2 * np.pi) - np.pi
        u = (np.stack([shoulder, elbow], axis=1) - scale.lower) / scale.span
        out.append(np.where(((u >= 0) & (u <= 1)).all(axis=1)[:, None], u, np.nan))
    return np.stack(out, axis=1)
