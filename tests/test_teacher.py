"""The teacher of a small log: what it says, how it errs, what it imagines."""

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from calib.body import gp
from calib.body.basis import Basis
from calib.body.teacher import IMAGINED, Teacher, learn_teacher
from calib.body.trend import Trend
from calib.common.scale import TURN, Scale

SPAN = np.array([1.5, 2.3])
SCALE = Scale(np.zeros(2), SPAN, np.zeros(2, dtype=bool))


@pytest.fixture(autouse=True)
def one_thread():
    """As in training, where sums must not depend on threads."""
    with threadpool_limits(1, user_api="blas"):
        yield


def points(n, seed=0):
    return np.random.default_rng(seed).random((n, 2))


def arm(u):
    a, b = (u * SPAN).T
    x = 0.3 * np.cos(a) + 0.25 * np.cos(a + b)
    return np.stack([x, 0.3 * np.sin(a) + 0.25 * np.sin(a + b)], axis=1)


def sagging(u):
    """An arm whose links bend: no rigid chain."""
    return arm(u) + 4e-3 * np.exp(-8 * ((u - 0.4) ** 2).sum(axis=1))[:, None] * [0.3, -1]


def learn(u, x, scale=SCALE, seed=0):
    return learn_teacher(scale, (True, True), u, x, np.random.default_rng(seed))


@pytest.mark.parametrize("rows", [30, 100])
def test_from_a_few_exact_rows_it_knows_the_arm(rows):
    u = points(rows)
    teacher = learn(u, arm(u))
    fresh = points(500, seed=1)
    assert np.linalg.norm(teacher.value(fresh) - arm(fresh), axis=1).max() < 1e-6
    assert teacher.process is None


def test_what_the_trend_cannot_follow_is_left_to_a_gaussian_process():
    u = points(300)
    teacher = learn(u, sagging(u))
    fresh = 0.05 + 0.9 * points(500, seed=1)
    gap = np.linalg.norm(teacher.value(fresh) - sagging(fresh), axis=1)
    assert gap.mean() < 5e-5


def test_a_teacher_says_its_trend_plus_its_process():
    u, fresh = points(60), points(100, seed=1)
    rest = 1e-2 * np.stack([np.sin(7 * u[:, 0]), np.cos(5 * u[:, 1])], axis=1)
    trend = Trend(Basis((0.0, 0.0), 1), np.array([[1.0, 2.0], [3.0, 0.0], [0.0, -1.0]]))
    process, _ = gp.fit(u, rest, SCALE, np.random.default_rng(0))
    alone = Teacher(trend, None, u, np.zeros(60), SCALE)
    both = Teacher(trend, process, u, np.zeros(60), SCALE)
    np.testing.assert_array_equal(alone.value(fresh), trend.value(fresh))
    assert alone.deviation(fresh) is None
    np.testing.assert_array_equal(both.value(fresh), trend.value(fresh) + process.value(fresh))
    np.testing.assert_allclose(both.value(u), trend.value(u) + rest, atol=1e-4)
    np.testing.assert_array_equal(both.deviation(fresh), process.deviation(fresh))


def test_noise_is_averaged_out():
    u = points(300)
    x = arm(u) + np.random.default_rng(1).normal(scale=1e-3, size=(300, 2))
    fresh = points(500, seed=2)
    gap = np.linalg.norm(learn(u, x).value(fresh) - arm(fresh), axis=1)
    assert gap.mean() < 4e-4


def test_its_errors_are_those_of_rows_unseen():
    u = points(300)
    x = arm(u) + np.random.default_rng(1).normal(scale=1e-3, size=(300, 2))
    teacher = learn(u, x)
    assert teacher.errors.shape == (300,)
    seen = np.linalg.norm(teacher.value(u) - x, axis=1)
    assert teacher.errors.mean() > seen.mean()
    assert teacher.errors.mean() == pytest.approx(1e-3 * np.sqrt(np.pi / 2), rel=0.15)


def test_it_imagines_only_near_rows_and_repeats_the_rows():
    u = points(150) * [0.4, 1.0]  # the log covers less than half of the first joint
    teacher = learn(u, arm(u))
    imagined = teacher.imagine(np.random.default_rng(0))
    assert len(imagined) == IMAGINED
    assert (imagined[:150] == u).all()
    assert imagined[:, 0].max() < 0.65
    assert (imagined >= 0).all()
    assert (imagined <= 1).all()
    covered = np.histogram2d(*imagined.T, bins=5, range=[[0, 0.4], [0, 1]])[0]
    assert (covered > 0).all()


def test_near_goes_round_a_whole_turn():
    scale = Scale(np.zeros(2), np.array([TURN, 2.3]), np.array([True, False]))
    u = points(200)
    u[:, 0] = (0.85 + 0.3 * u[:, 0]) % 1.0
    teacher = learn_teacher(scale, (True, True), u, u, np.random.default_rng(0))
    drawn = teacher.imagine(np.random.default_rng(0))[200:, 0]
    assert ((drawn > 0.65) | (drawn < 0.35)).all()
    assert (drawn > 0.99).any()
    assert (drawn < 0.01).any()


def test_the_same_random_numbers_give_the_same_teacher():
    u = points(80)
    x = sagging(u) + np.random.default_rng(1).normal(scale=1e-4, size=(80, 2))
    a, b = learn(u, x), learn(u, x)
    assert a.value(u).tobytes() == b.value(u).tobytes()
    assert (
        a.imagine(np.random.default_rng(3)).tobytes()
        == b.imagine(np.random.default_rng(3)).tobytes()
    )
