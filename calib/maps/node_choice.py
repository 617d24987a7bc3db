"""Node choice: each motor node its own complexity, where a smooth part is wrong.

One pair of degree and samples for all nodes lets a local defect spoil every answer: what
follows the defect fits noise elsewhere.  So nodes that speak where held-out residuals stand
out choose for themselves, by the held-out errors of the rows around them, and the others
have what serves the calm rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..body.basis import exponents
from ..common.arrays import Array, Index
from . import local_models as local
from .gates import find_gates, opening
from .local_models import LocalModels
from .map import Map, nearest_points

Shape = tuple[int, int]
"""Degree of a local model and the number of samples that it is fitted to."""

_TURNS = 9  # rounds in which nodes reconsider
_COLOURS = 3  # of which each node takes part in every third
_SURE = 1.0  # standard errors by which another choice must win
_RUNS = 3  # that tell whether one is sure
_RUN = 20  # neighbouring rows that may be repeats of each other
_AROUND = 5  # rows whose median residual tells whether a row is calm
_BESIDE = 20  # rows of which one has to be wrong for a calm row to lie beside a defect
_GAPS = 8  # neighbours of such a row towards which the gap between rows is watched
_NONE = 3.0  # of a mean of noise's own variance: a smaller one is taken for no residual
_CALM = 0.99  # quantile of that median where the smooth part is right
_HARM = 30.0  # weight of a calm row: what mends a defect must not spoil what is right beside it


@dataclass(frozen=True, eq=False)
class NodeChoice:
    """What the nodes that speak where the smooth part is wrong have chosen."""

    shape: Index  # (nodes,), which of the shapes each node has, -1 for none
    rows: Index  # (m,), rows that those speak for which chose for themselves
    # (m, o) [unit], what remained of these rows while they were held out
    residual: Array = field(repr=False)
    gates: Array | None = field(repr=False)  # of all nodes, see :mod:`calib.maps.gates`

    @staticmethod
    def of(
        motor: Map,
        u: Array,
        unseen: Sequence[Array],
        folds: Sequence[Index],
        wrong: NDArray[np.bool_],
        shapes: Sequence[Shape],
        common: int,
    ) -> NodeChoice:
        """Let the nodes choose.

        u : (n, dof), joints of the rows, in the unit box
        unseen : sequence of (n, o) arrays, for each fold the residuals of a smooth part that has
            not seen its rows
        folds : sequence of int arrays, contiguous blocks of rows
        wrong : (n,), rows where the smooth part is wrong
        common : which of the shapes serves the calm rows, -1 for none: nodes that are not sure of
            a better one have it
        """
        index, weight, gap = local.speaking(motor, u)
        nodes = np.unique(index[wrong]) if common < 0 else np.arange(motor.size)
        place = np.full(motor.size, -1)
        place[nodes] = np.arange(len(nodes))
        rows = np.flatnonzero((place[index] >= 0).any(axis=1))
        held = np.concatenate([part[fold] for part, fold in zip(unseen, folds, strict=True)])
        calm, beside, between, usually, known = _calm(motor, u, held, wrong)
        square = np.einsum("no,no->n", held, held)
        gates = find_gates(motor, u, square, calm, held.shape[1]) if calm.any() else None
        mostly = _mostly(motor, u, index, weight, ~calm)[nodes]
        more = local.speaking(motor, between)
        index = place[np.concatenate([index[rows], more[0]])]
        weight, gap = np.concatenate([weight[rows], more[1]]), np.concatenate([gap[rows], more[2]])
        owner = np.concatenate([rows, beside])
        predicted = held_out(motor, nodes, u, unseen, folds, owner, index, gap, shapes)
        if gates is not None:
            predicted *= opening(gates[nodes[index]], gap)[..., None]
        target = np.concatenate([known[rows], usually])
        calm = np.concatenate([calm[rows], np.ones(len(beside), dtype=bool)])
        square, quiet = square[rows], calm[: len(rows)]
        noise = max(float(np.mean(square[quiet]) if quiet.any() else np.median(square)), 1e-300)
        chosen, remains = _settled(
            owner, target, predicted, index, weight, calm, noise, mostly, common
        )
        # what is reported are the rows as they were measured
        remains = remains[: len(rows)] + held[rows] - known[rows]
        shape = np.full(motor.size, common)
        shape[nodes] = chosen
        return NodeChoice(shape, rows, remains, gates)

    def remaining(self, rows: Index, otherwise: Array) -> Array:
        """What remained of some rows (k, o); `otherwise` where none of these nodes speaks."""
        place = np.minimum(np.searchsorted(self.rows, rows), len(self.rows) - 1)
        mine = self.rows[place] == rows
        return np.where(mine[:, None], self.residual[place], otherwise)


def fit_each(
    motor: Map,
    u: Array,
    residual: Array,
    shapes: Sequence[Shape],
    choice: Index,
    gates: Array | None = None,
) -> LocalModels:
    """Local models of each node's own shape, (nodes,) indices into `shapes`, -1 for none.

    A node whose rows do not carry its polynomial has one of a lower degree, and one that is far
    from all rows has none.
    Coefficients are those of the largest degree; a node of a lower one has zeros.
    """
    used = [shapes[k] for k in np.unique(choice[choice >= 0])]
    if not used:
        return local.NO_MODELS
    degree = max(d for d, _ in used)
    terms = len(exponents(u.shape[1], degree))
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
    most = max(samples for _, samples in used)
    return LocalModels(degree, most, radius, coefficients, gates=gates)


def held_out(
    motor: Map,
    nodes: Index,
    u: Array,
    unseen: Sequence[Array],
    folds: Sequence[Index],
    rows: Index,
    index: Index,
    gap: Array,
    shapes: Sequence[Shape],
) -> Array:
    """What each node that has not seen a row says of it, (1 + shapes, m, nodes, o)."""
    outputs = unseen[0].shape[1]
    predicted = np.zeros((1 + len(shapes), *index.shape, outputs))  # the first says nothing
    most = max(k for _, k in shapes)
    for fold, residual in zip(folds, unseen, strict=True):
        held = np.flatnonzero((rows >= fold[0]) & (rows <= fold[-1]))
        speak, place = np.unique(index[held], return_inverse=True)
        at, spacings = motor.units[nodes[speak]], motor.spacings[nodes[speak]]
        others = np.setdiff1d(np.arange(len(u)), fold, assume_unique=True)
        around = nearest_points(u[others], motor.scale, at, most + 1)
        for k, (degree, samples) in enumerate(shapes):
            models = local.fit(
                at, u[others], residual[others], motor.scale, degree, samples, around, spacings
            )
            each = local.contributions(models, place.reshape(-1, index.shape[1]), gap[held])
            predicted[k + 1, held] = np.where(index[held][..., None] >= 0, each, 0.0)
    return predicted


def _mostly(
    motor: Map, u: Array, index: Index, weight: Array, wrong: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Which nodes (nodes,) speak mostly for wrong rows; those that speak for none: stand there."""
    of_node = np.bincount(index.ravel(), weight.ravel(), motor.size)
    of_wrong = np.bincount(index.ravel(), (weight * wrong[:, None]).ravel(), motor.size)
    mostly = np.asarray(of_wrong > 0.5 * of_node)
    alone = np.flatnonzero(of_node == 0.0)
    mostly[alone] = wrong[nearest_points(u, motor.scale, motor.units[alone])[1][:, 0]]
    return mostly


