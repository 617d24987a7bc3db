"""Link starts: joints from which every branch of a position is reached, as links propose them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array, Index
from ..maps.association import Association
from ..maps.predictor import Predictor
from .newton import Iterate, Newton, limit_length
from .settings import SOLVER
from .solutions import Solutions, distinct, rank_within
from .solver import Solver
from .task import Positions


@dataclass(frozen=True)
class LinkStartSettings:
    """How links are followed: lengths are node spacings of the motor map unless noted."""

    step: float = 2.0  # longest first step of a node
    most: int = 60  # proposals of a target
    cell: float = 1.5  # proposals that are closer count as one
    apart: float = 0.3  # solutions of two joints that are closer are one
    # spacings of the sensory map by which a start may miss its node
    missed: float = 2.0
    width: int = 8  # most starts of a sensory node
    # nearest sensory nodes of a target, of three joints: with one 25 of 2,029 solutions were
    # missed at limits and folds, with three 4, with five none
    nodes: int = 5
    spare_width: int = 32  # most starts of a sensory node, of redundant arms
    ahead: int = 48  # sensory nodes that a single query makes ready
    # of the largest singular value: less is left out of a first step
    flat: float = 1e-2
    # branches further apart than a node have separate starts
    fold_threshold: float = 1e-2
    rounds: int = 2  # a second one leaves a third of what a first one misses


LINK_STARTS = LinkStartSettings()


def solver_by_links(association: Association, predictor: Predictor) -> Solver:
    """The solver for positions of a forward map whose starts links propose."""
    span = association.sensory.scale.span
    extent = float(np.linalg.norm(span))
    task = Positions(predictor.value_and_slope, len(span), extent)
    newton = Newton(task, association.motor.scale)
    return Solver(
        newton,
        LinkStarts(association, newton),
        not newton.redundant,
        LINK_STARTS.fold_threshold,
    )


class LinkStarts:
    """For each sensory node the joints that lead there: one start per branch.

    Every motor node that was ever active with it is linked to it.  Starts are refined and merged
    when a sensory node is first used, and remembered: many targets share them.
    """

    def __init__(self, association: Association, newton: Newton) -> None:
        self.association = association
        self._newton = newton
        nodes = association.sensory.size
        dof = association.motor.units.shape[1]
        outputs = association.sensory.units.shape[1]
        self._width = (
            LINK_STARTS.spare_width if newton.redundant else LINK_STARTS.width
        )
        # one node leads two joints to both their solutions
        has_branches = dof > 2 and not newton.redundant
        self._count = LINK_STARTS.nodes if has_branches else 1
        starts = nodes, self._width
        self._ready = np.zeros(nodes, dtype=bool)
        self._u = np.full((*starts, dof), np.nan)
        self._value = np.zeros((*starts, outputs))
        self._inverse = np.zeros((*starts, dof, outputs))
        # of redundant joints none: they would take most of the memory
        bends = 0 if newton.redundant else dof
        self._bends = np.zeros((*starts, dof, bends, bends))

    def of(self, x: Array) -> tuple[Index, Array]:
        """Starts of the nearest nodes, a step towards each target `x` (n, m) on."""
        node = self._nearest_nodes(x)
        filled = np.isfinite(self._u[node, :, 0])
        target, place, column = filled.nonzero()
        start = node[target, place], column
        residual = x[target] - self._value[start]
        inverse = self._inverse[start]
        step = (inverse @ residual[..., None])[..., 0]
        longest = LINK_STARTS.step * self.association.motor.spacing
        step = limit_length(step, longest)
        if not self._newton.redundant:
            step = _bent(step, self._bends[start])
        return target, self._u[start] + step

    def _nearest_nodes(self, x: Array) -> Index:
        """The sensory nodes nearest to each target (n, k), made ready."""
        sensory = self.association.sensory
        place = sensory.scale.to_unit(x)
        _, node = sensory.nearest(place, self._count)
        is_ready = self._ready[node]
        if is_ready.all():
            return node
        missing = node[~is_ready]
        if (
            0 < len(missing) < LINK_STARTS.ahead
        ):  # single queries follow each other
            count = min(LINK_STARTS.ahead, sensory.size)
            places = sensory.units[missing]
            _, around = sensory.nearest(places, count)
            missing = around[~self._ready[around]]
        self._prepare(np.unique(missing))
        return node

    def _prepare(self, nodes: Index) -> None:
        """Remember the starts of sensory nodes, and how each moves with its position."""
        solutions = self._branches(self._solutions(nodes))
        column = rank_within(solutions.target)
        fits = column < self._width
        solutions = solutions.rows(fits)
        place = nodes[solutions.target], column[fits]
        self._remember(place, solutions.u)
        self._ready[nodes] = True

    def _solutions(self, nodes: Index) -> Solutions:
        """Joints that links lead to sensory nodes; of each node the closest first."""
        sensory = self.association.sensory
        x = sensory.scale.from_unit(sensory.units[nodes])
        target, u = self._proposals(nodes)
        iterate = self._newton.refine(u, x[target], SOLVER.close)
        order = np.lexsort((iterate.distance, target))
        solutions = Solutions(target, iterate.u, iterate.distance)
        return solutions.rows(order)

    def _branches(self, solutions: Solutions) -> Solutions:
        """The best solution of each branch, of those that come close to their node."""
        newton = self._newton
        motor = self.association.motor
        sensory = self.association.sensory
        span = float(sensory.scale.span.mean())
        spacing = sensory.spacing * span
        near = solutions.distance <= LINK_STARTS.missed * spacing
        best = rank_within(solutions.target) == 0
        solutions = solutions.rows(near | best)
        solved = LINK_STARTS.cell if newton.redundant else LINK_STARTS.apart
        met = newton.is_met(solutions.distance)
        apart = np.where(met, solved, 1.0) * motor.spacing
        single = distinct(
            newton.scale,
            solutions.target,
            solutions.u,
            apart,
        )
        return solutions.rows(single)

    def _proposals(self, nodes: Index) -> tuple[Index, Array]:
        """Joints of motor nodes that are linked to sensory nodes, the strongest of each branch."""
        motor = self.association.motor
        links = self.association.partners.take(nodes)
        order = np.lexsort((-links.data, links.rows))
        rank = rank_within(links.rows[order])
        strong = rank < LINK_STARTS.most
        strongest = order[strong]
        target = links.rows[strongest]
        node = links.indices[strongest]
        u = self._newton.clip(motor.units[node])
        apart = LINK_STARTS.cell * motor.spacing
        single = distinct(
            self._newton.scale,
            target,
            u,
            apart,
        )
        return target[single], u[single]

    def _remember(self, place: tuple[Index, Index], u: Array) -> None:
        """Remember joints (n, dof), and how positions move around them."""
        origin = np.zeros((len(u), self._newton.task.count))
        iterate = self._newton.at(u, origin)
        inverse = np.asarray(
            np.linalg.pinv(iterate.slope, rcond=LINK_STARTS.flat), float
        )
        self._u[place] = u
        self._value[place] = -iterate.residual
        self._inverse[place] = inverse
        if not self._newton.redundant:
            self._bends[place] = self._bends_at(iterate, inverse)

    def _bends_at(self, iterate: Iterate, inverse: Array) -> Array:
        """Bends B (n, dof, dof, dof) of steps du from joints.

        To second order ``J^-1 dx = du + B du du`` with ``B = J^-1 dJ/du / 2``.
        """
        changes = []
        for probe in SOLVER.probe * np.eye(iterate.u.shape[1]):
            _, ahead = self._newton.task.residual(iterate.u + probe, iterate.x)
            changes.append((ahead - iterate.slope) / SOLVER.probe)
        bends = np.einsum("nim,knmj->nijk", inverse, np.array(changes))
        return np.asarray(0.5 * bends)


def _bent(steps: Array, bends: Array) -> Array:
    """Steps du (n, dof) for which ``du + bends du du`` equals straight steps (n, dof)."""
    bent = steps
    for _ in range(LINK_STARTS.rounds):
        rates = (bends @ bent[:, None, :, None])[..., 0]
        bent = steps - (rates @ bent[..., None])[..., 0]
    return bent
