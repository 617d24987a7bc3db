"""One maximisation: a step that fails is damped where rows leave a direction open."""

import numpy as np

from calib.body.derivative import Derivative
from calib.body.fit import Fit
from calib.body.measurement import Measurement
from calib.body.parameters import Prior
from calib.body.structure import Structure


class Bent(Structure):
    """Outputs (u + v) q + c (u - v + b)^2: what q tells is u + v; u - v is long and curved."""

    size, outputs, blocks, dof, measurement = 2, 2, (2,), 1, Measurement()
    curve, middle = 1e-3, 0.01

    def predict(self, q, beta):
        own = self.curve * (beta[0] - beta[1] + self.middle) ** 2
        return beta.sum() * q * (1.0, -1.0) + own

    def derivative(self, q, beta, active):
        rise = 2 * self.curve * (beta[0] - beta[1] + self.middle)
        along = (q * (1.0, -1.0))[:, :, None]
        return self.predict(q, beta), Derivative.of(along + rise * np.array([1.0, -1.0]))


def test_a_step_that_an_open_direction_spoils_is_damped():
    rng = np.random.default_rng(0)
    q = rng.uniform(-1, 1, (40, 1))
    z = 0.3 * q * (1.0, -1.0) + rng.normal(0, 1e-4, (40, 2))
    prior, sizes = Prior(np.zeros(2), np.full(2, 1e3), ()), np.full(2, 1e-4)
    search = Fit(Bent(), q, z, np.zeros(2), prior, 6.0, sizes, 10 * sizes)
    search.linearise(fresh=True)
    share = search.move(np.array([0.15 + 1e5, 0.15 - 1e5]))  # right, but for its open part
    assert 0 < share < 0.4
    assert abs(search.beta.sum() - 0.3) < 1e-3
    assert abs(search.beta[0] - search.beta[1]) < 1.0
