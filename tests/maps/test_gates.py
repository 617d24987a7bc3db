"""Gates: a node's half-space ends where the rows say that a defect ends."""

import numpy as np
import pytest

from calib.common.scale import Scale
from calib.maps.gates import find_gates, opening
from calib.maps.lattice import Lattice
from calib.maps.map import Map

SCALE = Scale(np.zeros(2), np.ones(2), np.zeros(2, dtype=bool))
EDGE = 0.53
NOISE = 1e-3


def grid(n, scale=SCALE):
    lattice = Lattice((n, n))
    return Map((lattice.positions() + 0.5) / n, lattice, scale, np.zeros((0, 4)))


def rows(tilt=0.0, n=4000):
    """Rows whose residual is a hundred times the noise beyond a line, and where that is."""
    rng = np.random.default_rng(0)
    u = rng.random((n, 2))
    wrong = u[:, 0] + tilt * (u[:, 1] - 0.5) > EDGE
    held = NOISE * rng.normal(size=(n, 2)) * np.where(wrong, 100.0, 1.0)[:, None]
    return u, np.einsum("no,no->n", held, held), wrong


@pytest.mark.parametrize("tilt", [0.0, 0.7])
def test_gates_open_where_rows_are_wrong_and_close_where_they_are_calm(tilt):
    u, square, wrong = rows(tilt)
    motor = grid(10)
    gates = find_gates(motor, u, square, ~wrong, 2)
    closed = gates[:, -1] != 1.0
    away = np.abs(motor.units[:, 0] + tilt * (motor.units[:, 1] - 0.5) - EDGE)
    assert closed[away < 0.05].all()
    assert not closed[away > 0.3].any()
    # every row within a cell of a gated node, on the right side to a spacing of the rows
    index = np.flatnonzero(closed)
    gap = u[None] - motor.units[index, None]
    near = np.abs(gap).max(axis=2) < 0.1
    sides = np.abs(u[:, 0] + tilt * (u[:, 1] - 0.5) - EDGE) > 2.0 / np.sqrt(len(u))
    said = opening(np.repeat(gates[index, None], len(u), axis=1), gap)
    right = (said > 0.5) == wrong
    assert right[near & sides].mean() > 0.99


def test_without_wrong_or_without_calm_rows_there_is_no_gate():
    u, square, wrong = rows()
    assert find_gates(grid(6), u, square, np.ones_like(wrong), 2) is None
    gates = find_gates(grid(6), u[wrong], square[wrong], u[wrong][:, 0] < -1, 2)
    assert gates is None


def test_an_outlier_alone_closes_nothing():
    u, square, wrong = rows()
    calm = np.ones_like(wrong)
    quiet = np.where(wrong, square / 1e4, square)
    some = np.flatnonzero(wrong)[:3]
    quiet[some], calm[some] = 1.0, False
    gates = find_gates(grid(6), u, quiet, calm, 2)
    assert gates is None or (gates[:, :-1] == 0.0).all()


@pytest.mark.parametrize("dof", [1, 3])
def test_in_any_number_of_joints_the_edge_lies_between_the_rows(dof):
    rng = np.random.default_rng(1)
    u = rng.random((300 if dof == 1 else 3000, dof))
    wrong = u[:, 0] > 0.5
    square = np.where(wrong, 1.0, 1e-4) * rng.chisquare(2, len(u))
    scale = Scale(np.zeros(dof), np.ones(dof), np.zeros(dof, dtype=bool))
    lattice = Lattice((4,) * dof)
    motor = Map((lattice.positions() + 0.5) / 4, lattice, scale, np.zeros((0, 4)))
    gates = find_gates(motor, u, square, ~wrong, 2)
    beside = np.flatnonzero(np.abs(motor.units[:, 0] - 0.5) < 0.2)
    along = np.eye(dof)[0] * (0.5 - motor.units[beside, :1])  # the place on the edge
    assert (opening(gates[beside], along + 0.2 * np.eye(dof)[0]) == 1.0).all()
    assert (opening(gates[beside], along - 0.2 * np.eye(dof)[0]) == 0.0).all()


def test_a_gate_stays_open_where_a_defect_fades():
    # 10 standard deviations below 0.4, 2 up to 0.5, then noise; rows by their medians calm from 0.4
    u = np.random.default_rng(0).random((4000, 2))
    square = np.where(u[:, 0] < 0.4, 200.0, np.where(u[:, 0] < 0.5, 8.0, 2.0))
    motor = grid(6)
    gates = find_gates(motor, u, square, u[:, 0] >= 0.4, 2)
    beside = np.flatnonzero((motor.units[:, 0] > 0.3) & (motor.units[:, 0] < 0.5))
    for node in beside:
        at = np.array([[0.45, motor.units[node, 1]], [0.55, motor.units[node, 1]]])
        said = opening(gates[node], at - motor.units[node])
        np.testing.assert_allclose(said, [1.0, 0.0], atol=1e-9)
