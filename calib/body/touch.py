"""Touches: the tip was in one socket again and again, from many postures.

Where a socket is, nobody measured: each is a flat parameter of the fit, and is left out of the
belief once the fit is done, which eliminates it exactly.  What is known of the sockets (distances,
a plane) are rows of their own, and so are positions that a sensor measured.  Sockets alone tell
neither where the arm's base stands nor how it is turned about its first axis: both stay as drawn.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..arm.rotations import logarithm, similarity
from ..arm.spatial_chain import Motion
from ..common.arrays import Array
from ..samples.sockets import Known
from .belief import Body, Second
from .covariance import as_kept
from .fit import BLOCKS, Fit
from .fitting import BodyFit, fit
from .parameters import Block, Indices
from .settings import FINER, FREE, LOG_FLOOR, STATED, STUDENT
from .spatial import SpatialStructure
from .views import Columns, InSpace, Measurement

_POSTURES = 400  # all over the joints' range, of which the mean motion is that of the whole arm

_Belief = TypeVar("_Belief", Body, Second)


@dataclass(frozen=True, eq=False)
class Touch(Measurement):
    """The tip less the socket that it is in [m], or less the position that a sensor measured.

    A row also tells the socket's number and, where that is negative, a position.  Numbers from
    `count` on stand for the rows of what is known, weighed by `noise` over tolerance.
    """

    tip: InSpace  # the tip in the arm's base frame, or in the sensor's where there is one
    count: int  # sockets
    known: tuple[Known, ...] = ()
    noise: float = STATED  # of a touch [m]
    sensor: float = STATED  # of a measured position [m]

    @property
    def within(self) -> tuple[float, float]:  # type: ignore[override]
        """Doubt of joint origins; not large where no distance tells how large the arm is."""
        sized = self.tip.kind != "base" or any(each.value is not None for each in self.known)
        return (FINER[0], 5.0 if sized else 1.0)

    def parameters(self) -> tuple[Block, ...]:
        """The sockets."""
        names = [f"point.{k}.{axis}" for k in range(self.count) for axis in "xyz"]
        return (*self.tip.parameters(), Block.of("point", "m", names, FREE * self.tip.size))

    def rows(self, q: Array, point: NDArray[np.intp], x: Array) -> Array:
        """Rows of the fit: touches and measured positions, then what is known of the sockets."""
        counts = [1 if each.value is not None else len(each.points) for each in self.known]
        facts = np.zeros((sum(counts), q.shape[1] + 4))
        facts[:, -4] = self.count + np.arange(len(facts))
        return np.concatenate([np.column_stack([q, point, x]), facts])

    def ready(self, own: Mapping[str, Array]) -> Mapping[str, Any]:
        """What its tip asks for."""
        return self.tip.ready(own)

    def look(self, own: Mapping[str, Any], motion: Motion, also: Array) -> _Touched:
        """See the tip in its sockets."""
        seen = self.tip.look(own, motion, also)
        places = own["point"].reshape(-1, 3)
        number = also[:, 0].astype(int)
        touches, measured = (number >= 0) & (number < self.count), number < 0
        slope = np.zeros((len(number), 3, self.count, 3))
        slope[touches, :, number[touches]] = -np.eye(3)
        values = np.where(touches[:, None], motion.position.T - places[number * touches], 0.0)
        trust = self.noise / self.sensor
        values[measured] = trust * (seen.values - also[:, 1:])[measured]
        facts = ~(touches | measured)
        if facts.any():
            told = [(self.noise / each.tolerance, each.misfit(places)) for each in self.known]
            misfit = np.concatenate([weight * off for weight, (off, _) in told])
            slopes = np.concatenate([weight * by for weight, (_, by) in told])
            values[facts, 0] = misfit[number[facts] - self.count]
            slope[facts, 0] = slopes[number[facts] - self.count]
        trusted = np.asarray(trust * measured)
        return _Touched(values, seen, touches, trusted, slope.reshape(len(number), 3, -1))

    def start(self, structure: Any, q: Array) -> Array:
        """The drawing, with each socket where it says that the tip was on average."""
        beta = structure.neutral()
        joints, also = q[:, : structure.dof], q[:, structure.dof :]
        tip, number = structure.pose(joints, beta)[0], also[:, 0].astype(int)
        means = [tip[number == k].mean(axis=0) for k in range(self.count)]
        beta[structure.groups["point"]] = np.ravel(means)
        if (measured := number < 0).any():
            tip, x = tip[measured], also[measured, 1:]
            turn = similarity(tip, x)[0]
            beta[structure.groups["view.rotation"]] = logarithm(turn)
            beta[structure.groups["view.shift"]] = x.mean(axis=0) - turn @ tip.mean(axis=0)
        return np.asarray(beta)


@dataclass(frozen=True)
class _Touched:
    """What touches tell at n rows; those of what is known do not move with the arm."""

    values: Array  # (n, 3)
    seen: Any  # the tip
    touches: NDArray[np.bool_]  # (n,)
    trust: Array  # (n,), weight of a measured position, else 0
    slope: Array  # (n, 3, 3 p), by the sockets

    def push(self, velocity: Array, angular: Any = 0.0) -> Array:
        """How outputs (..., 3, n) move when the tip does."""
        moved = np.asarray(velocity * self.touches)
        return moved + self.seen.push(velocity, angular) * self.trust if self.trust.any() else moved

    def columns(self) -> Columns:
        """The derivative by the sockets, and by the sensor's frame."""
        yield "point", lambda: self.slope.transpose(2, 1, 0)
        for name, columns in self.seen.columns():
            yield name, lambda columns=columns: columns() * self.trust  # type: ignore[misc]


