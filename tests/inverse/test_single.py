"""One query at a time: the same answers as the batch, without its cost, and where it gives way."""

from __future__ import annotations

import pickle
from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np
import pytest
from chains import FOLLOWED, MIXED
from hypothesis import given, settings
from hypothesis import strategies as st
from models import in_pixels, in_space, six, trained

import calib
from calib.arm.loading import arm_from_urdf
from calib.body.belief import Body, Second
from calib.body.planar_row import PlanarRow
from calib.body.spatial import structure_of
from calib.body.spatial_bound_row import SpatialBoundRow
from calib.body.spatial_row import SpatialRow
from calib.common.scale import TURN, Scale
from calib.errors import QueryError
from calib.maps.lattice import Lattice
from calib.maps.map import Map
from calib.maps.node_bounds import blend_nodes
from calib.maps.node_cells import NodeCells
from calib.use.correct import correct, correct_one

MODELS = {
    "exact": lambda: trained("two_link", 600, 10),
    "three": lambda: trained("three_link", 600, 5),
    "space": in_space,
    "pixels": in_pixels,
    "six": six,
}
SPATIAL = ["space", "pixels", "six"]


@cache
def model(kind):
    """Exact, with curves, with local models of a bump, with a joint of a full turn, or in space."""
    if kind in MODELS:
        return MODELS[kind]()
    rng = np.random.default_rng(0)
    lower, upper = np.array([0.0, 0.3]), np.array([1.5, 2.5])
    if kind == "turning":
        lower, upper = np.array([-np.pi, 0.3]), np.array([np.pi, 2.5])
    q = rng.uniform(lower, upper, (900, 2))
    bent = q + 2e-3 * np.sin(9 * q)
    a, b = bent.T
    x = np.stack(
        [0.3 * np.cos(a) + 0.25 * np.cos(a + b), 0.3 * np.sin(a) + 0.25 * np.sin(a + b)], axis=1
    )
    if kind == "bump":
        x[:, 0] += 5e-3 * np.exp(-(((q - [0.7, 1.4]) / 0.25) ** 2).sum(axis=1))
    x += rng.normal(scale=1e-5, size=x.shape)
    samples = calib.Samples(q, x, ("base", "elbow"), lower, upper, (True, True))
    return calib.train(samples, size=12)


def rows(m, n, beyond=0.0, seed=1):
    u = np.random.default_rng(seed).uniform(-beyond, 1 + beyond, (n, len(m.about.lower)))
    return m.about.lower + u * (m.about.upper - m.about.lower)


KINDS = ["exact", "curves", "bump", "turning"]


@pytest.mark.parametrize("kind", [*KINDS, *SPATIAL])
def test_one_position_and_its_bounds_are_those_of_the_batch(kind):
    m = model(kind)
    assert m.single is not None
    if kind == "bump":
        assert m.predictor.models.degree >= 0
    q = rows(m, 400 if kind in KINDS else 60, beyond=0.1 if kind in KINDS else 0.02)
    together = m.forward(q)
    one_by_one = np.array([m.forward(row) for row in q])
    np.testing.assert_allclose(one_by_one, together, rtol=0, atol=1e-12 * m.reach)
    for bound in (m.expected_error, m.model_error):
        np.testing.assert_allclose([bound(row) for row in q], bound(q), rtol=1e-10)


@pytest.mark.parametrize("kind", ["exact", "curves", "bump"])
def test_one_inverse_near_a_start_is_that_of_the_batch(kind):
    m = model(kind)
    q = rows(m, 150)
    x = m.forward(q)
    near = np.clip(q + np.random.default_rng(2).normal(scale=0.01, size=q.shape), *limits(m))
    quick = [m.single.inverse(a, b) for a, b in zip(x, near, strict=True)]
    assert sum(found is not None for found in quick) > 0.9 * len(quick)
    together = m.inverse(x, near)
    one_by_one = np.array([m.inverse(a, near=b) for a, b in zip(x, near, strict=True)])
    np.testing.assert_allclose(one_by_one, together, rtol=0, atol=1e-9)


@pytest.mark.parametrize("kind", ["three", *SPATIAL])
def test_one_inverse_of_many_joints_is_that_of_the_batch_or_nearer(kind):
    m = model(kind)
    _warm(m)
    q = 0.1 * (m.about.lower + m.about.upper) + 0.8 * rows(m, 40)
    x = m.forward(q)
    near = np.clip(q + np.random.default_rng(2).normal(scale=0.01, size=q.shape), *limits(m))
    quick = [m.single.inverse(a, b) for a, b in zip(x, near, strict=True)]
    taken = np.array([found is not None for found in quick])
    assert taken.mean() > 0.9
    one = np.array([found for found in quick if found is not None])
    np.testing.assert_allclose(m.forward(one), x[taken], rtol=0, atol=1e-12 * m.solver.extent)
    together, scale = m.inverse(x, near)[taken], m.motor.scale
    # redundant joints of a batch slide until their steps are a millionth of the range
    enough = one.shape[1] == x.shape[1]
    np.testing.assert_allclose(one, together, rtol=0, atol=1e-12 if enough else 2e-5)
    far, further = (np.linalg.norm((each - near[taken]) / scale.span, axis=1)
                    for each in (one, together))  # fmt: skip
    assert (far < further + 1e-12).all()


