"""Which nodes carry local models: defects ask for some, noise and a late clock for none."""

from dataclasses import replace

import numpy as np
import pytest
from small_maps import grid, points

from calib.maps.model_selection import SELECTION, follows_the_motion, select

N = 6000
MOTOR = grid(20)


class Known:
    """A smooth part that is right but for what the tests add: positions are the joints."""

    def value(self, u):
        return u

    def value_and_slope(self, u):
        return u, np.broadcast_to(np.eye(2), (len(u), 2, 2))


def chosen(u, added):
    return select(MOTOR, u, u + added, Known(), added)


def noise(n=N, size=1e-4, seed=7):
    return size * np.random.default_rng(seed).standard_normal((n, 2))


def inside(u):
    return np.linalg.norm(u - 0.5, axis=1) < 0.15


def bump(u):
    return 2e-3 * np.exp(-(((u - 0.5) / 0.08) ** 2).sum(axis=1))[:, None] * [1.0, -0.5]


@pytest.mark.parametrize("size", [0.0, 1e-4, 1e-2])
def test_noise_leaves_every_node_silent(size):
    assert chosen(points(N), noise(size=size))[0].models.degree == -1


def test_a_defect_is_mended_and_nothing_is_said_far_from_it():
    u, fresh = points(N), points(4000, 1)
    predictor, held = chosen(u, bump(u) + noise())
    models = predictor.models
    left = np.linalg.norm(predictor.value(fresh) - fresh - bump(fresh), axis=1)
    before = np.linalg.norm(bump(fresh), axis=1)
    near = inside(fresh)
    assert left[near].mean() < 0.3 * before[near].mean()
    assert left[~near].mean() < 3e-5
    talks = (models.coefficients != 0.0).any(axis=(1, 2))
    assert not talks[np.linalg.norm(MOTOR.units - 0.5, axis=1) > 0.35].any()
    # held-out residuals are those of the mended predictor
    mine = inside(u)
    assert np.linalg.norm(held[mine], axis=1).mean() < 0.5 * before[near].mean()


def test_what_a_late_clock_leaves_is_not_learned():
    """Log of 20 ms late positions: local models made .27 mm into 2.3 mm."""
    t = np.arange(N) * 0.01
    u = 0.5 + 0.4 * np.stack([np.sin(0.7 * t) * np.cos(0.13 * t), np.sin(0.9 * t + 1)], axis=1)
    late = -0.02 * np.gradient(u, t, axis=0)
    assert follows_the_motion(u, late + noise())
    assert chosen(u, late + noise())[0].models.degree == -1
    assert not follows_the_motion(u, bump(u) + noise())


def test_a_defect_that_one_stretch_of_the_log_alone_shows_is_not_believed():
    u = points(N)
    once = np.zeros((N, 2))
    once[:40] = 2e-3  # the tracker slipped for forty rows
    assert chosen(u, once + noise())[0].models.degree == -1


def test_a_gain_within_what_chance_brings_is_not_believed(monkeypatch):
    u = points(N)
    assert chosen(u, bump(u) + noise())[0].models.degree >= 0
    strict = replace(SELECTION, total_gain=1e9)
    monkeypatch.setattr("calib.maps.model_selection.SELECTION", strict)
    assert chosen(u, bump(u) + noise())[0].models.degree == -1
