"""The inverse on maps that are grids and an arm that is a closed form: quick and exact."""

from __future__ import annotations

import numpy as np
import pytest
from closed_arms import THREE, TWO, both_elbows, drawn, solver
from planar import families_3r

from calib.inverse.newton import CLOSE
from calib.inverse.self_motions import representatives
from calib.inverse.solver import SAME, Solver

pytestmark = pytest.mark.usefixtures("one_blas_thread")


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
