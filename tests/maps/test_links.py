"""Links: activity, Oja's rule, its fixed point; local models: what they reproduce, and where."""

from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest
from conftest import lengths
from numpy.testing import assert_allclose, assert_array_equal
from scipy.sparse import csr_array
from small_maps import box, grid, network, points

from calib import SOM, Association
from calib.maps.blend import Blend
from calib.maps.links import WIRINGS, SparseRows, Wiring
from calib.maps.local_models import correction, correction_slope, exponents, fit, model_weights
from calib.maps.model_selection import SELECTION, follows_the_motion, select

BANDWIDTH = WIRINGS["oja"].bandwidth


def activity(nodes, u, bandwidth=BANDWIDTH, *, local=False):
    return Wiring(local=local, bandwidth=bandwidth).activity(nodes, u)


def link(a_motor, a_sensory, *, mutual=False):
    found = Wiring(mutual=mutual).link(a_motor, a_sensory)
    return csr_array((found.data, found.indices, found.indptr), found.shape)


@pytest.fixture(scope="module")
def pair():
    """Activities of two 3x3 maps for samples of a smooth function."""
    u = points(400)
    v = np.stack([u[:, 1] ** 1.3, 1 - u[:, 0]], axis=1)
    return activity(grid(3), u), activity(grid(3), v)


@pytest.mark.parametrize("bandwidth", [BANDWIDTH, 1.5])
def test_activity_is_equation_6_relative_to_the_winner(bandwidth):
    nodes, u = grid(3), points(20)
    square = ((u[:, None] - nodes.units[None]) ** 2).sum(axis=2)
    expected = np.exp(-square / (bandwidth * nodes.spacing) ** 2)
    expected /= expected.max(axis=1, keepdims=True)
    assert_allclose(activity(nodes, u, bandwidth).toarray(), expected, rtol=1e-9, atol=1e-300)


def test_a_local_bandwidth_is_that_of_each_node():
    even, u = grid(5), points(30)
    own, common = (activity(even, u, local=local).toarray() for local in (True, False))
    assert_allclose(own, common, rtol=1e-9, atol=1e-12)
    # nodes at 0, 1, 3: spacings 1, 1.5, 2
    uneven = network([[0.0], [1.0], [3.0]], (3,), box(False))
    a = activity(uneven, np.array([[1.2]]), 0.8, local=True).toarray()[0]
    z = (np.array([1.2, 0.2, 1.8]) / (0.8 * np.array([1.0, 1.5, 2.0]))) ** 2
    assert_allclose(a, np.exp(z.min() - z))


def test_links_are_the_fixed_point_of_ojas_rule_but_for_weak_ones(pair):
    a_motor, a_sensory = (a.toarray() for a in pair)
    dense = a_motor.T @ a_sensory / (a_sensory**2).sum(axis=0)
    links = link(*pair).toarray()
    kept = links > 0
    assert_allclose(links[kept], dense[kept], rtol=1e-6)
    weakest = np.minimum(dense.max(axis=1)[:, None], dense.max(axis=0)[None])
    assert (dense[~kept] < 0.02 * weakest[~kept] * 1.001).all()
    assert kept.any(axis=0).all()
    assert kept.any(axis=1).all()
    # a node that was hardly active has hardly a link
    one, faint = csr_array(np.array([[1.0]])), csr_array(np.array([[1e-3]]))
    assert link(one, faint).toarray()[0, 0] == pytest.approx(1e-3, rel=1e-3)
    assert link(one, one).toarray()[0, 0] == pytest.approx(1 - np.exp(-1), rel=1e-6)


def test_mutual_links_are_the_same_in_both_directions(pair):
    there = link(*pair, mutual=True).toarray()
    assert_allclose(there, link(*pair[::-1], mutual=True).toarray().T, rtol=1e-6)
    # the cosine between the activities of two nodes, where they have been active enough
    i, j = (a.toarray() / np.linalg.norm(a.toarray(), axis=0) for a in pair)
    kept = there > 0
    assert_allclose(there[kept], (i.T @ j)[kept], rtol=1e-6)


