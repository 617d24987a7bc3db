"""Imagined samples: where the body says that the tip would be, where a log has no rows.

The maps of a log learn from them besides its rows, so that the links propose starts for the
whole range of the joints.  Bounds, local models and errors rest on measured rows alone.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .learn import Options
from .smooth import LEARNED_ROWS, SmoothPart

Array = NDArray[np.float64]

_PER_NODE = 5  # imagined samples for each motor node


def with_imagined(u: Array, x: Array, part: SmoothPart, options: Options) -> tuple[Array, Array]:
    """Rows and imagined samples that the maps learn from.

    Parameters
    ----------
    u, x : (n, dof), (n, m) array
        Joints in the unit box and positions of the log.
    part : SmoothPart
        Whose body imagines.
    options : Options
        Size of the motor map, and the seed.

    Returns
    -------
    u, x : (k, dof), (k, m) array
    """
    if not options.taught or part.fit is None:
        return u, x
    every = -(-len(u) // LEARNED_ROWS)
    rng = np.random.default_rng(options.stream("imagined"))
    drawn = rng.random((_PER_NODE * math.prod(options.motor_size), u.shape[1]))
    seen = part.candidates[0].smooth.value(drawn)
    return np.concatenate([u[::every], drawn]), np.concatenate([x[::every], seen])