def test_joints_that_reach_a_target_are_the_answer_next_to_them():
    # links alone may propose another branch first
    m = model("space")
    q = rows(m, 2000)
    x = m.forward(q)
    known = np.isfinite(x).all(axis=1)
    assert known.mean() > 0.5
    np.testing.assert_allclose(m.inverse(x[known], near=q[known]), q[known], rtol=0, atol=1e-9)


def _warm(m):
    """Ask often enough that queries are compiled."""
    for _ in range(40):
        m.forward(rows(m, 1)[0])


@pytest.mark.parametrize("kind", SPATIAL)
def test_one_correction_in_space_is_that_of_the_batch(kind):
    m = model(kind)
    _warm(m)
    q = rows(m, 30) * 0.8 + 0.1 * (m.about.lower + m.about.upper)
    found = correct(m, q)
    kept = found.reachable & ~found.exceeded
    if kind == "six":
        kept &= found.angle < 1e-9  # the others keep positions alone
    quick = [correct_one(m, row) for row in q]
    assert kept.sum() > 15
    assert sum(quick[k] is not None for k in np.flatnonzero(kept)) > 0.9 * kept.sum()
    for k in np.flatnonzero(kept):
        if quick[k] is not None:
            np.testing.assert_allclose(quick[k], found.q[k], rtol=0, atol=1e-8)


@pytest.mark.parametrize("robot", ["six", "slide", "mimic"])
def test_a_bound_of_one_row_is_that_of_the_body(robot):
    """With any covariance, curves of some joints alone, a slide, and a joint that follows."""
    urdf = {"slide": MIXED, "mimic": FOLLOWED}.get(robot)
    arm = calib.load_arm("six_axis") if urdf is None else arm_from_urdf(urdf)
    structure = structure_of(arm, "similarity")
    rng = np.random.default_rng(0)

    def belief(share):
        beta = structure.neutral() + rng.normal(0, 1e-3, structure.size)
        active = np.flatnonzero(rng.random(structure.size) < share)
        active = np.setdiff1d(active, structure.groups["lens"])
        return beta, active, rng.normal(0, 1e-4, (len(active), 60))

    none, noise = np.zeros(3), np.full(3, 2e-3)
    other = Second(*belief(1.0), noise)
    body = Body(structure, *belief(0.7), noise, 1.3, none, 0.5 * noise, np.inf, 1.0, second=other)
    q = rng.uniform(arm.lower, arm.upper, (20, arm.dof))
    row = SpatialBoundRow(body)
    for counts in (False, True):
        one = [row.bound(each, noise=counts) for each in q.tolist()]
        np.testing.assert_allclose(one, body.bound(q, noise=counts), rtol=1e-10)


@pytest.mark.parametrize("view", ["base", "similarity", "pinhole"])
@pytest.mark.parametrize("robot", ["six", "slide", "mimic"])
def test_a_row_of_a_spatial_body_is_that_of_the_structure(robot, view):
    """With gravity, curves, a slide, and a joint that follows another one."""
    urdf = {"slide": MIXED, "mimic": FOLLOWED}.get(robot)
    arm = calib.load_arm("six_axis") if urdf is None else arm_from_urdf(urdf)
    structure = structure_of(arm, view)
    rng = np.random.default_rng(0)
    beta = structure.neutral() + rng.normal(0, 1e-3, structure.size)
    beta[structure.groups["view.rotation"]] = (-1.3, 0.2, 0.1)
    beta[structure.groups["view.shift"]] = (0.05, 0.1, 2.5)
    q = rng.uniform(arm.lower, arm.upper, (20, arm.dof))
    row = SpatialRow(structure, beta)
    x, slope = structure.predict_and_slope(q, beta)
    size = np.abs(x).max()
    np.testing.assert_allclose([row.predict(k) for k in q.tolist()], x, atol=1e-11 * size)
    sloped = [row.sloped(k) for k in q.tolist()]
    np.testing.assert_allclose([s[0] for s in sloped], x, atol=1e-11 * size)
    np.testing.assert_allclose([s[1] for s in sloped], slope, atol=1e-8 * size)


def test_threads_do_not_disturb_each_other():
    """Pinocchio writes each answer into its data, of which every thread has its own."""
    m = model("six")
    _warm(m)
    q = rows(m, 2)
    expected = [m.forward(row) for row in q]

    def ask(k):
        return all((m.forward(q[k]) == expected[k]).all() for _ in range(3000))

    with ThreadPoolExecutor(2) as pool:
        assert all(pool.map(ask, (0, 1)))


