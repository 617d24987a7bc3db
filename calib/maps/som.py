"""Training of self-organizing maps: the paper's online rule and Kohonen's batch rule."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..errors import LogError, OptionError
from ..scale import Scale
from .density import Gain, Visit, gain_of
from .lattice import Lattice
from .map import Map
from .schedule import Stage, coarse_to_fine, exponential, total_work

Array = NDArray[np.float64]
Progress = Callable[[float, float], None]
"""Called with the share of the work done and the current quantization error."""

RULES = ("batch", "online")
_ALPHA = 0.5  # learning rate at the start (eq. 4)
_BLOCK = 250  # samples of the online rule between two looks at the gain


@dataclass(frozen=True)
class SOM:
    """A self-organizing map that is still to be trained, on any array.

    Attributes
    ----------
    size : tuple of int
        Nodes along each lattice axis.
    map : str or gain function
        "som", "vdsom" or a reading of it ("vdsom:error"), or a function of a
        :class:`~calib.maps.density.Visit` that returns a gain per sample.
    rule : {"batch", "online"}
        Batch map (Kohonen 2013), or eq. 1 to 4 one sample at a time.
    epochs : int, optional
        Passes over the samples.
    sigma : (float, float), optional
        Neighbourhood radius at the start and at the end [nodes].
    seed : int
        Seed of the start and of the order of the samples.

    Examples
    --------
    >>> import numpy as np, calib
    >>> x = np.random.default_rng(0).uniform(size=(2000, 2))
    >>> som = calib.SOM((10, 10), map="som").fit(x)
    >>> som.weights.shape
    (100, 2)
    """

    size: tuple[int, ...]
    map: str | Gain = "vdsom"
    rule: str = "batch"
    epochs: int | None = None
    sigma: tuple[float, float] | None = None
    seed: int | np.random.SeedSequence = field(default=0)

    def __post_init__(self) -> None:
        if self.rule not in RULES:
            raise OptionError(f"rule {self.rule!r} is unknown, choose one of {', '.join(RULES)}")
        if self.epochs is not None and self.epochs < 1:
            raise OptionError(f"epochs {self.epochs}: at least 1 is needed")
        if self.sigma is not None and not (
            np.isfinite(self.sigma).all() and self.sigma[0] >= self.sigma[1] > 0
        ):
            start, end = self.sigma
            raise OptionError(
                f"sigma {start:g}:{end:g}: give START:END in nodes with START >= END > 0"
            )

    def fit(self, x: Array, *, scale: Scale | None = None, progress: Progress | None = None) -> Map:
        """Train on the rows of `x` (n, d) and return the map.

        Parameters
        ----------
        x : (n, d) array
            Samples, in any unit.
        scale : Scale, optional
            Unit box of the space; the box of the data where not given.
        progress : callable, optional
            Called now and then with the share of the work done and the current
            quantization error in the unit box.

        Returns
        -------
        Map

        Raises
        ------
        LogError
            If `x` has no rows, is not two-dimensional, or holds a value that is not finite.
        """
        x = np.asarray(x, dtype=float)
        if x.ndim != 2 or not len(x):
            raise LogError(f"samples of shape {x.shape}: expected (n, d) with n >= 1")
        if not np.isfinite(x).all():
            row = int(np.argmin(np.isfinite(x).all(axis=1)))
            raise LogError(f"sample {row} is {x[row]}: expected finite numbers, drop such rows")
        gain = gain_of(self.map) if isinstance(self.map, str) else self.map
        scale = scale or Scale.of_data(x)
        u = scale.to_unit(x)
        rng = np.random.default_rng(self.seed)
        lattice = Lattice(self.size)
        if self.rule == "online":
            epochs = _online(u, lattice, gain, self.epochs or 5, self.sigma, rng)
            work = len(u) * (self.epochs or 5)
        else:
            stages = coarse_to_fine(lattice, self.epochs, self.sigma)
            epochs = _batch(u, stages, gain, rng)
            work = total_work(stages, len(u))
        history, done = [], 0
        for epoch in epochs:
            done += epoch.shown
            history.append((epoch.nodes, epoch.sigma, epoch.error, epoch.topographic))
            weights = epoch.weights
            if progress is not None:
                progress(done / work, epoch.error)
        return Map(weights, lattice, scale, np.array(history))


@dataclass(frozen=True)
class _Epoch:
    weights: Array
    nodes: int
    sigma: float
    error: float
    topographic: float
    shown: int


def _topographic(u: Array, weights: Array, lattice: Lattice) -> float:
    """Topographic error on some 500 of the samples `u`."""
    some = u[:: max(1, len(u) // 500)]
    index = _nearest(weights, some, [1, 2])[1]
    return float(np.mean(~lattice.adjacent(index[:, 0], index[:, 1])))


def _nearest(weights: Array, u: Array, k: int | list[int]) -> tuple[Array, NDArray[np.intp]]:
    """Distance and index of the nearest node (or nodes) of each sample (eq. 1)."""
    from scipy.spatial import cKDTree

    tree = cKDTree(weights, compact_nodes=False, balanced_tree=False)
    distance, index = tree.query(u, k=k, workers=-1)
    return np.asarray(distance), np.asarray(index, dtype=np.intp)


def _batch(
    u: Array, stages: list[Stage], gain: Gain | None, rng: np.random.Generator
) -> Iterator[_Epoch]:
    """Kohonen's batch map, stage after stage; yields after each epoch.

    Its fixed points are those of eq. 2: each node is the mean of all samples, weighted by
    the neighbourhood h (eq. 3) of their winners and, for a VDSOM, by their gain.
    """
    weights = rng.random((stages[0].lattice.size, u.shape[1]))
    lattice = stages[0].lattice
    for stage in stages:
        if stage.lattice != lattice:
            weights = lattice.resample(weights, stage.lattice)
        lattice = stage.lattice
        some = u if stage.samples >= len(u) else u[rng.permutation(len(u))[: stage.samples]]
        for epoch, sigma in enumerate(stage.sigma):
            topographic = _topographic(some, weights, lattice)
            distance, winner = _nearest(weights, some, 1)  # eq. 1
            g = None
            if gain is not None and stage.final:
                t = (epoch + 1) / len(stage.sigma)
                g = gain(Visit(t, winner, distance, weights, lattice))
            sums = _smooth(_sums(some, winner, g, lattice.size), lattice, float(sigma))
            count = sums[:, -1:]
            reached = count > 1e-12 * count.max()
            weights = np.where(reached, sums[:, :-1] / np.where(reached, count, 1.0), weights)
            yield _Epoch(
                weights, lattice.size, float(sigma), float(distance.mean()), topographic, len(some)
            )


def _sums(u: Array, winner: NDArray[np.intp], gain: Array | None, nodes: int) -> Array:
    """Sum of the samples and number of samples per node, (nodes, d + 1)."""
    columns = [c if gain is None else gain * c for c in u.T]
    columns.append(np.ones(len(u)) if gain is None else gain)
    return np.stack([np.bincount(winner, c, minlength=nodes) for c in columns], axis=1)


def _smooth(sums: Array, lattice: Lattice, sigma: float) -> Array:
    """Sums over the neighbourhood h_ji of eq. 3: a Gaussian along each lattice axis."""
    from scipy.ndimage import gaussian_filter1d

    grid = sums.reshape(*lattice.shape, -1)
    for axis in range(lattice.dim):
        grid = gaussian_filter1d(grid, sigma, axis=axis, mode="constant")
    return grid.reshape(lattice.size, -1)


def _online(
    u: Array,
    lattice: Lattice,
    gain: Gain | None,
    epochs: int,
    sigma: tuple[float, float] | None,
    rng: np.random.Generator,
) -> Iterator[_Epoch]:
    """The paper's rule, one sample at a time (eq. 1 to 4); yields after each epoch.

    Winners and updates are exact, but for the neighbourhood being cut at four sigma; the
    gain of a VDSOM is computed once per block of samples.
    """
    start, end = sigma or (max(lattice.shape) / 2, 0.5)
    steps = epochs * len(u)
    radius = exponential(start, end, steps)
    alpha = _ALPHA * radius / start  # eq. 4: one time constant for both
    weights = rng.random((lattice.size, u.shape[1]))
    done = 0
    for _ in range(epochs):
        order = u[rng.permutation(len(u))]
        errors = []
        for first in range(0, len(order), _BLOCK):
            block = order[first : first + _BLOCK]
            rates = alpha[done : done + len(block)]
            if gain is not None:
                distance, winner = _nearest(weights, block, 1)
                t = (done + len(block)) / steps
                rates = rates * gain(Visit(t, winner, distance, weights, lattice))
            errors += present(weights, lattice, block, radius[done : done + len(block)], rates)
            done += len(block)
        yield _Epoch(
            weights,
            lattice.size,
            float(radius[done - 1]),
            float(np.mean(errors)),
            _topographic(u, weights, lattice),
            len(order),
        )


def present(
    weights: Array, lattice: Lattice, samples: Array, sigma: Array, rate: Array
) -> list[float]:
    """Show samples to a map one after the other, in place (eq. 1 to 3).

    Parameters
    ----------
    weights : (nodes, d) array
        Changed in place.
    samples : (n, d) array
        In the unit box.
    sigma, rate : (n,) array
        Neighbourhood radius [nodes] and learning rate (times gain) of each sample.

    Returns
    -------
    list of float
        Distance of each sample to its winner.
    """
    grid = weights.reshape(*lattice.shape, -1)
    axes = [np.arange(n, dtype=float) for n in lattice.shape]
    distances = []
    for x, s, a in zip(samples, sigma, rate, strict=True):
        gap = weights - x
        square = np.einsum("ij,ij->i", gap, gap)
        winner = int(square.argmin())  # eq. 1
        distances.append(float(np.sqrt(square[winner])))
        place = np.unravel_index(winner, lattice.shape)
        reach = int(4 * s) + 1
        window = tuple(slice(max(0, int(p) - reach), int(p) + reach + 1) for p in place)
        h = np.array(a)
        for axis, p, part in zip(axes, place, window, strict=True):  # eq. 3, axis by axis
            h = np.multiply.outer(h, np.exp((axis[part] - p) ** 2 / (-2.0 * s * s)))
        near = grid[window]
        near += np.minimum(h, 1.0)[..., None] * (x - near)  # eq. 2
    return distances
