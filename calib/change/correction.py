"""The correction: of several, the one that predicts held-out samples best."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..body import gp
from ..body.teacher import MOST_ROWS, learn_teacher
from ..common.scale import Scale
from ..maps.map import Map, search_tree
from ..maps.model_selection import better, blocks, of_trends, select
from .features import Chain, Frame, find_chain
from .outliers import find_outliers, spread_points
from .smooth_correction import Folds, Old, Smooth, fit_smooth

Array = NDArray[np.float64]

_DEGREES = (2, 3, 5)  # polynomials that may bend the sensor's frame
_SINGLE = 60  # with fewer rows each is held out alone
_NEAR = 2.5  # a detail is trusted within so many gaps between rows
_ROUNDING = 1e-9  # share of the extent that is no improvement


@dataclass(frozen=True, eq=False)
class Correction:
    """What a log says of all joint values, with an old map where it says nothing.

    Attributes
    ----------
    name : str
        What was corrected, in words.
    smooth : Smooth
        The old map, corrected by few coefficients.
    detail : callable or None
        (n, dof) -> (n, 2): what that leaves over, or for `scratch` the whole position.
    scratch : bool
        Whether the log alone predicts better than any correction of the old map.
    rows : (n, dof) array
        Joints of the log in the unit box.
    errors : (n,) array [unit]
        Distance of each row to what is said of it without its fold; NaN for rows of a
        long log that were not tried.
    kept : (m,) bool array
        Rows of the log that are no outliers.
    size : float [unit]
        Root mean square size of the detail.
    scale : Scale
        Range of the joints.
    """

    name: str
    smooth: Smooth
    detail: Callable[[Array], Array] | None
    scratch: bool
    rows: Array
    errors: Array
    kept: NDArray[np.bool_]
    size: float
    scale: Scale

    def value(self, u: Array) -> Array:
        """Corrected positions (n, 2) at the points `u` (n, dof) of the unit box."""
        value = self.smooth.value(u)
        if self.detail is None:
            return value
        detail = self.detail(u)
        trust = self.trust(u)[:, None]
        gap = detail - value if self.scratch else detail
        return np.asarray(value + trust * gap)

    def trust(self, u: Array) -> Array:
        """How much the detail counts at `u`: 1 near rows of the log, 0 far from all, (n,)."""
        tree = search_tree(self.rows, self.scale)
        gaps = np.asarray(tree.query(self.rows, k=min(3, len(self.rows)))[0])[:, -1]
        reach = max(_NEAR * float(np.quantile(gaps, 0.95)), 1e-9)
        beyond = np.maximum(np.asarray(tree.query(u)[0]) / reach - 1.0, 0.0)
        trust = np.exp(-(beyond**2))
        return np.asarray(np.where(trust > 1e-6, trust, 0.0))

    def doubt(self, u: Array) -> Array:
        """What is known of the error at `u`: near the log its own, far from it more, (n,)."""
        usual = float(np.sqrt(np.nanmean(self.errors**2)))
        away = (1.0 - self.trust(u)) * self.size
        return np.asarray(np.sqrt(usual**2 + 2.0 * self.smooth.doubt(u) ** 2 + away**2))


def choose_correction(
    old: Old,
    motor: Map,
    turning: tuple[bool, ...],
    u: Array,
    x: Array,
    rng: np.random.Generator,
) -> Correction:
    """Fit the candidates and take the simplest that predicts held-out rows best.

    Candidates are, in this order: nothing; the sensor's frame moved; links changed; both;
    the frame bent; on top of the best of them a trend and a Gaussian process (or, for a
    long log, local models) of what is left over; and the log alone, without the old map.

    Parameters
    ----------
    old : callable
        The old map.
    motor : Map
        Its nodes, which carry local models of a long log.
    turning : tuple of bool
        Joints that turn, rather than slide.
    u, x : (n, dof), (n, 2) array
        Joints in the unit box and positions.
    rng : Generator
        Draws the rows of a Gaussian process.
    """
    kept = find_outliers(old, motor.scale, turning, u, x)
    u, x = u[kept], x[kept]
    n = len(u)
    folds: Folds = blocks(n) if n >= _SINGLE else blocks(n, n)
    smooth = _best_smooth(old, motor.scale, turning, u, x, folds)
    rest = x - smooth.value(u)
    name, detail, errors = smooth.name, None, smooth.errors
    extent = float(np.linalg.norm(np.ptp(x, axis=0)))
    size = 0.0
    tell = _long_detail if n >= MOST_ROWS else _short_detail
    if float(errors.mean()) > _ROUNDING * extent:
        found, said = tell(motor, turning, u, rest, rng)
        # what the smooth part has seen of each row counts against the detail
        said = said / (1.0 - np.minimum(smooth.leverage, 0.9))
        tested = np.isfinite(said)
        if better(said[tested], errors[tested], _ROUNDING * extent):
            detail, errors = found, said
            size = float(np.sqrt(np.mean(np.sum(rest**2, axis=1))))
            name = f"{name} and a smooth rest" if smooth.terms else "a smooth correction"
    if n < MOST_ROWS and smooth.frame is not None and smooth.frame.degree > 1:
        affine = fit_smooth(old, Frame.of(old(u), 1), None, u, x, folds)
        rest = x - affine.value(u)
        found, said = _bent_frame(old, u, rest, rng, folds)
        said = said / (1.0 - np.minimum(affine.leverage, 0.9))
        if said.mean() < errors.mean():
            smooth, detail, errors, name = affine, found, said, "sensor frame bent"
            size = float(np.sqrt(np.mean(np.sum(rest**2, axis=1))))
    scratch = False
    if float(errors.mean()) > _ROUNDING * extent:
        alone, said = tell(motor, turning, u, x, rng)
        tested = np.isfinite(said)
        if said[tested].mean() < 0.97 * np.nanmean(errors[tested]):
            name, detail, errors, scratch = "the log alone", alone, said, True
            size = float(np.sqrt(np.mean(np.sum((x - smooth.value(u)) ** 2, axis=1))))
    return Correction(name, smooth, detail, scratch, u, errors, kept, size, motor.scale)


def _best_smooth(
    old: Old, scale: Scale, turning: tuple[bool, ...], u: Array, x: Array, folds: Folds
) -> Smooth:
    said = old(u)
    points, positions = spread_points(old, u.shape[1])
    chain = find_chain(scale, turning, points, positions)
    affine = Frame.of(positions, 1)
    tried: list[tuple[Frame | None, Chain | None]] = [(None, None), (affine, None)]
    if chain is not None:
        tried += [(None, chain), (affine, chain)]
    tried += [(Frame.of(positions, degree), None) for degree in _DEGREES]
    best: Smooth | None = None
    extent = float(np.linalg.norm(np.ptp(x, axis=0)))
    for frame, links in tried:
        terms = (0 if frame is None else frame.values(said[:1]).shape[1]) + (
            0 if links is None else links.values(u[:1]).shape[1]
        )
        if terms and len(u) < 1.3 * terms + 2:
            continue
        candidate = fit_smooth(old, frame, links, u, x, folds)
        if best is None or _clearly(candidate.errors, best.errors, 1e-7 * extent):
            best = candidate
    assert best is not None  # noqa: S101
    return best


def _clearly(errors: Array, others: Array, floor: float) -> bool:
    """Whether errors are smaller by more than one standard error of their difference."""
    gain = others - errors
    chance = float(gain.std()) / np.sqrt(len(gain))
    return bool(gain.mean() > max(chance, floor, 0.01 * float(others.mean())))


def _short_detail(
    motor: Map, turning: tuple[bool, ...], u: Array, x: Array, rng: np.random.Generator
) -> tuple[Callable[[Array], Array], Array]:
    teacher = learn_teacher(motor.scale, turning, u, x, rng)
    return teacher.value, teacher.errors


def _bent_frame(
    old: Old, u: Array, rest: Array, rng: np.random.Generator, folds: Folds
) -> tuple[Callable[[Array], Array], Array]:
    """A Gaussian process of the position that the old map predicts: a bent sensor frame."""
    positions = old(u)
    box = Scale.of_data(positions)
    process, kept = gp.fit(box.to_unit(positions), rest, box, rng)
    errors = np.linalg.norm(rest, axis=1)
    for rows in folds:
        place = np.flatnonzero(np.isin(kept, rows))
        if len(place):
            errors[kept[place]] = process.held_out(place, rest[kept])
    return lambda points: process.value(box.to_unit(old(points))), errors


def _long_detail(
    motor: Map, turning: tuple[bool, ...], u: Array, x: Array, _: np.random.Generator
) -> tuple[Callable[[Array], Array], Array]:
    selected = select(motor, u, of_trends(motor.scale, turning, u, x))
    errors = np.full(len(u), np.nan)
    errors[selected.rows] = selected.errors
    return selected.predictor.value, errors
