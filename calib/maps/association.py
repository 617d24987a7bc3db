"""Association: two maps and the links between them, read out in both directions.

Readouts are ``winner``, ``activity`` and ``linear``.  Places are those of the maps' unit boxes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Annotated

import numpy as np

from ..common.arrays import Array, Index, Shape, freeze
from ..common.parallel import side_by_side
from ..common.rows import group_sums
from .clusters import Clusters
from .linear_models import LinearModels, regress
from .links import WIRINGS, SparseRows, Wiring, entry_rows
from .map import Map
from .settings import READOUT

if TYPE_CHECKING:
    import os

    from scipy.sparse import csr_array


@dataclass(frozen=True)
class Association:
    """Two maps and the links between them.

    Attributes
    ----------
    motor, sensory : Map
    linked : SparseRows of shape (motor nodes, sensory nodes)
        Strength c_ij of each link; `links` is the same as a csr_array.
    wiring : Wiring
        How links were learned (eq. 5) and how active nodes are (eq. 6).
    motor_shifts, sensory_shifts : (nodes, dof), (nodes, m) array, optional
        From each node's weight to the mean of the samples at which it was active, in node spacings
        and half precision, as in a model file; without them means are at the weights.
    """

    motor: Map
    sensory: Map
    linked: SparseRows
    wiring: Wiring = WIRINGS["reciprocal"]
    motor_shifts: (
        Annotated[Array, Shape("nodes", "dof", storage="f2")] | None
    ) = None
    sensory_shifts: (
        Annotated[Array, Shape("places", "width", storage="f2")] | None
    ) = None

    def __repr__(self) -> str:
        strong = f"{len(self.linked.data):,} links"
        return f"Association({self.motor!r}, {self.sensory!r}, {strong})"

    def __post_init__(self) -> None:
        freeze(self, "motor_shifts", "sensory_shifts")

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write both maps and their links into one file, which `calib.load_maps` reads."""
        from ..model_file.container import save_maps

        save_maps(self, path)

    @cached_property
    def links(self) -> csr_array:
        """Strength c_ij of each connection, (motor nodes, sensory nodes)."""
        from scipy.sparse import csr_array

        links = self.linked
        entries = (links.data, links.indices, links.indptr)
        return csr_array(entries, shape=links.shape)

    @staticmethod
    def learn(
        motor: Map,
        u: Array,
        sensory: Map,
        v: Array,
        wiring: Wiring,
    ) -> Association:
        """Link two maps by samples (n, dof) and (n, m) in their unit boxes."""
        a_i, a_j = side_by_side(
            partial(wiring.activity, motor, u),
            partial(wiring.activity, sensory, v),
        )
        return Association(
            motor,
            sensory,
            wiring.link(a_i, a_j),
            wiring,
            _shifts(motor, a_i, u),
            _shifts(sensory, a_j, v),
        )

    def predict(self, q: Array, readout: str = "activity") -> Array:
        """Positions (n, m) that a readout gives for joints (n, dof), both in their own units."""
        rows = np.atleast_2d(np.asarray(q, dtype=float))
        u = self.motor.scale.to_unit(rows)
        return self.sensory.scale.from_unit(self.forward(u, readout))

    def forward(self, u: Array, readout: str) -> Array:
        """Positions in the sensory unit box (n, m) for joints `u` (n, dof) in theirs."""
        if readout == "winner":
            _, nodes = self.motor.nearest(u)
            partner = self._strongest_partner[nodes[:, 0]]
            return self.sensory.units[partner]
        if readout == "linear":
            return self.sensory.scale.to_unit(self.linear.value(u))
        # sum_i a_i c_ij w_j / sum_i a_i c_ij
        a = self.wiring.activity(self.motor, u)
        total = a @ self._strength
        sums = a @ self._partner_sums
        is_linked = total > 0
        predicted = sums / np.where(is_linked, total, 1.0)[:, None]
        unlinked = np.flatnonzero(~is_linked)
        if len(unlinked):
            predicted[unlinked] = self.forward(u[unlinked], "winner")
        return predicted

    def inverses(self, v: Array, near: Array) -> dict[str, Array]:
        """Joints in the unit box (n, dof) for positions `v` (n, m) in theirs, by readout.

        Of the winner's branches the one closest to `near` (n, dof) answers: ``winner`` with its
        strongest partner there, ``activity`` with the mean of that cluster of nodes, ``linear``
        with a regression on the sensory nodes' mean activity positions.
        """
        clusters = self.clusters
        winner = self.sensory.nearest(v)[1][:, 0]
        branch = clusters.nearest(winner, near, self.motor.scale)
        anchor = clusters.centre[winner, branch]
        nodes, activity = self.wiring.active_nodes(self.sensory, v)
        step, strength = self._partners_on_branch(nodes, anchor)
        weight = activity * strength
        # their sum is no zero
        weight[:, 0] += 1e-300
        places = _places(self.sensory, self.sensory_shifts)
        offset = places[nodes] - v[:, None]
        middle, mean, slope = regress(offset, step, weight)
        to_query = np.einsum("nd,ndo->no", middle, slope)
        return {
            "linear": anchor + mean - to_query,
            "activity": anchor + mean,
            "winner": self.motor.units[clusters.core[winner, branch]],
        }

    def _partners_on_branch(
        self,
        nodes: Index,
        anchor: Array,
    ) -> tuple[Array, Array]:
        """Of sensory nodes (n, k) the clusters on the branch of places (n, dof).

        Returns (n, k, dof), (n, k), offsets from the place to their centres, and their strengths; 0
        where a node has no cluster there.
        """
        scale = self.motor.scale
        cluster = self.clusters.nearest(nodes, anchor[:, None], scale)
        centre = self.clusters.centre[nodes, cluster]
        step = scale.difference(centre, anchor[:, None])
        distance = np.linalg.norm(step, axis=2)
        on_branch = distance <= READOUT.core * self.motor.spacing
        strength = self.clusters.strength[nodes, cluster]
        return step, np.where(on_branch, strength, 0.0)

    @cached_property
    def linear(self) -> LinearModels:
        """Linear models of the motor nodes: the readout ``linear`` forwards, in sensory units."""
        motor = self.motor
        strength = self._strength
        means = _places(motor, self.motor_shifts)
        total = np.where(strength > 0, strength, 1.0)
        partners = self._partner_sums / total[:, None]
        inside = motor.scale.wrapped(motor.units)
        predicted = self.sensory.scale.from_unit(partners)
        return LinearModels.of(
            motor,
            means,
            predicted,
            strength,
            self.wiring.active_nodes(motor, inside),
        )

    @cached_property
    def _strength(self) -> Array:
        """Sum of the links of each motor node, (motor nodes,)."""
        sums = self.links.sum(axis=1)
        return np.asarray(sums, dtype=float).ravel()

    @cached_property
    def _partner_sums(self) -> Array:
        """Sum of the sensory weights linked to each motor node, times their links."""
        return self.links @ self.sensory.units

    @cached_property
    def _strongest_partner(self) -> Index:
        """Sensory node with the strongest link to each motor node, or to the nearest linked one."""
        has_links = np.diff(self.linked.indptr) > 0
        source = self.motor.nearest_of(has_links)
        strongest = self.links.argmax(axis=1)
        partners = np.asarray(strongest).ravel()
        return partners[source]

    @cached_property
    def partners(self) -> SparseRows:
        """Links by sensory node, (sensory nodes, motor nodes).

        A node without links has those of the nearest one that has some.
        """
        links = self.linked.transposed()
        has_links = np.diff(links.indptr) > 0
        source = self.sensory.nearest_of(has_links)
        return links.take(source)

    @cached_property
    def clusters(self) -> Clusters:
        """The branches of each sensory node."""
        return Clusters.of(self.partners, self.motor)


def _shifts(network: Map, activity: csr_array, u: Array) -> Array:
    """Mean offsets (nodes, d) [node spacings] of samples `u` (n, d) from the nodes active at them.

    activity : (n, nodes); a node that was never active has none
    """
    rows = entry_rows(activity.indptr)
    nodes = activity.indices
    a = activity.data
    places = network.units[nodes]
    gap = network.scale.difference(u[rows], places)
    pulls = a[:, None] * gap
    offsets = group_sums(nodes, pulls, network.size)
    total = group_sums(nodes, a, network.size)
    total = np.where(total > READOUT.active, total, np.inf)
    shifts = offsets * (1.0 / total)[:, None] / network.spacing
    within = np.clip(shifts, -READOUT.furthest, READOUT.furthest)
    # in half precision, as in a model file
    return within.astype(np.float16).astype(float)


def _places(network: Map, shifts: Array | None) -> Array:
    """Mean places (nodes, d) of the samples at which nodes were active, in the unit box."""
    if shifts is None:
        return network.units
    return network.units + shifts * network.spacing
