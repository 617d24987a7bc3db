"""Repeats: rows at one pose are one measurement of the arm, however often it was read."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..common.arrays import Array
from .samples import Samples


def at_poses(samples: Samples) -> Samples:
    """Return a row for each pose, in the order in which the log shows them.

    Its position is the median of the readings there, along each axis; what else is known of the
    row is that of the first one.  A log without repeats stays as it is.
    """
    if samples.poses == len(samples):
        return samples
    index = samples.pose_index
    order = np.argsort(index, kind="stable")
    first = order[np.searchsorted(index[order], np.arange(samples.poses))]
    readings = np.split(samples.x[order], np.flatnonzero(np.diff(index[order])) + 1)
    medians = np.array([np.median(reading, axis=0) for reading in readings])
    orientation = samples.orientation
    if orientation is not None:
        turns = np.split(orientation[order], np.flatnonzero(np.diff(index[order])) + 1)
        orientation = np.array([_middle_turn(turn) for turn in turns])
    return replace(samples.take(first), x=medians, orientation=orientation)


def reading_noise(samples: Samples) -> tuple[float, float]:
    """Return how far single readings are from those that `at_poses` takes for a pose.

    Returns repeat : sd of readings of one pose along an axis [unit], 0 without repeats
    Returns hidden : the part of it that the medians do not show any more [unit]
    """
    counts = np.bincount(samples.pose_index)
    freedom = len(samples) - len(counts)
    if not freedom:
        return 0.0, 0.0
    sums = np.stack(
        [np.bincount(samples.pose_index, axis) for axis in samples.x.T], axis=1
    )
    apart = samples.x - (sums / counts[:, None])[samples.pose_index]
    repeat = float(np.sqrt((apart**2).sum() / (freedom * samples.x.shape[1])))
    return repeat, repeat * float(np.sqrt(1.0 - np.mean(1.0 / counts)))


def _middle_turn(turns: Array) -> Array:
    """Mean (4,) of unit quaternions (k, 4) that are near each other."""
    same_side = np.where(turns @ turns[0] < 0, -1.0, 1.0)
    mean = (same_side[:, None] * turns).sum(axis=0)
    return np.asarray(mean / np.linalg.norm(mean))
