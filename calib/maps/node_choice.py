"""Node choice: each motor node its own complexity, where a smooth part is wrong.

One pair of degree and samples for all nodes lets a local defect spoil every answer: what
follows the defect fits noise elsewhere.  So nodes that speak where held-out residuals stand
out choose for themselves, by the held-out errors of the rows around them, and the others
have what serves the calm rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from . import local_models as local
from .local_models import LocalModels, Neighbourhood
from .map import Map, search_tree

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Shape = tuple[int, int]
"""Degree of a local model and the number of samples that it is fitted to."""

_GROUPS = 3  # of folds, held out in turn
_AROUND = 60  # rows by which a node chooses, besides those that it speaks for
_TURNS = 9  # rounds in which nodes reconsider
_COLOURS = 3  # of which each node takes part in every third
_CARE = 0.9  # power of what was there by which distances are shared: 0 none, 1 in full
_PRICE = 0.01  # share of the distances by which another choice must mend them
_RUN = 20  # neighbouring rows that may be repeats of each other
_SURE = 2.0  # standard errors by which a local model must win over none


@dataclass(frozen=True, eq=False)
class NodeChoice:
    """What the nodes that speak where the smooth part is wrong have chosen.

    Attributes
    ----------
    nodes : (k,) int array
        These nodes.
    shape : (k,) int array
        Which of the shapes each has, -1 for none.
    rows : (m,) int array
        Rows that they speak for.
    residual : (m, o) array [unit]
        What remained of these rows while they were held out.
    """

    nodes: Index
    shape: Index
    rows: Index
    residual: Array = field(repr=False)

    @staticmethod
    def of(
        motor: Map,
        u: Array,
        unseen: Sequence[Array],
        folds: Sequence[Index],
        wrong: NDArray[np.bool_],
        shapes: Sequence[Shape],
        common: Shape | None,
    ) -> NodeChoice:
        """Let the nodes choose.

        Parameters
        ----------
        motor : Map
        u : (n, dof) array
            Joints of the rows, in the unit box.
        unseen : sequence of (n, o) arrays
            For each fold the residuals of a smooth part that has not seen its rows.
        folds : sequence of int arrays
            Contiguous blocks of rows.
        wrong : (n,) bool array
            Rows where the smooth part is wrong.
        shapes : sequence of (degree, samples)
        common : (degree, samples) or None
            What serves the calm rows: nodes that are not sure of a better one have it.
        """
        index, weight, gap = local.speaking(motor, u)
        nodes = np.unique(index[wrong]) if common is None else np.arange(motor.size)
        place = np.full(motor.size, -1)
        place[nodes] = np.arange(len(nodes))
        rows = np.flatnonzero((place[index] >= 0).any(axis=1))
        index, weight, gap = place[index[rows]], weight[rows], gap[rows]
        weight = np.where(index >= 0, weight, 0.0)
        target, said = _held_out(motor, nodes, u, unseen, folds, rows, index, gap, shapes)
        said = [each * weight[..., None] for each in said]
        square = np.empty((len(shapes) + 1, len(rows)))
        square[0] = np.einsum("no,no->n", target, target)
        for k, each in enumerate(said):
            gap = target - each.sum(axis=1)
            square[k + 1] = np.einsum("no,no->n", gap, gap)
        usual = 0 if common is None else list(shapes).index(common) + 1
        chosen = _least(motor, nodes, u[rows], index, square, usual) - 1
        chosen, remains = _settled(target, said, index, chosen, len(nodes))
        return NodeChoice(nodes, chosen, rows, remains)

    def remaining(self, rows: Index, otherwise: Array) -> Array:
        """What remained of some rows (k, o); `otherwise` where none of these nodes speaks."""
        place = np.minimum(np.searchsorted(self.rows, rows), len(self.rows) - 1)
        mine = self.rows[place] == rows
        return np.where(mine[:, None], self.residual[place], otherwise)

    def models(
        self,
        motor: Map,
        u: Array,
        residual: Array,
        shapes: Sequence[Shape],
        common: Shape | None,
    ) -> LocalModels:
        """Local models of all nodes, fitted to all rows; `common` is the others' shape."""
        choice = np.full(motor.size, -1 if common is None else list(shapes).index(common))
        choice[self.nodes] = self.shape
        return fit_each(motor, u, residual, shapes, choice)


def fit_each(
    motor: Map, u: Array, residual: Array, shapes: Sequence[Shape], choice: Index
) -> LocalModels:
    """Local models of each node's own shape, (nodes,) indices into `shapes`, -1 for none.

    A node whose rows do not carry its polynomial has one of a lower degree, and one that is far
    from all rows has none.
    Coefficients are those of the largest degree; a node of a lower one has zeros.
    """
    from ..body.basis import exponents

    used = [shapes[k] for k in np.unique(choice[choice >= 0])]
    if not used:
        return local.NO_MODELS
    degree, dof = max(d for d, _ in used), u.shape[1]
    terms = len(exponents(dof, degree))
    coefficients = np.zeros((motor.size, terms, residual.shape[1]))
    radius = np.full(motor.size, motor.spacing)
    for k, (own, samples) in enumerate(shapes):
        nodes = np.flatnonzero(choice == k)
        if len(nodes):
            at, spacings = motor.units[nodes], motor.spacings[nodes]
            found = local.fit(at, u, residual, motor.scale, own, samples, spacings=spacings)
            coefficients[nodes, : found.coefficients.shape[1]] = found.coefficients
            radius[nodes] = found.radius
    coefficients *= local.near_rows(motor, u)[:, None, None]
    return LocalModels(degree, max(k for _, k in used), radius, coefficients)


