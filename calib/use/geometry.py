"""Geometry: joint offsets, link placements and the sensor's frame that fit a model best.

`calib correct` takes the sensor's frame from here, `calib urdf` the offsets and placements.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..body.bound import autocorrelation_time
from ..common.choices import CAUSES, LOG_FRAMES
from ..errors import OptionError
from ..model.alignment import Alignment

if TYPE_CHECKING:
    from ..arm.planar_arm import PlanarArm
    from ..model.model import Model

Array = NDArray[np.float64]

_POINTS, _ROWS = 500, 2_000
_STEPS = 60
_OFFSET = math.radians(10.0)  # prior standard deviation of a joint's offset [rad]
_PLACED = 1e-3  # of a joint's or the tip's place [m]; also of a sliding joint's offset
_WIDER = (1.0, 5.0, 20.0)  # the prior's widths that are tried
_NU = 6.0  # degrees of freedom of the residuals
_FLOOR = 1e-6  # of the reach: a residual below is rounding


@dataclass(frozen=True, eq=False)
class Geometry:
    """A fitted planar geometry.

    Attributes
    ----------
    arm : PlanarArm
        The nominal arm.
    offsets : (dof,) array [rad or m]
        Joint value at which the nominal arm stands where the real one reads zero.
    moved : (dof, 2) array [m]
        How far each joint's successor (the last one's: the tip) is displaced in the plane,
        in the axes of the plane at the zero posture.
    base : (2,) array [m]
        Displacement of the first joint; zero unless it was freed.
    interval_offsets, interval_moved, interval_base : arrays
        Half widths of the 95 % intervals; what the data cannot tell apart is within them.
    frame : Alignment
        From the root link's plane to the frame that the model answers in.
    free : bool
        Whether that frame was fitted; the first joint's offset is zero then, by convention.
    residual : float [m]
        Root mean square distance that this geometry does not explain.
    before : float [m]
        The same for the nominal geometry, in the same frame.
    reach : float [m]
        Furthest distance of the tip from the first joint.
    """

    arm: PlanarArm
    offsets: Array
    moved: Array
    base: Array
    interval_offsets: Array
    interval_moved: Array
    interval_base: Array
    frame: Alignment
    free: bool
    residual: float
    before: float
    reach: float

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        names = self.arm.joint_names
        offsets = zip(names, self.offsets.tolist(), self.interval_offsets.tolist(), strict=True)
        moved = zip(names, self.moved.tolist(), self.interval_moved.tolist(), strict=True)
        return {
            "offsets": {n: {"value": v, "interval": i} for n, v, i in offsets},
            "moved": {n: {"value": v, "interval": i} for n, v, i in moved},
            "base": {"value": self.base.tolist(), "interval": self.interval_base.tolist()},
            "frame": {"matrix": self.frame.matrix.tolist(), "shift": self.frame.shift.tolist()},
            "frame_fitted": self.free,
            "residual": self.residual,
            "before": self.before,
            "reach": self.reach,
        }


def nominal_arm(model: Model) -> PlanarArm:
    """Return the arm as its URDF describes it."""
    from ..arm.loading import arm_from_urdf

    about = model.about
    if not about.urdf:
        raise OptionError(
            "the model has no URDF, so there is no nominal arm to compare it with",
            hint="train it with a robot, or with a robot and a log",
            parameter="robot",
        )
    from ..arm.planar_arm import PlanarArm

    arm = arm_from_urdf(about.urdf, about.joint_names, about.tip, lock=about.locked)
    if not isinstance(arm, PlanarArm):
        raise OptionError(
            f"{about.robot} moves in space: this works for planar arms alone so far",
            hint="name a planar part of the arm with `joints`",
        )
    return arm


def frame_is_free(model: Model, view: str = "auto") -> bool:
    """Whether nothing says how the sensor's frame lies to the robot's root link.

    Positions of a simulation are in the root link's plane; those of a log are in the sensor's
    own frame, unless `view` is "base".
    """
    if view not in LOG_FRAMES:
        raise OptionError(
            f"view {view!r}: expected one of {', '.join(LOG_FRAMES)}", parameter="view", value=view
        )
    source = model.about.source
    if model.history:
        source = model.history[0].get("from", {}).get("source", source)
    based = "base" in (view, model.about.options.get("view"))
    return bool(source == "log") and not based


def fit_geometry(
    model: Model, *, view: str = "auto", cause: str = "sensor", move_base: bool = False
) -> Geometry:
    """Fit the nominal chain to what was learned, where rows were, by Gauss-Newton.

    Unknown are an offset for each joint and, in the plane, the place of the tip in the last
    link's frame and of each joint in its predecessor's; with a free frame also its turn, shift
    and, for other units than m, scale.  A Gaussian prior (10 deg, 1 mm) settles what the data
    cannot tell apart, such as an offset and a turned link; the intervals hold that freedom.

    Parameters
    ----------
    model : Model
        It must have a URDF.
    view : {"auto", "base"}
        "base" says that a log's positions are in the root link's frame.
    cause : {"sensor", "joints"}
        What an adaptation found that turns the sensor's frame and the first joint alike; with
        "joints" the frame is taken to have stayed.
    move_base : bool
        Whether the first joint's place is fitted too; only in a known frame.
    """
    arm, free = nominal_arm(model), frame_is_free(model, view)
    if len(model.axes) != 2:
        raise OptionError(
            "offsets and placements are fitted for planar arms, this one moves in space",
            hint="train the planar sub-chain with `planar=True`",
            parameter="planar",
        )
    if move_base and free:
        raise OptionError(
            "the base cannot be told from the sensor's frame",
            hint="say that the log is in the robot's root frame with `view='base'`",
            parameter="view",
        )
    if not free and model.about.unit != "m":
        raise OptionError(
            f"the model's positions are in {model.about.unit!r}, a URDF's are in m",
            hint="adapt it with a log in m (or `unit='mm'`)",
            parameter="unit",
            value=model.about.unit,
        )
    q, x, error = _points(model)
    # undo what adaptations found to be the sensor's
    for moved in reversed(frames(model, cause)):
        x = np.asarray(np.linalg.solve(moved.matrix, (x - moved.shift).T).T, dtype=float)
    problems = [_Problem(arm, q, x, free, move_base, mirrored) for mirrored in (False, True)]
    problems = problems if free else problems[:1]
    if free and model.about.unit == "m":
        problems = [replace(problem, scaled=False) for problem in problems]
    found = [(problem, *problem.solve()) for problem in problems]
    problem, theta, covariance = min(found, key=lambda each: each[0].rms(each[1]))
    half = 1.96 * np.sqrt(np.diag(covariance)) * max(1.0, problem.inflation(theta, error))
    reach = float(np.linalg.norm(arm.forward(q) - arm.forward(q).mean(axis=0), axis=1).max())
    scale = math.exp(theta[problem.frame][1])
    parts, widths = problem.split(theta), problem.split(half)
    nominal = np.zeros_like(theta)
    nominal[problem.frame] = theta[problem.frame]
    return Geometry(
        arm,
        *parts,
        *widths,
        problem.alignment(theta),
        free,
        problem.rms(theta) / scale,
        problem.rms(nominal) / scale,
        reach,
    )


def frames(model: Model, cause: str = "sensor") -> list[Alignment]:
    """Return how the sensor's frame moved, adaptation after adaptation.

    None with the cause "joints", which says that it stayed.
    """
    if cause not in CAUSES:
        raise OptionError(
            f"cause {cause!r}: expected one of {', '.join(CAUSES)}", parameter="cause", value=cause
        )
    if cause == "joints":
        return []
    return [Alignment.from_json(e["frame"]) for e in model.history if e.get("frame") is not None]


def changed_arm(arm: PlanarArm, moved: Array, base: Array) -> PlanarArm:
    """Return the arm with its joints and tip displaced in the plane at the zero posture."""
    axes = np.stack([arm.plane.x, arm.plane.y])
    shifts = np.cumsum(np.vstack([base, moved]), axis=0) @ axes
    chain = arm.chain
    chain = replace(chain, points=chain.points + shifts[:-1], tip=chain.tip + shifts[-1])
    return replace(arm, chain=chain)


def _points(model: Model) -> tuple[Array, Array, float]:
    """Joint values and positions [unit] where rows were, and the least error of their mean.

    They are the rows themselves where kept, else the motor nodes that rows visited, at which
    the model answers: its error there is that of its own rows, and larger than the residual.
    """
    if model.rows is not None and not model.history:
        some = slice(None, None, -(-len(model.rows) // _ROWS))
        return model.rows.q[some], model.rows.x[some], 0.0
    nodes = np.flatnonzero(model.visited)
    if len(nodes) > _POINTS:
        nodes = np.sort(np.random.default_rng(0).choice(nodes, _POINTS, replace=False))
    q = np.clip(model.motor.weights[nodes], model.about.lower, model.about.upper)
    x = model.forward(q)
    known = np.isfinite(x).all(axis=1)
    noise = float(np.nanmedian(model.bounds)) / 2.45  # standard deviation along an axis
    error = noise * math.sqrt(len(q) / max(model.about.samples, 10))
    return q[known], x[known], error


@dataclass(frozen=True, eq=False)
class _Problem:
    """One least-squares problem; its parameters are offsets, places, base and frame."""

    arm: PlanarArm
    q: Array
    x: Array
    free: bool
    move_base: bool
    mirrored: bool
    scaled: bool = True

    @property
    def frame(self) -> slice:
        """Turn [rad], logarithm of the scale, and shift of the frame, among the parameters."""
        return slice(3 * self.arm.dof + 2, 3 * self.arm.dof + 6)

    def split(self, theta: Array) -> tuple[Array, Array, Array]:
        dof = self.arm.dof
        return theta[:dof], theta[dof : 3 * dof].reshape(dof, 2), theta[3 * dof : 3 * dof + 2]

    def alignment(self, theta: Array) -> Alignment:
        turn, growth, *shift = theta[self.frame].tolist()
        c, s = math.cos(turn), math.sin(turn)
        flip = np.diag([-1.0, 1.0]) if self.mirrored else np.eye(2)
        return Alignment(math.exp(growth) * np.array([[c, -s], [s, c]]) @ flip, np.array(shift))

    def predicted(self, theta: Array) -> Array:
        offsets, moved, base = self.split(theta)
        return self.alignment(theta).apply(
            changed_arm(self.arm, moved, base).forward(self.q + offsets)
        )

    def rms(self, theta: Array) -> float:
        residual = self.x - self.predicted(theta)
        return float(np.sqrt(np.mean(np.sum(residual**2, axis=1))))

    def inflation(self, theta: Array, error: float) -> float:
        """Return by how much intervals of independent residuals are too small.

        Neighbouring rows err alike: the mean of n has the error of n over their
        autocorrelation time.
        """
        residual = self.x - self.predicted(theta)
        noise = self.rms(theta) / math.sqrt(2.0)
        time = autocorrelation_time(residual)
        return max(math.sqrt(time), error / max(noise, 1e-300))

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
        floor = _FLOOR * float(np.linalg.norm(np.ptp(self.x, axis=0)))
        noise = max(self.rms(theta) / math.sqrt(2.0), floor)
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
            before, noise = noise, max(self._noise(theta, noise), floor)
            slope = self._slopes(theta, use)
            if turned < 1e-9 and abs(noise - before) < 1e-6 * noise:
                break
        weighted = self._weight(theta, noise)[:, None] * slope / noise
        information = weighted.T @ weighted + root.T @ root
        covariance = np.zeros((len(theta), len(theta)))
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
