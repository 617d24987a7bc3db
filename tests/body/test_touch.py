"""Touches: an arm whose tip was in the same sockets again and again, against a known truth."""

from __future__ import annotations

import numpy as np
import pytest

import calib
from calib.arm.rotations import similarity
from calib.body.spatial import structure_of
from calib.body.touch import Known, fit_touches

MM = 1e-3


def touching(structure, beta, points, each, play, rng):
    """Joint values (n, dof) at which the true tip is in each socket, and the sockets' numbers."""
    lower, upper = structure.limits
    rows, numbers = [], []
    for k, point in enumerate(points):
        found = np.zeros((0, structure.arm.dof))
        while len(found) < each:
            q = rng.uniform(lower, upper, (400, structure.arm.dof))
            target = point + play * rng.standard_normal((400, 3))
            for _ in range(60):
                x, slope = structure.truth.predict_and_slope(q, beta)
                lean = slope @ np.swapaxes(slope, 1, 2) + 1e-6 * np.eye(3)
                step = np.swapaxes(slope, 1, 2) @ np.linalg.solve(lean, (target - x)[..., None])
                q = q + np.clip(step[..., 0], -0.3, 0.3)
            x = structure.truth.predict(q, beta)
            there = (np.linalg.norm(x - target, axis=1) < 1e-9) & (q > lower).all(1)
            found = np.concatenate([found, q[there & (q < upper).all(1)]])
        rows.append(found[:each])
        numbers += [k] * each
    return np.concatenate(rows), np.array(numbers)


class World:
    """A six-joint arm with origins off by half a millimetre and a tenth of a degree."""

    def __init__(self, seed, each=25, play=0.1 * MM):
        rng = np.random.default_rng(seed)
        self.arm = calib.load_arm("six_axis")
        self.truth = structure_of(self.arm, "base")
        self.limits = np.maximum(self.arm.lower, -2.5), np.minimum(self.arm.upper, 2.5)
        self.beta = self.truth.neutral()
        self.beta[self.truth.shifts] = 0.5 * MM * rng.standard_normal(self.truth.shifts.shape)
        self.beta[self.truth.turns] = np.radians(0.1) * rng.standard_normal(self.truth.turns.shape)
        self.beta[self.truth.groups["tool"]] = 3 * MM * rng.standard_normal(3)
        reach = self.arm.chain.reach
        middle = np.array([0.45, 0.0, 0.35]) * reach
        self.points = middle + 0.2 * reach * rng.uniform(-1, 1, (4, 3))
        self.q, self.number = touching(self, self.beta, self.points, each, play, rng)

    def known(self, *pairs):
        return [
            Known(pair, float(np.linalg.norm(np.subtract(*self.points[list(pair)]))), 0.1 * MM)
            for pair in pairs
        ]

    def fit(self, known):
        lower, upper = self.limits
        return fit_touches(self.truth, self.q, self.number, known, lower=lower, upper=upper)

    def off(self, body):
        """Distances of the tip from the truth but for a rigid motion, which no touch tells."""
        q = np.random.default_rng(9).uniform(*self.limits, (500, self.arm.dof))
        true, said = self.truth.predict(q, self.beta), body.predict(q)
        turn, shift, _ = similarity(said, true)
        shift = true.mean(axis=0) - turn @ said.mean(axis=0)
        return np.linalg.norm(said @ turn.T + shift - true, axis=1), body.bound(q, noise=False)


@pytest.fixture(scope="module")
def world():
    return World(0)


def test_the_tip_is_found_from_sockets_alone(world):
    fit = world.fit(world.known((0, 1), (2, 3)))
    off, bound = world.off(fit.fit.body)
    before = world.off(world.fit([]).fit.body)[0]
    drawn = np.linalg.norm(
        world.truth.predict(world.q, world.truth.neutral()) - world.points[world.number], axis=1
    )
    assert drawn.mean() > 2 * MM
    assert off.mean() < 0.25 * MM
    assert off.mean() < before.mean()
    assert (off < bound).mean() > 0.9
    scatter = fit.fit.body.predict(world.q) - fit.points[world.number]
    assert np.linalg.norm(scatter, axis=1).mean() < 0.3 * MM
    apart = np.linalg.norm(fit.points[0] - fit.points[1])
    assert apart == pytest.approx(np.linalg.norm(world.points[0] - world.points[1]), abs=0.2 * MM)


def test_without_a_distance_the_arm_keeps_its_size(world):
    body = world.fit([]).fit.body
    reach = np.linalg.norm(body.predict(world.q), axis=1)
    true = np.linalg.norm(world.truth.predict(world.q, world.beta), axis=1)
    assert reach.mean() == pytest.approx(true.mean(), rel=0.03)


def test_a_plane_and_distances_are_differentiated_rightly():
    rng = np.random.default_rng(1)
    flat = np.column_stack([rng.standard_normal((5, 2)), 1e-3 * rng.standard_normal(5)])
    for known in (Known((0, 1), 0.4, 1e-4), Known((0, 1, 2, 4), None, 1e-4)):
        value, slope = known.misfit(flat)
        step = 1e-6 * rng.standard_normal(flat.shape)
        moved = known.misfit(flat + step)[0] - known.misfit(flat - step)[0]
        assert np.allclose(moved, 2 * np.tensordot(slope, step), atol=1e-8)
        assert len(value) == (1 if known.value else 4)


def test_offsets_are_within_their_intervals():
    hits = []
    for seed in range(3):
        world = World(10 + seed, each=15)
        body = world.fit(world.known((0, 1), (2, 3))).fit.body
        offsets = world.truth.groups["offset"][1:]
        hits += list(np.abs(body.beta[offsets]) < 1.96 * body.deviations[offsets] + 1e-12)
    assert np.mean(hits) > 0.8
