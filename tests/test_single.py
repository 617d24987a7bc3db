"""One query at a time: the same answers as the batch, without its cost, and where it gives way."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from models import trained

import calib
from calib.body.scalar_slope import compile_slope
from calib.common.scale import TURN, Scale
from calib.errors import QueryError
from calib.maps.lattice import Lattice
from calib.maps.map import Map
from calib.maps.node_bounds import blend_nodes
from calib.maps.node_cells import NodeCells


@cache
def model(kind):
    """Exact, with joint curves, with local models of a bump, or with a joint of a full turn."""
    if kind == "exact":
        return trained("two_link", 600, 10)
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
    u = np.random.default_rng(seed).uniform(-beyond, 1 + beyond, (n, 2))
    return m.about.lower + u * (m.about.upper - m.about.lower)


KINDS = ["exact", "curves", "bump", "turning"]


@pytest.mark.parametrize("kind", KINDS)
def test_one_position_and_its_bounds_are_those_of_the_batch(kind):
    m = model(kind)
    assert m.single is not None
    if kind == "bump":
        assert m.predictor.models.degree >= 0
    q = rows(m, 400, beyond=0.1)
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
    evaluate = compile_slope(structure, beta)
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