@dataclass(frozen=True)
class TouchFit:
    """A body that touches told, in the arm's base frame or the sensor's."""

    fit: BodyFit
    points: Array  # (p, 3), where the sockets are [m]


def fit_touches(
    structure: SpatialStructure,
    q: Array,
    point: NDArray[np.intp],
    known: Sequence[Known] = (),
    *,
    lower: Array,
    upper: Array,
    x: Array | None = None,
    seed: int = 0,
) -> TouchFit:
    """Fit an arm to touches.

    structure : the arm with its drawing as prior: in its base frame (view ``"base"``), or before
        the sensor that measured some rows (``"rigid"``)
    q : (n, dof), joint values [rad or m]
    point : (n,), the number of the socket that each row touched, from 0; negative where it was
        none, and a sensor measured `x`
    known : distances and planes; without a distance the arm's size stays as drawn
    lower, upper : (dof,), the joints' range: bounds are of motions within it
    x : (n, 3), what the sensor measured [m]
    """
    point = np.asarray(point, dtype=int)
    drawn = structure.pose(q, structure.neutral())[0]
    extent = float(np.sqrt(((drawn - drawn.mean(axis=0)) ** 2).sum(axis=1).mean()))
    tip = structure.measurement
    assert isinstance(tip, InSpace)  # noqa: S101 - views of the tip
    touch = Touch(tip, int(point.max()) + 1, tuple(known))
    rows = touch.rows(q, point, np.zeros((len(q), 3)) if x is None else x)
    none = np.zeros((len(rows), 3))
    view = "touch" if structure.view == "base" else "touch and rigid"
    seen = structure.with_view(view, reading=touch, extent=extent)
    if len(rows) > len(q) or (point < 0).any():
        # distances weigh as they were stated, and positions as they are, beside touches' own noise
        chain = dict(seen.members())["chain"]
        first = Fit(
            seen, rows, none, touch.start(seen, rows), seen.prior(chain),
            nu=STUDENT, floor=LOG_FLOOR * seen.extents,
        ).maximise()  # fmt: skip
        off, noise = first.residual[: len(q)][point < 0], float(first.noise[0])
        sensor = 1.48 * float(np.median(np.abs(off))) if len(off) else STATED
        touch = replace(touch, noise=noise, sensor=max(sensor, noise / 10))
        seen = replace(seen, reading=touch)
    found = fit(seen, rows, none, seed=seed)
    points = found.body.beta[seen.groups["point"]].reshape(-1, 3)
    body = restated(found.body, structure)
    if structure.view == "base":
        range_of = np.random.default_rng(seed).random((_POSTURES, q.shape[1]))
        body = anchored(body, lower + range_of * (upper - lower))
    else:
        sensor_at = structure.sensor(body.beta)
        points = points @ sensor_at.rotation.T + sensor_at.shift
    held = _scattered(found.held_out, point, len(rows))[: len(q)]
    return TouchFit(replace(found, body=body, held_out=held), points)


def _scattered(residual: Array, point: NDArray[np.intp], rows: int) -> Array:
    """Held-out residuals, about their own mean where a block holds most touches of a socket.

    What the other blocks say of the arm does not tell where such a socket is.
    """
    out, counts = residual.copy(), np.bincount(point[point >= 0])
    for first, last in pairwise(np.linspace(0, rows, BLOCKS + 1).round().astype(int)):
        inside = np.arange(first, min(last, len(point)))
        for k in np.unique(point[inside][point[inside] >= 0]):
            own = inside[point[inside] == k]
            if 2 * len(own) > counts[k]:
                out[own] -= out[own].mean(axis=0)
    return out


def restated(body: Body, structure: SpatialStructure) -> Body:
    """The belief in another structure of the same arm; what that does not have is left out."""
    place = {label.name: k for k, label in enumerate(structure.labels)}
    to = np.array([place.get(label.name, -1) for label in body.structure.labels])

    def carried(belief: _Belief) -> _Belief:
        beta, active = structure.neutral(), to[belief.active]
        beta[to[to >= 0]] = belief.beta[to >= 0]
        kept = active >= 0
        root = as_kept(belief.covariance[np.ix_(kept, kept)])
        return replace(belief, beta=beta, active=active[kept], root=root)

    second = body.second and carried(body.second)
    return replace(carried(body), structure=structure, second=second)


def anchored(body: Body, q: Array) -> Body:
    """The belief without what moves the arm as a whole, on average over postures `q` (n, dof).

    No touch tells a motion of the whole arm: it stays as drawn, and intervals and bounds leave it
    out.  The first joint's origin moves the arm as a whole, so that it takes the opposite part.
    """
    structure = body.structure
    assert isinstance(structure, SpatialStructure)  # noqa: S101 - touches are of these alone
    base: Indices = np.concatenate([structure.shifts[0], structure.turns[0]])

    def without(belief: _Belief) -> _Belief:
        both = np.concatenate([base, belief.active])
        x = structure.linearise(q, belief.beta, both)[1].reshape(-1, len(both))
        whole = np.linalg.lstsq(x[:, :6], x[:, 6:], rcond=None)[0]
        order, root = np.argsort(both), np.concatenate([-whole @ belief.root, belief.root])
        return replace(belief, active=both[order], root=root[order])

    return replace(without(body), second=body.second and without(body.second))
