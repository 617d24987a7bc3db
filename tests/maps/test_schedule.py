"""Schedules: radii that decay exponentially, and lattices that grow."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.maps.lattice import Lattice
from calib.maps.schedule import coarse_to_fine, decay, shrunk, total_work


@given(st.floats(0.1, 100), st.floats(0.01, 1), st.integers(2, 200))
def test_radii_start_and_end_as_told_and_fall_by_one_factor(start, share, n):
    values = decay(start, start * share, n)
    assert len(values) == n
    assert values[0] == pytest.approx(start)
    assert values[-1] == pytest.approx(start * share)
    np.testing.assert_allclose(values[1:] / values[:-1], share ** (1 / (n - 1)), rtol=1e-9)


def test_equation_4_is_this_decay():
    sigma, t, big_t = 5.0, np.arange(11), 4.0
    values = decay(sigma, sigma * np.exp(-10 / big_t), 11)
    np.testing.assert_allclose(values, sigma * np.exp(-t / big_t))


def test_one_epoch_has_the_last_radius():
    assert decay(5.0, 0.5, 1).tolist() == [0.5]


SHAPES = [(70, 70), (300, 300), (100, 40), (17, 17, 17), (2, 300), (400,), (5, 5), (2, 2), (2,) * 7]


@pytest.mark.parametrize("varying", [False, True])
@pytest.mark.parametrize("shape", SHAPES)
def test_lattices_grow_up_to_the_one_asked_for(shape, varying):
    stages = coarse_to_fine(Lattice(shape), varying=varying)
    sizes = [s.lattice.size for s in stages]
    assert sizes == sorted(sizes)
    if not varying:  # ten, and what rounding to nodes adds
        assert all(b < 15 * a for a, b in pairwise(sizes))
    assert stages[-1].lattice.shape == shape
    assert all(s.lattice.size < 200 for s in stages[:1])


@pytest.mark.parametrize("shape", SHAPES)
def test_lattices_are_ordered_and_finished_by_eq_2_and_refined_by_steps_in_between(shape):
    stages = coarse_to_fine(Lattice(shape))
    first, last = stages[0], stages[-1]
    assert first.step is None
    assert last.step is None
    for stage in stages[1:-1]:
        assert 0 < stage.step < 2  # 2 would overshoot
    for stage in (first, last):
        assert (np.diff(stage.sigma) < 0).all()
        assert stage.sigma[-1] < 1.0


def test_the_papers_lattice_grows_from_64_nodes_by_nine():
    shapes = [s.lattice.shape for s in coarse_to_fine(Lattice((70, 70)))]
    assert list(dict.fromkeys(shapes)) == [(8, 8), (24, 24), (70, 70)]


@pytest.mark.parametrize("shape", [(70, 70), (300, 300), (12, 12), (100, 40), (17, 17, 17), (400,)])
def test_a_varying_density_has_one_coarse_lattice_and_sets_out_from_a_fifth_of_the_side(shape):
    *coarse, final = coarse_to_fine(Lattice(shape), varying=True)
    assert len({stage.lattice.shape for stage in coarse}) == 1
    assert final.lattice.shape == shape
    assert final.sigma[0] == pytest.approx(max(max(shape) / 5, 3.0))
    assert final.sigma[-1] == pytest.approx(1.5)
    even = coarse_to_fine(Lattice(shape))[-1].sigma
    assert len(final.sigma) > len(even)
    assert final.sigma[0] > even[0]


@pytest.mark.parametrize(
    ("epochs", "sigma", "radii"),
    [(7, None, (35.0, 0.4, 7)), (None, (3.0, 2.0), (3.0, 2.0, 20)), (4, (9.0, 1.0), (9.0, 1.0, 4))],
)
def test_epochs_or_sigma_train_the_full_lattice_alone(epochs, sigma, radii):
    (stage,) = coarse_to_fine(Lattice((70, 70)), epochs, sigma)
    start, end, n = radii
    assert stage.lattice.shape == (70, 70)
    assert (len(stage.sigma), stage.sigma[0], stage.sigma[-1]) == (
        n,
        pytest.approx(start),
        pytest.approx(end),
    )


def test_work_counts_the_samples_that_each_stage_shows():
    stages = coarse_to_fine(Lattice((70, 70)))
    expected = sum(len(s.sigma) * min(s.samples, 5000) for s in stages)
    assert total_work(stages, 5000) == expected
    assert total_work(coarse_to_fine(Lattice((9, 9)), 3, None), 5000) == 15_000


@pytest.mark.parametrize(
    ("shape", "nodes", "expected"),
    [
        ((70, 70), 100, (10, 10)),
        ((20, 10), 50, (10, 5)),
        ((70, 70), 120, (11, 11)),
        ((16, 16, 16), 512, (8, 8, 8)),
        ((100, 2), 50, (50, 2)),
        ((30, 30), 1, (2, 2)),
    ],
)
def test_a_shrunk_lattice_keeps_its_proportions_and_has_about_so_many_nodes(shape, nodes, expected):
    assert shrunk(Lattice(shape), nodes).shape == expected
