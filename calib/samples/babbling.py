"""Motor babbling: move a simulated arm at random and record what its sensor sees."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import partial

import numpy as np
from numpy.random import Generator

from ..arm.arm import Arm
from ..common.arrays import Array
from ..common.checks import whole
from ..errors import OptionError
from .changes import Change, parse_changes
from .samples import Samples
from .simulation import Simulation

MAX_SAMPLES = 10_000_000

_TURN = 0.95  # 1 is a triangle wave with sharp turns, near 0 a sine


def babble(
    arm: Arm,
    n: int = 20_000,
    *,
    seed: int = 0,
    noise: float = 0.0,
    method: str = "uniform",
    changes: Iterable[str | Change] = (),
    ranges: Mapping[str, tuple[float, float]] | None = None,
) -> Samples:
    """Move the simulated arm through its range and record joints and positions.

    arm : the arm, from `calib.load_arm`
    n : number of samples
    seed : of the random numbers. Joint values, noise and outliers draw from streams of their own,
        so that other noise leaves the joint values as they are.
    noise : standard deviation of the sensor along each axis [m]
    method : how the joints move, independently and ``"uniform"``; ``"halton"`` or ``"sobol"``, low
        discrepancy sequences, which cover the range more evenly; or ``"smooth"``, a trajectory
        such as a real arm can execute (see `smooth_points` for its largest step)
    changes : what differs from the arm as described, such as `"elbow.length=+20%"`
    ranges : babble only this part of a joint's range [rad or m]
    Returns samples in the order of motion.
    Raises OptionError if an argument is outside of what is possible.

    Examples
    --------
    >>> import calib
    >>> log = calib.babble(calib.load_arm("two_link"), 1000, seed=1)
    >>> log.q.shape, log.x.shape
    ((1000, 2), (1000, 2))
    """
    if not isinstance(arm, Arm):
        raise OptionError(
            f"arm {arm!r}: expected an arm, as `calib.load_arm` returns it", parameter="arm"
        )
    n = whole("samples", n, 1, MAX_SAMPLES)
    seed = whole("seed", seed, 0, 2**63 - 1)
    if method not in SAMPLERS:
        raise OptionError(f"babbling {method!r} is unknown; choices: {', '.join(SAMPLERS)}")
    if ranges:
        arm = arm.with_range(dict(ranges))
    simulation = Simulation(arm, noise=noise, changes=parse_changes(changes))
    joints, sensor = (np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(2))
    low, high = np.asarray(arm.lower), np.asarray(arm.upper)
    q = low + (high - low) * SAMPLERS[method](n, len(low), joints)
    np.clip(q, low, high, out=q)  # low + (high - low) may round beyond high
    q.flags.writeable = False
    x = simulation.measure(q, sensor)
    x.flags.writeable = False
    return Samples(
        q=q,
        x=x,
        joint_names=tuple(arm.joint_names),
        lower=low,
        upper=high,
        revolute=tuple(arm.revolute),
        simulation=simulation,
        arm=arm,
    )


def _even_points(n: int, dof: int, rng: Generator, sequence: str) -> Array:
    """Return Halton's or Sobol's sequence in the unit cube (n, dof), shifted at random."""
    from scipy.stats import qmc

    halton, sobol = qmc.Halton(dof, scramble=False), qmc.Sobol(dof, scramble=False)
    # the balance of Sobol's holds for powers of two; its beginning is what is needed
    some = halton.random(n) if sequence == "halton" else sobol.random_base2((n - 1).bit_length())
    return np.asarray((some[:n] + rng.random(dof)) % 1.0)


def smooth_points(n: int, dof: int, rng: Generator) -> Array:
    """Return a continuous trajectory (n, dof) that covers the unit cube.

    Each coordinate sweeps to and fro as a triangle wave whose turns are rounded. The
    rates are powers of the root of g^(dof + 1) = g + 1, so that no two of them have a
    common multiple and the sweeps fill the cube evenly; the phases are random.

    Notes
    -----
    With d = 2 pi n^(-1/dof) no coordinate moves by more than 0.38 d from one point to the
    next, and no step differs from the one before by more than 1.22 d^2. For two joints
    and 20,000 samples that is 1.7 % of the range for the step and 0.24 % for its change.
    """
    golden = 2.0
    for _ in range(64):
        golden = (1.0 + golden) ** (1.0 / (dof + 1))
    rates = 2.0 * np.pi * n ** (-1.0 / dof) * golden ** -np.arange(dof)
    phase = np.arange(n)[:, None] * rates + rng.uniform(0.0, 2.0 * np.pi, dof)
    return np.asarray(0.5 + 0.5 * np.arcsin(_TURN * np.sin(phase)) / np.arcsin(_TURN))


SAMPLERS: dict[str, Callable[[int, int, Generator], Array]] = {
    "uniform": lambda n, dof, rng: rng.random((n, dof)),
    "halton": partial(_even_points, sequence="halton"),
    "sobol": partial(_even_points, sequence="sobol"),
    "smooth": smooth_points,
}
