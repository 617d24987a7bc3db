"""Repeatability: how far readings at one pose scatter, the sensor's share and the arm's apart.

A pose that was measured again shows the noise without any model.  Readings that follow each other
while the arm rests are one visit: they differ by the sensor's noise alone.  Visits to one pose
differ by the arm's return as well.  With readings r of visits v to poses p, along each axis::

    x_pvr = mean_p + return_pv + noise_pvr

The two variances follow from the sums of squares within and between visits (a nested analysis of
variance), their intervals from chi-squared with the degrees of freedom that those rest on.  A
reading far from the others of its pose is wrong, and no noise.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace

import numpy as np

from ..common.arrays import Array, Mask
from ..common.rows import group_means, row_lengths
from ..errors import LogError
from .motion import Visits, visits_of
from .samples import Samples

MOST_MEDIANS = 8.0
"""Usual distances from a pose's median that a reading may have: no normal noise is further."""


@dataclass(frozen=True)
class Repeatability:
    """Standard deviations along an axis; NaN where the log cannot determine one.

    Attributes
    ----------
    sensor : float [unit]
        Of readings of one visit.
    arm : float [unit]
        Of the place that the arm returns to.
    together : float [unit]
        Of readings of different visits, which the sensor and the arm make differ.  Where each
        visit has one reading the log determines this alone.
    sensor_interval, arm_interval, together_interval : (float, float) [unit]
        95 % intervals; from 0 to that of both of what is not told apart.
    poses : int
        Poses that were measured more than once.
    repeats : int
        Their readings beyond the first of each.
    returns : int
        Their visits beyond the first of each.
    left_out : int
        Readings that contradict the others of their pose.
    unit : str
        Of the positions.
    """

    sensor: float
    arm: float
    together: float
    sensor_interval: tuple[float, float]
    arm_interval: tuple[float, float]
    together_interval: tuple[float, float]
    poses: int
    repeats: int
    returns: int
    left_out: int
    unit: str = "m"

    @property
    def reading(self) -> float:
        """Standard deviation of a single reading of a pose, as far as it is known [unit]."""
        return self.together if np.isfinite(self.together) else self.sensor

    def to_json(self) -> dict[str, object]:
        """Return what `calib noise --json` prints."""
        document = asdict(self)
        document["return"] = document.pop("arm")
        document["intervals"] = {
            "sensor": document.pop("sensor_interval"),
            "return": document.pop("arm_interval"),
            "together": document.pop("together_interval"),
        }
        return document


def repeatability(samples: Samples) -> Repeatability:
    """Return how far a log's readings of the same poses scatter.

    Raises LogError if no pose was measured twice.
    """
    visits = visits_of(samples.q)
    if not len(visits.rows):
        raise LogError(
            f"none of the log's {len(samples)} rows is at the pose of another: they do not "
            "show the noise",
            hint="go to some poses again, and read each a few times",
        )
    agreeing = _agreeing(samples.x, visits)
    left_out = int((~agreeing).sum())
    if left_out:
        samples = samples.take(agreeing)
        visits = visits_of(samples.q)
    x = samples.x[visits.rows]
    axes = x.shape[1]
    readings_of_visit = np.bincount(visits.visit)
    pose = visits.pose[np.unique(visits.visit, return_index=True)[1]]
    readings_of_pose = np.bincount(pose, readings_of_visit)
    poses = len(readings_of_pose)
    repeats = len(x) - poses
    returns = len(readings_of_visit) - poses
    means = group_means(visits.visit, x)
    off = means - group_means(visits.pose, x)[pose]
    within = float(((x - means[visits.visit]) ** 2).sum())
    between = float((readings_of_visit[:, None] * off**2).sum())
    sensor = _deviation(within, axes * (repeats - returns))
    arm = np.full(3, np.nan)
    together = arm
    if returns:
        squares = np.bincount(pose, readings_of_visit.astype(float) ** 2)
        weights = readings_of_pose - squares / readings_of_pose
        told_apart = repeats > returns
        noise = sensor if told_apart else np.zeros(3)
        return_weight = axes * float(weights.sum())
        arm = _return_sd(between, axes * returns, return_weight, noise)
        together = np.hypot(noise, arm)
        if not told_apart:
            sensor = arm = np.array([np.nan, 0.0, together[2]])
    sensor_sd, *sensor_interval = sensor.tolist()
    arm_sd, *arm_interval = arm.tolist()
    together_sd, *together_interval = together.tolist()
    return Repeatability(
        sensor=sensor_sd,
        arm=arm_sd,
        together=together_sd,
        sensor_interval=tuple(sensor_interval),
        arm_interval=tuple(arm_interval),
        together_interval=tuple(together_interval),
        poses=poses,
        repeats=repeats,
        returns=returns,
        left_out=left_out,
        unit=samples.unit,
    )


