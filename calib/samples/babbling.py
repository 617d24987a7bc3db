"""Motor babbling: move a simulated arm at random and record what its sensor sees."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from ..arm.arm import Arm
from ..common.checks import whole
from ..errors import OptionError
from .samples import Samples
from .simulation import Change, Simulation, parse_changes

MAX_SAMPLES = 10_000_000


def babble(
    arm: Arm,
    n: int = 20_000,
    *,
    seed: int = 0,
    noise: float = 0.0,
    changes: Iterable[str | Change] = (),
    ranges: Mapping[str, tuple[float, float]] | None = None,
) -> Samples:
    """Move the simulated arm at random through its range and record joints and positions.

    arm : the arm, from `calib.load_arm`
    n : number of samples
    seed : of the random numbers. Joint values, noise and outliers draw from streams of their own,
        so that other noise leaves the joint values as they are.
    noise : standard deviation of the sensor along each axis [m]
    changes : what differs from the arm as described, such as `"elbow.length=+20%"`
    ranges : babble only this part of a joint's range [rad or m]
    Raises OptionError if an argument is outside of what is possible.

    Examples
    --------
    >>> import calib
    >>> log = calib.babble(calib.load_arm("two_link"), 1000, seed=1)
    >>> log.q.shape, log.x.shape
    ((1000, 2), (1000, 2))
    """
    if not isinstance(arm, Arm):
        raise OptionError(f"arm {arm!r}: expected an arm, as `calib.load_arm` returns it")
    n = whole("samples", n, 1, MAX_SAMPLES)
    seed = whole("seed", seed, 0, 2**63 - 1)
    if ranges:
        arm = arm.with_range(dict(ranges))
    simulation = Simulation(arm, noise=noise, changes=parse_changes(changes))
    joints, sensor = (np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(2))
    q = simulation.draw(n, joints)
    x = simulation.measure(q, sensor)
    limits = arm.lower, arm.upper, arm.revolute
    return Samples(q, x, arm.joint_names, *limits, simulation=simulation, arm=arm)
