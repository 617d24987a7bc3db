"""Growing neural gas: ages, insertion, removal, growth, and what a gain does to it."""

import numpy as np
import pytest

import calib
from calib.maps import gng
from calib.maps.gng import Gas, Pace, insert, present_gng
from calib.maps.graph import Graph
from calib.maps.map import search_tree


def uniform(n, seed=0):
    return np.random.default_rng(seed).random((n, 2))


def gas(weights, pairs, age=None, error=None):
    weights = np.array(weights, dtype=float)
    pairs = np.array(pairs, dtype=np.intp).reshape(-1, 2)
    age = np.zeros(len(pairs)) if age is None else np.array(age, dtype=float)
    error = np.zeros(len(weights)) if error is None else np.array(error, dtype=float)
    return Gas(weights, error, pairs, age)


def edges(g):
    return {tuple(p): a for p, a in zip(g.pairs.tolist(), g.age.tolist(), strict=True)}


def test_one_sample_does_what_the_source_says():
    g = gas([[0.0], [1.0], [3.0]], [[0, 1], [0, 2]], age=[4, 7])
    present_gng(g, np.array([[0.2]]), Pace(winner=0.1, neighbour=0.01, decay=0.9))
    # node 0 wins, node 1 is second: the winner moves by epsilon_b, both neighbours by
    # epsilon_n, the edge to the second is renewed, the other edge of the winner ages
    np.testing.assert_allclose(g.weights[:, 0], [0.02, 1 - 0.008, 3 - 0.028], atol=1e-12)
    assert edges(g) == {(0, 1): 0.0, (0, 2): 8.0}
    np.testing.assert_allclose(g.error, [0.9 * 0.04, 0.0, 0.0])


def test_edges_of_the_winner_alone_grow_older():
    g = gas([[0.0], [1.0], [5.0], [6.0]], [[0, 1], [2, 3]], age=[3, 3])
    present_gng(g, np.array([[0.1]]), Pace())
    assert edges(g) == {(0, 1): 0.0, (2, 3): 3.0}


def test_the_two_nearest_nodes_are_joined():
    g = gas([[0.0], [1.0], [5.0]], [[0, 2], [1, 2]])
    present_gng(g, np.array([[0.4]]), Pace())
    assert (0, 1) in edges(g)


def test_an_edge_beyond_the_oldest_age_is_removed_and_a_node_without_edges_too():
    g = gas([[0.0], [1.0], [5.0]], [[0, 1], [0, 2]], age=[0, 50])
    present_gng(g, np.array([[0.1]]), Pace(oldest=50))
    assert edges(g) == {(0, 1): 0.0}
    assert len(g.weights) == len(g.error) == 2


def test_a_node_is_inserted_between_the_worst_and_its_worst_neighbour():
    g = gas([[0.0], [1.0], [3.0], [9.0]], [[0, 1], [1, 2], [2, 3]], error=[1, 8, 4, 2])
    new = insert(g, Pace(shared=0.5))
    assert g.weights[new] == pytest.approx(2.0)
    assert set(edges(g)) == {(0, 1), (2, 3), (1, new), (2, new)}
    np.testing.assert_allclose(g.error, [1, 4, 2, 2, 4])


def test_a_gas_grows_to_its_size_and_follows_its_samples():
    x = uniform(3000)
    network = calib.SOM((10, 10), "gng").fit(x)
    assert 95 <= network.size <= 100
    assert network.quantization_error(x) < 1.15 * 0.377 / 10
    assert network.topographic_error(x) < 0.05
    assert network.history[0, 0] < network.history[-1, 0]


def test_a_gas_leaves_a_hole_empty_that_a_lattice_crosses():
    x = uniform(6000)
    x = x[np.linalg.norm(x - 0.5, axis=1) > 0.3]
    gap = {}
    for name in ("som", "gng"):
        w = calib.SOM((10, 10), name).fit(x).weights
        gap[name] = int(np.sum(np.linalg.norm(w - 0.5, axis=1) < 0.22))
    assert gap["gng"] == 0 < gap["som"]


def test_a_gain_decides_where_nodes_are_inserted():
    x = uniform(3000)

    def right(visit):
        return np.where(visit.weights[visit.winners, 0] > 0.5, 30.0, 1.0)

    grown = Gas(x[:2].copy(), np.zeros(2))
    pace = Pace(decay=0.999)
    for k in range(0, 3000, 10):
        present_gng(grown, x[k : k + 10], pace, right)
        if k % 50 == 0:
            insert(grown, pace)
    assert np.mean(grown.weights[:, 0] > 0.5) > 0.6


def test_a_graph_answers_what_a_lattice_does():
    graph = Graph(4, np.array([[0, 1], [1, 2], [1, 3]]))
    assert graph.shape == (4,)
    assert graph.degree.tolist() == [1, 3, 1, 1]
    i, j = np.array([0, 1, 3, 2]), np.array([1, 0, 2, 2])
    assert graph.adjacent(i, j).tolist() == [True, True, False, True]


