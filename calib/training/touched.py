"""Training from touches: the arm and its sockets first; then sockets are positions like others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..arm.arm import SpatialArm
from ..body.spatial import structure_of
from ..body.touch import TouchFit, fit_touches
from ..common.arrays import Mask
from ..common.scale import Scale
from ..common.wording import listed
from ..errors import LogError
from ..maps.model_selection import of_body
from ..samples.samples import Samples
from .smooth import SmoothPart

_WRONG = 8.0  # times the rows' median error: the tip was not in this socket
_MOST = 0.25  # share of rows that may be wrong
_FEW = 12  # rows that tell an arm in space at least


def fit_sockets(samples: Samples, scale: Scale, seed: int) -> tuple[Samples, SmoothPart, list[str]]:
    """Fit arm and sockets; rows that are not in theirs are left out.

    Returns the samples with their sockets' places as positions, in the arm's base frame.
    Raises LogError if the touches tell nothing of the arm.
    """
    arm, touch = samples.arm, samples.touch
    assert touch is not None  # noqa: S101 - samples of touches
    if not isinstance(arm, SpatialArm):
        raise LogError("touches need the robot in space that made them: give its URDF")
    counts = np.bincount(touch.number, minlength=len(touch.sockets))
    if len(samples) < _FEW or counts.max() < 4:
        raise LogError(
            f"{len(samples)} touches of {len(counts)} sockets tell nothing of the arm: expected "
            "20 postures and more in each socket, with the wrist turned each way"
        )
    structure = structure_of(arm, "base")

    def fitted(rows: Mask) -> TouchFit:
        # sockets that lost all their rows are known no more
        own, number = np.unique(touch.number[rows], return_inverse=True)
        place = {int(old): new for new, old in enumerate(own)}
        known = [
            replace(each, points=tuple(place[k] for k in each.points))
            for each in touch.known
            if all(k in place for k in each.points)
        ]
        found = fit_touches(
            structure, samples.q[rows], number, known,
            lower=samples.lower, upper=samples.upper, seed=seed,
        )  # fmt: skip
        points = np.full((len(touch.sockets), 3), np.nan)
        points[own] = found.points
        return replace(found, points=points)

    kept = np.ones(len(samples), bool)
    for _ in range(3):
        found = fitted(kept)
        off = np.linalg.norm(found.fit.body.predict(samples.q) - found.points[touch.number], axis=1)
        now = off <= _WRONG * np.median(off[kept])
        if (now == kept).all() or now.mean() < 1 - _MOST:
            break
        kept = now
    notes: list[str] = []
    if gone := int((~kept).sum()):
        lines = samples.rows if samples.rows is not None else np.arange(1, len(samples) + 1)
        first = listed([str(row) for row in lines[~kept][:5]])
        notes.append(f"{gone} rows were in no socket of theirs and are left out, rows {first}")
    if not any(each.value is not None for each in touch.known):
        notes.append(
            "touches alone do not tell how large the arm is: its size stays as drawn; state the "
            "distance of two points, as in `distance='A,B=50mm'`"
        )
    notes.append(
        "no touch tells where the base stands and how it is turned about the first axis: both stay "
        "as drawn and are left out of intervals"
    )
    samples = samples.take(kept)
    assert samples.touch is not None  # noqa: S101
    samples = replace(samples, x=found.points[samples.touch.number])
    u = scale.to_unit(samples.q)
    part = SmoothPart(of_body(found.fit, scale, u, samples.x), found.fit, np.arange(len(u)))
    return samples, part, notes
