"""Functions of your own in a map: what they are given, and how their answers are checked.

:class:`calib.SOM` and :func:`calib.train` take a gain (a varying density, eq. 7 and 8), a
neighbourhood (eq. 3) and a link rule (eq. 5) as functions.  Each gets one object
whose fields are documented here or, for a gain, at :class:`~calib.maps.density.Visit`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from ..errors import OptionError
from .density import Gain, Visit
from .lattice import Lattice


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Nodes around a winner, as a neighbourhood sees them.

    Attributes
    ----------
    distance : (...) array [nodes]
        Distance of each node to the winner on the lattice; 0 at the winner.
    steps : (..., dim) int array [nodes]
        Steps from the winner along each axis.
    sigma : float [nodes]
        Neighbourhood radius now.
    progress : float
        t / T, from 0 to 1.
    """

    distance: Array
    steps: NDArray[np.intp]
    sigma: float
    progress: float


Neighbourhood = Callable[[Surroundings], Array]
"""Returns h of each node, shaped like `distance`: 0 or more, finite, above 0 at the winner."""


@dataclass(frozen=True, eq=False)
class Pairs:
    """Pairs of nodes that were active together, as a link rule sees them.

    Attributes
    ----------
    together : (k,) array
        Sum over the samples of a_i a_j for each pair of a motor and a sensory node.
    motor, sensory : (k,) array
        Sums of a_i^2 and of a_j^2 of the pair's two nodes.
    samples : int
        Number of samples.

    Examples
    --------
    Eq. 5 comes to rest at ``pairs.together / pairs.sensory``.
    """

    together: Array
    motor: Array
    sensory: Array
    samples: int


LinkRule = Callable[[Pairs], Array]
"""Returns the strength of each pair's link, (k,): 0 or more, finite."""


def checked_gain(gain: Gain) -> Gain:
    """A user's gain whose answers are checked whenever it is asked."""

    def ask(visit: Visit) -> Array:
        found = _checked("gain", gain(visit), visit.winners.shape, "one factor for each sample")
        if not found.any():
            raise OptionError("the gain returned zeros alone: no sample would be learned")
        return found

    return ask


def neighbourhood_values(
    neighbourhood: Neighbourhood, lattice: Lattice, sigma: float, progress: float
) -> Array:
    """Values h of a neighbourhood at all steps, (2 n - 1 along each axis), checked."""
    distance, steps = lattice_steps(lattice)
    return checked_h(neighbourhood, Surroundings(distance, steps, sigma, progress))


def lattice_steps(lattice: Lattice) -> tuple[Array, NDArray[np.intp]]:
    """All steps that two nodes can be apart: their lengths, and the steps by axis."""
    most = np.array(lattice.shape) - 1
    steps = np.moveaxis(np.indices(tuple(2 * most + 1)), 0, -1) - most
    return np.linalg.norm(steps, axis=-1), steps


def checked_h(neighbourhood: Neighbourhood, around: Surroundings) -> Array:
    """What a neighbourhood says of the nodes around a winner, checked."""
    shape = around.distance.shape
    h = _checked("neighbourhood", neighbourhood(around), shape, "one value for each node")
    if not (h[around.distance == 0.0] > 0.0).all():
        raise OptionError("the neighbourhood is 0 at the winner itself, expected above 0")
    return h


def checked_links(rule: LinkRule, pairs: Pairs) -> Array:
    """What a rule says of pairs of nodes, checked."""
    shape = pairs.together.shape
    found = _checked("link rule", rule(pairs), shape, "one strength for each pair")
    if not found.any():
        raise OptionError("the link rule returned zeros alone: nothing would be linked")
    return found


def _checked(what: str, value: object, shape: tuple[int, ...], of_each: str) -> Array:
    """A user's answer as an array of this shape, finite and not negative."""
    try:
        found = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise OptionError(f"the {what} returned {value!r:.60}, expected an array") from None
    if found.shape != shape:
        raise OptionError(
            f"the {what} returned an array of shape {found.shape}, expected {shape}: {of_each}"
        )
    bad = found[~(np.isfinite(found) & (found >= 0.0))].ravel()
    if len(bad):
        raise OptionError(
            f"the {what} returned {bad[0]:g} for {len(bad)} of {found.size}: expected finite "
            "numbers, 0 or more"
        )
    return found