def _calm(
    motor: Map, u: Array, held: Array, wrong: NDArray[np.bool_]
) -> tuple[NDArray[np.bool_], Index, Array, Array, Array]:
    """Rows (n,) around which the smooth part is right, and places between those beside others.

    A median of a few rows tells sooner on which side of a sharp edge a row lies than the mean
    of many by which a defect is found.  Calm rows alone do not hold a steep polynomial in
    the gaps between them: a place halfway to a calm neighbour counts as one more row.

    Returns calm : (n,)
    Returns row, place, residual : (k,), (k, d), (k, o), of each such place a row, itself in the
        unit box, and the mean of the calm rows around
    Returns known : (n, o), residuals of all rows, zero where nothing but noise is known of them
    """
    near = nearest_points(u, motor.scale, u, _BESIDE)[1]
    if wrong.all():
        return ~wrong, near[:0, 0], u[:0], held[:0], held
    square = np.einsum("no,no->n", held, held)
    middle = np.median(square[near[:, :_AROUND]], axis=1)
    calm = np.asarray(middle <= np.quantile(middle[~wrong], _CALM))
    beside = calm & ~calm[near].all(axis=1)
    row, k = np.nonzero(calm[near[:, 1 : _GAPS + 1]] & beside[:, None])
    # their mean: nothing beside a sharp edge, the slope of a wide defect
    count = np.count_nonzero(calm[near], axis=1)
    residual = np.einsum("nk,nko->no", calm[near] / np.maximum(count, 1)[:, None], held[near])
    # Judged by its own noisy residual, every second correction of a calm row seems to help.
    # So where the mean of mostly calm rows is no larger than that of noise, it counts as zero;
    # with zero for all calm rows a ripple would not be mended where it crosses zero.
    noise = _NONE * square[calm].mean() / np.maximum(count, 1)
    nothing = (
        calm & (count >= near.shape[1] / 2) & (np.einsum("no,no->n", residual, residual) < noise)
    )
    residual[nothing] = 0.0
    known = np.where(nothing[:, None], 0.0, held)
    place = u[row] + 0.5 * motor.scale.difference(u[near[row, k + 1]], u[row])
    return calm, row, place, residual[row], known