def line(places, periodic=False, d=1):
    """Nodes on a line in `d` dimensions, joined in a row."""
    units = np.zeros((len(places), d))
    units[:, 0] = places
    return network(units, (len(places),), box(*[periodic] * d))


def linked(motor, sensory, dense):
    links = csr_array(np.array(dense))
    rows = SparseRows(links.data, links.indices, links.indptr, links.shape)
    return Association(motor, sensory, rows)


FORKED = linked(line([0.0, 1.0]), line([0.1, 0.4, 0.9], d=2), [[0.2, 0.0, 0.7], [0.4, 0.5, 0.0]])
"""Two motor nodes, each linked to two of three sensory nodes."""
ONE_TO_ONE = linked(line([0.0, 0.5, 1.0]), line([0.0, 0.5, 1.0], d=2), np.eye(3))


def active(u, nodes):
    """Equation 6 of nodes that are evenly apart."""
    return np.exp(-((u - nodes) ** 2) / (BANDWIDTH * (nodes[1] - nodes[0])) ** 2)


def test_the_winner_answers_with_its_strongest_partner_and_activity_with_the_weighted_mean():
    said = FORKED.forward(np.array([[0.2], [0.7]]), "winner")
    assert said.tolist() == [[0.9, 0.0], [0.4, 0.0]]
    said = ONE_TO_ONE.inverses(np.array([[0.3, 0.0], [0.9, 0.0]]), np.full((2, 1), 0.5))["winner"]
    assert said.tolist() == [[0.5], [1.0]]
    # of the partners, through the links
    u = np.array([[0.3], [0.5]])
    shares = active(u, np.array([0.0, 1.0])) @ [[0.2, 0.0, 0.7], [0.4, 0.5, 0.0]]
    expected = shares @ [0.1, 0.4, 0.9] / shares.sum(axis=1)
    assert_allclose(FORKED.forward(u, "activity")[:, 0], expected, rtol=1e-12)
    nodes = np.array([0.0, 0.5, 1.0])
    a = active(0.25, nodes)
    said = ONE_TO_ONE.inverses(np.array([[0.25, 0.0]]), np.array([[0.5]]))["activity"]
    assert_allclose(said, [[a @ nodes / a.sum()]], rtol=1e-9)


@pytest.mark.parametrize(
    ("wishes", "winner", "activity"),
    [
        ([0.0, 0.45], 0.1, (0.1 * 1.0 + 0.125 * 0.5) / 1.5),
        ([0.55, 1.0], 0.9, 0.875 * 0.25 + 0.9 * 0.75),
    ],
)
def test_the_branch_near_the_wish_answers_and_branches_are_never_averaged(wishes, winner, activity):
    # motor nodes 4, 5 and 35, 36 of 41 reach one position, the middle one another
    links = np.zeros((41, 2))
    links[[4, 5, 35, 36], 0] = 1.0, 0.5, 0.25, 0.75
    links[20, 1] = 1.0
    branching = linked(line(np.linspace(0, 1, 41)), line([0.2, 0.8], d=2), links)
    said = branching.inverses(np.array([[0.2, 0.0]] * 2), np.array(wishes)[:, None])
    assert_allclose(said["winner"], winner, rtol=1e-6)
    assert_allclose(said["activity"], activity, rtol=1e-6)


def test_a_branch_across_the_seam_of_a_turn_is_one_branch():
    motor = line([0.05, 0.35, 0.65, 0.95], periodic=True)
    pair = linked(motor, line([0.2, 0.8], d=2), [[1.0, 0.0], [0.0, 1.0], [0.0, 0.0], [1.0, 0.0]])
    said = pair.inverses(np.array([[0.2, 0.0]]), np.array([[0.9]]))["activity"][0, 0]
    assert min(said % 1.0, -said % 1.0) < 0.05


@pytest.mark.parametrize("rule", ["batch", "online"])
def test_samples_at_one_place_leave_readouts_without_a_hole(rule):
    """All nodes of a map at one place have no spacing: nothing is divided by it."""
    q = points(200, seed=1)
    pair = SOM(4, rule=rule, epochs=1).fit_pair(q, np.ones_like(q))
    assert_allclose(pair.predict(q, "linear"), 1.0, atol=1e-9)
    v = pair.sensory.scale.to_unit(np.ones_like(q))
    for answer in pair.inverses(v, pair.motor.scale.to_unit(q)).values():
        assert np.isfinite(answer).all()


