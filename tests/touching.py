"""An arm whose tip touches sockets, whose truth is known."""

import numpy as np
from models import log_of

import calib
from calib.body.spatial import structure_of
from calib.samples.sockets import SocketFact, Touches

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

    def __init__(self, seed, each=25, play=0.1 * MM, flat=False):
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
        self.points = middle + 0.2 * reach * rng.uniform(-1, 1, (4, 3)) * (1, 1, 1 - flat)
        self.q, self.number = touching(self, self.beta, self.points, each, play, rng)

    def known(self, *pairs):
        apart = (np.linalg.norm(np.subtract(*self.points[list(pair)])) for pair in pairs)
        return [SocketFact(pair, float(m), 0.1 * MM) for pair, m in zip(pairs, apart, strict=True)]

    def log(self, q=None, number=None, known=()):
        """Touches as a log holds them: the world's own, or others."""
        q = self.q if q is None else q
        number = self.number if number is None else number
        names = "ABCD"[: number.max() + 1]
        touch = Touches(number, tuple(("", name) for name in names), tuple(known))
        return log_of(self.arm, q, np.zeros((len(q), 3)), touch=touch)
