"""What moves while a log is taken is told by `train`, and what is no arm is not taken for it."""

from dataclasses import replace

import numpy as np
import pytest

import calib

N = 200


def measured(moved=0.0, bent=0.0, path=False, seed=0):
    """A log of a planar arm, its second half moved [m], and positions that no chain explains."""
    arm = calib.load_arm("two_link")
    log = replace(calib.babble(arm, N, seed=seed, noise=5e-4), simulation=None)
    if path:
        u = np.linspace(0.0, 1.0, N)[:, None]
        q = log.lower + (log.upper - log.lower) * (0.5 + 0.45 * np.sin(u * (8.0, 11.0) + (0, 1)))
        log = replace(log, q=q, x=arm.forward(q) + log.x - arm.forward(log.q))
    wave = np.stack([np.sin(12.0 * log.x[:, 1]), np.cos(9.0 * log.x[:, 0] * log.x[:, 1])], axis=1)
    later = np.arange(N)[:, None] >= N // 2
    return replace(log, x=log.x + later * (moved, 0.0) + bent * wave)


def told(log):
    return [note for note in calib.train(log, size=6).about.notes if "moved while" in note]


@pytest.mark.parametrize("moved", [0.003, 0.02])
def test_a_sensor_that_moves_half_way_is_told_with_its_row_and_size(moved):
    (note,) = told(measured(moved))
    row, size = (float(note.split(word)[1].split()[0]) for word in ("about ", "on are "))
    assert abs(row - N // 2) <= 0.1 * N
    assert size == pytest.approx(1e3 * moved, rel=0.2)


@pytest.mark.parametrize("how", [{}, {"bent": 0.01}, {"bent": 0.01, "path": True}])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_noise_and_what_is_no_arm_are_not_told_as_moved(how, seed):
    assert not told(measured(seed=seed, **how))


@pytest.mark.parametrize("times", [3.0, 6.0, 20.0])
def test_noise_that_grows_is_not_told_as_moved(times):
    log = measured()
    noise = np.random.default_rng(1).normal(0.0, 5e-4, log.x.shape)
    later = np.arange(N)[:, None] >= N // 2
    assert not told(replace(log, x=log.x + later * times * noise))
