"""Joints that follow a moving target on one branch, on maps that are grids."""

from __future__ import annotations

import numpy as np
import pytest
from closed_arms import both_elbows, solver

from calib.inverse.newton import CLOSE
from calib.inverse.tracking import follow_targets

pytestmark = pytest.mark.usefixtures("one_blas_thread")


# --- following --------------------------------------------------------------------------


def circle(n=40):
    angle = np.linspace(0, 2 * np.pi, n)
    return np.array([0.38, 0.16]) + 0.04 * np.stack([np.cos(angle), np.sin(angle)], axis=1)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_path_stays_on_the_elbow_where_it_starts(sign):
    s, x = solver(), circle()
    branches = both_elbows(s.scale, x)
    expected = branches[:, 0 if sign > 0 else 1]
    track = follow_targets(s, x, expected[0] + 0.01)
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
    free = follow_targets(s, x, None)
    assert free.jumps == []
    np.testing.assert_allclose(free.u, branches[:, 0], atol=1e-6)
    # from the other elbow there is one jump, as late as can be
    bound = follow_targets(s, x, branches[0, 1])
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
        track = follow_targets(s, x, None)
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
    track = follow_targets(s, x, goal[0])
    assert track.jumps == []
    np.testing.assert_allclose(s.predictor.value(track.u), x, atol=CLOSE)
    assert np.linalg.norm(np.diff(track.u, axis=0), axis=1).max() < 0.1


def test_redundant_joints_drift_to_the_middle_of_their_ranges():
    s = solver(3, 9, 14)
    goal = np.array([[0.5, 0.5, 0.5]])
    x = s.predictor.value(goal)[0] + 0.5 * (circle() - circle()[0])
    aside, _ = s.newton.settle(goal, x[:1], np.array([[0.9, 0.5, 0.1]]))
    pull = np.linalg.norm(s.newton.tangent(aside, 0.5 - aside))
    track = follow_targets(s, np.concatenate([x, x[1:], x[1:]]), aside[0])
    left = np.linalg.norm(s.newton.tangent(track.u[-1:], 0.5 - track.u[-1:]))
    assert pull > 0.1
    assert left < 0.5 * pull
