"""Readouts of the links: ``winner``, ``activity`` and ``linear``, in both directions."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Annotated

import numpy as np

from ..common.arrays import Array, Index, Shape, freeze
from ..common.choices import READOUTS
from ..common.parallel import side_by_side
from ..common.scale import Scale
from ..errors import OptionError
from .linear_models import LinearModels, regress
from .links import WIRINGS, SparseRows, Wiring
from .map import Map
from .settings import READOUT

if TYPE_CHECKING:
    import os

    from scipy.sparse import csr_array


def check_readout(name: str) -> None:
    """Refuse an unknown readout."""
    if name not in READOUTS:
        raise OptionError(
            f"readout {name!r} is unknown, choose one of {', '.join(READOUTS)}"
        )


@dataclass(frozen=True)
class Clusters:
    """Motor nodes linked to each sensory node, grouped into branches."""

    center: Array  # (sensory nodes, c, dof), link-weighted mean in the unit box, strongest first
    # (sensory nodes, c), sum of its links, 0 where there is no such cluster
    strength: Array
    # (sensory nodes, c), motor node with the strongest link of each cluster
    core: Index

    def nearest(
        self,
        nodes: Index,
        place: Array,
        scale: Scale,
    ) -> Index:
        """Number of each node's cluster that is nearest to a place: (...), (..., dof) -> (...)."""
        gap = scale.difference(self.center[nodes], place[..., None, :])
        distance = np.linalg.norm(gap, axis=-1)
        distance = np.where(self.strength[nodes] > 0, distance, np.inf)
        return np.asarray(distance.argmin(axis=-1))


