"""Touches: the tip was in one socket again and again, from many postures.

Where a socket is, nobody measured: each is a flat parameter of the fit, and is left out of the
belief once the fit is done, which eliminates it exactly.  What is known of the sockets (distances,
a plane) are rows of their own.  Sockets tell neither where the arm's base stands nor how it is
turned about its first axis: both stay as drawn.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from ..samples.sockets import Known
from .belief import Body
from .covariance import as_kept
from .measurement import Measurement
from .parameters import Block, Indices
from .posterior import BodyFit, fit_structure
from .search import BLOCKS
from .settings import FREE, SCALES, STATED
from .spatial import SpatialStructure
from .spatial_view import InSpace

_POSTURES = 400  # all over the joints' range, of which the mean motion is that of the whole arm


@dataclass(frozen=True, eq=False)
class Touch(Measurement):
    """The tip less the socket that it is in [m]; a row also tells the socket's number.

    Numbers from `count` on stand for the rows of what is known, weighed by `noise` over tolerance.
    """

    tip: InSpace  # the tip in the arm's base frame
    count: int  # sockets
    known: tuple[Known, ...] = ()
    noise: float = STATED  # of a touch [m]

    blocks = (3,)

    @property
    def scales(self) -> tuple[float, ...]:  # type: ignore[override]
        """Without a distance nothing tells how large the arm is: origins are where drawn."""
        return SCALES if any(each.value is not None for each in self.known) else (1.0,)

    def parameters(self) -> tuple[Block, ...]:
        """The sockets."""
        parts = tuple((None, f"point.{k}.{axis}", "m") for k in range(self.count) for axis in "xyz")
        return (*self.tip.parameters(), Block("point", parts, sd=FREE * self.tip.size))

    def facts(self) -> int:
        """Rows that what is known of the sockets takes."""
        return sum(1 if each.value is not None else len(each.points) for each in self.known)

    def look(self, own: Mapping[str, Array], motion: Any, also: Array) -> _Touched:
        """See the tip in its sockets."""
        seen = self.tip.look(own, motion, also[:, :0])
        places = own["point"].reshape(-1, 3)
        number = also[:, 0].astype(int)
        touches = number < self.count
        slope = np.zeros((len(number), 3, self.count, 3))
        slope[touches, :, number[touches]] = -np.eye(3)
        values = np.where(touches[:, None], seen.values - places[number * touches], 0.0)
        if not touches.all():
            told = [(self.noise / each.tolerance, each.misfit(places)) for each in self.known]
            misfit = np.concatenate([weight * off for weight, (off, _) in told])
            slopes = np.concatenate([weight * by for weight, (_, by) in told])
            values[~touches, 0] = misfit[number[~touches] - self.count]
            slope[~touches, 0] = slopes[number[~touches] - self.count]
        return _Touched(values, seen, touches, slope.reshape(len(number), 3, -1))

    def start(self, structure: Any, q: Array) -> Array:
        """The drawing, with each socket where it says that the tip was on average."""
        beta = structure.neutral()
        joints, also = structure.apart(q)
        tip = structure.pose(joints, beta)[0]
        number = also[:, 0].astype(int)
        for k in range(self.count):
            beta[structure.groups["point"][3 * k : 3 * k + 3]] = tip[number == k].mean(axis=0)
        return np.asarray(beta)


@dataclass(frozen=True)
class _Touched:
    """What touches tell at n rows; those of what is known do not move with the arm."""

    values: Array  # (n, 3)
    seen: Any  # the tip
    touches: NDArray[np.bool_]  # (n,)
    slope: Array  # (n, 3, 3 p), by the sockets

    def push(self, velocity: Array, angular: Any = 0.0) -> Array:
        """How outputs (..., 3, n) move when the tip does."""
        return np.asarray(self.seen.push(velocity, angular) * self.touches)

    def columns(self) -> Iterator[tuple[str, Callable[[], Array]]]:
        """The derivative by the sockets."""
        yield "point", lambda: self.slope.transpose(2, 1, 0)


@dataclass(frozen=True)
class TouchFit:
    """A body that touches told, in the arm's base frame."""

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
    seed: int = 0,
) -> TouchFit:
    """Fit an arm to touches.

    structure : the arm seen in its base frame (view ``"base"``), with its drawing as prior
    q : (n, dof), joint values [rad or m]
    point : (n,), the number of the socket that each row touched, from 0
    known : distances and planes; without a distance the arm's size stays as drawn
    lower, upper : (dof,), the joints' range: bounds are of motions within it
    """
    point = np.asarray(point, dtype=int)
    count, tip = int(point.max()) + 1, structure.measurement
    assert isinstance(tip, InSpace)  # noqa: S101 - a base view sees the tip
    touch = Touch(tip, count, tuple(known))
    facts = np.zeros((touch.facts(), q.shape[1] + 1))
    facts[:, -1] = count + np.arange(len(facts))
    rows = np.concatenate([np.column_stack([q, point]), facts])

    def fitted(touch: Touch) -> BodyFit:
        seen = structure.with_view("touch", reading=touch)
        return fit_structure(seen, rows, np.zeros((len(rows), 3)), seed=seed)

    fit = fitted(touch)
    if len(facts):  # distances weigh as they were stated beside touches of their own noise
        fit = fitted(replace(touch, noise=float(fit.body.noise[0])))
    points = fit.body.beta[fit.body.structure.groups["point"]].reshape(-1, 3)
    range_of = np.random.default_rng(seed).random((_POSTURES, q.shape[1]))
    body = anchored(restated(fit.body, structure), lower + range_of * (upper - lower))
    held = _scattered(fit.held_out, point, len(rows))[: len(q)]
    return TouchFit(replace(fit, body=body, held_out=held), points)


