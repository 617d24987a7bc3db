"""Networks that are still to be trained: one entry for all kinds and both rules."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.random import SeedSequence

from ..common.arrays import Array
from ..common.choices import RULES, check_choice
from ..common.parallel import one_blas_thread
from ..common.scale import Scale
from ..errors import LogError, OptionError
from .association import Association
from .batch import Density, coarse_to_fine, learn_batch
from .density import Gain, gain_of, guard_gain, kind_of
from .dsom import learn_dsom
from .gng import learn_gng
from .lattice import Lattice, Size, shape_of
from .links import Wiring, wiring_of, without_weak
from .map import Epoch, Map
from .settings import BATCH
from .vdsom import VDSOM, Layer, passes

_Progress = Callable[[float, float], None]
"""Called with the share of the work done and the current quantization error."""

_MOST_EPOCHS = 1_000_000


@dataclass(frozen=True)
class SOM:
    """A self-organizing map that is still to be trained, on any array.

    Attributes
    ----------
    size : int, str or tuple of int
        Nodes along each lattice axis: 10 means 10x10, as does "10x10"; a growing neural gas
        takes their number.
    map : str or gain function
        "som", "vdsom" (as the paper means it) or another reading of it ("vdsom:rho"), "dsom",
        "gng" or one with a varying density ("gng:error"), or a function of a
        :class:`calib.Visit` that returns a gain per sample.
    rule : {"batch", "online"}
        Batch map (Kohonen 2013), or eq. 1 to 8 one sample at a time (`vdsom.py`).  A dynamic
        map and a growing neural gas know only the latter and take no notice.
    epochs : int, optional
        Passes over the samples.
    sigma : (float, float), optional
        Neighbourhood radius at the start and at the end [nodes].
    seed : int
        Seed of the start and of the order of the samples.
    links : str
        For :meth:`fit_pair`: a name of :data:`calib.maps.links.WIRINGS`.

    Examples
    --------
    >>> import numpy as np, calib
    >>> x = np.random.default_rng(0).uniform(size=(2000, 2))
    >>> som = calib.SOM(10, map="som").fit(x)
    >>> som.weights.shape
    (100, 2)
    >>> som
    Map(10x10 nodes in 2 dimensions, 20 epochs)
    """

    size: Size
    map: str | Gain = "vdsom"
    rule: str = "batch"
    epochs: int | None = None
    sigma: tuple[float, float] | None = None
    seed: int | SeedSequence = field(default=0)
    links: str = "reciprocal"

    def __post_init__(self) -> None:
        wiring_of(self.links)
        kind_of(self.map)
        object.__setattr__(self, "size", shape_of(self.size))
        check_choice("rule", self.rule, RULES)
        if self.epochs is not None and not 1 <= self.epochs <= _MOST_EPOCHS:
            raise OptionError(
                f"epochs {self.epochs}: at least 1, at most {_MOST_EPOCHS:,}"
            )
        _check_radii(self.sigma)

    def fit(
        self,
        x: Array,
        *,
        scale: Scale | None = None,
        progress: _Progress | None = None,
        residual: Array | None = None,
    ) -> Map:
        """Train on the rows of `x` and return the map.

        Parameters
        ----------
        x : (n, d) array
            Samples, in any unit; a LogError reports what is wrong with them.
        scale : Scale, optional
            Unit box of the space; the box of the data where not given.
        progress : callable, optional
            Called with the share of the work done and the quantization error in the unit box.
        residual : (n,) array, optional
            How wrong a smooth model is at each sample, for the default varying density.
        """
        x = _training_samples(x)
        scale = scale or Scale.of_data(x)
        epochs, total = self._epochs_and_count(
            scale.to_unit(x), scale, residual
        )
        history = []
        # small products of matrices: threads would only wait for each other
        with one_blas_thread():
            for epoch in epochs:
                history.append(epoch.row)
                if progress is not None:
                    progress(len(history) / total, epoch.error)
        return Map(epoch.weights, epoch.lattice, scale, np.array(history))

    def fit_pair(
        self,
        q: Array,
        x: Array,
    ) -> Association:
        """Train two maps of this kind on paired samples, and the links between them.

        Parameters
        ----------
        q, x : (n, d), (n, k) array
            Paired samples, such as joint values and positions, in any unit.

        Returns
        -------
        Association
            Maps, links and their readouts.  With the online rule maps and links develop together:
            eq. 5 is stepped.
        """
        q = _training_samples(q)
        x = _training_samples(x)
        if len(q) != len(x) or len(q) < 2:
            raise LogError(
                f"samples of shapes {q.shape} and {x.shape}: expected (n, d) and (n, k)"
            )
        scales = (Scale.of_data(q), Scale.of_data(x))
        u = scales[0].to_unit(q)
        v = scales[1].to_unit(x)
        if self.rule == "online" and kind_of(self.map) == "som":
            return self.online_pair((u, v), scales)
        seed = self.seed
        entropy = seed.entropy if isinstance(seed, SeedSequence) else seed
        motor_seed, sensory_seed = SeedSequence(entropy).spawn(2)
        motor_som = replace(self, seed=motor_seed)
        sensory_som = replace(self, seed=sensory_seed)
        motor = motor_som.fit(q, scale=scales[0])
        sensory = sensory_som.fit(x, scale=scales[1])
        wiring = wiring_of(self.links)
        return Association.learn(motor, u, sensory, v, wiring)

    def online_pair(
        self,
        points: tuple[Array, Array],
        scales: tuple[Scale, Scale],
        shapes: tuple[Size, Size] | None = None,
        progress: _Progress | None = None,
    ) -> Association:
        """Maps and links that develop together, one sample at a time (eq. 1 to 8).

        points : (n, d), (n, k), paired samples in the unit boxes of the `scales`
        shapes : of the two lattices, where they differ
        """
        wiring = wiring_of(self.links)
        sizes = shapes or (self.size, self.size)
        lattices = [Lattice(shape_of(size)) for size in sizes]
        net, epochs = self._network_and_epochs(lattices, points, scales, wiring)
        history = []
        with one_blas_thread():
            for of_maps in epochs:
                history.append([epoch.row for epoch in of_maps])
                if progress is not None:
                    progress(len(history) / self._pass_count, of_maps[1].error)
        by_map = np.array(history).swapaxes(0, 1)
        motor, sensory = (
            replace(layer.map, history=rows)
            for layer, rows in zip(net.layers, by_map, strict=True)
        )
        return Association(motor, sensory, without_weak(net.links), wiring)

    def _network_and_epochs(
        self,
        lattices: Sequence[Lattice],
        points: Sequence[Array],
        scales: Sequence[Scale],
        wiring: Wiring | None = None,
    ) -> tuple[VDSOM, Iterator[list[Epoch]]]:
        """Maps at their random start, and the passes over the samples that train them."""
        rng = np.random.default_rng(self.seed)
        layers = []
        for lattice, u, scale in zip(lattices, points, scales, strict=True):
            weights = rng.random((lattice.size, u.shape[1]))
            per_node = len(u) / lattice.size
            layers.append(Layer(weights, lattice, scale, self._gain, per_node))
        net = VDSOM(layers, wiring)
        last = 0.5 if self.map == "som" else BATCH.last_radius_varying
        first = max(lattices[0].shape) / 2
        radii = self.sigma or (first, last)
        return net, passes(net, points, self._pass_count, radii, rng)

    @property
    def _gain(self) -> Gain | None:
        if isinstance(self.map, str):
            return gain_of(self.map)
        return guard_gain(self.map)

    @property
    def _pass_count(self) -> int:
        """Passes over the samples of the rules that do not go from coarse to fine."""
        return self.epochs or (10 if kind_of(self.map) == "gng" else 5)

    def _epochs_and_count(
        self,
        u: Array,
        scale: Scale,
        residual: Array | None,
    ) -> tuple[Iterator[Epoch], int]:
        """The epochs that train, and how many they are."""
        rng = np.random.default_rng(self.seed)
        lattice = Lattice(shape_of(self.size))
        gain = self._gain
        count = self._pass_count
        kind = kind_of(self.map)
        if kind == "gng":
            return learn_gng(u, lattice.size, gain, count, rng), count
        if kind == "dsom":
            return learn_dsom(u, lattice, count, rng), count
        if self.rule == "online":
            _, epochs = self._network_and_epochs([lattice], [u], [scale])
            return (epoch for (epoch,) in epochs), count
        densities: dict[str | Gain, Density] = {
            "som": "even",
            "vdsom:residual": "growing",
        }
        density = densities.get(self.map, "varying")
        stages = coarse_to_fine(lattice, self.epochs, self.sigma, density)
        count = sum(len(stage.sigma) for stage in stages)
        return learn_batch(u, stages, gain, rng, residual), count


def _training_samples(samples: Array) -> Array:
    """Return samples (n, d) as finite numbers that a map can be trained on, or raise LogError."""
    x = np.asarray(samples, dtype=float)
    if x.ndim != 2 or not x.size:
        raise LogError(
            f"samples of shape {x.shape}: expected (n, d) with n, d >= 1"
        )
    is_finite = np.isfinite(x).all(axis=1)
    row = int(np.argmin(is_finite))
    if not is_finite[row]:
        raise LogError(
            f"sample {row} is {x[row]}: expected finite numbers, drop such rows"
        )
    return x


def _check_radii(sigma: object) -> None:
    """Refuse what are no neighbourhood radii at the start and at the end of a training."""
    if sigma is None:
        return
    try:
        start, end = np.asarray(sigma, dtype=float)
        falls = bool(np.inf > start >= end > 0)
    except (TypeError, ValueError):
        falls = False
    if not falls:
        raise OptionError(
            f"sigma {sigma!r}: give (START, END) in nodes with START >= END > 0"
        )
