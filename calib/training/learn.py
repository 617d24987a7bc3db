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
    scale: Scale,
    u: Array,
    x: Array,
    options: Options,
    residual: Array | None = None,
    progress: Progress | None = None,
) -> Association:
    """Learn both maps and the links between them: the paper's part.

    u, x : (n, dof), (n, m), joints in the unit box of `scale` and positions
    residual : (n,), how wrong the smooth part is around each sample, see
        :func:`calib.maps.misfit.misfit`; the default varying density puts nodes there
    """
    seen, shapes = Scale.of_data(x), (options.motor_size, options.sensory_size)
    v = seen.to_unit(x)

    def som(which: int, stream: str) -> SOM:
        given = options.map, options.rule, options.epochs, options.sigma
        return SOM(shapes[which], *given, options.stream(stream))

    def tell(done: float, error: float) -> None:
        if progress is not None:
            progress(done, "maps", error)

    if options.rule == "online" and kind_of(options.map) == "som":
        # The links that eq. 5 has made on the way lag behind the maps (30x30 nodes, five passes of
        # 20,000 samples: `activity` 9.2 mm); kept are those at which it comes to rest (2.9 mm).
        pair = som(0, "motor").developed((u, v), (scale, seen), shapes, tell).association
        motor, sensory = pair.motor, pair.sensory
        return _linked(motor, u, sensory, v, options)
    # steps of a few samples hold the interpreter's lock: two threads would fight for it
    motor, sensory = (side_by_side if kind_of(options.map) == "som" else in_turn)(
        lambda: som(0, "motor").fit(scale.from_unit(u), scale=scale, partners=v, residual=residual),
        lambda: som(1, "sensory").fit(x, scale=seen, partners=u, residual=residual, progress=tell),
    )
    return _linked(motor, u, sensory, v, options)


def _linked(motor: Map, u: Array, sensory: Map, v: Array, options: Options) -> Association:
    for name, found in (("motor", motor), ("sensory", sensory)):
        if not found.spacing > _COLLAPSED:
            raise OptionError(f"the {name} map did not unfold: its nodes collapsed", hint=UNFOLD)
    return Association.learn(motor, u, sensory, v, wiring_of(options.links))
