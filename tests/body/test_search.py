"""One maximisation: a step that fails is damped where rows leave a direction open."""

import numpy as np
from small_maps import UNIT_BOX

from calib.body.fit import Fit
from calib.body.parameters import Prior
from calib.body.rows import Rows
from calib.body.structure import Structure
from calib.body.views import Measurement
from calib.maps.model_selection import misfit


class Bent(Structure):
    """Outputs (u + v) q + c (u - v + b)^2: what q tells is u + v; u - v is long and curved."""

    size, outputs, blocks, dof, measurement = 2, 2, (2,), 1, Measurement()
    sensors, others, place = (), (), 0
    curve, middle = 1e-3, 0.01

    def predict(self, q, beta):
        own = self.curve * (beta[0] - beta[1] + self.middle) ** 2
        return beta.sum() * q * (1.0, -1.0) + own

    def linearise(self, q, beta, active=None):
        rise = 2 * self.curve * (beta[0] - beta[1] + self.middle)
        along = (q * (1.0, -1.0))[:, :, None]
        return self.predict(q, beta), along + rise * np.array([1.0, -1.0])


def test_a_step_that_an_open_direction_spoils_is_damped():
    rng = np.random.default_rng(0)
    q = rng.uniform(-1, 1, (40, 1))
    z = 0.3 * q * (1.0, -1.0) + rng.normal(0, 1e-4, (40, 2))
    prior, sizes = Prior(np.zeros(2), np.full(2, 1e3), ()), np.full(2, 1e-4)
    start = np.array([0.1405, 0.1495])  # where the open direction is nearly flat
    rows = [Rows(q, z, floor=sizes, noise=10 * sizes)]
    search = Fit(Bent(), rows, start, prior, nu=6.0).maximise(learn=False, steps=1)
    assert abs(search.beta.sum() - 0.3) < 1e-3
    assert abs(search.beta[0] - search.beta[1]) < 1.0


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


def test_rows_that_repeat_and_outliers_are_no_misfit():
    u, noise = rows(600)
    assert misfit(UNIT_BOX, np.repeat(u, 10, axis=0), np.repeat(noise, 10, axis=0), 1.0, u) is None
    u, held = rows()
    held[::50] *= 100
    assert misfit(UNIT_BOX, u, held, 1.0, u) is None
