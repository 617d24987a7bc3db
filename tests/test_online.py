"""The online rule in blocks: what is exact, what is near, and that it agrees with batch."""

import numpy as np
import pytest

import calib
from calib.maps.lattice import Lattice
from calib.maps.online import block_length, present, present_block, winners
from calib.paper.setting import Setting
from calib.paper.trial import Schedule, activity_errors, association


def uniform(n, seed=0, d=2):
    return np.random.default_rng(seed).random((n, d))


def both(lattice, w, x, sigma, rate):
    one, block = w.copy(), w.copy()
    n = len(x)
    present(one, lattice, x, np.full(n, sigma), np.full(n, rate))
    present_block(block, lattice, x, sigma, np.full(n, rate))
    return one, block


@pytest.mark.parametrize(("shape", "sigma"), [((20, 20), 1.0), ((20, 20), 6.0), ((6, 6, 6), 1.0)])
def test_at_a_small_rate_a_block_is_its_samples_one_after_the_other(shape, sigma):
    lattice = Lattice(shape)
    w = (lattice.positions() + 0.5) / shape[0]
    x = uniform(40, seed=1, d=len(shape))
    one, block = both(lattice, w, x, sigma, 1e-4)
    moved = np.abs(one - w).max()
    assert np.abs(one - block).max() < 0.01 * moved


def test_the_error_of_a_block_is_of_second_order():
    lattice = Lattice((20, 20))
    w = (lattice.positions() + 0.5) / 20
    x = uniform(60, seed=1)
    gaps = []
    for rate in (4e-3, 2e-3):
        one, block = both(lattice, w, x, 2.0, rate)
        gaps.append(np.abs(one - block).max())
    assert gaps[1] < 0.35 * gaps[0]


def test_a_block_of_one_sample_is_eq_2_up_to_the_square_of_the_rate():
    lattice, w, x = Lattice((8, 8)), uniform(64, seed=2), uniform(1, seed=3)
    one, block = both(lattice, w, x, 1.0, 0.01)
    np.testing.assert_allclose(block, one, atol=1e-4)


def test_no_node_leaves_the_hull_of_itself_and_the_samples_whatever_the_rate():
    lattice, w = Lattice((8, 8)), uniform(64, seed=2)
    x = 0.4 + 0.2 * uniform(30, seed=3)
    present_block(w, lattice, x, 2.0, np.full(30, 1e3))
    assert (w >= 0).all()
    assert (w <= 1).all()
    assert np.abs(w[winners(w, x)[1]] - 0.5).max() <= 0.1 + 1e-9


def test_blocks_are_single_samples_while_the_radius_is_wide():
    lattice = Lattice((70, 70))
    assert block_length(lattice, 35.0, 0.5) == 1
    assert block_length(lattice, 5.0, 0.07) > 50
    assert block_length(lattice, 1.0, 0.01) > block_length(lattice, 5.0, 0.07)


def test_winners_are_the_nearest_nodes_however_they_are_found():
    w = uniform(300, seed=4)
    for n in (10, 500):
        x = uniform(n, seed=5)
        distance, index = winners(w, x)
        gap = np.linalg.norm(x[:, None] - w[None], axis=2)
        assert (index == gap.argmin(axis=1)).all()
        np.testing.assert_allclose(distance, gap.min(axis=1), atol=1e-12)


def test_online_and_batch_are_equally_precise_on_the_papers_arm():
    """The same schedule, three seeds each: no further apart than seeds are, or a tenth."""
    found = {}
    for rule in ("batch", "online"):
        errors = []
        for seed in (0, 1, 2):
            log = calib.babble(calib.load_arm("two_link"), 3000, seed=seed)
            pair = association(log, "som", Schedule(8, 0.8, rule=rule), 12, seed)
            errors.append(activity_errors(pair, *Setting().validation(log, seed, 3000)).mean())
        found[rule] = np.array(errors)
    a, b = found["batch"], found["online"]
    assert abs(a.mean() - b.mean()) < max(2 * np.hypot(a.std(), b.std()), 0.1 * a.mean())


@pytest.mark.parametrize("side", [6, 8, 16])
def test_a_varying_density_helps_small_lattices_too(side):
    """At one strength for all sizes it tore a lattice of 8x8, and the map was useless."""
    q = calib.babble(calib.load_arm("two_link"), 3000, seed=0).q

    def none(visit: calib.Visit):
        return np.ones(len(visit.winners))

    plain, varying = (
        calib.SOM((side, side), network, rule="online").fit(q).history[-1, 2:]
        for network in (none, "vdsom")
    )
    assert varying[0] < plain[0]  # distance to the winner
    assert varying[1] < 0.02  # topographic error
