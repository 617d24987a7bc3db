"""Late clock: the delay of a log's positions, estimated together with the chain and its frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from ..body.belief import Body
from ..common.rows import finite_rows
from ..samples.delays import Delay, Trajectory, estimate_delay
from ..samples.motion import directions
from ..samples.samples import Samples
from .settings import LATE_CLOCK
from .smooth import SmoothPart


@dataclass(frozen=True, eq=False)
class InTime:
    """A log with its joints at the times of its positions, where a delay is clear."""

    samples: Samples
    part: SmoothPart | None = None  # of moved samples, where they were fitted
    notes: list[str] = field(default_factory=list)


def in_time(
    samples: Samples,
    trajectory: Trajectory,
    body: Body,
    start: float = 0.0,
    fit: Callable[[Samples], SmoothPart] | None = None,
) -> InTime:
    """Bring the clocks of a log together.

    start : a delay that rows have shown, with which the body was fitted
    fit : fits the body anew to moved samples; without it the body is that of another log
    """
    delay = _delay(samples, trajectory, body, start, fresh=fit is not None)
    if start:  # beside which its rest explains little, or nothing
        sd = 0.1 * trajectory.step
        delay = delay or Delay(start, sd, trajectory.unit, 1.0)
        delay = replace(delay, share=1.0)
    if delay is None or not delay.clear:
        return InTime(samples)
    moved = samples
    part = None
    # where joints jump, a delay is found by several
    for _ in range(LATE_CLOCK.rounds):
        moved = trajectory.moved(samples, delay.value)
        if fit is not None:  # with curves that have not followed the delay
            part = fit(moved)
            body = part.fit.body
        again = _delay(samples, trajectory, body, delay.value, fresh=False)
        if again is None or abs(again.value - delay.value) < again.sd:
            break
        delay = replace(again, share=delay.share)
    return InTime(moved, part, [delay.note()])


def _delay(
    samples: Samples,
    trajectory: Trajectory,
    body: Body,
    start: float,
    *,
    fresh: bool,
) -> Delay | None:
    """Estimate a delay from `start` on, together with the chain and its frame.

    fresh : whether the body was fitted to these rows as they are: then its curves may have followed
        the delay along a path, and are left out
    """
    structure = body.structure
    if structure.outputs != samples.x.shape[1]:
        return None
    members = structure.members()
    prior = structure.prior(dict(members).get("chain", members[0][1]))
    active = prior.active
    beta = body.beta.copy()
    if fresh:
        beta[prior.sd == 0] = prior.mean[prior.sd == 0]
    middle = len(trajectory.time) // 2
    half = LATE_CLOCK.rows // 2
    some = slice(max(0, middle - half), middle + half)
    total = start
    share = 0.0
    for _ in range(LATE_CLOCK.steps):
        q, speed = trajectory.before(total)
        q = q[some]
        inside = finite_rows(q)
        if inside.mean() < 0.5:
            return None
        q = q[inside]
        seen, slope = structure.predict_and_slope(q, beta)
        step = estimate_delay(
            structure.residual(samples.x[some][inside], seen),
            np.einsum("nmk,nk->nm", slope, speed[some][inside]),
            structure.linearise(q, beta, active)[1],
            prior.sd[active] ** -2.0,
            (prior.mean - beta)[active],
            # joints with play err by their direction
            play=slope * directions(q)[:, None],
            unit=trajectory.unit,
        )
        if step is None:
            return None
        delay, change = step
        share = share or delay.share
        moved = np.zeros(len(beta))
        moved[active] = change
        beta = structure.retract(beta, moved)
        total += delay.value
        if abs(delay.value) < LATE_CLOCK.settled * delay.sd:
            break
    return Delay(total, delay.sd, delay.unit, share)
