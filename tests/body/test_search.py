"""One maximisation: a step that fails is damped where rows leave a direction open."""

import numpy as np
from small_maps import UNIT_BOX

from calib.maps.model_selection import misfit


def rows(n=6000, seed=0):
    rng = np.random.default_rng(seed)
    return rng.random((n, 2)), rng.normal(scale=1e-3, size=(n, 2))


def test_noise_is_no_misfit():
    assert all(misfit(UNIT_BOX, *rows(seed=s), 1.0, rows(seed=s)[0]) is None for s in range(5))


def test_a_defect_stands_out_of_noise_where_it_is_and_only_there():
    u, held = rows()
    inside = np.linalg.norm(u - 0.5, axis=1) < 0.1
    held[inside] += 3e-3
    found = misfit(UNIT_BOX, u, held, 1.0, u)
    assert (found[np.linalg.norm(u - 0.5, axis=1) < 0.08] > 0).all()
    assert (found[np.linalg.norm(u - 0.5, axis=1) > 0.2] == 0).mean() > 0.995
    np.testing.assert_allclose(np.median(found[inside]), 2 * 9e-6, rtol=0.3)
