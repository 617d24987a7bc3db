"""Models and logs that the tests of drift and adaptation share."""

from functools import cache

import numpy as np

import calib


@cache
def arm() -> calib.PlanarArm:
    return calib.load_arm("two_link")


@cache
def model(noise: float = 0.0) -> calib.Model:
    return calib.train(calib.babble(arm(), 4000, seed=0, noise=noise), size=30)


def log(*changes: str, n: int = 200, seed: int = 1, noise: float = 1e-3) -> calib.Samples:
    return calib.babble(arm(), n, seed=seed, noise=noise, changes=list(changes))


def error(adapted: calib.Model, samples: calib.Samples) -> float:
    """Mean distance [m] to the true position all over the workspace."""
    q = np.random.default_rng(7).uniform(arm().lower, arm().upper, (1000, 2))
    gap = adapted.forward(q) - samples.simulation.exact(q)
    return float(np.linalg.norm(gap, axis=1).mean())
