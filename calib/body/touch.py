"""Touches: the tip was in one socket again and again, from many postures.

Where a socket is, nobody measured: each is a flat parameter of the fit, and is left out of the
belief once the fit is done, which eliminates it exactly.  Sockets alone determine neither where the
arm's base is nor how it is turned: both stay as drawn.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..arm.rotations import similarity
from ..arm.spatial_chain import ChainState
from ..common.arrays import Array
from ..samples.sockets import SocketFact
from .belief import Body
from .body_fit import BodyFit, fit
from .parameters import Block, Gaussian, Hyper, Indices
from .rows import Rows, with_measurements
from .settings import FINER, FIT, FLAT_SD, PRIOR
from .spatial import SpatialStructure
from .views import ArmSize, Measurement, Sight

_POSTURES = 400
"""Number of postures all over the range; their mean motion is the motion of the whole arm."""

DRAWN_SIZE = 2e-3
"""Sd of an arm's size over that of its drawing: links are machined, and an aluminium frame 20 deg
warmer than the drawing is .5 of a thousandth larger."""


@dataclass(frozen=True, eq=False)
class Touch(Measurement):
    """The tip less the socket that it is in [m]; a row also has the socket's number."""

    count: int  # sockets
    within: tuple[float, float] = FINER  # factor on the sd of joint origins

    outputs = 3
    floating = True
    free = ("point",)
    tool = Hyper("tool", PRIOR.socket, (1.0, 1.0))

    def parameters(self, arm: ArmSize) -> tuple[Block, ...]:
        """The sockets."""
        names = [f"{k}.{axis}" for k in range(self.count) for axis in "xyz"]
        return (Block.of("point", "m", names, sd=FLAT_SD * arm.reach),)

    def look(
        self, blocks: Mapping[str, Array], state: ChainState, row_facts: Array
    ) -> Sight:
        """The tips minus their sockets."""
        places = blocks["point"].reshape(-1, 3)
        number = row_facts[:, 0].astype(int)
        miss = state.position.T - places[number]
        return Sight(miss, lambda: np.eye(3))


@dataclass(frozen=True, eq=False)
class SocketFacts(Measurement):
    """Facts about sockets over their tolerances: a row for each distance and point of a plane.

    They do not depend on the joints.
    """

    facts: tuple[SocketFact, ...]

    outputs = 1
    noise = 1.0

    def look(
        self,
        blocks: Mapping[str, Array],
        state: ChainState,  # noqa: ARG002
        row_facts: Array,
    ) -> Sight:
        """The sockets' misfits."""
        places = blocks["point"].reshape(-1, 3)
        misfit = np.concatenate(
            [fact.misfit(places) / fact.tolerance for fact in self.facts]
        )
        rows = row_facts[:, 0].astype(int)
        values = misfit[rows, None]
        return Sight(values, lambda: np.zeros((1, 3)))


def rows_of_touches(
    q: Array, point: Indices, facts: Sequence[SocketFact], x: Array
) -> list[Rows]:
    """The rows of touches, positions, and facts about sockets, each a measurement.

    The parameters are those of `fit_touches`.
    """
    touched = point >= 0
    measured = ~touched
    has_distance = any(fact.value is not None for fact in facts)
    within = PRIOR.touches
    if measured.any() or has_distance:
        within = PRIOR.sized_touches
    sockets = int(point.max()) + 1
    touch = Touch(sockets, within=within)
    number = point[touched].astype(float)
    numbered = np.column_stack([q[touched], number])
    miss = np.zeros((len(number), 3))
    rows = [Rows(numbered, miss, touch)]
    if measured.any():
        rows.append(Rows(q[measured], x[measured]))
    if facts:
        rows.append(_rows_of_facts(facts, q.shape[1]))
    return rows


def _rows_of_facts(facts: Sequence[SocketFact], dof: int) -> Rows:
    """One row of each distance, and of each point of a plane; its joints do not matter."""
    count = 0
    for fact in facts:
        count += 1 if fact.value is not None else len(fact.points)
    still = np.zeros((count, dof + 1))
    still[:, -1] = np.arange(count)
    misfit = np.zeros((count, 1))
    return Rows(still, misfit, SocketFacts(tuple(facts)))


def fit_touches(
    structure: SpatialStructure,
    q: Array,
    point: Indices,
    facts: Sequence[SocketFact],
    *,
    lower: Array,
    upper: Array,
    x: Array,
    seed: int,
) -> tuple[BodyFit, Array]:
    """Fit an arm to touches; also return the sockets' places (p, 3) [m] in the sensor's frame.

    structure : the arm with its drawing as prior: in its base frame (view ``"base"``), or before
        the sensor that measured some rows (``"rigid"``)
    q : (n, dof), joint values [rad or m]
    point : (n,), the number of the socket that each row touched, from 0; negative where it was
        none, and a sensor measured `x`
    facts : distances and planes; without a distance the arm's size stays as drawn
    lower, upper : (dof,), the joints' range: bounds are of motions within it
    x : (n, 3), what the sensor measured [m]
    """
    tip, _ = structure.pose(q, structure.neutral())
    variance = tip.var(axis=0).sum()
    extent = float(np.sqrt(variance))
    workspace = structure.with_sensor(extent=extent)
    rows = rows_of_touches(q, point, facts, x)
    with_sockets = with_measurements(workspace, rows)
    begin = _beginning(with_sockets, tip, point, x)
    joint_fit = fit(with_sockets, rows, begin=begin, seed=seed)
    body = in_structure(joint_fit.body, structure)
    if (point < 0).any():
        # bounds are of touches and of readings
        of_sensor = joint_fit.other_sensors[0].body
        body = replace(body, noise=np.maximum(body.noise, of_sensor.noise))
    else:
        rng = np.random.default_rng(seed)
        size = (_POSTURES, len(lower))
        postures = rng.uniform(lower, upper, size)
        body = without_whole_motion(body, postures)
    # not as fitted: other blocks hardly determine a socket whose touches are mostly in one block
    no_widening = np.ones(len(q))
    held_out = _held_out(joint_fit, point)
    fitted = replace(
        joint_fit, body=body, held_out=held_out, widening=no_widening
    )
    return fitted, _socket_places(joint_fit.body)


