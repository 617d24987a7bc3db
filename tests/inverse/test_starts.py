"""Where the links say that a solution may be, on maps that are grids."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from closed_arms import both_elbows, drawn, elbow_of, solver

from calib.inverse.newton import CLOSE
from calib.inverse.solver import Solver
from calib.maps.map import Map

pytestmark = pytest.mark.usefixtures("one_blas_thread")


# --- what the links propose -------------------------------------------------------------


@pytest.mark.parametrize("dof", [2, 3])
def test_proposals_are_one_short_step_from_a_linked_node(dof):
    s = solver(dof, *((16, 14) if dof == 2 else (9, 14)))
    motor, sensory = s.association.motor, s.association.sensory
    x = s.predictor.value(drawn(100, dof))
    target, u = s.starts.propose(x)
    assert np.unique(target).tolist() == list(range(100))
    assert (np.diff(target) >= 0).all()
    assert u.min() >= 0.0
    assert u.max() <= 1.0
    # no two of a target share a cell, and most miss it by less than a node does
    gap = np.linalg.norm(s.predictor.value(u) - x[target], axis=1)
    spacing = sensory.spacing * sensory.scale.span.mean()
    assert np.median(gap) < 0.2 * spacing
    away = motor.nearest(u)[0][:, 0] / motor.spacing
    assert away.max() <= 2.0
    cell = np.floor(u / (1.5 * motor.spacing)).astype(int)
    assert len(np.unique(np.column_stack([target, cell]), axis=0)) == len(u)


def test_far_targets_get_three_proposals_at_most():
    target, _ = solver().starts.propose(np.array([[5.0, 5.0], [-5.0, 1.0]]))
    assert np.bincount(target).tolist() == [3, 3]


def test_starts_of_a_sensory_node_hold_every_branch():
    s = solver()
    sensory = s.association.sensory
    x = s.predictor.value(drawn(200))
    node = sensory.weights[sensory.nearest(sensory.scale.to_unit(x))[1][:, 0]]
    u, step, folded = s.starts.of(x)
    assert step.shape == u.shape[:2]
    branches = both_elbows(s.scale, x)
    clear = np.abs(elbow_of(x)) > 0.5
    inside = np.linalg.norm(node, axis=1) < 0.52
    assert not folded[clear & inside].all()
    assert folded[np.abs(elbow_of(x)) < 0.1].all()
    for k in np.flatnonzero(clear & inside):
        for branch in branches[k][np.isfinite(branches[k, :, 0])]:
            if branch.min() > 0.1 and branch.max() < 0.9:
                assert np.nanmin(np.abs(u[k] - branch).max(axis=1)) < 0.06
    known = np.isfinite(u[..., 0])
    assert (known.sum(axis=1) >= 1).all()
    # a step is told in node spacings, and no start is further away than two
    assert np.nanmax(step) < 20


def test_a_start_is_one_linear_step_from_a_kept_one_and_the_step_is_told_in_spacings():
    s = solver()
    sensory, spacing = s.association.sensory, s.association.motor.spacing
    x = s.predictor.value(drawn(300))
    u, step, _ = s.starts.of(x)
    kept = s.starts._u[sensory.nearest(sensory.scale.to_unit(x))[1][:, 0]]
    inside = ((u > 0) & (u < 1)).all(axis=2)
    length = np.linalg.norm(u - kept, axis=2) / spacing
    short = inside & (step <= 2.0)
    assert np.count_nonzero(short) > 300
    np.testing.assert_allclose(length[short], step[short], rtol=1e-9)
    long = inside & (step > 2.0)
    np.testing.assert_allclose(length[long], 2.0, rtol=1e-9)
    # and it leads closer: by Newton's first step the error falls to the square
    before = np.linalg.norm(
        s.predictor.value(kept[short]) - np.repeat(x, 8, 0)[short.ravel()], axis=1
    )
    after = np.linalg.norm(s.predictor.value(u[short]) - np.repeat(x, 8, 0)[short.ravel()], axis=1)
    assert np.median(after) < 0.1 * np.median(before)


@pytest.mark.parametrize(("dof", "room"), [(2, 8), (3, 32)])
def test_kept_starts_hit_their_node_and_are_apart(dof, room):
    s = solver(dof, *((16, 14) if dof == 2 else (9, 14)))
    sensory, motor = s.association.sensory, s.association.motor
    s.starts.of(s.predictor.value(drawn(100, dof)))
    known = np.flatnonzero(s.starts._known)
    u = s.starts._u[known]
    assert u.shape[1] == room
    there = np.isfinite(u[..., 0])
    assert there[:, 0].all()
    # the first ones are filled, without a gap
    assert (np.diff(there.astype(int), axis=1) <= 0).all()
    value = s.predictor.value(u.reshape(-1, dof)).reshape(*u.shape[:2], 2)
    miss = np.linalg.norm(value - sensory.weights[known, None], axis=2)
    spacing = sensory.spacing * sensory.scale.span.mean()
    # all within two spacings of their node, or where none is, three at most
    close = np.nanmin(miss, axis=1) <= 2.0 * spacing
    assert np.nanmax(miss[close]) <= 2.0 * spacing
    assert (there[~close].sum(axis=1) <= 3).all()
    gap = np.abs(u[:, :, None] - u[:, None]).max(axis=3)
    gap[:, np.arange(room), np.arange(room)] = np.inf
    assert np.nanmin(gap) >= 0.3 * motor.spacing
    if dof > 2:
        met = miss <= CLOSE * s.extent
        both = met[:, :, None] & met[:, None]
        assert np.nanmin(np.where(both, gap, np.inf)) >= 1.5 * motor.spacing


def test_around_are_the_nodes_nearest_by_position_and_the_corners():
    s = solver()
    x = s.predictor.value(drawn(5))
    target, u = s.starts.around(x)
    size = s.association.motor.size
    ranks = [k for k in (1, 2, 3, 5, 8, 13, 21, 34, 55, 89, 144) if k <= size]
    assert target.tolist() == np.repeat(np.arange(5), len(ranks) + 4).tolist()
    value = s.predictor.value(s.association.motor.units)
    for k in range(5):
        order = np.argsort(np.linalg.norm(value - x[k], axis=1))
        rows = u[target == k]
        np.testing.assert_array_equal(
            rows[: len(ranks)], s.association.motor.units[order[np.array(ranks) - 1]]
        )
        assert sorted(map(tuple, rows[len(ranks) :])) == [(0, 0), (0, 1), (1, 0), (1, 1)]


def test_nodes_beyond_the_limits_are_tried_at_the_limits():
    s = solver()
    motor = s.association.motor
    wide = Map(1.3 * motor.units - 0.15, motor.lattice, motor.scale, motor.history)
    assert wide.units.min() < 0.0 < 1.0 < wide.units.max()
    apart = Solver(replace(s.association, motor=wide), s.predictor)
    _, u = apart.starts.around(s.predictor.value(drawn(50)))
    assert (u >= 0.0).all()
    assert (u <= 1.0).all()
    kept = np.clip(wide.units, 0.0, 1.0)
    for row in u[:40]:
        assert (row == kept).all(axis=1).any() or set(row) <= {0.0, 1.0}
