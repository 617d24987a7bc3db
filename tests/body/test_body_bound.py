"""The bound: closed forms, leave-block-out against refits, coverage of a known case."""

import numpy as np
import pytest

from calib.body.covariance import radius_95, root_of, spread_of
from calib.body.drawing import PlanarDrawing
from calib.body.fit import Fit
from calib.body.gate import leave_blocks_out
from calib.body.parameters import Prior
from calib.body.planar import PlanarStructure
from calib.body.rows import Rows
from calib.body.sensors import InPlane


@pytest.mark.parametrize("ratio", [1.0, 0.5, 0.1, 0.0])
def test_radius_holds_95_percent_of_a_flat_gaussian(ratio):
    covariance = np.diag([1.0, ratio**2])
    x = np.random.default_rng(0).normal(size=(200_000, 2)) * [1.0, ratio]
    inside = np.mean(np.linalg.norm(x, axis=1) <= radius_95(covariance[None])[0])
    assert inside == pytest.approx(0.95, abs=0.006)


def known(n: int, seed: int):
    """Rows of a two-link arm whose prior and noise are exactly those of the fit."""
    generator = np.random.default_rng(seed)
    s = PlanarStructure(
        ("a", "b"), (True, True), (1, 1), PlanarDrawing((0.3, 0.25), (0.0, 0.0)), False,
        (InPlane("rigid", extent=0.4),),
    )  # fmt: skip
    prior = s.prior(("view.rotation", "view.shift", "length", "offset", "gain"))
    sd = np.where(prior.sd > 0, np.minimum(prior.sd, 5e-3), 0.0)
    prior = Prior(prior.mean, sd)
    truth = prior.mean + sd * generator.normal(size=s.size)
    q = generator.uniform(-1.5, 1.5, (n, 2))
    z = s.predict(q, truth) + generator.normal(0, 1e-3, (n, 2))
    return s, prior, truth, q, z


def fitted(s, prior, q, z):
    sizes = {"floor": np.full(2, 1e-9), "noise": np.full(2, 1e-3)}
    fit = Fit(s, [Rows(q, z, **sizes)], prior.mean, prior, nu=np.inf)
    return fit.maximise(learn=False, tolerance=1e-8)


def test_posterior_covers_an_exactly_known_case():
    inside = []
    for seed in range(60):
        s, prior, truth, q, z = known(12, seed)
        f = fitted(s, prior, q, z)
        ask = np.random.default_rng(seed + 1000).uniform(-1.5, 1.5, (40, 2))
        radius = radius_95(spread_of(s.linearise(ask, f.beta, f.active)[1], root_of(f.covariance)))
        error = np.linalg.norm(s.predict(ask, f.beta) - s.predict(ask, truth), axis=1)
        inside.append(np.mean(error <= radius))
    assert np.mean(inside) == pytest.approx(0.95, abs=0.03)


def test_leave_block_out_equals_the_refit():
    s, prior, _, q, z = known(40, 3)
    f = fitted(s, prior, q, z)
    held = leave_blocks_out(f)
    for a, b in zip(held.edges[:-1], held.edges[1:], strict=True):
        others = np.r_[0:a, b:40]
        again = fitted(s, prior, q[others], z[others])
        refit = z[a:b] - s.predict(q[a:b], again.beta)
        assert np.allclose(held.residual[a:b], refit, atol=5e-6)
        assert not np.allclose(f.residual[a:b], refit, atol=3e-5)