@dataclass(frozen=True)
class Association:
    """Two maps and the links between them.

    Attributes
    ----------
    motor, sensory : Map
    linked : SparseRows of shape (motor nodes, sensory nodes)
        Strength c_ij of each connection; `links` is the same as a csr_array.
    wiring : Wiring
        How they were learned (eq. 5) and how active nodes are (eq. 6).
    motor_shifts, sensory_shifts : (nodes, dof), (nodes, m) array, optional
        Mean position of the samples at which each node was active, less its weight, in node
        spacings and half precision, as a model file keeps it; 0 where not known.
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
        return csr_array(
            (links.data, links.indices, links.indptr), shape=links.shape
        )

    @staticmethod
    def learn(
        motor: Map,
        u: Array,
        sensory: Map,
        v: Array,
        wiring: Wiring,
    ) -> Association:
        """Link two maps by samples (n, dof) and (n, 2) in their unit boxes."""
        a_i, a_j = side_by_side(
            partial(wiring.activity, motor, u),
            partial(wiring.activity, sensory, v),
        )
        together = (a_i.T @ a_j).tocsr()  # sums of a_i a_j
        motor_sums = _sums(motor, a_i, u)
        sensory_sums = _sums(sensory, a_j, v)
        return Association(
            motor,
            sensory,
            wiring.link(together, motor_sums[:, -1], sensory_sums[:, -1]),
            wiring,
            _shifts(motor, motor_sums),
            _shifts(sensory, sensory_sums),
        )

    def predict(self, q: Array, readout: str = "activity") -> Array:
        """Positions (n, m) that a readout gives for joints (n, dof), both in their own units."""
        u = self.motor.scale.to_unit(np.atleast_2d(np.asarray(q, dtype=float)))
        return self.sensory.scale.from_unit(self.forward(u, readout))

    def forward(self, u: Array, readout: str) -> Array:
        """Positions in the sensory unit box (n, 2) for joints `u` (n, dof) in theirs."""
        if readout == "winner":
            return self.sensory.units[
                self._strongest_partner[self.motor.nearest(u)[1][:, 0]]
            ]
        if readout == "linear":
            return self.sensory.scale.to_unit(self.linear.value(u))
        a = self.wiring.activity(self.motor, u)
        # sum_i a_i c_ij w_j / sum_i a_i c_ij
        total = a @ self._strength
        predicted = (
            np.asarray(a @ self._partner_sums)
            / np.where(total > 0, total, 1.0)[:, None]
        )
        unlinked = np.flatnonzero(~(total > 0))
        if len(unlinked):
            predicted[unlinked] = self.forward(u[unlinked], "winner")
        return predicted

    def inverses(self, v: Array, near: Array) -> dict[str, Array]:
        """Joints in the unit box (n, dof) for positions `v` (n, 2) in theirs, by readout.

        Of the winner's branches the one closest to `near` (n, dof) answers: ``winner`` with its
        strongest partner there, ``activity`` with the mean of that cluster of nodes, ``linear``
        with a regression on the sensory nodes' mean activity positions.
        """
        scale = self.motor.scale
        clusters = self.clusters
        winner = self.sensory.nearest(v)[1][:, 0]
        branch = clusters.nearest(winner, near, scale)
        anchor = clusters.center[winner, branch]
        # of each active node the cluster on the same branch, where it has one there
        nodes, activity = self.wiring.active_nodes(self.sensory, v)
        cluster = clusters.nearest(nodes, anchor[:, None], scale)
        step = scale.difference(
            clusters.center[nodes, cluster], anchor[:, None]
        )
        distance = np.linalg.norm(step, axis=2)
        on_branch = distance <= READOUT.core * self.motor.spacing
        strength = clusters.strength[nodes, cluster]
        weight = np.where(on_branch, activity * strength, 0.0)
        weight[:, 0] += 1e-300
        total = weight.sum(axis=1, keepdims=True)
        mean = np.einsum("nk,nkd->nd", weight, step) / total
        places = _places(self.sensory, self.sensory_shifts)
        place = places[nodes] - v[:, None]
        middle, value, slope = regress(place, step, weight)
        return {
            "linear": anchor + value - np.einsum("nd,ndo->no", middle, slope),
            "activity": anchor + mean,
            "winner": self.motor.units[clusters.core[winner, branch]],
        }

    @cached_property
    def linear(self) -> LinearModels:
        """The forward direction of the readout ``linear``, with slopes [unit]."""
        motor = self.motor
        strength = self._strength
        means = _places(motor, self.motor_shifts)
        partners = (
            self._partner_sums / np.where(strength > 0, strength, 1.0)[:, None]
        )
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
        return np.asarray(self.links.sum(axis=1), dtype=float).ravel()

    @cached_property
    def _partner_sums(self) -> Array:
        return self.links @ self.sensory.units

    @cached_property
    def _strongest_partner(self) -> Index:
        """Sensory node most strongly linked to each motor node, or to the nearest linked one."""
        source = self.motor.nearest_of(np.diff(self.linked.indptr) > 0)
        return np.asarray(self.links.argmax(axis=1)).ravel()[source]

    @cached_property
    def partners(self) -> SparseRows:
        """Links by sensory node, (sensory nodes, motor nodes), or those of the nearest linked."""
        links = self.linked.transposed()
        return links.take(self.sensory.nearest_of(np.diff(links.indptr) > 0))

    @cached_property
    def clusters(self) -> Clusters:
        """The branches of each sensory node."""
        links = self.partners
        motor = self.motor
        sensory_node = links.rows
        motor_node = links.indices.astype(np.intp)
        label = _cluster_labels(links, motor)
        # the strongest link of each cluster, and of the cluster of each link
        order = np.lexsort((-links.data, label))
        begins = np.append(True, np.diff(label[order]) > 0)
        strongest = order[begins]
        core = motor.units[motor_node[strongest]]
        gap = motor.scale.difference(motor.units[motor_node], core[label])
        inside = np.linalg.norm(gap, axis=1) <= READOUT.core * motor.spacing
        weight = np.where(inside, links.data, 0.0)
        total = np.bincount(label, weight)
        sums = [np.bincount(label, weight * g) for g in gap.T]
        center = core + np.stack(sums, axis=1) / total[:, None]
        # clusters of each sensory node, the strongest first
        owners = sensory_node[strongest]
        rank = np.lexsort((-links.data[strongest], owners))
        owner = owners[rank]
        column = np.arange(len(owner)) - np.searchsorted(owner, owner)
        strong = column < READOUT.most_clusters
        columns = int(column[strong].max()) + 1
        table = np.full((links.shape[0], columns), -1)
        table[owner[strong], column[strong]] = rank[strong]
        strength = np.where(table >= 0, total[table], 0.0)
        return Clusters(center[table], strength, motor_node[strongest][table])


def _cluster_labels(links: SparseRows, motor: Map) -> Index:
    """Cluster of each link: those of one sensory node to motor nodes that are close to each other.

    links : (sensory nodes, motor nodes)
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    count = len(links.indices)
    around = 3 ** min(motor.units.shape[1], 3)
    distance, near = motor.nearest(motor.units, min(around, motor.size))
    close = distance <= READOUT.joined * motor.spacing
    # links have ascending keys: those of the same sensory node to a close motor node
    rows = links.rows * motor.size
    keys = rows + links.indices
    sought = rows[:, None] + near[links.indices]
    place = np.minimum(np.searchsorted(keys, sought), count - 1)
    one, column = np.nonzero(close[links.indices] & (keys[place] == sought))
    pairs = (one, place[one, column])
    graph = coo_array((np.ones(len(one)), pairs), (count, count))
    label: Index = connected_components(graph)[1].astype(np.intp)
    return label


def _sums(network: Map, activity: csr_array, u: Array) -> Array:
    """Sums over samples (n, d), (nodes, d + 2): activity times offset from the node, a and a^2."""
    rows = np.repeat(np.arange(len(u)), np.diff(activity.indptr))
    gap = network.scale.difference(u[rows], network.units[activity.indices])
    a = activity.data
    columns = (*(a * c for c in gap.T), a, a * a)
    return np.stack(
        [np.bincount(activity.indices, c, network.size) for c in columns],
        axis=1,
    )


def _shifts(network: Map, sums: Array) -> Array:
    """Mean offsets (nodes, d) [node spacings]; a node that was never active has none."""
    active = np.where(sums[:, -2] > READOUT.active, sums[:, -2], np.inf)
    shifts = sums[:, :-2] * (1.0 / active)[:, None] / network.spacing
    return np.asarray(
        np.clip(shifts, -READOUT.furthest, READOUT.furthest).astype(np.float16),
        dtype=float,
    )


def _places(network: Map, shifts: Array | None) -> Array:
    """Where nodes are active (nodes, d), in the unit box."""
    return (
        network.units
        if shifts is None
        else network.units + shifts * network.spacing
    )
