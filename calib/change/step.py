"""One step of a stream that is followed: what the adaptation curves of the paper show."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Step:
    """The state after some samples of the stream."""

    samples: int  # samples seen so far
    # distortion of the maps (eq. 9): running mean of the squared distance to the winner, in the
    # unit box.
    zeta_motor: float
    zeta_sensory: float
    threshold: float  # what the sensory distortion exceeds by chance next to never
    # [unit], running mean of the distance from each sample to what the readout ``activity`` said of
    # it before it was learned
    error: float
    # [nodes], neighbourhood radius of the sensory map (eq. 10), 0 before a change was noticed.
    sigma: float
    # learning rate and forgetting factor of the links (eq. 12).
    eta: float
    beta: float
    adapting: bool  # whether a change was noticed and the maps are re-forming
    changes: int = 0  # changes noticed so far
