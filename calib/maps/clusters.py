"""Clusters: the motor nodes linked to a sensory node, grouped into branches of the inverse."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..common.arrays import Array, Index
from ..common.rows import components, group_sums, row_lengths
from ..common.scale import Scale
from .links import SparseRows, entry_rows
from .map import Map
from .settings import READOUT

if TYPE_CHECKING:
    from scipy.sparse import csr_array


@dataclass(frozen=True)
class Clusters:
    """Motor nodes linked to each sensory node, in up to c clusters: one for each branch.

    A sensory node's cluster with the strongest link comes first.
    """

    centre: Array  # (sensory nodes, c, dof), mean of the motor nodes, weighted by their links
    # (sensory nodes, c), sum of its links, 0 where there is no such cluster
    strength: Array
    # (sensory nodes, c), motor node with the strongest link of each cluster
    core: Index

    @staticmethod
    def of(links: SparseRows, motor: Map) -> Clusters:
        """Clusters of links (sensory nodes, motor nodes), of which each sensory node has some."""
        motor_node = links.indices.astype(np.intp)
        label = _cluster_labels(links, motor)
        # the strongest link of each cluster, in the order of labels: its core
        order = np.lexsort((-links.data, label))
        is_next = np.diff(label[order]) > 0
        begins = np.append(True, is_next)
        strongest = order[begins]
        core = motor_node[strongest]
        # the link-weighted mean of each cluster, of the nodes around its core
        place = motor.units[core]
        linked = motor.units[motor_node]
        gap = motor.scale.difference(linked, place[label])
        distance = row_lengths(gap)
        inside = distance <= READOUT.core * motor.spacing
        weight = np.where(inside, links.data, 0.0)
        total = group_sums(label, weight)
        offsets = group_sums(label, weight[:, None] * gap)
        centre = place + offsets / total[:, None]
        table = _table_of_clusters(links, strongest)
        strength = np.where(table >= 0, total[table], 0.0)
        return Clusters(centre[table], strength, core[table])

    def nearest(self, nodes: Index, place: Array, scale: Scale) -> Index:
        """Which cluster (...) of sensory nodes (...) is nearest to places (..., dof)."""
        centres = self.centre[nodes]
        gap = scale.difference(centres, place[..., None, :])
        distance = np.linalg.norm(gap, axis=-1)
        exists = self.strength[nodes] > 0
        distance = np.where(exists, distance, np.inf)
        return np.asarray(distance.argmin(axis=-1))


def _table_of_clusters(links: SparseRows, strongest: Index) -> Index:
    """Labels (sensory nodes, c) of each sensory node's clusters, the strongest first, else -1.

    links : (sensory nodes, motor nodes)
    strongest : (clusters,), the strongest link of each
    """
    owners = links.rows[strongest]
    order = np.lexsort((-links.data[strongest], owners))
    owner = owners[order]
    first = np.searchsorted(owner, owner)
    column = np.arange(len(owner)) - first
    strong = column < READOUT.most_clusters
    columns = int(column[strong].max()) + 1
    nodes = links.shape[0]
    table = np.full((nodes, columns), -1)
    table[owner[strong], column[strong]] = order[strong]
    return table


def _cluster_labels(links: SparseRows, motor: Map) -> Index:
    """Cluster of each link: links of a sensory node to motor nodes close to each other share one.

    links : (sensory nodes, motor nodes)
    """
    count = len(links.indices)
    neighbours = _close_nodes(motor)[links.indices]
    link = entry_rows(neighbours.indptr)
    # links are in the order of their keys; look for those of the same node to close motor nodes
    rows = links.rows * motor.size
    keys = rows + links.indices
    neighbour_keys = rows[link] + neighbours.indices
    place = np.searchsorted(keys, neighbour_keys)
    place = np.minimum(place, count - 1)
    exists = keys[place] == neighbour_keys
    return components(count, link[exists], place[exists])


def _close_nodes(motor: Map) -> csr_array:
    """Pairs of a motor node and a later one close to it, (motor nodes, motor nodes)."""
    from scipy.sparse import coo_array

    around = 3 ** min(motor.units.shape[1], 3)
    k = min(around, motor.size)
    distance, near = motor.nearest(motor.units, k)
    node, column = np.nonzero(distance <= READOUT.joined * motor.spacing)
    other = near[node, column]
    is_apart = node != other
    first = np.minimum(node, other)[is_apart]
    second = np.maximum(node, other)[is_apart]
    ones = np.ones(len(first))
    shape = (motor.size, motor.size)
    # what is there twice is added up
    return coo_array((ones, (first, second)), shape).tocsr()