def _held_out(joint_fit: BodyFit, point: Indices) -> Array:
    """Held-out residuals (n, 3) of touches of sockets (n,), and of a sensor's readings (-1)."""
    touched = point >= 0
    held_out = np.empty((len(point), 3))
    held_out[touched] = _about_means(joint_fit.held_out, point[touched])
    if not touched.all():
        held_out[~touched] = joint_fit.other_sensors[0].held_out
    return held_out


def _socket_places(body: Body) -> Array:
    """Where sockets are (p, 3) [m] in the sensor's frame, by a fit to their touches."""
    structure = body.structure
    index = structure.groups["point"]
    points = body.beta[index].reshape(-1, 3)
    sensor = structure.sensor(body.beta)
    return points @ sensor.rotation.T + sensor.shift


def _beginning(
    structure: SpatialStructure, tip: Array, point: Indices, x: Array
) -> Array:
    """Parameters (d,) to begin with: sockets and sensor where the drawing has the tip (n, 3)."""
    begin = structure.neutral()
    sockets = structure.groups["point"].reshape(-1, 3)
    for k, socket in enumerate(sockets):
        in_socket = tip[point == k]
        begin[socket] = in_socket.mean(axis=0)
    measured = point < 0
    if measured.any():
        turn, shift, scale = similarity(
            tip[measured], x[measured], scale=structure.metre
        )
        begin = structure.with_sensor_at(begin, turn, shift, scale)
    return begin


def _about_means(residual: Array, point: Indices) -> Array:
    """Held-out residuals, minus their mean where a block has most touches of a socket.

    The other blocks determine the arm, but hardly the place of such a socket.
    """
    out = residual.copy()
    counts = np.bincount(point)
    order = np.arange(len(point))
    for block in np.array_split(order, FIT.blocks):
        numbers = point[block]
        for k in np.unique(numbers):
            rows = block[numbers == k]
            if 2 * len(rows) > counts[k]:
                out[rows] -= out[rows].mean(axis=0)
    return out


def in_structure(body: Body, structure: SpatialStructure) -> Body:
    """The belief in another structure of the arm, without parameters that this does not have."""
    before = [label.name for label in body.structure.labels]
    after = [label.name for label in structure.labels]
    _, old, new = np.intersect1d(before, after, return_indices=True)

    def reordered(belief: Gaussian) -> tuple[Array, Array]:
        beta = structure.neutral()
        beta[new] = belief.beta[old]
        root = np.zeros((structure.size, belief.root.shape[1]))
        root[new] = belief.full_root[old]
        return beta, root

    return replace(body.with_beliefs(reordered), structure=structure)


def without_whole_motion(body: Body, q: Array) -> Body:
    """The belief without the uncertainty of the whole arm's motion, on average over `q` (n, dof).

    Touches do not determine where the whole arm is: it stays as drawn, and intervals and bounds
    omit it.  Each uncertain parameter is combined with the move of the first joint's origin that
    cancels its motion of the whole arm.
    """
    structure = body.structure
    assert isinstance(structure, SpatialStructure)  # noqa: S101 - touches are of these alone
    shift = structure.shifts[0]
    turn = structure.turns[0]
    base: Indices = np.append(shift, turn)

    def without(belief: Gaussian) -> tuple[Array, Array]:
        _, slope = structure.linearise(q, belief.beta)
        flat = slope.reshape(-1, structure.size)
        root = belief.full_root
        by_base = flat[:, base]
        by_unknowns = flat @ root
        whole, *_ = np.linalg.lstsq(by_base, by_unknowns, rcond=None)
        root[base] -= whole
        return belief.beta, root

    return body.with_beliefs(without)


def with_size(body: Body, sd: float) -> Body:
    """The belief with the arm's size uncertain by a relative `sd`.

    No touch changes if arm and sockets grow by one factor: only a drawing (`DRAWN_SIZE`) or a
    stated distance of sockets determines the size.
    """
    structure = body.structure
    assert isinstance(structure, SpatialStructure)  # noqa: S101 - touches are of these alone
    chain = structure.chain
    growth = np.zeros(structure.size)
    stops = np.vstack([chain.points, chain.tip])
    *links, tool = sd * np.diff(stops, axis=0)
    growth[structure.shifts[1:]] = links
    growth[structure.groups["tool"]] = chain.rotation.T @ tool

    def with_growth(belief: Gaussian) -> tuple[Array, Array]:
        root = belief.full_root
        fitted = root.any(axis=1)
        return belief.beta, np.column_stack([root, growth * fitted])

    return body.with_beliefs(with_growth)