def test_the_same_seed_gives_the_same_gas():
    a, b = (calib.SOM((6, 6), "gng:error", seed=4).fit(uniform(500)) for _ in range(2))
    assert a.units.tobytes() == b.units.tobytes()
    assert (a.edges == b.edges).all()


def test_a_model_of_gases_survives_a_file(tmp_path):
    log = calib.babble(calib.load_arm("two_link"), 1500, seed=0)
    model = calib.train(log, size=10, map="gng")
    model.save(tmp_path / "m.calib")
    again = calib.load(tmp_path / "m.calib")
    assert (again.motor.edges == model.motor.edges).all()
    assert again.motor.lattice.shape == (model.motor.size,)
    assert model.about.errors["activity"]["forward"]["distance"]["mean"] < 0.03
    q = log.q[:5]
    np.testing.assert_array_equal(again.forward(q), model.forward(q))


def test_learning_shows_every_sample_once_per_pass_in_short_blocks_at_an_even_pace(monkeypatch):
    shown, x = [], uniform(1000)

    def spy(gas, block, pace, gain, progress):
        shown.append((block, len(gas.weights), pace, gain, progress))
        return present_gng(gas, block, pace, gain, progress)

    def gain(visit):
        return np.ones(len(visit.winners))

    monkeypatch.setattr(gng, "present_gng", spy)
    epochs = list(gng.learn_gng(x, 150, gain, 4, np.random.default_rng(0)))
    blocks, sizes, paces, gains, progress = zip(*shown, strict=True)
    # each pass holds all samples, in another order
    order = np.concatenate(blocks).reshape(4, 1000, 2)
    for rows in order:
        np.testing.assert_array_equal(np.sort(rows[:, 0]), np.sort(x[:, 0]))
    assert not np.array_equal(order[0], order[1])
    # a block is at most a tenth of the nodes long, and at least one sample
    lengths = np.array([len(b) for b in blocks])
    assert (lengths <= np.maximum(1, np.array(sizes) // 10)).all()
    assert lengths.max() == 15
    # 60 % of the samples bring all nodes, at an even pace
    done = np.cumsum(lengths)
    np.testing.assert_allclose(progress, np.minimum(1.0, done / (0.6 * 4000)))
    assert abs(sizes[int(np.searchsorted(done, 1200))] - 75) <= 2
    assert len(epochs[-1].weights) <= 150
    # errors are remembered over twice as many samples as there will be nodes
    assert {pace.decay for pace in paces} == {1 - 1 / 300}
    assert set(gains) == {gain}
    assert [epoch.shown for epoch in epochs] == [1000] * 4
    small = gng.learn_gng(x, 5, None, 1, np.random.default_rng(0))
    shown.clear()
    assert len(next(small).weights) == 5
    assert {pace.decay for _, _, pace, _, _ in shown} == {1 - 1 / 200}


def test_a_small_gas_is_shown_a_few_samples_per_node_and_is_as_good(monkeypatch):
    u, fresh = (np.random.default_rng(seed).random((n, 2)) for seed, n in ((0, 3000), (1, 4000)))
    few = list(gng.learn_gng(u, 9, None, 10, np.random.default_rng(2)))
    assert {epoch.shown for epoch in few} == {gng.samples_shown(3000, 9)} == {135}
    monkeypatch.setattr(gng, "_PER_NODE", 10**9)
    many = list(gng.learn_gng(u, 9, None, 2, np.random.default_rng(2)))
    assert {epoch.shown for epoch in many} == {3000}
    miss = [search_tree(run[-1].weights).query(fresh)[0].mean() for run in (few, many)]
    assert miss[0] < 1.1 * miss[1]


def test_an_epoch_tells_the_mean_distance_to_the_winners(monkeypatch):
    x, told = uniform(300), []

    def spy(gas, block, *rest):
        told.append(np.linalg.norm(block[:, None] - gas.weights, axis=2).min(axis=1).sum())
        return present_gng(gas, block, *rest)

    monkeypatch.setattr(gng, "present_gng", spy)
    (epoch,) = gng.learn_gng(x, 20, None, 1, np.random.default_rng(0))
    assert epoch.error == pytest.approx(sum(told) / 300)
    assert epoch.sigma == 0.0
    assert epoch.lattice.size == len(epoch.weights)


def test_a_node_without_an_edge_hands_its_turn_to_the_worst_edge():
    weights = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [5.0, 5.0]])
    g = Gas(weights, np.array([1.0, 2.0, 4.0, 9.0]), np.array([[0, 1], [0, 2]]), np.zeros(2))
    new = insert(g, Pace())
    assert g.error[3] == 0.0
    np.testing.assert_allclose(g.weights[new], [0.0, 0.5])
    assert set(edges(g)) == {(0, 1), (0, new), (2, new)}
