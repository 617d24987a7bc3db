"""The tag's track: what of it cannot be the tip."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import LogError
from .judge import MOST, held_out
from .tags import Tag

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

STILL = 2.0
"""A tag that moves less than this over a recording does not move [px]."""


@dataclass
class TipTags:
    """The tip's tag in pictures or frames, one after the other, and why it was not taken.

    Attributes
    ----------
    number : int
        Id of the tag.
    reasons : Counter of str
        Why pictures have no tag, and how many.
    twice : list
        Where it was there twice: names of pictures, or times [s].
    """

    number: int
    reasons: Counter[str] = field(default_factory=Counter)
    twice: list[Any] = field(default_factory=list)

    def pick(self, found: Sequence[Tag], where: object) -> tuple[Tag | None, Tag | None]:
        """Return the tag as far as it was found, and only if it is sharp."""
        tip = [tag for tag in found if tag.number == self.number]
        if len(tip) > 1:
            self.twice.append(where)
            return None, None
        if not tip:
            self.reasons[f"tag {self.number} not seen"] += 1
            return None, None
        if not tip[0].sharp:
            self.reasons["blurred"] += 1
        return tip[0], tip[0] if tip[0].sharp else None


def check_motion(q: Array, pixels: Array, tag: int, what: str) -> None:
    """Refuse a recording in which the arm, or the tag alone, stands still.

    Raises
    ------
    LogError
        With the place of a tag that stays while joints move.
    """
    moved = float(np.linalg.norm(np.ptp(pixels, axis=0)))
    if np.ptp(q, axis=0).max() < 2e-3:
        raise LogError(f"the arm never moves in {what}: nothing to learn from")
    if moved < STILL:
        u, v = np.median(pixels, axis=0)
        raise LogError(
            f"tag {tag} stays at ({u:.0f}, {v:.0f}) px in all of {what} while the joints move: "
            "check that it is on the tip and that no second tag of this id is in view"
        )


def stuck(q: Array, pixels: Array) -> Mask:
    """Find rows where the tag is again at one place although the joints are elsewhere.

    A second tag of the same id lies still, and is seen where the first is hidden: three rows or
    more at one place, to half a pixel, whose joints differ by far more than those of rows that a
    working arm brings there.  Joints (n, joints) and pixels (n, 2) give a mask (n,).
    """
    n = len(pixels)
    result = np.zeros(n, bool)
    spread = np.maximum(np.ptp(q, axis=0), 1e-9)
    scale = float(np.linalg.norm(np.ptp(pixels, axis=0)))
    for k in range(n):
        near = np.linalg.norm(pixels - pixels[k], axis=1) < 0.5
        if near.sum() < 3 or result[k]:
            continue
        moved = float(np.ptp(q[near], axis=0).max() / spread.max())
        if moved > 0.1 and scale > 20.0:
            result |= near
    return result if result.mean() < 0.5 else np.zeros(n, bool)


def astray(q: Array, pixels: Array) -> Mask:
    """Find single rows far from where the others say that the joints put the tag.

    Rows go one after another, the worst first, at most a tenth of them.
    """
    n = len(q)
    result = np.zeros(n, bool)
    if not 15 <= n <= MOST:
        return result
    spread = float(np.linalg.norm(pixels.std(axis=0)))
    for _ in range(n // 10):
        rows = np.flatnonzero(~result)
        distance = held_out(q[rows], pixels[rows], blocks=len(rows))
        worst = int(np.argmax(distance))
        rest = np.delete(rows, worst)  # which it spoils as long as it is among them
        typical = float(np.median(held_out(q[rest], pixels[rest], blocks=len(rest))))
        if distance[worst] < max(25.0 * typical, 0.2 * spread):
            break
        result[rows[worst]] = True
    return result


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