def _settled(
    rows: Index,
    target: Array,
    predicted: Array,
    index: Index,
    weight: Array,
    calm: NDArray[np.bool_],
    noise: float,
    mostly: NDArray[np.bool_],
    usual: int,
) -> tuple[Index, Array]:
    """The choices (nodes,) once no node gains by another, and what remains (m, o).

    The cost of a row is log(1 + square / noise): to halve a large error counts the same
    wherever it is.  Calm rows count more often.  Each node is judged beside the others as they
    are; only some may change at a time, so that two neighbours do not both mend the same rows.
    """
    nodes = len(mostly)
    row, column = np.nonzero(index >= 0)
    node, own = index[row, column], weight[row, column]
    every = predicted[:, row, column] * own[:, None]  # (1 + shapes, pairs, o)
    total = np.maximum(weight.sum(axis=1), 1e-300)
    care = np.where(calm, _HARM, 1.0)

    # neighbouring rows of a log can be near-repeats: those of a run count as one
    runs = rows.max() // _RUN + 1
    run, place = np.unique(node * runs + rows[row] // _RUN, return_inverse=True)
    owner = run // runs
    several = np.bincount(owner, minlength=nodes)

    def remains(sums: Array, speaks: Array, of: Index | slice) -> Array:
        return np.asarray(target[of] - sums * local.heard(speaks / total[of])[:, None])

    def cost(residual: Array) -> Array:
        return np.asarray(np.log1p(np.einsum("mo,mo->m", residual, residual) / noise))

    def together(chosen: Index) -> tuple[Array, NDArray[np.bool_], Array, Array]:
        now, talks = every[chosen[node] + 1, np.arange(len(node))], chosen[node] >= 0
        sums = np.stack([np.bincount(row, c, len(target)) for c in now.T], axis=1)
        heard = np.asarray(np.bincount(row, own * talks, len(target)), dtype=np.float64)
        return now, talks, np.asarray(sums, dtype=np.float64), heard

    # all begin with the shape that serves the wrong rows best: one node alone is hardly heard
    first = [
        remains(*together(np.full(nodes, k))[2:], slice(None)) for k in range(len(predicted) - 1)
    ]
    costs = [cost(residual)[~calm].sum() for residual in first]
    chosen = np.full(nodes, int(np.argmin(costs)))
    # what stands until another choice is sure: in the midst of a defect no node is silent
    stands = np.where(mostly, chosen, usual)
    for turn in range(_TURNS):
        now, talks, sums, speaks = together(chosen)
        others, silent = sums[row] - now, speaks[row] - own * talks
        after = [
            cost(remains(others + new, silent + own * (k > 0), row)) for k, new in enumerate(every)
        ]
        score = np.zeros((len(every), nodes))
        before = np.stack(after)[stands[node] + 1, np.arange(len(node))]
        for k, each in enumerate(after):
            gain = before - each
            of_run, total_gain = np.bincount(place, gain), np.bincount(node, gain, nodes)
            away = of_run - (total_gain / np.maximum(several, 1))[owner]
            sure = total_gain > _SURE * np.sqrt(np.bincount(owner, away**2, nodes))
            sure &= several >= _RUNS  # of fewer the spread is not known
            score[k] = np.where(sure, np.bincount(node, gain * care[row], nodes), 0.0)
        # with a dozen rows of its own such a node seemed surely better silent one time in ten, and
        # its vote then silenced its neighbours in the midst of the defect
        score[0, mostly] = 0.0
        best = score.argmax(axis=0) - 1
        best = np.where(score.max(axis=0) > 0.0, best, stands)
        chosen = np.where(np.arange(nodes) % _COLOURS == turn % _COLOURS, best, chosen)
    return chosen, remains(*together(chosen)[2:], slice(None))
