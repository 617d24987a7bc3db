"""Learning: both maps and their links, from samples that were measured or imagined."""

from __future__ import annotations

from collections.abc import Callable

from ..common.arrays import Array
from ..common.parallel import in_turn, side_by_side
from ..common.scale import Scale
from ..errors import OptionError
from ..maps.association import Association
from ..maps.density import kind_of
from ..maps.links import wiring_of
from ..maps.som import SOM
from .options import TrainingOptions

Progress = Callable[[float, str, float], None]
"""Called with the share of the work done, the stage, and the current error (or NaN)."""

LATTICE = "vdsom:residual"
"""The default map."""

UNFOLD = "give a larger `size`, more `epochs` or samples, or `rule='batch'`"
"""What to do about a map that did not spread over its samples."""

_COLLAPSED = 1e-9  # mean distance of joined nodes in the unit box


def associate(
    scale: Scale,
    u: Array,
    x: Array,
    options: TrainingOptions,
    residual: Array | None = None,
    progress: Progress | None = None,
) -> Association:
    """Learn both maps and the links between them: the paper's part.

    u, x : (n, dof), (n, m), joints in the unit box of `scale` and positions
    residual : (n,), how wrong the smooth part is around each sample; the default varying density
        puts nodes there
    """
    seen, shapes, network = Scale.of_data(x), options.shapes, options.map or LATTICE
    v = seen.to_unit(x)

    def som(which: int, stream: str) -> SOM:
        given = network, options.rule, options.epochs, options.sigma
        return SOM(shapes[which], *given, options.stream(stream))

    def tell(done: float, error: float) -> None:
        if progress is not None:
            progress(done, "maps", error)

    if options.rule == "online" and kind_of(network) == "som":
        # The links that eq. 5 has made on the way lag behind the maps (30x30 nodes, five passes of
        # 20,000 samples: `activity` 9.2 mm); kept are those at which it comes to rest (2.9 mm).
        pair = som(0, "motor").developed((u, v), (scale, seen), shapes, tell).association
        motor, sensory = pair.motor, pair.sensory
    else:
        # steps of a few samples hold the interpreter's lock: two threads would fight for it
        motor, sensory = (side_by_side if kind_of(network) == "som" else in_turn)(
            lambda: som(0, "motor").fit(scale.from_unit(u), scale=scale, residual=residual),
            lambda: som(1, "sensory").fit(x, scale=seen, residual=residual, progress=tell),
        )
    for name, found in (("motor", motor), ("sensory", sensory)):
        if not found.spacing > _COLLAPSED:
            raise OptionError(f"the {name} map did not unfold: its nodes collapsed", hint=UNFOLD)
    return Association.learn(motor, u, sensory, v, wiring_of(options.links))
