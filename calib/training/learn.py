"""Learning: which maps samples get, both of them and their links.

Without a body a log's held-out blocks choose between a lattice, a sheet that folds over a few paths
which cross in the workspace, and a gas.  A lattice can follow a stream.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..common.arrays import Array
from ..common.parallel import in_turn, side_by_side
from ..common.scale import Scale
from ..errors import OptionError
from ..maps.association import Association
from ..maps.density import kind_of
from ..maps.lattice import shape_of
from ..maps.links import wiring_of
from ..maps.som import SOM
from ..samples.samples import Samples
from .options import TrainingOptions
from .smooth import unit_box

Progress = Callable[[float, str, float], None]
"""Called with the share of the work done, the stage, and the current error (or NaN)."""

LATTICE = "vdsom:residual"
"""The default map."""

UNFOLD = "give a larger `size`, more `epochs` or samples, or `rule='batch'`"
"""What to do about a map that did not spread over its samples."""

_COLLAPSED = 1e-9  # mean distance of joined nodes in the unit box
_SIDE = 70  # nodes along each axis of a plane lattice, as in the paper's best table
_ROWS_PER_NODE = 5
# fewest nodes along a side, without a body, which imagines samples where a log has no rows, and
# with one: its links have to propose starts for every branch
_LEAST_SIDE = (4, 20)
_BLOCKS, _PARTS = 10, 3  # contiguous blocks, of which every third is held out in turn
_BETTER = 0.9  # of the lattice's error: what a gas has to reach


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
    v, in_order = seen.to_unit(x), kind_of(network) == "som"
    motor_som, sensory_som = (
        SOM(shape, network, options.rule, options.epochs, options.sigma, options.stream(name))
        for shape, name in zip(shapes, ("motor", "sensory"), strict=True)
    )

    def tell(done: float, error: float) -> None:
        if progress is not None:
            progress(done, "maps", error)

    if options.rule == "online" and in_order:
        # The links that eq. 5 has made on the way lag behind the maps (30x30 nodes, five passes of
        # 20,000 samples: `activity` 9.2 mm); kept are those at which it comes to rest (2.9 mm).
        pair = motor_som.developed((u, v), (scale, seen), shapes, tell)
        motor, sensory = pair.motor, pair.sensory
    else:
        # steps of a few samples hold the interpreter's lock: two threads would fight for it
        motor, sensory = (side_by_side if in_order else in_turn)(
            lambda: motor_som.fit(scale.from_unit(u), scale=scale, residual=residual),
            lambda: sensory_som.fit(x, scale=seen, residual=residual, progress=tell),
        )
    for name, found in (("motor", motor), ("sensory", sensory)):
        if not found.spacing > _COLLAPSED:
            raise OptionError(f"the {name} map did not unfold: its nodes collapsed", hint=UNFOLD)
    return Association.learn(motor, u, sensory, v, wiring_of(options.links))


def resolved(samples: Samples, options: TrainingOptions) -> tuple[TrainingOptions, list[str]]:
    """The options with the lattices and the map of these samples, and what the user is told."""
    options, notes = _with_sizes(samples, options)
    if options.map:
        return options, notes
    plain = options.rule == "batch" and options.epochs is None and options.sigma is None
    if options.body == "none" and samples.simulation is None and plain:
        share = _gas_over_lattice(samples, options)
        if share < _BETTER:
            told = f"maps without a lattice (gas), which have {share:.2f} of a VDSOM's error"
            notes.append(f"{told} on held-out blocks of the log; `map` chooses another")
            return replace(options, map="gas"), notes
    return replace(options, map=LATTICE), notes


def _gas_over_lattice(samples: Samples, options: TrainingOptions) -> float:
    """Error of a gas on held-out blocks of a log over that of a lattice, readout ``linear``."""
    folds, scale = np.array_split(np.arange(len(samples)), _BLOCKS), unit_box(samples)
    u, x, error = scale.to_unit(samples.q), samples.x, dict.fromkeys(("gas", LATTICE), 0.0)
    # each row is held out once: of an uneven log a third of the blocks alone, most of them from
    # where it dwells, had the gas at 0.86, all of them at 0.95 of the lattice's error
    for first in range(_PARTS):
        held = np.concatenate(folds[first::_PARTS])
        seen = np.setdiff1d(np.arange(len(samples)), held, assume_unique=True)
        for name in error:
            pair = associate(scale, u[seen], x[seen], replace(options, map=name))
            error[name] += float(np.linalg.norm(pair.linear.value(u[held]) - x[held], axis=1).sum())
    return error["gas"] / max(error[LATTICE], 1e-300)


def _with_sizes(samples: Samples, options: TrainingOptions) -> tuple[TrainingOptions, list[str]]:
    """The options with both lattices, and what the user is told."""
    notes, dof, width = list[str](), samples.dof, samples.x.shape[1]
    sizes = {name: getattr(options, name) for name in ("size", "motor_size", "sensory_size")}
    given, motor, sensory = (
        None if size is None else shape_of(size, name) for name, size in sizes.items()
    )
    if set(sizes.values()) == {None} and samples.simulation is None:
        rows, least = len(samples), _LEAST_SIDE[options.body != "none"]
        side = min(_SIDE, max(least, round(math.sqrt(rows / _ROWS_PER_NODE))))
        notes = [f"lattices of {side}x{side} nodes for {rows:,} rows, `size` chooses others"]
        given = (side, side)
    given = given or (_SIDE, _SIDE)
    plane = given if len(given) == 2 else (_SIDE, _SIDE)
    # as many nodes in a lattice of the joints' dimension, and in one of the space
    motor = motor or (_of_dimension(dof, given) if len(given) == 2 and dof in (1, 3) else given)
    sensory = sensory or (_of_dimension(3, plane) if width == 3 else plane)
    for name, shape, most, each in (
        ("motor", motor, dof, "joint"),
        ("sensory", sensory, width, "coordinate"),
    ):
        if len(shape) > most:
            told = f"{name} size {'x'.join(map(str, shape))}: expected at most {most} numbers"
            raise OptionError(f"{told}, one per {each}", parameter=f"{name}_size")
    return replace(options, motor_size=motor, sensory_size=sensory), notes


def _of_dimension(dim: int, nodes: tuple[int, ...]) -> tuple[int, ...]:
    """A lattice of so many axes with as many nodes as another one."""
    return (max(2, round(math.prod(nodes) ** (1 / dim))),) * dim
