"""The inverse on maps that are grids and an arm that is a closed form: quick and exact."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from planar import families_3r
from test_newton import THREE, TWO, ClosedForm, elbow_of
from threadpoolctl import threadpool_limits

from calib.common.scale import Scale
from calib.inverse.newton import CLOSE
from calib.inverse.self_motions import representatives
from calib.inverse.solver import SAME, Solver
from calib.inverse.tracking import follow
from calib.maps.association import Association
from calib.maps.lattice import Lattice
from calib.maps.links import WIRINGS
from calib.maps.map import Map

LOWER, UPPER = np.array([-0.5, -2.6]), np.array([1.5, 2.6])
LOWER_3, UPPER_3 = np.array([0.0, 0.26, -1.57]), np.array([1.57, 2.6, 1.57])


@pytest.fixture(autouse=True)
def _one_thread():
    with threadpool_limits(1, user_api="blas"):
        yield


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


# --- two joints -------------------------------------------------------------------------


def test_every_branch_is_found_once_and_no_other():
    s = solver()
    x = s.predictor.value(drawn(300))
    expected = both_elbows(s.scale, x)
    target, u, left = s.solve_all(x)
    assert (np.diff(target) >= 0).all()
    assert left.max() <= CLOSE * s.extent
    for k, branches in enumerate(expected):
        branches = branches[np.isfinite(branches[:, 0])]
        found = u[target == k]
        assert len(found) == len(branches)
        away = np.abs(found[:, None] - branches[None]).max(axis=2)
        assert away.min(axis=1).max() < 1e-6
        # the one nearest to the middle of the ranges comes first
        middle = np.linalg.norm(found - 0.5, axis=1)
        assert (np.diff(middle) >= 0).all()


def test_of_the_branches_the_one_nearest_to_the_wish_answers():
    s = solver()
    x, near = s.predictor.value(drawn(300)), drawn(300, seed=2)
    u, left = s.solve(x, near)
    assert left.max() <= CLOSE * s.extent
    branches = both_elbows(s.scale, x)
    away = np.linalg.norm(branches - near[:, None], axis=2)
    best = branches[np.arange(300), np.nanargmin(away, axis=1)]
    np.testing.assert_allclose(u, best, atol=1e-6)


def test_beside_the_fold_the_answer_is_hardly_further_than_the_wish_that_solves():
    s = solver()
    goal = drawn(200)
    goal[:, 1] = 0.5 + np.linspace(-0.01, 0.01, 200)  # all but stretched
    x = s.predictor.value(goal)
    u, left = s.solve(x, goal)
    assert left.max() <= CLOSE * s.extent
    away = np.linalg.norm(u - goal, axis=1)
    # a lattice as coarse as this one may take the twin for it, which is as close as this
    assert away.max() < 0.02
    assert np.mean(away < 1e-6) > 0.95


def test_out_of_reach_the_answer_is_the_nearest_point_of_the_circle():
    s = solver()
    angle = np.linspace(-0.4, 1.4, 40)
    ray = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    for far in (0.56, 0.8, 50.0):
        target, u, left = s.solve_all(far * ray)
        assert target.tolist() == list(range(40))
        np.testing.assert_allclose(left, far - sum(TWO), atol=1e-9)
        np.testing.assert_allclose(s.predictor.value(u), sum(TWO) * ray, atol=1e-6)
        again, left = s.solve(far * ray, drawn(40, seed=3))
        np.testing.assert_allclose(left, far - sum(TWO), atol=1e-9)
        np.testing.assert_allclose(s.predictor.value(again), sum(TWO) * ray, atol=1e-6)


def test_out_of_reach_no_point_of_a_grid_is_nearer():
    s = solver()
    x = np.random.default_rng(5).uniform(-0.6, 0.6, (150, 2))
    side = np.linspace(0, 1, 121)
    reached = s.predictor.value(np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2))
    least = np.linalg.norm(reached[None] - x[:, None], axis=2).min(axis=1)
    _, left = s.solve(x, np.full((150, 2), 0.5))
    assert (left <= least + 1e-9).all()
    assert np.count_nonzero(least > 0.02) > 30


def test_a_joint_that_turns_round_finds_its_one_branch_everywhere():
    s = solver(turning=True)
    goal = drawn(300, seed=4, margin=0.0)
    goal[:, 1] = 0.02 + 0.96 * goal[:, 1]
    x = s.predictor.value(goal)
    target, u, _ = s.solve_all(x)
    assert target.tolist() == list(range(300))
    np.testing.assert_allclose(s.scale.difference(u, goal), 0.0, atol=1e-6)
    assert u.min() >= 0.0
    assert u[:, 0].max() < 1.0
    near, left = s.solve(x, drawn(300, seed=6))
    np.testing.assert_allclose(s.scale.difference(near, goal), 0.0, atol=1e-6)
    assert left.max() <= CLOSE * s.extent


def test_answers_do_not_depend_on_the_company_or_on_what_was_asked_before():
    x = solver().predictor.value(drawn(60))
    fresh = Solver(solver().association, solver().predictor)
    alone = [fresh.solve_all(x[k : k + 1])[1] for k in (59, 0, 17)]
    target, u, _ = solver().solve_all(x)
    for k, found in zip((59, 0, 17), alone, strict=True):
        np.testing.assert_allclose(u[target == k], found, atol=1e-9)


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


# --- redundant joints -------------------------------------------------------------------


def test_redundant_joints_near_a_solution_stay_there():
    s = solver(3, 9, 14)
    goal = drawn(150, 3)
    u, left = s.solve(s.predictor.value(goal), goal)
    np.testing.assert_allclose(u, goal, atol=1e-9)
    assert left.max() < 1e-12


def test_redundant_joints_come_as_close_to_a_wish_as_the_target_lets_them():
    s = solver(3, 9, 14)
    x, near = s.predictor.value(drawn(40, 3)), drawn(40, 3, seed=2)
    u, left = s.solve(x, near)
    assert left.max() <= CLOSE * s.extent
    worse = 0
    for k in range(40):
        curves = families_3r(THREE, s.scale.lower, s.scale.lower + s.scale.span, x[k])
        on_target = (np.concatenate(curves) - s.scale.lower) / s.scale.span
        best = np.linalg.norm(on_target - near[k], axis=1).min()
        assert np.linalg.norm(u[k] - near[k]) >= best - 1e-3
        worse += np.linalg.norm(u[k] - near[k]) > best + 0.01
    assert worse <= 4  # another family, or another bend of the same one, was closer


def test_redundant_joints_far_from_a_wish_are_no_further_than_those_of_the_links():
    s = solver(3, 9, 14)
    x, near = s.predictor.value(drawn(400, 3)), drawn(400, 3, seed=100)
    u, left = s.solve(x, near)
    proposed, missed = s._from_starts(x, near)
    away, other = (np.linalg.norm(v - near, axis=1) for v in (u, proposed))
    assert left.max() <= CLOSE * s.extent
    assert missed.max() <= CLOSE * s.extent
    far = away > 4.0 * s.association.motor.spacing
    assert np.count_nonzero(far) > 20
    assert (away[far] <= other[far] + 1e-6).all()


def test_redundant_joints_out_of_reach_stretch():
    s = solver(3, 9, 14)
    x = 0.9 * np.array([[np.cos(a), np.sin(a)] for a in (0.6, 0.9, 1.2)])
    straight = s.predictor.value(np.array([[0.0, 0.0, 0.5]]))  # the elbow at its limit
    u, left = s.solve(x, drawn(3, 3))
    assert (left < 0.9 - np.linalg.norm(straight) + 0.05).all()
    np.testing.assert_allclose(u[:, 1], 0.0, atol=1e-9)
    np.testing.assert_allclose(left, np.linalg.norm(s.predictor.value(u) - x, axis=1), atol=1e-12)


def test_each_family_of_a_redundant_arm_has_one_representative():
    s = solver(3, 9, 14)
    x = s.predictor.value(drawn(15, 3, seed=5, margin=0.1))
    target, u, left = s.solve_all(x)
    assert left.max() <= CLOSE * s.extent
    right = 0
    for k in range(15):
        curves = families_3r(THREE, s.scale.lower, s.scale.lower + s.scale.span, x[k])
        found = s.scale.from_unit(u[target == k])
        away = np.array([[np.abs(c - q).max(axis=1).min() for c in curves] for q in found])
        assert (away.min(axis=1) < 5e-3).all()
        right += (np.count_nonzero(away < 5e-3, axis=0) == 1).all()
    assert right >= 13


def test_representatives_join_what_one_self_motion_connects():
    s = solver(3, 9, 14)
    x = s.predictor.value(np.array([[0.5, 0.5, 0.5]]))
    curve = families_3r(THREE, s.scale.lower, s.scale.lower + s.scale.span, x[0])[0]
    some = (curve[:: len(curve) // 12] - s.scale.lower) / s.scale.span
    target, u = representatives(s.newton, np.zeros(len(some), dtype=np.intp), some, x)
    assert target.tolist() == [0]
    all_of_it = (curve - s.scale.lower) / s.scale.span
    best = np.linalg.norm(all_of_it - 0.5, axis=1).min()
    assert np.linalg.norm(u[0] - 0.5) == pytest.approx(best, abs=1e-3)


def test_solutions_closer_than_a_hair_are_one():
    s = solver()
    target = np.array([0, 0, 0, 1, 1], dtype=np.intp)
    u = np.array([[0.5, 0.5], [0.5 + SAME / 2, 0.5], [0.5 + 2 * SAME, 0.5], [0.5, 0.5], [0.1, 0.5]])
    assert s._distinct(target, u).tolist() == [True, False, True, True, True]


# --- following --------------------------------------------------------------------------


def circle(n=40):
    angle = np.linspace(0, 2 * np.pi, n)
    return np.array([0.38, 0.16]) + 0.04 * np.stack([np.cos(angle), np.sin(angle)], axis=1)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_path_stays_on_the_elbow_where_it_starts(sign):
    s, x = solver(), circle()
    branches = both_elbows(s.scale, x)
    expected = branches[:, 0 if sign > 0 else 1]
    track = follow(s, x, expected[0] + 0.01)
    assert track.jumps == []
    np.testing.assert_allclose(track.u, expected, atol=1e-6)


def test_where_one_elbow_ends_the_other_is_taken_from_the_start():
    s = solver()
    # at 85 deg the lower elbow would need a shoulder beyond its limit
    angle = np.linspace(0.3, 1.6, 30)
    x = 0.40 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    branches = both_elbows(s.scale, x)
    whole = np.isfinite(branches[..., 0]).all(axis=0)
    assert whole.tolist() == [True, False]
    free = follow(s, x, None)
    assert free.jumps == []
    np.testing.assert_allclose(free.u, branches[:, 0], atol=1e-6)
    # from the other elbow there is one jump, as late as can be
    bound = follow(s, x, branches[0, 1])
    last = int(np.flatnonzero(np.isfinite(branches[:, 1, 0]))[-1])
    assert bound.jumps == [last + 1]
    np.testing.assert_allclose(bound.u[: last + 1], branches[: last + 1, 1], atol=1e-6)
    np.testing.assert_allclose(bound.u[last + 1 :], branches[last + 1 :, 0], atol=1e-6)


def test_of_branches_that_all_lead_to_the_end_the_shortest_is_taken():
    s, rng = solver(), np.random.default_rng(0)
    taken = []
    for _ in range(150):
        begin, end = s.predictor.value(rng.uniform(0.1, 0.9, (2, 2)))
        x = begin + np.linspace(0.0, 1.0, 6)[:, None] * (end - begin)
        branches = both_elbows(s.scale, x)
        length = np.linalg.norm(np.diff(branches, axis=0), axis=2).sum(axis=0)
        # both exist all the way, and one is clearly shorter
        if not np.ptp(length) > 0.02:
            continue
        track = follow(s, x, None)
        assert track.jumps == []
        np.testing.assert_allclose(track.u, branches[:, length.argmin()], atol=1e-6)
        middle = np.linalg.norm(branches[0] - 0.5, axis=1)
        taken.append(length.argmin() == middle.argmin())
    # neither always the one that starts in the middle, nor never
    assert 3 < sum(taken) < len(taken) - 3


def test_redundant_joints_follow_in_small_steps():
    s = solver(3, 9, 14)
    goal = np.array([[0.5, 0.5, 0.5]])
    centre = s.predictor.value(goal)[0]
    x = centre + 0.5 * (circle() - circle().mean(axis=0))
    track = follow(s, x, goal[0])
    assert track.jumps == []
    np.testing.assert_allclose(s.predictor.value(track.u), x, atol=CLOSE)
    assert np.linalg.norm(np.diff(track.u, axis=0), axis=1).max() < 0.1


def test_redundant_joints_drift_to_the_middle_of_their_ranges():
    s = solver(3, 9, 14)
    goal = np.array([[0.5, 0.5, 0.5]])
    x = s.predictor.value(goal)[0] + 0.5 * (circle() - circle()[0])
    aside, _ = s.newton.settle(goal, x[:1], np.array([[0.9, 0.5, 0.1]]))
    pull = np.linalg.norm(s.newton.tangent(aside, 0.5 - aside))
    track = follow(s, np.concatenate([x, x[1:], x[1:]]), aside[0])
    left = np.linalg.norm(s.newton.tangent(track.u[-1:], 0.5 - track.u[-1:]))
    assert pull > 0.1
    assert left < 0.5 * pull
