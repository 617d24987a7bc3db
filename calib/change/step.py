"""One step of a stream that is followed: what the adaptation curves of the paper show."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Step:
    """The state after some samples of the stream.

    Attributes
    ----------
    samples : int
        Samples seen so far.
    zeta_motor, zeta_sensory : float
        Distortion of the maps (eq. 9): running mean of the squared distance to the
        winner, in the unit box.
    threshold : float
        What the sensory distortion exceeds by chance next to never.
    error : float [unit]
        Running mean of the distance from each sample to what the readout ``activity``
        said of it before it was learned.
    sigma : float [nodes]
        Neighbourhood radius of the sensory map (eq. 10), 0 before a change was noticed.
    eta, beta : float
        Learning rate and forgetting factor of the links (eq. 12).
    adapting : bool
        Whether a change was noticed and the maps are re-forming.
    changes : int
        Changes noticed so far.
    """

    samples: int
    zeta_motor: float
    zeta_sensory: float
    threshold: float
    error: float
    sigma: float
    eta: float
    beta: float
    adapting: bool
    changes: int = 0
