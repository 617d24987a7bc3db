"""Maps: both lattices of a log or a simulation, and the links between them: the paper's part."""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from ..common.arrays import Array, Index
from ..common.parallel import side_by_side
from ..common.rows import diagonal, thinned
from ..common.scale import Scale
from ..errors import OptionError
from ..maps import model_selection
from ..maps.association import Association
from ..maps.density import kind_of
from ..maps.links import wiring_of
from ..maps.map import Map
from ..maps.som import SOM
from .fitted_log import FittedLog, SoundLog
from .options import LATTICE, UNFOLD, Progress, TrainingOptions
from .settings import LEARNING


def maps_of(
    log: SoundLog,
    options: TrainingOptions,
    rows: slice | Index = slice(None),
    progress: Progress | None = None,
) -> Association:
    """Maps and links of some rows of a log, and of what its body imagines."""
    samples = log.samples
    scale = samples.unit_box
    u = scale.to_unit(samples.q[rows])
    x = samples.x[rows]
    if not isinstance(log, FittedLog):
        return associate(scale, u, x, options, None, progress)
    # a log may leave parts of the joints' range out, a simulation only has too few samples
    nodes = math.prod(options.shapes[0])
    if samples.simulation is None or len(samples) < nodes:
        learned = thinned(len(u), LEARNING.most_rows)
        rng = np.random.default_rng(options.stream("imagined"))
        imagined = rng.random((LEARNING.imagined * nodes, u.shape[1]))
        u = np.concatenate([u[learned], imagined])
        x = np.concatenate([x[learned], log.body.value(imagined)])
    misfit = misfit_around(log, u)
    return associate(scale, u, x, options, misfit, progress)


def misfit_around(log: FittedLog, u: Array) -> Array | None:
    """Misfit (k,) of the body around points `u` (k, dof) of the unit box, None within noise."""
    scale = log.samples.unit_box
    learned = scale.to_unit(log.samples.q[log.rows])
    size = diagonal(log.samples.x[log.rows])
    return model_selection.misfit(scale, learned, log.fit.held_out, size, u)


def associate(
    scale: Scale,
    u: Array,
    x: Array,
    options: TrainingOptions,
    misfit: Array | None = None,
    progress: Progress | None = None,
) -> Association:
    """Learn both maps and the links between them: the paper's part.

    u, x : (n, dof), (n, m), joints in the unit box of `scale` and positions
    misfit : (n,), of the body around each sample; the default varying density puts nodes there
    """
    box = Scale.of_data(x)
    v = box.to_unit(x)
    in_order = kind_of(options.map or LATTICE) == "som"
    motor_shape, sensory_shape = options.shapes
    motor_som = _untrained("motor", motor_shape, options)
    sensory_som = _untrained("sensory", sensory_shape, options)

    def report(done: float, error: float) -> None:
        if progress is not None:
            progress(done, "maps", error)

    if options.rule == "online" and in_order:
        # The links that eq. 5 has made on the way lag behind the maps (30x30 nodes, five passes of
        # 20,000 samples: `activity` 9.2 mm); kept are those at which it comes to rest (2.9 mm).
        pair = motor_som.online_pair(
            (u, v), (scale, box), options.shapes, report
        )
        motor = pair.motor
        sensory = pair.sensory
    else:
        q = scale.from_unit(u)
        fit_motor = partial(motor_som.fit, q, scale=scale, residual=misfit)
        fit_sensory = partial(
            sensory_som.fit, x, scale=box, residual=misfit, progress=report
        )
        if in_order:
            motor, sensory = side_by_side(fit_motor, fit_sensory)
        else:
            # steps of a few samples hold the interpreter's lock: two threads would fight for it
            motor = fit_motor()
            sensory = fit_sensory()
    _refuse_collapsed("motor", motor)
    _refuse_collapsed("sensory", sensory)
    return Association.learn(motor, u, sensory, v, wiring_of(options.links))


def _untrained(
    name: str, shape: tuple[int, ...], options: TrainingOptions
) -> SOM:
    """The motor or the sensory map before its training."""
    return SOM(
        shape,
        options.map or LATTICE,
        options.rule,
        options.epochs,
        options.sigma,
        options.stream(name),
    )


def _refuse_collapsed(name: str, network: Map) -> None:
    """Raise OptionError for a map whose nodes are all at one place."""
    if not network.spacing > LEARNING.collapsed:
        raise OptionError(
            f"the {name} map did not unfold: its nodes collapsed", hint=UNFOLD
        )