def _agreeing(x: Array, visits: Visits) -> Mask:
    """Which readings (n,) of positions (n, m) are as near to their pose's median as is usual."""
    order = np.argsort(visits.pose, kind="stable")
    starts = np.cumsum(np.bincount(visits.pose))[:-1]
    distance = np.zeros(len(x))
    for rows in np.split(visits.rows[order], starts):
        distance[rows] = row_lengths(x[rows] - np.median(x[rows], axis=0))
    apart = distance[distance > 0.0]
    if not len(apart):
        return np.ones(len(x), bool)
    return np.asarray(distance <= MOST_MEDIANS * np.median(apart))


def _deviation(squares: float, freedom: int) -> Array:
    """Return a standard deviation from a sum of squares, and its 95 % interval, (3,)."""
    from scipy.special import chdtri

    if not freedom:
        return np.full(3, np.nan)
    tails = chdtri(freedom, [0.025, 0.975])
    return np.sqrt(squares / np.append(freedom, tails))


def _return_sd(
    between: float, freedom: int, return_weight: float, noise: Array
) -> Array:
    """Return the standard deviation of the arm's return, and its 95 % interval, (3,).

    It solves E[between] = freedom * noise^2 + return_weight * return^2.

    between : sum of squares between visits, with `freedom` degrees of freedom
    noise : (3,), the sensor's, and its interval
    """
    sd, low, high = noise
    # what is left of the least beside the most noise, and of the most beside the least
    opposite = np.array([sd, high, low])
    squares = _deviation(between, freedom) ** 2 - opposite**2
    variance = freedom / return_weight * np.maximum(squares, 0.0)
    return np.asarray(np.sqrt(variance))


def at_poses(samples: Samples) -> Samples:
    """Return a row for each pose, in the order in which the log shows them.

    Its joints and readings are means of those there; what else is known of the row is that of the
    first one.  A log without repeats stays unchanged.
    """
    index = samples.pose_index
    if samples.poses == len(samples):
        return samples
    first = np.unique(index, return_index=True)[1]
    orientation = samples.orientation
    if orientation is not None:
        same_side = np.sign(
            (orientation * orientation[first][index]).sum(axis=1)
        )
        orientation = group_means(index, same_side[:, None] * orientation)
        orientation = orientation / row_lengths(orientation)[:, None]
    return replace(
        samples.take(first),
        q=group_means(index, samples.q),
        x=group_means(index, samples.x),
        orientation=orientation,
    )


def noise_beside_poses(samples: Samples) -> tuple[float, float]:
    """Return how far single readings are from those that `at_poses` takes for a pose.

    Returns noise : sd of readings of one pose along an axis [unit], 0 without repeats
    Returns hidden : the part of it that the means do not show any more [unit]
    """
    if samples.poses == len(samples):
        return 0.0, 0.0
    noise = repeatability(samples).reading
    counts = np.bincount(samples.pose_index)
    return noise, noise * float(np.sqrt(1.0 - np.mean(1.0 / counts)))