def _held_out(
    motor: Map,
    nodes: Index,
    u: Array,
    unseen: Sequence[Array],
    folds: Sequence[Index],
    rows: Index,
    index: Index,
    gap: Array,
    shapes: Sequence[Shape],
) -> tuple[Array, list[Array]]:
    """Residuals of the rows (m, o), and what each node says of them by shape (m, nodes, o)."""
    outputs = unseen[0].shape[1]
    target = np.empty((len(rows), outputs))
    said = [np.zeros((*index.shape, outputs)) for _ in shapes]
    most = max(k for _, k in shapes)
    for group in range(min(_GROUPS, len(folds))):
        mine, parts = folds[group::_GROUPS], unseen[group::_GROUPS]
        out = np.zeros(len(u), dtype=bool)
        out[np.concatenate(mine)] = True
        others = np.flatnonzero(~out)
        left = np.concatenate([part[others] for part in parts], axis=1)  # each fold's smooth part
        around = Neighbourhood.of(motor.units[nodes], u[others], motor.scale, most)
        inside = [np.flatnonzero((rows >= fold[0]) & (rows <= fold[-1])) for fold in mine]
        for held, part in zip(inside, parts, strict=True):
            target[held] = part[rows[held]]
        for k, (degree, samples) in enumerate(shapes):
            models = local.fit(
                motor.units[nodes],
                u[others],
                left,
                motor.scale,
                degree,
                samples,
                around,
                motor.spacings[nodes],
            )
            every = models.coefficients.reshape(*models.coefficients.shape[:2], -1, outputs)
            for fold, held in enumerate(inside):
                own = replace(models, coefficients=every[:, :, fold])
                said[k][held] = local.contributions(own, index[held], gap[held])
    return target, said


def _least(motor: Map, nodes: Index, u: Array, index: Index, square: Array, usual: int) -> Index:
    """Best choice of `square` (choices, m) for each node by the rows around it, or the usual."""
    from scipy.sparse import csr_array

    near = min(_AROUND, len(u))
    inside = np.where(motor.scale.periodic, motor.units[nodes] % 1.0, motor.units[nodes])
    close = np.asarray(search_tree(u, motor.scale).query(inside, k=np.arange(1, near + 1))[1])
    speaks = np.nonzero(index >= 0)
    pairs = np.concatenate(
        [
            np.repeat(np.arange(len(nodes)), near) * len(u) + close.ravel(),
            index[speaks] * len(u) + speaks[0],
        ]
    )
    node, row = np.divmod(np.unique(pairs), len(u))
    judge = csr_array((np.ones(len(node)), (node, row)), shape=(len(nodes), len(u)))
    count = np.asarray(judge.sum(axis=1), dtype=float).ravel()
    gain = square[usual] - square
    mean = (judge @ gain.T) / count[:, None]
    sure = mean > _SURE * _standard_errors(node, row, gain, mean, count)
    score = np.where(sure, mean, 0.0)
    best = score.argmax(axis=1)
    return np.asarray(np.where(score.max(axis=1) > 0.0, best, usual), dtype=np.intp)


def _standard_errors(node: Index, row: Index, gain: Array, mean: Array, count: Array) -> Array:
    """Standard errors of the mean gains (nodes, choices): runs of rows count as one.

    Neighbouring rows of a log can be near-repeats; sums within a run are compared, which of
    rows in random order are the rows themselves.
    """
    run, place = np.unique(node * (row.max() // _RUN + 1) + row // _RUN, return_inverse=True)
    owner = run // (row.max() // _RUN + 1)
    errors = np.empty_like(mean)
    for k, each in enumerate(gain):
        away = np.bincount(place, each[row] - mean[node, k], len(run))
        errors[:, k] = np.sqrt(np.bincount(owner, away**2, len(mean))) / count
    return errors


def _settled(
    target: Array, said: Sequence[Array], index: Index, chosen: Index, nodes: int
) -> tuple[Index, Array]:
    """The choices (nodes,) once no node gains by another, and what remains (m, o).

    Nodes were compared as if all had the same shape; here each is judged beside the others
        as they are, by the distances that remain at the rows it speaks for, each as a share of
    what was there: a calm row beside a defect counts as much as one within.  Only some may
    change at a time, so that two neighbours do not both mend the same rows.
    """
    every = np.stack([np.zeros_like(said[0]), *said])  # (1 + shapes, m, nodes of a row, o)
    row, column = np.nonzero(index >= 0)
    node = index[row, column]
    every = every[:, row, column]  # (1 + shapes, pairs, o)
    chosen = chosen.copy()
    size = np.linalg.norm(target, axis=1)
    share = 1.0 / (size + np.median(size))[row] ** _CARE
    for turn in range(_TURNS):
        now = every[chosen[node] + 1, np.arange(len(node))]
        remains = target - _per_row(row, now, len(target))
        before = share * np.linalg.norm(remains, axis=1)[row]
        gains = []
        for new in every:
            after = share * np.linalg.norm(remains[row] + now - new, axis=1)
            gains.append(np.bincount(node, before - after, nodes))
        score: Array = np.stack(gains).astype(float)
        # the price keeps a choice that is as good but for chance; none is chosen without
        score[1:] -= _PRICE * np.bincount(node, before, nodes)
        best, gain = score.argmax(axis=0) - 1, score.max(axis=0)
        moves = (gain > 0.0) & (best != chosen) & (np.arange(nodes) % _COLOURS == turn % _COLOURS)
        chosen = np.where(moves, best, chosen)
    now = every[chosen[node] + 1, np.arange(len(node))]
    return chosen, target - _per_row(row, now, len(target))


def _per_row(row: Index, values: Array, rows: int) -> Array:
    """Sums of the values (pairs, o) of each row, (rows, o)."""
    return np.stack([np.bincount(row, column, rows) for column in values.T], axis=1)
