"""Planes: the axis rule, the fit, and the way there and back."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib import LogError
from calib.arm.plane import fit_plane, plane_of

ROOT_HALF = np.sqrt(0.5)


def lifted(plane, coordinates):
    return plane.origin + coordinates @ plane.basis[:2]


numbers = st.floats(-1, 1)
normals = st.tuples(numbers, numbers, numbers).filter(lambda v: np.linalg.norm(v) > 0.1)


@pytest.mark.parametrize(
    ("normal", "x", "y"),
    [
        ([0, 0, 1], [1, 0, 0], [0, 1, 0]),
        ([0, 0, -3], [1, 0, 0], [0, 1, 0]),
        ([0, 1, 0], [1, 0, 0], [0, 0, 1]),
        ([1, 0, 0], [0, 1, 0], [0, 0, 1]),
        # x and y lie at 45 deg from the normal, and are one line in the plane: z is next
        ([1, 1, 0], [ROOT_HALF, -ROOT_HALF, 0], [0, 0, 1]),
        ([1, 0, 1], [ROOT_HALF, 0, -ROOT_HALF], [0, 1, 0]),
        # z is nearest to this normal: x and y, tilted
        ([0, -0.5, np.sqrt(0.75)], [1, 0, 0], [0, np.sqrt(0.75), 0.5]),
    ],
)
def test_axes_are_the_first_two_root_axes_off_the_normal(normal, x, y):
    plane = plane_of(normal, [0.1, 0.2, 0.3])
    np.testing.assert_allclose(plane.x, x, atol=1e-15)
    np.testing.assert_allclose(plane.y, y, atol=1e-15)


@given(normals, normals)
def test_every_normal_has_an_orthonormal_right_handed_plane_through_the_point(normal, through):
    plane = plane_of(normal, through)
    np.testing.assert_allclose(plane.basis @ plane.basis.T, np.eye(3), atol=1e-12)
    n = np.array(normal) / np.linalg.norm(normal)
    assert abs(plane.normal @ n) == pytest.approx(1, abs=1e-12)
    assert plane.distances([through])[0] == pytest.approx(0, abs=1e-12)
    # the origin is the root's origin moved along the normal
    np.testing.assert_allclose(np.cross(plane.origin, n), 0, atol=1e-12)


@given(normals, st.integers(0, 2**32 - 1))
def test_a_fit_finds_the_plane_that_its_points_lie_in(normal, seed):
    plane = plane_of(normal, [0.3, 0.1, -0.4])
    points = lifted(plane, np.random.default_rng(seed).uniform(-1, 1, (50, 2)))
    found, rms = fit_plane(points)
    np.testing.assert_allclose(np.abs(found.normal @ plane.normal), 1, atol=1e-9)
    np.testing.assert_allclose(lifted(found, found.project(points)), points, atol=1e-9)
    assert rms < 1e-12


def test_a_fit_reports_the_spread_across_the_plane():
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-1, 1, (5_000, 2)), rng.normal(0, 0.01, 5_000)])
    _, rms = fit_plane(points)
    assert rms == pytest.approx(0.01, rel=0.05)


@pytest.mark.parametrize(
    ("points", "word"),
    [
        (np.zeros((2, 3)), "shape (2, 3)"),
        (np.outer(np.arange(5), [1, 2, 3]), "line"),
        (np.ones((5, 3)), "line"),
        (np.ones((5, 2)), "shape (5, 2)"),
        (np.full((5, 3), np.nan), "finite"),
    ],
)
def test_points_that_span_no_plane_are_refused(points, word):
    with pytest.raises(LogError) as caught:
        fit_plane(points)
    assert word in str(caught.value)
    assert "\n" not in str(caught.value)
