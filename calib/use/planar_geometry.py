"""The least-squares problem of a planar geometry: offsets, places, base and sensor's frame."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..arm.arms import PlanarArm
from ..body.bound import autocorrelation_time
from ..common.arrays import Array
from ..model.alignment import Alignment

_STEPS = 60
_OFFSET = math.radians(10.0)  # prior standard deviation of a joint's offset [rad]
_PLACED = 1e-3  # of a joint's or the tip's place [m]; also of a sliding joint's offset
_WIDER = (1.0, 5.0, 20.0)  # the prior's widths that are tried
_NU = 6.0  # degrees of freedom of the residuals
_FLOOR = 1e-6  # of the reach: a residual below is rounding


@dataclass(frozen=True, eq=False)
class PlanarProblem:
    """One least-squares problem; its parameters are offsets, places, base and frame.

    `error` [unit] is the least noise along an axis that positions are credited with: an adapted
    model answers without noise, yet with the error of its rows.
    """

    arm: PlanarArm
    q: Array
    x: Array
    free: bool
    move_base: bool
    mirrored: bool
    scaled: bool = True
    error: float = 0.0

    @property
    def frame(self) -> slice:
        """Turn [rad], logarithm of the scale, and shift of the frame, among the parameters."""
        return slice(3 * self.arm.dof + 2, 3 * self.arm.dof + 6)

    def split(self, theta: Array) -> tuple[Array, Array, Array]:
        """Offsets (dof,), places (dof, 2) and base (2,) among the parameters."""
        dof = self.arm.dof
        return theta[:dof], theta[dof : 3 * dof].reshape(dof, 2), theta[3 * dof : 3 * dof + 2]

    def alignment(self, theta: Array) -> Alignment:
        """The sensor's frame."""
        turn, growth, *shift = theta[self.frame].tolist()
        c, s = math.cos(turn), math.sin(turn)
        flip = np.diag([-1.0, 1.0]) if self.mirrored else np.eye(2)
        return Alignment(math.exp(growth) * np.array([[c, -s], [s, c]]) @ flip, np.array(shift))

    def predicted(self, theta: Array) -> Array:
        """Positions (n, 2) that the sensor sees of the arm."""
        offsets, moved, base = self.split(theta)
        return self.alignment(theta).apply(
            changed_arm(self.arm, moved, base).forward(self.q + offsets)
        )

    def rms(self, theta: Array) -> float:
        """Root mean square distance that the parameters leave."""
        residual = self.x - self.predicted(theta)
        return float(np.sqrt(np.mean(np.sum(residual**2, axis=1))))

    @property
    def _floor(self) -> float:
        """Least noise along an axis that residuals are credited with [unit]."""
        rounding = _FLOOR * float(np.linalg.norm(np.ptp(self.x, axis=0)))
        return max(rounding, self.error, 1e-300)

    def inflation(self, theta: Array) -> float:
        """Return by how much intervals of independent residuals are too small.

        Neighbouring rows err alike: the mean of n has the error of n over their
        autocorrelation time.
        """
        return math.sqrt(max(1.0, autocorrelation_time(self.x - self.predicted(theta))))

    def solve(self) -> tuple[Array, Array]:
        """Return the most probable parameters and their covariance."""
        best = self._fit(self._start(), _WIDER[0])
        for wider in _WIDER[1:]:
            tried = self._fit(best[0], wider)
            if tried[2] < best[2] - 5.0:  # a wider prior has to earn its width
                best = tried
        return best[0], best[1]

    def _weight(self, theta: Array, noise: float) -> Array:
        """Roots of Student weights (2 n,) of the residuals: a few rows may be grossly wrong."""
        r = np.sum((self.x - self.predicted(theta)) ** 2, axis=1) / noise**2
        return np.repeat(np.sqrt((_NU + 2.0) / (_NU + r)), 2)

    def _noise(self, theta: Array, noise: float) -> float:
        """Scale of the residuals along an axis [unit], with the weights at the last one."""
        r = (self.x - self.predicted(theta)).ravel() * self._weight(theta, noise)
        return float(np.sqrt(np.mean(r**2)))

    def _start(self) -> Array:
        theta = np.zeros(3 * self.arm.dof + 6)
        if not self.free:
            return theta
        old = self.arm.forward(self.q)
        if self.mirrored:
            old = old * [-1.0, 1.0]
        a, b = old - old.mean(axis=0), self.x - self.x.mean(axis=0)
        turn = math.atan2(
            float(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])), float(np.sum(a * b))
        )
        growth = 0.0
        if self.scaled:
            growth = 0.5 * math.log(float(np.sum(b**2)) / max(float(np.sum(a**2)), 1e-300))
        theta[self.frame] = turn, growth, 0.0, 0.0
        shift = (self.x - self.predicted(theta)).mean(axis=0)
        theta[self.frame] = turn, growth, *shift
        return theta

    def _prior(self, wider: float) -> Array:
        """Standard deviations: 0 holds a parameter, infinity leaves it free."""
        dof = self.arm.dof
        offsets = np.where(np.array(self.arm.revolute), _OFFSET, _PLACED * wider)
        if self.free:
            offsets[0] = 0.0
        base = np.full(2, np.inf if self.move_base else 0.0)
        frame = np.full(4, np.inf if self.free else 0.0)
        frame[1] = np.inf if self.free and self.scaled else 0.0
        return np.concatenate([offsets, np.full(2 * dof, _PLACED * wider), base, frame])

    def _root(self, wider: float) -> Array:
        """Root of the prior's information: across a link its far end keeps the narrow width.

        There a displacement is the same as a turn, which an offset should carry.
        """
        sd = self._prior(wider)
        root = np.diag(1.0 / np.where(sd > 0.0, sd, np.inf))
        chain, dof = self.arm.chain, self.arm.dof
        places = (
            np.vstack([chain.points, chain.tip]) @ np.stack([self.arm.plane.x, self.arm.plane.y]).T
        )
        for k in range(dof):
            link = places[k + 1] - places[k]
            length = float(np.linalg.norm(link))
            if not self.arm.revolute[k] or length < _PLACED:
                continue
            along = link / length
            turn = np.array([along, [-along[1], along[0]]])
            at = slice(dof + 2 * k, dof + 2 * k + 2)
            root[at, at] = np.diag([1.0 / (_PLACED * wider), 1.0 / _PLACED]) @ turn
        return root

    def _fit(self, theta: Array, wider: float) -> tuple[Array, Array, float]:
        sd = self._prior(wider)
        root = self._root(wider)
        use = np.flatnonzero(sd > 0.0)
        root = root[:, use]
        held = theta.copy()
        held[sd == 0.0] = 0.0
        theta = held
        noise = max(self.rms(theta) / math.sqrt(2.0), self._floor)
        slope = self._slopes(theta, use)
        for _ in range(_STEPS):
            weight = self._weight(theta, noise)
            residual = weight * (self.x - self.predicted(theta)).ravel() / noise
            rows = np.vstack([weight[:, None] * slope / noise, root])
            pull = np.concatenate([residual, -root @ theta[use]])
            step = np.linalg.lstsq(rows, pull, rcond=1e-14)[0]
            turned = float(np.abs(step).max())
            theta = theta.copy()
            theta[use] += step * min(1.0, 0.5 / turned) if turned > 0.5 and not self.free else step
            before, noise = noise, max(self._noise(theta, noise), self._floor)
            slope = self._slopes(theta, use)
            if turned < 1e-9 and abs(noise - before) < 1e-6 * noise:
                break
        weighted = self._weight(theta, noise)[:, None] * slope / noise
        information = weighted.T @ weighted + root.T @ root
        covariance = np.zeros((len(theta), len(theta)))
        # flat directions of a free frame beside tight priors: an inverse would lose all digits
        covariance[np.ix_(use, use)] = np.linalg.pinv(information, rcond=1e-15, hermitian=True)
        fitted = np.isfinite(sd[use])
        cost = 2.0 * len(self.q) * math.log(noise) + 0.5 * float(np.sum((root @ theta[use]) ** 2))
        # Laplace: what the prior allows and the data leave
        cost += 0.5 * float(np.linalg.slogdet(information)[1]) + float(
            np.sum(np.log(sd[use][fitted]))
        )
        return theta, covariance, cost

    def _slopes(self, theta: Array, use: NDArray[np.intp]) -> Array:
        columns = []
        for k in use:
            step = np.zeros_like(theta)
            step[k] = 1e-6
            change = self.predicted(theta + step) - self.predicted(theta - step)
            columns.append(change.ravel() / 2e-6)
        return np.stack(columns, axis=1)


def changed_arm(arm: PlanarArm, moved: Array, base: Array) -> PlanarArm:
    """Return the arm with its joints and tip displaced in the plane at the zero posture."""
    axes = np.stack([arm.plane.x, arm.plane.y])
    shifts = np.cumsum(np.vstack([base, moved]), axis=0) @ axes
    chain = arm.chain
    chain = replace(chain, points=chain.points + shifts[:-1], tip=chain.tip + shifts[-1])
    return replace(arm, chain=chain)
