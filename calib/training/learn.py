"""Learning: both maps and their links, from samples that were measured or imagined."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

from numpy.random import SeedSequence

from ..common.arrays import Array
from ..common.parallel import in_turn, side_by_side
from ..common.scale import Scale
from ..errors import OptionError
from ..maps.association import Association
from ..maps.density import Gain, kind_of
from ..maps.fields import LinkRule
from ..maps.links import wiring_of
from ..maps.map import Map
from ..maps.som import SOM

Progress = Callable[[float, str, float], None]
"""Called with the share of the work done, the stage, and the current error (or NaN)."""

_STREAMS = {"motor": 0, "sensory": 1, "imagined": 2, "bounds": 3, "evaluation": 4}
"""Independent random streams of one seed."""

UNFOLD = "give a larger `size`, more `epochs` or samples, or `rule='batch'`"
"""What to do about a map that did not spread over its samples."""

_COLLAPSED = 1e-9  # mean distance of joined nodes in the unit box


@dataclass(frozen=True)
class Options:
    """How a model is trained."""

    # lattices
    motor_size: tuple[int, ...]
    sensory_size: tuple[int, ...]
    map: str | Gain  # network, see :class:`calib.SOM`
    rule: str  # {"batch", "online"}, training rule
    epochs: int | None  # passes over the samples, None for coarse to fine
    sigma: tuple[float, float] | None  # neighbourhood radius at the start and the end [nodes]
    seed: int  # seed of everything that is drawn
    taught: bool  # whether the maps learn from imagined samples besides the rows
    # how links are learned and read, a name of :data:`calib.maps.links.WIRINGS` or a
    # :data:`calib.maps.fields.LinkRule`
    links: str | LinkRule = "reciprocal"
    body: str = "auto"  # {"auto", "none"}, whether a kinematic model stands under the maps
    view: str = "auto"  # what the sensor measures, see :func:`calib.body.fitting.fit_body`

    def to_json(self) -> dict[str, Any]:
        """Plain data for a model file."""
        data = asdict(self)
        for name in ("map", "links"):
            if callable(data[name]):
                data[name] = getattr(data[name], "__name__", "custom")
        return data

    def stream(self, name: str) -> SeedSequence:
        """Seed of one of the independent random streams."""
        return SeedSequence(self.seed, spawn_key=(_STREAMS[name],))


def associate(
    scale: Scale, u: Array, x: Array, options: Options, residual: Array | None = None
) -> Association:
    """Learn both maps and the links between them: the paper's part; see :func:`both_maps`."""
    return link(*both_maps(scale, u, x, options, residual), u, x, options)


def both_maps(
    scale: Scale,
    u: Array,
    x: Array,
    options: Options,
    residual: Array | None = None,
    progress: Progress | None = None,
) -> tuple[Map, Map]:
    """Motor and sensory map, at the same time where they learn from many samples at once.

    `residual` (n,) is how wrong the smooth part is around each sample, see
    :func:`calib.maps.misfit.misfit`: the default varying density puts nodes there.
    """
    seen = Scale.of_data(x)
    v = seen.to_unit(x)

    def fit(name: str, size: tuple[int, ...], points: Array, box: Scale, partners: Array) -> Map:
        def tell(done: float, error: float) -> None:
            if progress is not None and name == "sensory":
                progress(done, "maps", error)

        som = SOM(
            size, options.map, options.rule, options.epochs, options.sigma, options.stream(name)
        )
        return som.fit(points, scale=box, progress=tell, partners=partners, residual=residual)

    # steps of a few samples hold the interpreter's lock: two threads would fight for it
    together = options.rule == "batch" and kind_of(options.map) == "som"
    maps = (side_by_side if together else in_turn)(
        lambda: fit("motor", options.motor_size, scale.from_unit(u), scale, v),
        lambda: fit("sensory", options.sensory_size, x, seen, u),
    )
    for name, found in zip(("motor", "sensory"), maps, strict=True):
        if not found.spacing > _COLLAPSED:
            raise OptionError(f"the {name} map did not unfold: its nodes collapsed", hint=UNFOLD)
    return maps


def link(motor: Map, sensory: Map, u: Array, x: Array, options: Options) -> Association:
    """Both maps and the links between them."""
    wiring, v = wiring_of(options.links), sensory.scale.to_unit(x)
    return Association.learn(motor, u, sensory, v, wiring)
