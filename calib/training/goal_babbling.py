"""Goal babbling: targets where the map's own error is largest, reached by the map's inverse.

Babbling joints at random measures everywhere alike.  Here the arm picks positions to reach
(Rolf, Steil and Gienger 2010): half of them where the maps that it has so far predict worst
(Baranes and Oudeyer 2013), and it goes there as well as their inverse knows how.  What comes
of it is measured and learned before the next targets are picked.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from ..arm.arm import Arm
from ..common.arrays import Array
from ..common.parallel import one_blas_thread
from ..common.scale import Scale
from ..errors import OptionError
from ..maps.association import Association
from ..maps.links import WIRINGS
from ..maps.map import search_tree
from ..maps.som import SOM
from ..samples.babbling import babble
from ..samples.changes import Change
from ..samples.samples import Samples

_ROUNDS = 8  # times that the maps are learned anew and targets are picked
_FIRST = 0.3  # share of the samples that is babbled at random, to have a map at all
_GOALS = 0.6  # share of each further round that goes where errors are; the rest at random
_PER_NODE = 6  # samples for each node of the maps on the way
_LARGEST = 30  # nodes along a side of these
_LEAST = 60  # samples that anything can be learned from
_AROUND = 8  # samples whose errors tell how wrong the map is at one of them
_STRAY = 0.5  # how far joints and targets are scattered [node spacings]


def goal_babble(
    arm: Arm,
    n: int = 2_000,
    *,
    seed: int = 0,
    noise: float = 0.0,
    changes: Iterable[str | Change] = (),
    ranges: Mapping[str, tuple[float, float]] | None = None,
) -> Samples:
    """Move the simulated arm to positions that its maps do not know well yet.

    arm : the arm, from `calib.load_arm`
    n : number of samples, 60 or more
    seed : seed of the random numbers
    noise : [m], standard deviation of the sensor along each axis
    changes : what differs from the arm as described
    ranges : [rad or m], babble only this part of a joint's range
    Returns Samples, rows in the order of motion.

    References
    ----------
    Rolf, Steil, Gienger, "Goal babbling permits direct learning of inverse kinematics",
    IEEE Trans. Autonomous Mental Development 2, 2010.  Baranes, Oudeyer, "Active learning
    of inverse models with intrinsically motivated goal exploration in robots", Robotics and
    Autonomous Systems 61, 2013.
    """
    if not isinstance(n, (int, np.integer)) or isinstance(n, bool) or n < _LEAST:
        raise OptionError(f"samples {n!r}: goal babbling needs at least {_LEAST}")
    first = max(_LEAST // 2, round(_FIRST * n))
    begun = babble(arm, first, seed=seed, noise=noise, changes=changes, ranges=ranges)
    simulation = begun.simulation
    assert simulation is not None  # noqa: S101
    goals, sensor = (
        np.random.default_rng(s) for s in np.random.SeedSequence(seed, spawn_key=(1,)).spawn(2)
    )
    scale = Scale.of_range(begun.lower, begun.upper, begun.revolute)
    q = begun.q
    x = begun.x
    edges = np.linspace(first, n, _ROUNDS + 1).astype(int)
    with one_blas_thread():
        for size in np.diff(edges):
            u = next_joints(scale, q, x, int(size), goals)
            new = np.clip(scale.from_unit(u), begun.lower, begun.upper)
            # the arm goes on from where it stands, so that backlash has its history
            seen = simulation.measure(np.concatenate([q[-1:], new]), sensor)[1:]
            q, x = np.concatenate([q, new]), np.concatenate([x, seen])
    return replace(begun, q=q, x=x)


def next_joints(scale: Scale, q: Array, x: Array, n: int, rng: np.random.Generator) -> Array:
    """Joints (n, dof) of the unit box to measure next, after `q` (m, dof) and `x` (m, k)."""
    u = scale.to_unit(q)
    dof = u.shape[1]
    side, seen = int(np.clip((len(u) / _PER_NODE) ** (1 / 2), 4, _LARGEST)), Scale.of_data(x)
    seeds = np.random.SeedSequence(int(rng.integers(2**31))).spawn(2)
    nodes = SOM((side, side), "som", seed=seeds[0]).fit(scale.from_unit(u), scale=scale)
    places = SOM((side, side), "som", seed=seeds[1]).fit(x, scale=seen)
    pair = Association.learn(nodes, u, places, seen.to_unit(x), WIRINGS["reciprocal"])
    error = _own_error(pair, scale, u, x, rng)
    by_error = round(_GOALS * n)
    # targets beside the positions where errors are largest, more often the larger they are
    share = error**2 / np.sum(error**2)
    chosen = rng.choice(len(u), by_error, p=share)
    sensory, motor = pair.sensory, pair.motor
    v = sensory.scale.to_unit(x[chosen])
    v = v + _STRAY * sensory.spacing * rng.standard_normal(v.shape)
    # of several branches the one on which the map was wrong
    reached = pair.inverse(v, u[chosen], "linear")
    goals = reached + _STRAY * motor.spacing * rng.standard_normal((by_error, dof))
    everywhere = rng.random((n - by_error, dof))
    found = np.concatenate([goals, everywhere])[rng.permutation(n)]
    return np.where(scale.periodic, found % 1.0, np.clip(found, 0.0, 1.0))


def _own_error(
    pair: Association, scale: Scale, u: Array, x: Array, rng: np.random.Generator
) -> Array:
    """How wrong the maps are around each sample (m,), by links that have not seen it."""
    wiring, v = pair.wiring, pair.sensory.scale.to_unit(x)
    error = np.empty(len(u))
    half = rng.permutation(len(u)) % 2
    for k in (0, 1):
        seen, held = half != k, half == k
        other = Association.learn(pair.motor, u[seen], pair.sensory, v[seen], wiring)
        predicted = pair.sensory.scale.from_unit(other.forward(u[held], "linear"))
        error[held] = np.linalg.norm(predicted - x[held], axis=1)
    near = search_tree(u, scale).query(u, k=min(_AROUND, len(u)))[1]
    return np.asarray(error[near].mean(axis=1) + 1e-12)