N, MOTOR = 6000, grid(20)
SLIP = np.where(np.arange(N)[:, None] < 40, 2e-3, 0.0)
"""What a tracker that slipped for forty rows adds: one stretch of the log alone shows it."""


def fitted(motor, u, x, degree, samples):
    shape = SELECTION.shapes[0]._replace(degree=degree, samples=samples)
    return fit(motor, np.arange(motor.size), u, x, shape)


def polynomial(degree, d=2, seed=0):
    """A random polynomial of two outputs and its gradient (n, 2, d)."""
    terms = exponents(d, degree)
    c = np.random.default_rng(seed).normal(size=(len(terms), 2))

    def value(u):
        return np.prod(u[:, None] ** terms, axis=2) @ c

    def slope(u):
        parts = []
        for k in range(d):
            lower = np.maximum(terms - np.eye(d, dtype=int)[k], 0)
            parts.append((np.prod(u[:, None] ** lower, axis=2) * terms[:, k]) @ c)
        return np.stack(parts, axis=2)

    return value, slope


@pytest.mark.parametrize(("d", "degree", "n"), [(2, 0, 30), (2, 1, 50), (2, 3, 80), (3, 2, 60)])
def test_polynomials_of_the_models_degree_are_reproduced_with_their_slopes(d, degree, n):
    value, slope = polynomial(degree, d)
    motor, u = grid({2: 18, 3: 7}[d], (False,) * d), points(3000, d=d)
    models = fitted(motor, u, value(u), degree, n)
    fresh = points(300, seed=1, d=d)
    blend = Blend(motor, fresh)
    said, tilt = correction(models, blend), correction_slope(models, blend)
    assert_allclose(said, value(fresh), atol=1e-6)
    assert_allclose(tilt, slope(fresh), atol=1e-4)


def test_models_join_at_the_seam_of_a_joint_that_turns_round():
    motor, u = grid(9, (True, False)), points(4000)

    def truth(u):
        angle = 2 * np.pi * u[:, 0]
        return np.stack([np.cos(angle) + u[:, 1], np.sin(angle)], axis=1)

    models = fitted(motor, u, truth(u), 2, 60)
    y = np.linspace(0.05, 0.95, 50)
    before, after = (np.stack([np.full(50, x), y], axis=1) for x in (1 - 1e-9, 1e-9))
    low, high = (correction(models, Blend(motor, p)) for p in (before, after))
    assert_allclose(low, high, atol=1e-6)
    assert_allclose(high, truth(after), atol=5e-3)


@pytest.mark.parametrize(("degree", "samples"), [(0, 30), (1, 50), (2, 60)])
def test_each_node_has_the_least_squares_fit_with_weights_that_end_at_its_radius(degree, samples):
    motor, u = grid(8), points(600)
    x = np.random.default_rng(1).normal(size=(600, 2))  # no polynomial: the weights tell
    models = fitted(motor, u, x, degree, samples)
    for node, found, radius in zip(motor.units, models.coefficients, models.radius, strict=True):
        z = (u - node) / radius
        square = np.sum(z**2, axis=1)
        assert_allclose(np.sort(square)[samples], 1.0)
        rows = np.argsort(square)[:samples]
        root = (1.0 - square[rows])[:, None]  # of the weight
        features = np.prod(z[rows, None] ** exponents(2, degree), axis=2)
        expected = np.linalg.lstsq(root * features, root * x[rows], rcond=None)[0]
        assert_allclose(found, expected, rtol=1e-5, atol=1e-6)


