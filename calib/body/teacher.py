"""The teacher: what a small log says of all joint values, for maps that need more samples."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..common.scale import Scale
from ..maps.map import search_tree
from ..maps.model_selection import better, blocks, outdoes
from . import gp
from .gp import GaussianProcess
from .trend import Trend
from .trend_choice import TrendChoice, choose_trends

Array = NDArray[np.float64]

MOST_ROWS = 1000
"""Maps learn from the rows of a longer log themselves."""

IMAGINED = 20_000
"""Samples that the teacher imagines."""

_NEAR = 2.5  # imagined samples lie within so many gaps between rows from a row


@dataclass(frozen=True, eq=False)
class Teacher:
    """A trend and, where it helps, a Gaussian process of what the trend leaves over.

    Attributes
    ----------
    trend : Trend
        Smooth function of the joints.
    process : GaussianProcess or None
        Of the residuals.
    rows : (n, dof) array
        Joints of the log, in the unit box.
    errors : (n,) array [unit]
        Distance of each row to what a teacher says that has not seen its block.
    scale : Scale
        Range of the joints.
    """

    trend: Trend
    process: GaussianProcess | None
    rows: Array
    errors: Array
    scale: Scale

    def value(self, u: Array) -> Array:
        """Positions (n, 2) at the points `u` (n, dof) of the unit box."""
        value = self.trend.value(u)
        return value if self.process is None else value + self.process.value(u)

    def deviation(self, u: Array) -> Array | None:
        """Standard deviation per axis at `u`, (n,), if the teacher knows it."""
        return None if self.process is None else self.process.deviation(u)

    def imagine(self, rng: np.random.Generator) -> Array:
        """Draw joints (n, dof) of the unit box that are near rows of the log."""
        tree = search_tree(self.rows, self.scale)
        gaps = np.asarray(tree.query(self.rows, k=min(3, len(self.rows)))[0])[:, -1]
        reach = _NEAR * float(np.quantile(gaps, 0.95))
        found: list[Array] = []
        count = 0
        for _ in range(200):
            u = rng.random((IMAGINED, self.rows.shape[1]))
            near = u[np.asarray(tree.query(u)[0]) <= reach]
            found.append(near)
            count += len(near)
            if count >= IMAGINED:
                break
        return np.concatenate([self.rows, *found])[:IMAGINED]


def learn_teacher(
    scale: Scale, turning: tuple[bool, ...], u: Array, x: Array, rng: np.random.Generator
) -> Teacher:
    """Learn a teacher from a small log.

    Parameters
    ----------
    scale : Scale
        Range of the joints.
    turning : tuple of bool
        Joints that turn, rather than slide.
    u, x : (n, dof), (n, 2) array
        Joints in the unit box and measured positions.
    rng : Generator
        Draws the rows that a Gaussian process rests on, where there are many.
    """
    folds = blocks(len(u))
    best: Teacher | None = None
    for choice in choose_trends(scale, turning, u, x, folds):
        alone, *helped = _teachers(choice, scale, u, x, folds, rng)
        teacher = next((t for t in helped if better(t.errors, alone.errors)), alone)
        if best is None or outdoes(
            teacher.errors, best.errors, teacher.trend.terms - best.trend.terms
        ):
            best = teacher
    assert best is not None  # noqa: S101
    return best


def _teachers(
    choice: TrendChoice,
    scale: Scale,
    u: Array,
    x: Array,
    folds: list[NDArray[np.intp]],
    rng: np.random.Generator,
) -> Iterator[Teacher]:
    """The trend alone, and with a Gaussian process of what it leaves over."""
    left = [x - trend.value(u) for trend in choice.without]
    plain = np.empty(len(u))
    for rows, unseen in zip(folds, left, strict=True):
        plain[rows] = np.linalg.norm(unseen[rows], axis=1)
    yield Teacher(choice.trend, None, u, plain, scale)
    residual = x - choice.trend.value(u)
    if float(np.abs(residual).max()) < 1e-9 * float(np.linalg.norm(np.ptp(x, axis=0))):
        return
    process, kept = gp.fit(u, residual, scale, rng)
    errors = plain.copy()
    for rows, unseen in zip(folds, left, strict=True):
        place = np.flatnonzero(np.isin(kept, rows))
        if len(place):
            errors[kept[place]] = process.held_out(place, unseen[kept])
    yield Teacher(choice.trend, process, u, errors, scale)
