"""Model selection: which nodes carry local models, and of which shape, by held-out errors.

Folds are contiguous: neighbouring rows of a real log can be near-repeats.  Figures: docs/maps.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import comb

import numpy as np

from ..common.arrays import Array, Index, Mask
from ..common.rows import group_sums, row_lengths
from ..common.scale import Scale
from . import local_models as local
from .blend import Blend
from .local_models import NO_MODELS
from .map import Map, nearest_points
from .predictor import Predictor, Smooth
from .settings import SELECTION, ModelShape


def blocks(n: int, folds: int = 10) -> list[Index]:
    """Contiguous blocks of the rows 0 ... n - 1."""
    return np.array_split(np.arange(n), min(folds, n))


def better(errors: Array, others: Array) -> bool:
    """Whether paired held-out errors are smaller by more than chance."""
    gain = others - errors
    deviation = float(gain.std())
    chance = 2.0 * deviation / np.sqrt(len(gain))
    least = max(chance, 0.03 * float(others.mean()))
    return bool(gain.mean() > least)


def follows_the_motion(x: Array, residual: Array) -> bool:
    """Whether residuals (n, o) of rows at positions (n, o) point along the rows' motion.

    A late clock leaves -speed x delay along the path, a play its half: no function of the joints.
    The mean along it has to exceed a tenth of their size and five standard errors of twenty blocks.
    """
    motion = np.gradient(x, axis=0)
    length = np.linalg.norm(motion, axis=1, keepdims=True)
    direction = motion / np.maximum(length, 1e-300)
    along = np.einsum("no,no->n", residual, direction)
    distance = row_lengths(residual)
    size = float(np.median(distance))
    parts = blocks(len(x), SELECTION.parts)
    means_of_parts = [along[part].mean() for part in parts]
    means = np.array(means_of_parts)
    deviation = float(means.std())
    chance = deviation / np.sqrt(len(means))
    threshold = max(SELECTION.sure * chance, SELECTION.along * size)
    return bool(abs(np.median(means)) > threshold)


@dataclass(frozen=True, eq=False)
class DefectRows:
    """Rows that local models may mend, and the nodes that may carry such models."""

    motor: Map
    u: Array  # (n, dof), all samples in the unit box
    rows: Index  # (k,), those with a node among wrong rows in their blend
    nodes: Mask  # (nodes,), which nodes lie among wrong rows
    held_out: Array  # (k, o), what the smooth part leaves over
    noise: float  # mean square of the noise
    weight: Array  # (k,), of each row's gain

    @staticmethod
    def of(
        motor: Map,
        u: Array,
        x: Array,
        held_out: Array,
    ) -> DefectRows:
        """Wrong rows by the held-out residuals (n, o) at positions (n, o), around each row.

        A row is wrong where the median of its neighbours' residuals exceeds the noise.
        """
        _, near = nearest_points(u, motor.scale, u, SELECTION.rows_around)
        # neighbours share what a smooth part misses: their difference is noise
        nearest = held_out[near[:, 1]]
        difference = float(np.median(_square(held_out - nearest)))
        ranges = np.ptp(x, axis=0)
        extent = float(np.linalg.norm(ranges))
        rounding = (SELECTION.rounding * extent) ** 2
        of_median = difference / (2.0 * np.log(2.0))
        noise = max(of_median, rounding, 1e-300)
        median = np.median(_square(held_out)[near], axis=1)
        wrong = median >= SELECTION.calm * noise
        blend = Blend(motor, u)
        excess = blend.weight * (wrong[:, None] - SELECTION.wrong_share)
        index = blend.index.ravel()
        nodes = group_sums(index, excess.ravel(), motor.size) > 0.0
        among_defects = nodes[blend.index].any(axis=1)
        rows = np.flatnonzero(among_defects)
        weight = np.where(wrong[rows], 1.0, SELECTION.harm)
        return DefectRows(motor, u, rows, nodes, held_out[rows], noise, weight)

    @cached_property
    def blend(self) -> Blend:
        """The nodes nearest to each row."""
        return Blend(self.motor, self.u[self.rows])

    def mended(
        self,
        residual: Array,
        shape: ModelShape,
    ) -> Mended:
        """The rows with local models at the nodes that mend them by more than chance.

        residual : (n, o), what the smooth part leaves over of all samples
        """
        predictions = self._predictions(residual, shape)
        part = self.rows * SELECTION.parts // len(self.u)
        gain = self._gain(self._residual(predictions, self.nodes))
        nodes = self.nodes & self._helpful_nodes(gain, part)
        held_out = self._residual(predictions, nodes)
        gains = group_sums(part, self._gain(held_out), SELECTION.parts)
        total = 0.0
        if _beyond_chance(gains, SELECTION.total_gain):
            total = float(gains.sum())
        return Mended(shape, np.flatnonzero(nodes), held_out, total)

    def _helpful_nodes(
        self,
        gain: Array,
        part: Index,
    ) -> Mask:
        """Which nodes (nodes,) gain in several parts of the log, from each row's gain and part."""
        size = self.motor.size
        parts = SELECTION.parts
        cells = part[:, None] * size + self.blend.index
        gains = self.blend.weight * gain[:, None]
        count = parts * size
        sums = group_sums(cells.ravel(), gains.ravel(), count)
        return _beyond_chance(sums.reshape(parts, size), SELECTION.node_gain)

    def _predictions(
        self,
        residual: Array,
        shape: ModelShape,
    ) -> Array:
        """Values (k, m, o) of nodes' models at the rows, each fitted without the row's fold."""
        motor = self.motor
        u = self.u
        predictions = []
        for fold in blocks(len(u), SELECTION.folds):
            rows = self.rows[np.isin(self.rows, fold)]
            blend = Blend(motor, u[rows])
            nodes = np.unique(blend.index)
            rest = np.delete(u, fold, axis=0)
            missed = np.delete(residual, fold, axis=0)
            models = local.fit(motor, nodes, rest, missed, shape)
            predictions.append(local.model_values(models, blend))
        return np.concatenate(predictions)

    def _residual(
        self,
        predictions: Array,
        nodes: Mask,
    ) -> Array:
        """What the models of some nodes (nodes,) leave of the held-out residuals, (k, o)."""
        has_model = nodes[self.blend.index]
        weight = local.model_weights(self.blend.weight, has_model)
        corrections = np.einsum("nm,nmo->no", weight, predictions)
        return np.asarray(self.held_out - corrections)

    def _gain(self, residual: Array) -> Array:
        """By how much each row's cost falls, (k,), harm of calm rows counted more."""
        fall = self._cost(self.held_out) - self._cost(residual)
        return self.weight * fall

    def _cost(self, residual: Array) -> Array:
        """Cost of each row: to halve a large error counts the same wherever it is."""
        return np.log1p(_square(residual) / self.noise)


