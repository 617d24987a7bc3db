"""Touches: an arm whose tip was in the same sockets again and again, against a known truth."""

import numpy as np
import pytest
from touching import MM, World

from calib.samples.sockets import Known


@pytest.fixture(scope="module")
def world():
    return World(0)


@pytest.fixture(scope="module")
def unscaled(world):
    """What the sockets tell without a distance between them."""
    return world.fit([])[0].body


def test_the_tip_is_found_from_sockets_alone(world, unscaled):
    fit, points = world.fit(world.known((0, 1), (2, 3)))
    off, bound = world.off(fit.body)
    before = world.off(unscaled)[0]
    drawn = np.linalg.norm(
        world.truth.predict(world.q, world.truth.neutral()) - world.points[world.number], axis=1
    )
    assert drawn.mean() > 2 * MM
    assert off.mean() < 0.25 * MM
    assert off.mean() < before.mean()
    assert (off < bound).mean() > 0.9
    scatter = fit.body.predict(world.q) - points[world.number]
    assert np.linalg.norm(scatter, axis=1).mean() < 0.3 * MM
    apart = np.linalg.norm(points[0] - points[1])
    assert apart == pytest.approx(np.linalg.norm(world.points[0] - world.points[1]), abs=0.2 * MM)


def test_a_plane_and_distances_are_differentiated_rightly():
    rng = np.random.default_rng(1)
    flat = np.column_stack([rng.standard_normal((5, 2)), 1e-3 * rng.standard_normal(5)])
    for known in (Known((0, 1), 0.4, 1e-4), Known((0, 1, 2, 4), None, 1e-4)):
        value, slope = known.misfit(flat)
        step = 1e-6 * rng.standard_normal(flat.shape)
        moved = known.misfit(flat + step)[0] - known.misfit(flat - step)[0]
        assert np.allclose(moved, 2 * np.tensordot(slope, step), atol=1e-8)
        assert len(value) == (1 if known.value else 4)
