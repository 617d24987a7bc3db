"""Misfit: how far positions are from others in the best frame, whatever a few rows contradict."""

from __future__ import annotations

import numpy as np

from ..arm.rotations import similarity
from ..common.arrays import Array
from ..common.rows import (
    finite_rows,
    median_length,
    row_lengths,
    solve_least_squares,
)


def spread(x: Array) -> float:
    """Median distance of rows (n, m) from their middle: one wrong row does not move it."""
    x = x[finite_rows(x)]
    return median_length(x - np.median(x, axis=0))


def misfit(a: Array, b: Array, *, affine: bool = False) -> float:
    """Median distance of `b` (n, m) from `a` (n, k) after `align`."""
    difference = b - align(a, b, affine=affine)
    return median_length(difference)


def align(a: Array, b: Array, *, affine: bool = False) -> Array:
    """`a` (n, k), turned, shifted and scaled to `b` (n, m), whatever a few rows contradict.

    Where `affine`, or the one has more coordinates, by the best affine map instead.  No reflection:
    a mirrored sensor is to be seen as a misfit.
    """
    affine = affine or a.shape[1] != b.shape[1]
    features = np.column_stack([a, np.ones(len(a))])
    # spreads about the median: single wrong rows decide nothing
    distance = row_lengths(b - np.median(b, axis=0))
    agree = distance <= 5.0 * np.median(distance) + 1e-300
    for _ in range(4):
        if affine:
            moved = features @ solve_least_squares(features[agree], b[agree])
        else:
            rotation, shift, scale = similarity(a[agree], b[agree])
            moved = scale * a @ rotation.T + shift
        distance = row_lengths(b - moved)
        agree = distance <= 3.0 * np.median(distance) + 1e-300
    return np.asarray(moved)
