"""Each node its own complexity: a defect is followed and spoils nothing elsewhere."""

from dataclasses import replace

import numpy as np
import pytest

from calib.body.basis import exponents
from calib.common.scale import Scale
from calib.maps import local_models as local
from calib.maps.lattice import Lattice
from calib.maps.local_models import near_rows, speaking
from calib.maps.map import Map
from calib.maps.model_selection import SmoothCandidate, blocks, select
from calib.maps.node_choice import fit_each

SCALE = Scale(np.zeros(2), np.ones(2), np.zeros(2, dtype=bool))
NOISE = 2e-4
N = 6000


class Flat:
    """A smooth part that says zero."""

    terms = 1

    def value(self, u):
        return np.zeros((len(u), 2))

    def value_and_slope(self, u):
        return self.value(u), np.zeros((len(u), 2, 2))


def grid(n):
    lattice = Lattice((n, n))
    return Map((lattice.positions() + 0.5) / n, lattice, SCALE, np.zeros((0, 4)))


def degrees_of(models):
    """Degree of each node's own polynomial of two joints, -1 for none."""
    total = exponents(2, max(models.degree, 0)).sum(axis=1)
    return np.where((models.coefficients != 0.0).any(axis=2), total, -1).max(axis=1)


def rows(n=N, seed=0):
    rng = np.random.default_rng(seed)
    return rng.random((n, 2)), rng.normal(scale=NOISE, size=(n, 2))


def inside(u):
    return (u > 0.3).all(axis=1) & (u < 0.6).all(axis=1)


def defect(u):
    a, b = (u.T - 0.3) * np.pi / 0.3
    height = np.where(inside(u), 5e-3 * np.sin(a) ** 2 * np.sin(b) ** 2, 0.0)
    return np.stack([height, -height], axis=1)


def chosen(u, x, motor):
    candidate = SmoothCandidate(Flat(), x, [x] * len(blocks(len(u))))
    return select(motor, u, [candidate])


@pytest.fixture(scope="module")
def defective():
    u, noise = rows()
    motor = grid(15)
    return chosen(u, defect(u) + noise, motor), motor


def test_nodes_in_the_defect_have_models_and_the_others_have_none(defective):
    selected, motor = defective
    degree = degrees_of(selected.predictor.models)
    middle = (np.abs(motor.units - 0.45) < 0.1).all(axis=1)
    far = (np.abs(motor.units - 0.45) > 0.3).any(axis=1)
    assert (degree[middle] >= 0).all()
    assert (degree[far] == -1).all()


def test_no_node_is_silent_in_the_midst_of_a_defect_however_few_its_rows_are():
    u, noise = rows(800)
    u = 0.2 + 0.5 * u  # four rows for each node
    motor = replace(grid(14), units=0.2 + 0.5 * grid(14).units)
    degree = degrees_of(chosen(u, defect(u) + noise, motor).predictor.models)
    middle = (np.abs(motor.units - 0.45) < 0.1).all(axis=1)
    assert (degree[middle] >= 0).all()


def test_the_defect_is_followed_and_nothing_is_said_far_from_it(defective):
    selected, _ = defective
    fresh, _ = rows(seed=1)
    gap = np.linalg.norm(selected.predictor.value(fresh) - defect(fresh), axis=1)
    assert (
        gap[inside(fresh)].mean()
        < 0.15 * np.linalg.norm(defect(fresh)[inside(fresh)], axis=1).mean()
    )
    far = (np.abs(fresh - 0.45) > 0.35).any(axis=1)
    assert gap[far].max() == 0.0


def test_held_out_errors_are_those_of_the_mixed_models(defective):
    """Rows were unseen: what remains is at least the noise, and less than the defect."""
    selected, _ = defective
    noise = NOISE * np.sqrt(np.pi / 2)
    assert noise * 0.95 < selected.errors.mean() < 1.5 * noise


def test_noise_alone_leaves_every_node_without_a_model():
    u, noise = rows()
    assert chosen(u, noise, grid(12)).predictor.models.degree == -1


def test_each_shape_is_fitted_as_if_alone():
    u, noise = rows(2000)
    motor, shapes = grid(6), [(0, 30), (2, 60)]
    choice = np.arange(36) % 3 - 1
    mixed = fit_each(motor, u, noise, shapes, choice)
    assert degrees_of(mixed).tolist() == [(-1, 0, 2)[k + 1] for k in choice]
    for k, (degree, samples) in enumerate(shapes):
        alone = local.fit(motor.units, u, noise, SCALE, degree, samples)
        terms = alone.coefficients.shape[1]
        mine = choice == k
        np.testing.assert_allclose(mixed.coefficients[mine, :terms], alone.coefficients[mine])
        assert (mixed.coefficients[mine, terms:] == 0).all()


def test_nodes_far_from_all_rows_say_nothing():
    u, noise = rows(3000)
    kept = u[:, 0] < 0.5
    motor = grid(20)
    share = near_rows(motor, u[kept])
    assert (share[motor.units[:, 0] < 0.5] == 1).all()
    assert (share[motor.units[:, 0] > 0.7] == 0).all()
    shape = fit_each(motor, u[kept], 1 + noise[kept], [(1, 50)], np.zeros(400, dtype=int))
    far = np.array([[0.9, 0.5]])
    assert (local.predict(shape, motor, far)[0] == 0).all()


def test_on_an_even_lattice_every_point_is_spoken_for_in_full():
    motor = grid(9)
    index, weight, gap = speaking(motor, rows(500)[0])
    np.testing.assert_allclose(weight.sum(axis=1), 1.0)
    assert index.shape == weight.shape == gap.shape[:2]


def test_a_dense_cluster_does_not_speak_for_points_far_from_it():
    nodes = np.concatenate([0.5 + 0.01 * grid(5).units, [[0.1, 0.1], [0.9, 0.9]]])
    pairs = [(a, b) for a in range(25) for b in range(a + 1, 25) if b - a in (1, 5)]
    from calib.maps.graph import Graph

    motor = Map(nodes, Graph(27, np.array([*pairs, (25, 26)])), SCALE, np.zeros((0, 4)))
    _, weight, _ = speaking(motor, np.array([[0.505, 0.505], [0.6, 0.6]]))
    assert weight[0].sum() == pytest.approx(1.0)
    assert weight[1].sum() == 0.0
