"""Readouts of the links: ``winner``, ``activity`` and ``linear``, in both directions."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Annotated

import numpy as np

from ..common.arrays import Array, Index, Shape, freeze
from ..common.choices import READOUTS
from ..common.parallel import side_by_side
from ..errors import OptionError
from .linear_models import LinearModels, regress
from .links import WIRINGS, Compressed, Wiring
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


@dataclass(frozen=True)
class Association:
    """Two maps and the links between them.

    Attributes
    ----------
    motor, sensory : Map
    linked : Compressed of shape (motor nodes, sensory nodes)
        Strength c_ij of each connection; `links` is the same as a csr_array.
    wiring : Wiring
        How they were learned (eq. 5) and how active nodes are (eq. 6).
    motor_shifts, sensory_shifts : (nodes, dof), (nodes, m) array, optional
        Mean position of the samples at which each node was active, less its weight, in node
        spacings and half precision, as a model file keeps it; 0 where not known.
    """

    motor: Map
    sensory: Map
    linked: Compressed
    wiring: Wiring = WIRINGS["reciprocal"]
    motor_shifts: Annotated[Array, Shape("nodes", "dof", kept="f2")] | None = (
        None
    )
    sensory_shifts: (
        Annotated[Array, Shape("places", "width", kept="f2")] | None
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
        motor: Map, u: Array, sensory: Map, v: Array, wiring: Wiring
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
            np.asarray(a @ self._weighted)
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
        a = self.wiring.activity(self.sensory, v)
        n = len(v)
        k = a.nnz // max(n, 1)
        nodes = a.indices.reshape(n, k)
        weight = a.data.reshape(n, k)
        winner = self.sensory.nearest(v)[1][:, 0]
        away = np.linalg.norm(
            scale.difference(clusters.center[winner], near[:, None]), axis=2
        )
        branch = np.where(clusters.strength[winner] > 0, away, np.inf).argmin(
            axis=1
        )
        anchor = clusters.center[winner, branch]
        gap = scale.difference(clusters.center[nodes], anchor[:, None, None])
        far = np.linalg.norm(gap, axis=3) + np.where(
            clusters.strength[nodes] > 0, 0.0, np.inf
        )
        best = far.argmin(axis=2)[..., None]
        close = (
            np.take_along_axis(far, best, 2)[..., 0]
            <= READOUT.core * self.motor.spacing
        )
        strength = np.take_along_axis(clusters.strength[nodes], best, 2)[..., 0]
        weight = np.where(close, weight * strength, 0.0)
        weight[:, 0] += 1e-300
        step = np.take_along_axis(gap, best[..., None], 2)[:, :, 0]
        places = _places(self.sensory, self.sensory_shifts)
        middle, value, slope = regress(places[nodes] - v[:, None], step, weight)
        mean = np.einsum("nk,nkd->nd", weight, step) / weight.sum(
            axis=1, keepdims=True
        )
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
            self._weighted / np.where(strength > 0, strength, 1.0)[:, None]
        )
        inside = motor.scale.wrapped(motor.units)
        predicted = self.sensory.scale.from_unit(partners)
        return LinearModels.of(
            motor,
            means,
            predicted,
            strength,
            self.wiring.activity(motor, inside),
        )

    @cached_property
    def _strength(self) -> Array:
        return np.asarray(self.links.sum(axis=1), dtype=float).ravel()

    @cached_property
    def _weighted(self) -> Array:
        return self.links @ self.sensory.units

    @cached_property
    def _strongest_partner(self) -> Index:
        """Sensory node most strongly linked to each motor node, or to the nearest linked one."""
        source = self.motor.nearest_of(np.diff(self.linked.indptr) > 0)
        return np.asarray(self.links.argmax(axis=1)).ravel()[source]

    @cached_property
    def partners(self) -> Compressed:
        """Links by sensory node, (sensory nodes, motor nodes), or those of the nearest linked."""
        links = self.linked.transposed()
        return links.take(self.sensory.nearest_of(np.diff(links.indptr) > 0))

    @cached_property
    def clusters(self) -> Clusters:
        """The branches of each sensory node."""
        from scipy.sparse import coo_array, csr_array
        from scipy.sparse.csgraph import connected_components

        links = self.partners
        motor = self.motor
        j = links.rows
        i = links.indices.astype(np.intp)
        # two links of one sensory node are joined where their motor nodes are close
        link_numbers = np.arange(1, len(i) + 1)
        columns = csr_array(
            (link_numbers, links.indices, links.indptr), links.shape
        ).tocsc()
        one, two = (columns[:, nodes] for nodes in _close_nodes(motor))
        met = one.astype(bool).multiply(two.astype(bool))
        pairs = [csr_array(part.multiply(met)).data - 1 for part in (one, two)]
        graph = coo_array((np.ones(len(pairs[0])), pairs), (len(i),) * 2)
        label = connected_components(graph)[1].astype(np.intp)

        order = np.lexsort((-links.data, label))
        first = order[
            np.append(True, np.diff(label[order]) > 0)
        ]  # strongest link of each cluster
        core = first[label]  # the strongest link of the same cluster
        gap = motor.scale.difference(motor.units[i], motor.units[i[core]])
        weight = np.where(
            np.linalg.norm(gap, axis=1) <= READOUT.core * motor.spacing,
            links.data,
            0.0,
        )
        total = np.bincount(label, weight)
        shift = np.stack(
            [np.bincount(label, weight * g) for g in gap.T], axis=1
        )
        center = motor.units[i[first]] + shift / total[:, None]
        # clusters of each sensory node, the strongest first
        rank = np.lexsort((-links.data[first], j[first]))
        owner = j[first][rank]
        column = np.arange(len(owner)) - np.searchsorted(owner, owner)
        strong = column < READOUT.most_clusters
        table = np.full((links.shape[0], int(column[strong].max()) + 1), -1)
        table[owner[strong], column[strong]] = rank[strong]
        strength = np.where(table >= 0, total[table], 0.0)
        return Clusters(center[table], strength, i[first][table])


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
    share = np.where(
        sums[:, -2] > READOUT.active,
        1.0 / np.maximum(sums[:, -2], READOUT.active),
        0.0,
    )
    shifts = sums[:, :-2] * share[:, None] / network.spacing
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


def _close_nodes(network: Map) -> tuple[Index, Index]:
    """Pairs of nodes that are close to each other, the first ones and the second."""
    n, dim = network.units.shape
    distance, near = network.nearest(network.units, min(3 ** min(dim, 3), n))
    one, column = np.nonzero(distance <= READOUT.joined * network.spacing)
    two = near[one, column]
    pair = np.unique(np.minimum(one, two) * n + np.maximum(one, two))
    one, two = np.divmod(pair, n)
    apart = one < two
    return one[apart], two[apart]
