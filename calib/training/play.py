"""Play: backlash that the order of a log's rows shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..body.approach import learn_play
from ..common.arrays import Array
from ..common.wording import unit_of_joint
from ..samples.repeatability import at_poses
from ..samples.samples import Samples
from .settings import PLAY
from .smooth import Fit, SmoothPart


def freed_of_play(
    samples: Samples, part: SmoothPart, fit: Fit
) -> tuple[Samples, SmoothPart, Array]:
    """Return samples without the play that their order shows, their part, and half the play.

    part : of the samples as they are
    """
    play = np.zeros(samples.dof)
    # curves and frame have taken a part of it before
    for _ in range(PLAY.rounds):
        more = _play_of(at_poses(samples), part)
        if more is None:
            break
        samples = without_play(samples, more)
        part = fit(samples)
        play = play + more
    return samples, part, play


def _play_of(samples: Samples, part: SmoothPart) -> Array | None:
    """Half the play of each joint (dof,) [rad or m], None where the rows' order shows none."""
    simulation = samples.simulation
    exact = simulation is not None and not simulation.hidden
    if len(part.rows) < PLAY.fewest or exact or samples.side is None:
        return None
    rows = part.rows[:: -(-len(part.rows) // PLAY.most)]
    scale = part.smooth.scale
    u = scale.to_unit(samples.q[rows])
    value, slope = part.smooth.value_and_slope(u)
    # a joint near a limit mostly came from one side: its curve has taken that part already
    surprise = samples.side[rows].copy()
    for k, values in enumerate(np.clip(u, 0.0, 1.0).T):
        powers = np.polynomial.chebyshev.chebvander(
            2.0 * values - 1.0, PLAY.trend
        )
        trend = np.linalg.lstsq(powers, surprise[:, k])[0]
        surprise[:, k] -= powers @ trend
    return learn_play(samples.x[rows] - value, slope / scale.span, surprise)


def without_play(samples: Samples, play: Array) -> Samples:
    """Return the samples with the joints where they stood, rather than what they read."""
    return replace(samples, q=samples.motion.stood(play))


def play_words(samples: Samples, play: Array) -> str:
    """One line about the backlash that the order of the rows shows."""
    backlash = []
    joints = zip(samples.joint_names, play, samples.revolute, strict=True)
    for name, half, turns in joints:
        factor, unit = unit_of_joint(turns, True)
        if half > 0.0:
            backlash.append(f"{name} {2 * factor * half:.3g} {unit}")
    return (
        f"the direction of approach counts, backlash of {', '.join(backlash)}: give it to forward "
        "for smaller errors, else the expected error covers both sides"
    )