@pytest.mark.parametrize("kind", ["exact", "six"])
def test_a_warm_model_can_be_pickled(kind):
    m = model(kind)
    _warm(m)
    again = pickle.loads(pickle.dumps(m))
    q = rows(m, 5)
    np.testing.assert_array_equal(again.forward(q), m.forward(q))


def limits(m):
    return m.about.lower, m.about.upper


def test_far_starts_and_branches_are_left_to_the_batch():
    """The answer nearest to a start may be on another branch: the quick path must not guess."""
    m = trained("two_link_full", 1500, 14)
    q = rows(m, 200, seed=3)
    x = m.forward(q)
    near = rows(m, 200, seed=4)
    one_by_one = np.array([m.inverse(a, near=b) for a, b in zip(x, near, strict=True)])
    np.testing.assert_allclose(one_by_one, m.inverse(x, near), rtol=0, atol=1e-8)


def test_lists_tuples_and_integers_are_queries_too():
    m = model("exact")
    wanted = m.forward([[0.0, 1.0]])[0]
    for q in ([0, 1], (0.0, 1.0), np.array([0.0, 1.0]), np.array([0, 1])):
        np.testing.assert_allclose(m.forward(q), wanted, atol=1e-15)


@pytest.mark.parametrize("bad", [[0.5], [0.5, np.nan], ["a", "b"], [0.5, 1.0, 2.0], [np.inf, 1.0]])
def test_what_is_no_query_is_still_refused(bad):
    with pytest.raises(QueryError):
        model("exact").forward(bad)


def test_a_single_answer_is_an_array_that_can_be_written():
    m = model("exact")
    x = m.forward([0.5, 1.0])
    x += 1.0
    np.testing.assert_allclose(m.forward([0.5, 1.0]), x - 1.0)


def test_warming_up_changes_no_answer(tmp_path):
    m = model("curves")
    m.save(tmp_path / "m.calib")
    q = rows(m, 50)
    cold, warm = calib.load(tmp_path / "m.calib"), calib.load(tmp_path / "m.calib", warm=True)
    np.testing.assert_array_equal(warm.forward(q), cold.forward(q))
    assert warm.warm_up() is warm


@pytest.mark.parametrize("kind", KINDS)
def test_the_scalar_slope_is_that_of_the_structure(kind):
    m = model(kind)
    structure, beta = m.body.structure, m.body.beta.copy()
    rng = np.random.default_rng(5)
    for group, size in (("elastic", 1e-2), ("view.shear", 0.1), ("view.tilt", 0.1), ("lens", 0.05)):
        beta[structure.groups[group]] = size * rng.normal(size=len(structure.groups[group]))
    evaluate = PlanarRow.of(structure, beta).sloped
    q = rows(m, 50)
    found = [evaluate(row) for row in q.tolist()]
    x, slope = structure.predict(q, beta), structure.slope(q, beta)
    np.testing.assert_allclose([f[:2] for f in found], x, rtol=0, atol=1e-12 * m.reach)
    np.testing.assert_allclose([f[2:] for f in found], slope, rtol=0, atol=1e-9 * m.reach)


@settings(max_examples=60, deadline=None)
@given(
    st.integers(2, 7),
    st.sampled_from([(False, False), (True, False), (True, True)]),
    st.integers(0, 2**31),
)
def test_cells_find_the_nodes_that_a_search_finds(side, periodic, seed):
    rng = np.random.default_rng(seed)
    lattice = Lattice((side, side + 1))
    scale = Scale(np.zeros(2), np.full(2, TURN), np.array(periodic))
    units = lattice.positions() / (side + 1) + rng.uniform(0, 0.2, (lattice.size, 2))
    motor = Map(units, lattice, scale, np.zeros((0, 4)))
    cells = NodeCells.of(motor)
    if cells is None:
        assert any(periodic)
        return
    values = rng.random(lattice.size)
    u = rng.random((40, 2))
    found = [cells.blend(row, values.tolist()) for row in u.tolist()]
    np.testing.assert_allclose(found, blend_nodes(motor, values, u), rtol=1e-9)


def test_nodes_that_are_all_equally_far_share_the_say():
    lattice = Lattice((4, 4, 4))  # eight nodes around the middle, of which six speak
    box = Scale(np.zeros(3), np.ones(3), np.zeros(3, dtype=bool))
    motor = Map((lattice.positions() + 0.5) / 4, lattice, box, np.zeros((0, 4)))
    cells = NodeCells.of(motor)
    nodes, weights = cells.near([0.5, 0.5, 0.5])
    assert len(set(nodes)) == len(nodes) == 6
    assert weights == [1 / 6] * 6
    values = np.where(np.abs(motor.units - 0.5).max(axis=1) < 0.2, 3.0, np.nan).tolist()
    assert cells.blend([0.5, 0.5, 0.5], values) == pytest.approx(3.0)