def test_nodes_count_smoothly_by_their_share_and_have_slopes_where_many_stand_on_a_point():
    """Of 12 rows a map's nodes stand on these: 0 over 0 stopped `train --body none`."""
    place = np.array([[0.1, 0.1]])
    blend = Blend(replace(grid(5), units=np.repeat(place, 25, axis=0)), place)
    assert_allclose(blend.weight, 0.25)
    assert_array_equal(blend.tilt(), 0.0)
    weight = np.array([[0.2, 0.8], [0.35, 0.65], [0.4, 0.6], [0.45, 0.55], [0.6, 0.4]])
    answers = model_weights(weight, np.tile([True, False], (5, 1)))[:, 0]
    ramp = 0.25**2 * (3 - 2 * 0.25)  # a quarter of the way from silent to full
    assert_allclose(answers, [0.0, ramp, 0.5, 1 - ramp, 1.0], atol=1e-12)


def test_slopes_are_finite_differences_of_the_blended_value():
    u = points(20_000)
    x = np.stack([np.sin(2 * u[:, 0]), u[:, 0] * u[:, 1]], axis=1)
    sensory = SOM((9, 9), "som").fit(x)
    v = sensory.scale.to_unit(x)
    linear = Association.learn(grid(9), u, sensory, v, WIRINGS["reciprocal"]).linear
    u, h = 0.05 + 0.9 * points(300, seed=3), 1e-6
    value, slope = linear.value_and_slope(u)
    assert_allclose(value, linear.value(u), rtol=0, atol=1e-15)
    for k in range(2):
        step = h * np.eye(2)[k]
        found = (linear.value(u + step) - linear.value(u - step)) / (2 * h)
        # but for a point or two whose nearest nodes change within the step
        assert np.quantile(np.abs(found - slope[:, :, k]), 0.99) < 1e-6


def chosen(u, added):
    """What is selected where a smooth part is right but for what is added to the joints."""
    right = Mock(value=lambda u: u)
    right.value_and_slope = lambda u: (u, np.broadcast_to(np.eye(2), (len(u), 2, 2)))
    return select(MOTOR, u, u + added, right, added)


def noise(n=N, size=1e-4, seed=7):
    return size * np.random.default_rng(seed).standard_normal((n, 2))


def inside(u):
    return lengths(u - 0.5) < 0.15


def bump(u):
    return 2e-3 * np.exp(-(((u - 0.5) / 0.08) ** 2).sum(axis=1))[:, None] * [1.0, -0.5]


@pytest.mark.parametrize(("size", "slip"), [(0.0, 0), (1e-4, 0), (1e-2, 0), (1e-4, SLIP)])
def test_noise_and_a_slip_leave_every_node_silent(size, slip):
    assert chosen(points(N), slip + noise(size=size))[0].models.degree == -1


def test_a_defect_is_mended_and_nothing_is_said_far_from_it():
    u, fresh = points(N), points(4000, 1)
    predictor, held = chosen(u, bump(u) + noise())
    models = predictor.models
    left = lengths(predictor.value(fresh) - fresh - bump(fresh))
    before = lengths(bump(fresh))
    near = inside(fresh)
    assert left[near].mean() < 0.3 * before[near].mean()
    assert left[~near].mean() < 3e-5
    has_model = (models.coefficients != 0.0).any(axis=(1, 2))
    assert not has_model[lengths(MOTOR.units - 0.5) > 0.35].any()
    # held-out residuals are those of the mended predictor
    mine = inside(u)
    assert lengths(held[mine]).mean() < 0.5 * before[near].mean()


def test_what_a_late_clock_leaves_is_not_learned():
    """Log of 20 ms late positions: local models made .27 mm into 2.3 mm."""
    t = np.arange(N) * 0.01
    u = 0.5 + 0.4 * np.stack([np.sin(0.7 * t) * np.cos(0.13 * t), np.sin(0.9 * t + 1)], axis=1)
    late = -0.02 * np.gradient(u, t, axis=0)
    assert follows_the_motion(u, late + noise())
    assert chosen(u, late + noise())[0].models.degree == -1
    assert not follows_the_motion(u, bump(u) + noise())


def test_a_gain_within_what_chance_brings_is_not_believed(monkeypatch):
    u = points(N)
    assert chosen(u, bump(u) + noise())[0].models.degree >= 0
    strict = replace(SELECTION, total_gain=1e9)
    monkeypatch.setattr("calib.maps.model_selection.SELECTION", strict)
    assert chosen(u, bump(u) + noise())[0].models.degree == -1
