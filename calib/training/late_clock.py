"""A late clock: the delay of a log along a path, estimated together with the arm and its frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..body.belief import Body
from ..common.rows import finite_rows
from ..samples.delays import Delay, Trajectory, estimate_delay
from ..samples.motion import directions
from ..samples.samples import Samples
from .settings import LATE_CLOCK


def samples_in_time(
    samples: Samples, body: Body, *, fresh: bool = False
) -> tuple[Samples, list[str]]:
    """Align the clocks of a log along a path where a delay is clear, else state their uncertainty.

    fresh : whether the body was fitted to these rows, rather than to another log
    Returns the samples with their joints at the times of their positions, and notes.
    """
    trajectory = Trajectory.of(samples)
    if trajectory is None:
        return samples, []
    delay = _delay(samples, trajectory, body, fresh=fresh)
    if delay is None:
        return samples, []
    if not delay.clear:
        # without an uncertainty, 17 of 40 unchanged logs of 9 s, 3 ms late, were "drifted"
        velocity = np.nan_to_num(trajectory.before(0.0)[1])
        return replace(samples, clock_sd=delay.doubt * velocity), []
    in_time = trajectory.samples_before(samples, delay.value, delay.sd)
    return in_time, [delay.note()]


def _delay(
    samples: Samples, trajectory: Trajectory, body: Body, *, fresh: bool
) -> Delay | None:
    """Estimate a delay together with the chain and its frame.

    fresh : whether the body was fitted to these rows; then its curves may have absorbed the delay,
        and are left out
    """
    structure = body.structure
    if structure.outputs != samples.x.shape[1]:
        return None
    # all blocks but curves: beside the chain alone, .1 deg of elasticity made a delay of 40 ms one
    # of 41.1 +- .5, which elasticity then absorbed, and errors of .03 mm .5; scales of a body that
    # has absorbed the delay are too wide to find it
    prior = (structure if fresh else body).prior(structure.blocks_but_curves)
    active = prior.active
    beta = body.beta.copy()
    if fresh:
        beta[prior.sd == 0] = prior.mean[prior.sd == 0]
    middle = len(samples) // 2
    half = LATE_CLOCK.rows // 2
    rows = np.arange(max(0, middle - half), min(middle + half, len(samples)))
    late = 0.0
    first_share = 0.0  # that the delay explains before other parameters follow
    rms = np.inf
    for _ in range(LATE_CLOCK.steps):
        q, speed = trajectory.before(late)
        inside = rows[finite_rows(q[rows])]
        if len(inside) < 0.5 * len(rows):
            return None
        q = q[inside]
        predicted, slope = structure.predict_and_slope(q, beta)
        residual = structure.residual(samples.x[inside], predicted)
        estimate = estimate_delay(
            residual,
            velocity=np.einsum("nmk,nk->nm", slope, speed[inside]),
            columns=structure.linearise(q, beta, active)[1],
            precision=prior.sd[active] ** -2.0,
            pull=(prior.mean - beta)[active],
            # joints with play err by their side
            play=slope * directions(q)[:, None],
        )
        if estimate is None:
            return None
        delay, change = estimate
        beta = structure.after_step(beta, active, change)
        first_share = first_share or delay.share
        late += delay.value
        # while other parameters still move, the sd of the delay is too large
        rms_before = rms
        rms = float(np.sqrt((residual**2).mean()))
        is_settled = abs(delay.value) < LATE_CLOCK.settled * delay.sd
        if is_settled and rms > LATE_CLOCK.falls * rms_before:
            break
    return Delay(late, delay.sd, trajectory.unit, first_share)