@dataclass(frozen=True, eq=False)
class Mended:
    """Defect rows with local models of one shape."""

    shape: ModelShape
    nodes: Index  # those that carry models
    held_out: Array  # (k, o), what these leave of the rows' residuals
    gain: float  # of all rows, 0 where it may be chance


def select(
    motor: Map,
    u: Array,
    x: Array,
    smooth: Smooth,
    held_out: Array,
) -> tuple[Predictor, Array]:
    """Give nodes local models of one shape where that mends what a smooth part leaves over.

    Nodes among wrong rows may carry one; those whose models mend held-out rows do.  The cost of a
    row is log(1 + |residual|^2 / noise).  The shape with the largest gain is taken.

    u, x : (n, dof), (n, m), joints of the samples in the unit box, in their order, and positions
    smooth : the smooth part, fitted to all samples
    held_out : (n, m), what smooth parts leave over that have not seen the row's fold
    Returns the predictor, and what is left of `held_out` where local models have not seen the row.
    """
    dof = u.shape[1]
    plain = Predictor(motor, smooth, NO_MODELS)
    shapes = [
        shape
        for shape in SELECTION.shapes
        if 1.2 * comb(dof + shape.degree, dof) <= shape.samples < len(u) // 4
    ]
    if not shapes or follows_the_motion(x, held_out):
        return plain, held_out
    defects = DefectRows.of(motor, u, x, held_out)
    if not len(defects.rows):
        return plain, held_out
    residual = x - smooth.value(u)
    choices = [defects.mended(residual, shape) for shape in shapes]
    best = max(choices, key=lambda choice: choice.gain)
    if best.gain <= 0.0:
        return plain, held_out
    mended = held_out.copy()
    mended[defects.rows] = best.held_out
    models = local.fit(motor, best.nodes, u, residual, best.shape)
    return Predictor(motor, smooth, models), mended


def _square(residual: Array) -> Array:
    return np.asarray(np.einsum("...o,...o->...", residual, residual))


def _beyond_chance(sums: Array, errors: float) -> Mask:
    """Whether sums (parts, ...) of parts of a log exceed zero by so many standard errors."""
    chance = errors * sums.std(axis=0) / np.sqrt(len(sums))
    return np.asarray(sums.mean(axis=0) > chance)


def misfit(
    scale: Scale,
    u: Array,
    held_out: Array,
    extent: float,
    at: Array,
) -> Array | None:
    """Mean squares (k,) of held-out residuals around points, less noise; None where all is noise.

    The median over the points is taken for the noise.  A mean square that exceeds it by no more
    than chance counts as zero, so that noise draws no nodes.

    u, held_out : (n, dof), (n, m) [unit], joints in the unit box, and what a smooth model that
        has not seen the row leaves over
    extent : [unit], diagonal of the workspace
    at : (k, dof), the points, in the unit box: what a map will learn from
    """
    rounding = (SELECTION.rounding * extent) ** 2
    square = np.maximum(_square(held_out), rounding)
    k = min(SELECTION.rows_averaged, len(u) // 4)
    _, index = nearest_points(u, scale, at, k)
    # without the largest: an outlier is no misfit
    ascending = np.sort(square[index], axis=1)
    members = k - k // 5
    here = ascending[:, :members].mean(axis=1)
    quantiles = np.quantile(here, (0.5, 0.16))
    noise, low = quantiles.tolist()
    # a mean of o k squares of noise is noise (1 +- sqrt(2 / (o k))); repeated rows count less than
    # their number: the calm half shows how much
    relative = np.sqrt(2.0 / (held_out.shape[1] * k))
    chance = SELECTION.chance * relative * noise
    threshold = noise + max(chance, SELECTION.spreads * (noise - low))
    excess = np.where(here > threshold, here - noise, 0.0)
    points_of_a_row = k * len(at) / len(u)
    return excess if np.count_nonzero(excess) > points_of_a_row else None
