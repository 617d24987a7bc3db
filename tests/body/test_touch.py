"""Touches: an arm whose tip was in the same sockets again and again, against a known truth."""

from dataclasses import replace

import numpy as np
import pytest
from touching import MM, World

from calib.body.fit import Fit
from calib.body.parameters import Prior
from calib.body.rows import together
from calib.body.spatial import structure_of
from calib.body.touch import touching


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


def test_touches_beside_positions_are_one_fit_of_stacked_rows(world):
    structure, rng = structure_of(world.arm, "rigid"), np.random.default_rng(3)
    number = np.where(rng.random(len(world.q)) < 0.3, -1, world.number)
    beta = structure.neutral()
    for name in ("placement", "tool"):
        beta[structure.groups[name]] = world.beta[world.truth.groups[name]]
    beta[structure.groups["view.rotation"]] = rng.normal(0, 1, 3)
    x = structure.predict(world.q, beta) + rng.normal(0, 0.1 * MM, (len(world.q), 3))
    told = touching(world.q, number, world.known((0, 1)), x)
    touches, positions, facts = told = [replace(each, noise=0.1 * MM) for each in told]
    seen = together(structure, told)
    prior = seen.prior((*seen.frame_groups, "placement", "offset"))
    begin = seen.neutral()
    for name in ("placement", "tool", "view.rotation"):
        begin[seen.groups[name]] = beta[structure.groups[name]]
    begin[seen.groups["point"]] = world.points.ravel()

    def fitted(rows):
        fit = Fit(seen, rows, begin, Prior(prior.mean, prior.sd), nu=np.inf)
        return fit.maximise(learn=False, steps=20, tolerance=1e-6)

    both, alone = fitted([positions, touches, facts]), fitted([positions])
    rows, off = [np.diag(1 / both.sd)], [(prior.mean - both.beta)[both.active] / both.sd]
    for part in both.parts:
        slope = part.structure.linearise(part.q, both.beta, both.active)[1] / part.noise[:, None]
        rows.append(slope.reshape(-1, len(both.active)))
        off.append((part.residual / part.noise).ravel())
    stacked, off = np.concatenate(rows), np.concatenate(off)
    covariance = np.linalg.inv(stacked.T @ stacked)
    assert np.allclose(both.covariance, covariance, rtol=1e-3, atol=1e-12)
    step = np.linalg.lstsq(stacked, off, rcond=None)[0]  # what stacked rows would move
    sd = np.sqrt(np.diag(covariance))
    assert (abs(step) < 1e-2 * sd).all()
    arm = np.isin(both.active, np.concatenate([seen.groups["placement"], seen.groups["offset"]]))
    narrower = sd[arm] / np.sqrt(np.diag(alone.covariance))[arm]
    assert narrower.max() < 1.0 + 1e-9
    assert narrower.min() < 0.6
    assert (abs(both.beta - begin)[both.active[arm]] < 4 * sd[arm]).all()
