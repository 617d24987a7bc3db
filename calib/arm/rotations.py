"""Rotations: matrices, quaternions (x, y, z, w) and rotation vectors of many rows, in NumPy.

Quaternions of rows that follow each other may change sign; what is returned has w >= 0.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..common.arrays import Array

QUATERNION = ("qx", "qy", "qz", "qw")
"""Columns of a quaternion, in the order of its components."""

# not scipy.spatial.transform: its import takes 0.24 s, longer than the query that needs a rotation,
# and its logarithm of 1,000 matrices 2.7 ms for 0.2 ms here
_LEAST = 1e-300
"""Angle [rad] in place of none: quotients of it are those of small angles."""

_SIGNS = np.cross(np.eye(3), np.eye(3)[:, None])
"""Signs (3, 3, 3) of a cross product: (v x u)_i = sum_jk signs_jik v_j u_k."""

_AXIAL = _SIGNS.transpose(2, 0, 1).reshape(9, 3)
"""What makes of a matrix M, row by row, the vector that belongs to M - M'."""

_CELLS = np.eye(9).reshape(9, 3, 3)
_TRACES = np.eye(3).ravel()
_PRODUCTS = np.zeros((9, 4, 4))
"""What each cell of a matrix adds to four times the products of its quaternion with itself."""
_PRODUCTS[:, :3, :3] = _CELLS + _CELLS.mT - _TRACES[:, None, None] * np.eye(3)
_PRODUCTS[:, :3, 3] = _AXIAL
_PRODUCTS[:, 3, :3] = _AXIAL
_PRODUCTS[:, 3, 3] = _TRACES


def matrix_of(quaternions: ArrayLike) -> Array:
    """Rotation matrices (n, 3, 3) of quaternions (n, 4) as qx, qy, qz, qw; any length."""
    q = np.asarray(quaternions, dtype=float)
    return exponential(_vector_of(q / _lengths(q)))


def quaternion_of(matrices: ArrayLike) -> Array:
    """Quaternions (n, 4) as qx, qy, qz, qw with qw >= 0 of rotation matrices (n, 3, 3).

    Of the four formulas (Shepperd 1978) each row takes the one that divides by most.
    """
    r = np.asarray(matrices, dtype=float)
    products = r.reshape(-1, 9) @ _PRODUCTS.reshape(9, 16) + np.eye(4).ravel()
    best = products[:, ::5].argmax(axis=1)
    rows = np.arange(len(products))
    q = products.reshape(-1, 4, 4)[rows, best]
    q = q / _lengths(q)
    q = np.where(q[:, 3:] < 0, -q, q)
    return np.asarray(q.reshape(*r.shape[:-2], 4))


def exponential(vectors: ArrayLike) -> Array:
    """Rotation matrices (n, 3, 3) of rotation vectors (n, 3) [rad]."""
    v = np.asarray(vectors, dtype=float)
    angle = np.maximum(_lengths(v), _LEAST)[..., None]
    k = cross_matrix(v)
    # Rodrigues: 1 + sin(angle) K + (1 - cos(angle)) K^2 of a unit vector
    straight = np.sin(angle) / angle * k
    bent = 2 * (np.sin(angle / 2) / angle) ** 2 * (k @ k)
    return np.eye(3) + straight + bent


def logarithm(matrices: ArrayLike) -> Array:
    """Rotation vectors (n, 3) [rad], at most pi long, of rotation matrices (n, 3, 3)."""
    return _vector_of(quaternion_of(matrices))


def _vector_of(q: Array) -> Array:
    """Rotation vectors (n, 3) [rad] of quaternions (n, 4) of length 1."""
    q = np.where(q[..., 3:] < 0, -q, q)
    sine = _lengths(q[..., :3])
    half = np.arctan2(sine, q[..., 3:])
    return 2 * half / np.maximum(sine, _LEAST) * q[..., :3]


def _lengths(vectors: Array) -> Array:
    """Lengths (..., 1) of vectors (..., d), quicker than NumPy's norm for a few."""
    return np.asarray(np.sqrt((vectors * vectors).sum(axis=-1, keepdims=True)))


def cross_matrix(vectors: ArrayLike) -> Array:
    """Matrices K (n, 3, 3) with K u = v x u of vectors v (n, 3)."""
    v = np.asarray(vectors, dtype=float)
    return (v @ _SIGNS.reshape(3, 9)).reshape(*v.shape, 3)


def nearest_rotation(matrix: Array) -> Array:
    """The rotations (..., 3, 3) nearest to matrices (Kabsch 1976)."""
    u, _, vt = np.linalg.svd(matrix)
    u[..., 2] *= np.linalg.det(u @ vt)[..., None]
    return np.asarray(u @ vt)


def similarity(
    a: Array, b: Array, *, mirrored: bool = False, scale: float | None = None
) -> tuple[Array, Array, float]:
    """Rotation (d, d), shift (d,) and scale with b = scale R a + shift of rows (Umeyama 1991).

    mirrored : whether a reflection serves too, if it fits better
    scale : where it is known
    """
    centroid = a.mean(axis=0)
    centre = b.mean(axis=0)
    u, s, vt = np.linalg.svd((b - centre).T @ (a - centroid))
    sign = np.ones(len(s))
    if not mirrored:  # of the orthogonal matrices that fit, the rotation
        sign[-1] = np.sign(np.linalg.det(u @ vt)) or 1.0
    turn = (u * sign) @ vt
    if scale is None:
        spread = float(((a - centroid) ** 2).sum())
        scale = max(float((s * sign).sum()) / max(spread, 1e-300), 1e-12)
    return turn, centre - scale * turn @ centroid, scale