def _scattered(residual: Array, point: NDArray[np.intp], rows: int) -> Array:
    """Held-out residuals, about their own mean where a block holds most touches of a socket.

    What the other blocks say of the arm does not tell where such a socket is.
    """
    out, counts = residual.copy(), np.bincount(point)
    for first, last in pairwise(np.linspace(0, rows, BLOCKS + 1).round().astype(int)):
        inside = np.arange(first, min(last, len(point)))
        for k in np.unique(point[inside]):
            own = inside[point[inside] == k]
            if 2 * len(own) > counts[k]:
                out[own] -= out[own].mean(axis=0)
    return out


def restated(body: Body, structure: SpatialStructure) -> Body:
    """The belief in another structure of the same arm; what that does not have is left out."""
    place = {label.name: k for k, label in enumerate(structure.layout.labels)}
    names = [label.name for label in body.structure.layout.labels]

    def kept(active: Indices) -> tuple[NDArray[np.bool_], Indices]:
        stays = np.array([names[k] in place for k in active], dtype=bool)
        return stays, np.array([place[names[k]] for k in active[stays]], dtype=np.intp)

    def carried(beta: Array) -> Array:
        out = structure.neutral()
        for name, value in zip(names, beta, strict=True):
            if name in place:
                out[place[name]] = value
        return out

    stays, active = kept(body.active)
    second = body.second
    if second is not None:
        own, others = kept(second.active)
        root = as_kept(second.covariance[np.ix_(own, own)])
        second = replace(second, beta=carried(second.beta), active=others, root=root)
    return replace(
        body,
        structure=structure,
        beta=carried(body.beta),
        active=active,
        root=as_kept(body.covariance[np.ix_(stays, stays)]),
        second=second,
    )


def anchored(body: Body, q: Array) -> Body:
    """The belief without what moves the arm as a whole, on average over postures `q` (n, dof).

    No touch tells a motion of the whole arm: it stays as drawn, and intervals and bounds leave it
    out.  The first joint's origin moves the arm as a whole, so that it takes the opposite part.
    """
    structure = body.structure
    assert isinstance(structure, SpatialStructure)  # noqa: S101 - touches are of these alone
    base = np.concatenate([structure.shifts[0], structure.turns[0]])

    def without(beta: Array, active: Indices, root: Array) -> tuple[Indices, Array]:
        _, x = structure.linearise(q, beta, np.concatenate([base, active]))
        x = x.reshape(-1, x.shape[2])
        whole = np.linalg.lstsq(x[:, :6], x[:, 6:], rcond=None)[0]
        both, order = np.concatenate([base, active]), np.argsort(np.concatenate([base, active]))
        return both[order], np.concatenate([-whole @ root, root])[order]

    active, root = without(body.beta, body.active, body.root)
    second = body.second
    if second is not None:
        others, roots = without(second.beta, second.active, second.root)
        second = replace(second, active=others, root=roots)
    return replace(body, active=active, root=root, second=second)
