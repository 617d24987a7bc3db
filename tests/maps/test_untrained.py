"""Networks that are not trained: a grid, random nodes, rows as nodes."""

import numpy as np
import pytest

import calib

ROWS = np.random.default_rng(0).normal(size=(500, 2))


def test_a_grid_is_the_middle_of_even_cells():
    network = calib.SOM((4, 5), "grid").fit(ROWS)
    assert sorted(set(network.units[:, 0].round(12))) == [0.125, 0.375, 0.625, 0.875]
    assert len(set(network.units[:, 1].round(12))) == 5


def test_rows_are_nodes_and_random_nodes_are_none():
    rows = calib.SOM((6, 6), "rows").fit(ROWS)
    gap = np.linalg.norm(rows.weights[:, None] - ROWS, axis=2).min(axis=1)
    assert gap.max() < 1e-4
    drawn = calib.SOM((6, 6), "random").fit(ROWS)
    assert ((drawn.units >= 0) & (drawn.units <= 1)).all()
    assert np.linalg.norm(drawn.weights[:, None] - ROWS, axis=2).min(axis=1).max() > 1e-3


@pytest.mark.parametrize("name", ["grid", "random", "rows"])
def test_the_same_seed_gives_the_same_nodes(name):
    a, b = (calib.SOM((5, 5), name, seed=3).fit(ROWS) for _ in range(2))
    assert a.units.tobytes() == b.units.tobytes()
    assert a.history.shape == (1, 4)


def test_a_model_learns_on_nodes_that_are_not_trained():
    samples = calib.babble(calib.load_arm("two_link"), 800, seed=0)
    model = calib.train(samples, size=8, map="grid", body="none")
    assert model.about.errors["linear"]["forward"]["distance"]["mean"] < 0.03
