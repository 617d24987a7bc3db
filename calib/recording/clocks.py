"""The camera's clock against the joints': offset and rate, or a refusal.

The best of the offsets that may fit must be clearly better than its rival.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..common.parallel import one_blas_thread
from ..errors import LogError
from .clock_search import Clocks, Pair
from .track import jumps

Array = NDArray[np.float64]

SURE = 1.5e-3
"""The standard deviation of the offset that is accepted [s]."""

_CHAINS = 3  # candidates to which a chain is fitted
_CHAIN_FITS = 0.03  # a planar chain that leaves more of the track's spread is none
_CLEARLY = 0.6  # the best candidate's error must be less than this share of its rival's
_FITS = 0.25  # and less than this share of the track's spread
_FASTEST = 0.012  # difference of the rates: beyond it the stated frame rate is not the true one
_APART = 0.3  # candidates further apart than this are rivals [s]


class ClockError(LogError):
    """Clocks of a video and its joints that no offset, or more than one, brings together."""


@one_blas_thread()
def align_clocks(
    time: Array,
    pixels: Array,
    joint_time: Array,
    q: Array,
    revolute: Sequence[bool] | None = None,
) -> Clocks:
    """Find when the joints were where the camera saw the tag.

    Parameters
    ----------
    time, pixels : (n,) array [s], (n, 2) array [px]
        Times of frames, by the camera's clock, and where the tag was; NaN where it was not seen.
    joint_time, q : (m,) array [s], (m, joints) array [rad or m]
        Joints, at increasing times by their clock.
    revolute : sequence of bool, optional
        Which joints turn; all if not given.

    Raises
    ------
    ClockError
        If nothing moves, no offset fits, or more than one does.
    """
    seen = np.isfinite(pixels[:, 0]) & ~jumps(pixels)
    t, x = time[seen], pixels[seen]
    if len(t) < 20:
        raise ClockError(f"the tag is in {len(t)} frames only: too few to match the clocks by")
    spread = float(np.sqrt(((x - x.mean(0)) ** 2).sum(1).mean()))
    if spread < 5.0 or np.ptp(q, axis=0).max() < 0.02:
        raise ClockError("the arm never moves, so the clocks cannot be matched; give `time_offset`")
    pair = Pair(t, x, joint_time, q)
    peaks = pair.peaks()
    if not len(peaks):
        raise ClockError(
            "the recordings are too short to match the clocks: expected at least 5 s of motion"
        )
    judged = sorted(map(pair.candidate, peaks), key=_by_error)
    apart = [c for k, c in enumerate(judged) if all(_apart(c, d) for d in judged[:k])]
    kinds = tuple(revolute) if revolute is not None else (True,) * q.shape[1]
    chains = [pair.chain(c, kinds) for c in apart[:_CHAINS]]
    fitted = sorted((c for c in chains if c is not None), key=_by_error)
    if not fitted or not fitted[0].error < _CHAIN_FITS * spread:
        fitted = sorted(map(pair.refined, apart[:_CHAINS]), key=_by_error)
    clocks = fitted[0]
    rival = min((c.error for c in fitted[1:] if _apart(c, clocks)), default=np.inf)
    if not clocks.error < _FITS * spread:
        raise ClockError(
            f"no offset between the clocks fits: the best leaves {clocks.error:.3g} px of "
            f"{spread:.3g} px; are these the joints of this video? else give `time_offset`"
        )
    if not clocks.error < _CLEARLY * rival:
        raise ClockError(
            f"the offset between the clocks is ambiguous: {clocks.offset:.2f} s leaves "
            f"{clocks.error:.3g} px, another leaves {rival:.3g} px; record a motion that does not "
            "repeat itself, or give `time_offset`"
        )
    if abs(clocks.rate) > _FASTEST:
        raise ClockError(
            f"the clocks' rates differ by {100 * clocks.rate:.1f} %, at most "
            f"{100 * _FASTEST:.1f} % expected: the video's frame rate is not the true one"
        )
    if not clocks.doubt < SURE:
        raise ClockError(
            f"the offset between the clocks is {clocks.offset:.3f} s but sure to "
            f"{1e3 * clocks.doubt:.2g} ms only, {1e3 * SURE:.2g} ms expected: record half a minute "
            "or more with varied motion, or give `time_offset`"
        )
    return replace(clocks, rival=float(rival))


def _apart(one: Clocks, other: Clocks) -> bool:
    return abs(one.offset - other.offset) > _APART


def _by_error(clocks: Clocks) -> float:
    return clocks.error
