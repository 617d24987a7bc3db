"""The tag's track: how well joints predict it, and what of it cannot be the tip.

Ridge regression on the products of the joints' harmonics, in which the tip of any arm and,
closely, its pixels are linear. Blocks of neighbouring rows are held out, in closed form.
"""

from __future__ import annotations

import numpy as np

from ..common.arrays import Array, Mask
from ..common.rows import thinned
from ..errors import LogError

_SEARCHED = 120  # rows that each of some eighty shifts is judged by
SOFT = 1e-4
"""Ridge, relative to the kernel's one."""

_STILL = 2.0  # [px]; a tag that moves less over a recording does not move


def harmonics(q: Array, other: Array) -> Array:
    """Return the covariance (n, m) of harmonics up to the second of each joint."""
    result = np.ones((len(q), len(other)))
    for a, b in zip(q.T, other.T, strict=True):
        c = np.cos(a[:, None] - b[None])
        result *= 0.45 + 0.45 * c + 0.1 * (2.0 * c**2 - 1.0)
    return result


class Judge:
    """A fit of what was seen by joints, from which blocks of rows are held out.

    Joints `q` (n, joints) are in the order of time; neighbouring rows are left out together,
    `blocks` times; `soft` is the ridge, relative to the kernel's one.
    """

    def __init__(self, q: Array, blocks: int = 8, soft: float = SOFT) -> None:
        n = len(q)
        self.q = q
        self._inverse = np.linalg.inv(harmonics(q, q) + 1.0 + soft * np.eye(n))  # one: a free mean
        self._parts = [p for p in np.array_split(np.arange(n), min(blocks, n)) if len(p)]

    def miss(self, x: Array) -> Array:
        """Return what the other blocks' fit leaves of values (n, d): linear in them."""
        weights = self._inverse @ (x - x.mean(0))
        miss: Array = np.empty_like(weights)
        for part in self._parts:
            miss[part] = np.linalg.solve(self._inverse[np.ix_(part, part)], weights[part])
        return miss

    def error(self, x: Array) -> float:
        """Return the median distance that values (n, d) are missed by."""
        return float(np.median(np.linalg.norm(self.miss(x), axis=1)))

    def predict(self, q: Array, x: Array) -> Array:
        """Return what the fit to values (n, d) of all rows says at joints (m, joints)."""
        middle = x.mean(0)
        return np.asarray((harmonics(q, self.q) + 1.0) @ (self._inverse @ (x - middle)) + middle)


def misses(q: Array, x: Array, blocks: int = 8) -> Array:
    """Return how far each row is predicted by the rows of other blocks (n,) [unit of x].

    Joints (n, joints) are in the order of time, x (n, d) is what was seen with them; neighbouring
    rows are left out together, `blocks` times, with the softness that has the least median.
    """
    return np.asarray(np.linalg.norm(Judge(q, blocks, softness(q, x, blocks)).miss(x), axis=1))


def softness(q: Array, x: Array, blocks: int = 8) -> float:
    """Return the ridge with which held-out blocks are predicted best."""
    return min((1e-2 * SOFT, SOFT, 1e2 * SOFT), key=lambda soft: Judge(q, blocks, soft).error(x))


def row_shift(q: Array, x: Array, most: int = 3) -> tuple[int, int, float, float]:
    """Find a row from which on the joints of a neighbour row fit better than a row's own.

    A picture that is missing leaves the rows before it right, so that every row may be the first.

    Returns that row, and how many rows further down its joints are, 0 where rows fit as they are;
    then mean distances [unit of x] that blocks of rows are predicted to, as they are and shifted.
    """
    n = len(q)

    def error(start: int, shift: int, *, moved: bool = True) -> float:
        rows = np.arange(n)
        source = rows + np.where(rows >= start, shift, 0)
        # rows without joints, and those whose joints an earlier one has, are left out
        good = np.flatnonzero((source >= 0) & (source < n) & ((rows < start) | (source >= start)))
        good = good[thinned(len(good), _SEARCHED)]
        return float(np.mean(misses(q[source[good] if moved else good], x[good])))

    # rows that predict each other well need no search
    if n < 12 + 2 * most or error(n, 0) < 0.02 * float(np.linalg.norm(x.std(axis=0))):
        return 0, 0, np.nan, np.nan
    step = max(1, n // 10)
    shifts = [shift for shift in range(-most, most + 1) if shift]
    tried = {(start, s): error(start, s) for start in range(0, n - 3, step) for s in shifts}
    for start, s in sorted(tried, key=lambda case: tried[case])[:4]:
        near = range(max(start - step + 1, 0), min(start + step, n - 3))
        tried |= {(k, s): error(k, s) for k in near}
    start, shift = min(tried, key=lambda case: tried[case])
    # of the same rows: one wrong row at the end is not mended by leaving it out
    other, own = tried[start, shift], error(start, shift, moved=False)
    return start, shift if other < 0.4 * own else 0, own, other


def check_motion(q: Array, pixels: Array, tag: int, what: str) -> None:
    """Raise LogError for a recording in which the arm, or the tag alone, stands still."""
    moved = float(np.linalg.norm(np.ptp(pixels, axis=0)))
    if np.ptp(q, axis=0).max() < 2e-3:
        raise LogError(f"the arm never moves in {what}: nothing to learn from")
    if moved < _STILL:
        u, v = np.median(pixels, axis=0)
        raise LogError(
            f"tag {tag} stays at ({u:.0f}, {v:.0f}) px in all of {what} while the joints move: "
            "check that it is on the tip and that no second tag of this id is in view"
        )


def stuck(q: Array, pixels: Array) -> Mask:
    """Find rows (n,) where the tag is again at one place although the joints are elsewhere.

    A second tag of the same id lies still, and is seen where the first is hidden: three rows or
    more at one place, to half a pixel, whose joints differ by far more than those of rows that a
    working arm brings there.
    """
    n = len(pixels)
    result = np.zeros(n, bool)
    spread = np.maximum(np.ptp(q, axis=0), 1e-9)
    scale = float(np.linalg.norm(np.ptp(pixels, axis=0)))
    for k in range(n):
        near = np.linalg.norm(pixels - pixels[k], axis=1) < 0.5
        if near.sum() < 3 or result[k]:
            continue
        # a working arm comes back to a place, but with about the same joints
        moved = float(np.ptp(q[near], axis=0).max() / spread.max())
        if moved > 0.1 and scale > 20.0:
            result |= near
    return result if result.mean() < 0.5 else np.zeros(n, bool)


def jumps(pixels: Array, half: int = 3) -> Mask:
    """Find frames away from the median of their neighbours (Hampel's filter).

    Pixels (n, 2), NaN where nothing was seen, with `half` neighbours on either side; a mask (n,).
    """
    seen = np.flatnonzero(np.isfinite(pixels[:, 0]))
    result = np.zeros(len(pixels), bool)
    if len(seen) < 2 * half + 1:
        return result
    x = np.pad(pixels[seen], ((half, half), (0, 0)), mode="edge")
    window = np.stack([x[k : k + len(seen)] for k in range(2 * half + 1)])
    middle = np.median(window, axis=0)
    far = np.linalg.norm(pixels[seen] - middle, axis=1)
    scale = 1.48 * np.median(np.abs(window - middle), axis=0).max(axis=1)
    result[seen] = far > 6.0 * np.maximum(scale, 1.0)
    return result
