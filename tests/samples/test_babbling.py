"""Babbling covers the range, repeats with its seed and keeps its streams apart."""

import numpy as np
import pytest

from calib.errors import OptionError
from calib.samples.samples import babble


def test_babbling_stays_within_and_covers_the_range(arm):
    log = babble(arm, 4000)
    assert log.q.shape == (4000, 2)
    assert (log.q >= arm.lower).all()
    assert (log.q <= arm.upper).all()
    unit = (log.q - arm.lower) / (arm.upper - arm.lower)
    cells = np.histogram2d(*unit.T, bins=20, range=[[0, 1], [0, 1]])[0]
    assert cells.min() >= 1  # 10 a cell on average
    assert cells.std() == pytest.approx(np.sqrt(10), abs=0.6)  # Poisson
    np.testing.assert_allclose(log.x, arm.forward(log.q), atol=1e-15)


def test_the_seed_decides(arm):
    one, same, other = (babble(arm, 50, seed=s, noise=0.01) for s in (4, 4, 5))
    assert (one.q == same.q).all()
    assert (one.x == same.x).all()
    assert (one.q != other.q).any(axis=1).all()


def test_noise_changes_neither_joints_nor_the_outliers_rows(arm):
    plain = babble(arm, 300, seed=2)
    noisy = babble(arm, 300, seed=2, noise=0.01, changes=["sensor.outliers=0.1"])
    wrong = babble(arm, 300, seed=2, changes=["sensor.outliers=0.1"])
    assert (plain.q == noisy.q).all()
    hit = (plain.x != wrong.x).any(axis=1)
    assert 10 < hit.sum() < 60
    assert (noisy.x[hit] == wrong.x[hit]).all()


def test_ranges_narrow_the_babbling_and_the_samples_say_so(arm):
    log = babble(arm, 500, ranges={"elbow": (1.0, 1.5)})
    assert log.lower.tolist() == [0.0, 1.0]
    assert log.upper.tolist() == [arm.upper[0], 1.5]
    assert (log.q[:, 1] >= 1.0).all()
    assert (log.q[:, 1] <= 1.5).all()
    assert log.simulation.draw(100, np.random.default_rng(0))[:, 1].max() <= 1.5
    assert log.arm.lower.tolist() == [0.0, 1.0]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"n": 0}, "samples is 0, expected a whole number, 1 to"),
        ({"n": 10_000_001}, "10,000,000"),
        ({"n": True}, "samples is True, expected a whole number"),
        ({"seed": -1}, "seed is -1"),
        ({"noise": -0.1}, "noise is -0.1"),
        ({"noise": float("nan")}, "noise is nan"),
        ({"ranges": {"elbow": (0.0, 1.0)}}, "elbow"),  # below the limit of 15 degrees
        ({"ranges": {"knee": (1.0, 1.5)}}, "knee"),
    ],
)
def test_impossible_arguments_are_refused_in_one_line(arm, arguments, message):
    with pytest.raises(OptionError, match=message) as caught:
        babble(arm, **{"n": 10, **arguments})
    assert "\n" not in str(caught.value)
