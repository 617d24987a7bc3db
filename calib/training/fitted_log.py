"""A fitted log: in time, without its play, and without the rows that contradict the others."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..body.approach import learn_play
from ..body.belief import Body
from ..common.arrays import Array, Mask
from ..common.rows import finite_rows, row_lengths, spread_rows
from ..common.wording import unit_of_joint
from ..samples.delays import Delay, Trajectory, estimate_delay
from ..samples.motion import directions
from ..samples.repeatability import at_poses
from ..samples.samples import Samples
from ..samples.tables import rows_in_words
from .settings import LATE_CLOCK, PLAY, WRONG
from .smooth import Fit, SmoothPart


def fit_sound_rows(samples: Samples, fit: Fit) -> FittedLog:
    """Fit samples; of a log without its delay and without the rows that contradict the others."""
    fitted = FittedLog.of(samples, fit)
    if samples.simulation is not None:
        return fitted.without_wrong_rows().without_play()
    # rows that came from the other side of a joint with play contradict the others, too; but a lag
    # looks like play
    if Trajectory.of(samples) is None:
        fitted = fitted.without_play()
    fitted = fitted.without_wrong_rows().in_time().without_play()
    # rows that contradict the others beside the better fit
    return fitted.without_wrong_rows()


@dataclass(frozen=True, eq=False)
class FittedLog:
    """A log with the body that is fitted to it; each method returns it with a new fit."""

    samples: Samples
    fit: Fit
    part: SmoothPart  # of these samples
    play: Array  # (dof,), half the play of each joint that the samples are freed of
    notes: tuple[str, ...] = ()

    @staticmethod
    def of(samples: Samples, fit: Fit) -> FittedLog:
        """The log as it is."""
        return FittedLog(samples, fit, fit(samples), np.zeros(samples.dof))

    def without_wrong_rows(self) -> FittedLog:
        """The log without the rows that contradict the others; a simulation without its outliers.

        The fit of a simulation believes every row: it finds a few outliers more each time.
        """
        simulation = self.samples.simulation
        if simulation is not None and not simulation.has_outliers:
            return self
        predicted = self.part.fit.body.predict(self.samples.q)
        sound, notes = contradictions(self.samples, self.samples.x - predicted)
        if sound.all():
            return self
        samples = self.samples.take(sound)
        fitted = replace(
            self,
            samples=samples,
            part=self.fit(samples),
            notes=(*self.notes, *notes),
        )
        return fitted if simulation is None else fitted.without_wrong_rows()

    def in_time(self) -> FittedLog:
        """The log with its clocks together, where a delay is clear."""
        samples, notes = in_time(self.samples, self.part.fit.body, fresh=True)
        if samples is self.samples:
            return self
        # curves that have not followed the delay
        part = self.fit(samples)
        return replace(
            self, samples=samples, part=part, notes=(*self.notes, *notes)
        )

    def without_play(self) -> FittedLog:
        """The log without the play that its order shows."""
        fitted = self
        # curves and frame have taken a part of it before
        for _ in range(PLAY.rounds):
            more = _play_of(at_poses(fitted.samples), fitted.part)
            if more is None:
                break
            samples = without_play(fitted.samples, more)
            fitted = replace(
                fitted,
                samples=samples,
                part=self.fit(samples),
                play=fitted.play + more,
            )
        return fitted


def contradictions(samples: Samples, residual: Array) -> tuple[Mask, list[str]]:
    """Find rows whose residual is gross, and far from those of the rows around them.

    A misfit of the prediction, or a corner where the sensor is worse, concerns neighbours alike.
    A row that has no neighbours contradicts none.

    residual : (n, m), measured less predicted positions, NaN where nothing is predicted
    Returns sound : (n,), False for a row to leave out; all are sound if these were over a quarter
    Returns notes : how many were left out, and which come first
    """
    n = len(samples)
    sound = np.ones(n, dtype=bool)
    size = np.nan_to_num(row_lengths(residual))
    low, high = np.quantile(samples.x, (0.05, 0.95), axis=0)
    limit = max(
        WRONG.gross * float(np.median(size)),
        WRONG.spread * float(np.quantile(size, 0.7)),
        WRONG.share * float(np.linalg.norm(high - low)),
    )
    suspects = np.flatnonzero(size > limit)
    if not len(suspects):
        return sound, []
    from scipy.spatial import cKDTree

    scale = samples.unit_box
    u = scale.to_unit(samples.q)
    box = scale.periodic.astype(float) if scale.periodic.any() else None
    tree = cKDTree(u, boxsize=box)
    around = min(WRONG.around, n - 1) + 1  # with the row itself
    some = u[spread_rows(n, WRONG.fitted)]
    usual = float(np.median(tree.query(some, k=[around])[0]))
    nearest = np.arange(1, around + 1)
    reach, near = map(np.asarray, tree.query(u[suspects], k=nearest))
    close = reach[:, -1] <= WRONG.near * usual
    suspects = suspects[close]
    near = near[close]
    others = residual[near]
    others[near == suspects[:, None]] = np.nan
    middle = np.nanmedian(others, axis=1)
    apart = np.linalg.norm(others - middle[:, None], axis=2)
    scatter = np.nanmedian(apart, axis=1)
    away = row_lengths(residual[suspects] - middle)
    wrong = suspects[away > np.maximum(limit, WRONG.apart * scatter)]
    if not 0 < len(wrong) <= WRONG.most * n:
        return sound, []
    sound[wrong] = False
    return sound, [
        f"left out, of learning and of the errors, {len(wrong):,} of {n:,} rows that "
        f"contradict their neighbours: {rows_in_words(samples.rows[wrong])}"
    ]


def _play_of(samples: Samples, part: SmoothPart) -> Array | None:
    """Half the play of each joint (dof,) [rad or m], None where the rows' order shows none."""
    simulation = samples.simulation
    exact = simulation is not None and not simulation.hidden
    if len(part.rows) < PLAY.fewest or exact or samples.side is None:
        return None
    rows = part.rows[:: -(-len(part.rows) // PLAY.most)]
    scale = part.smooth.scale
    u = scale.to_unit(samples.q[rows])
    value, slope = part.smooth.value_and_slope(u)
    # a joint near a limit mostly came from one side: its curve has taken that part already
    surprise = samples.side[rows].copy()
    for k, values in enumerate(np.clip(u, 0.0, 1.0).T):
        powers = np.polynomial.chebyshev.chebvander(
            2.0 * values - 1.0, PLAY.trend
        )
        trend = np.linalg.lstsq(powers, surprise[:, k])[0]
        surprise[:, k] -= powers @ trend
    return learn_play(samples.x[rows] - value, slope / scale.span, surprise)


def without_play(samples: Samples, play: Array) -> Samples:
    """Return the samples with the joints where they stood, rather than what they read."""
    assert samples.side is not None  # noqa: S101 - as samples are made
    return replace(samples, q=samples.q - play * samples.side)


def play_words(samples: Samples, play: Array) -> str:
    """One line about the backlash that the order of the rows shows."""
    backlash = []
    joints = zip(samples.joint_names, play, samples.revolute, strict=True)
    for name, half, turns in joints:
        factor, unit = unit_of_joint(turns, True)
        if half > 0.0:
            backlash.append(f"{name} {2 * factor * half:.3g} {unit}")
    return (
        f"the direction of approach counts, backlash of {', '.join(backlash)}: give it to forward "
        "for smaller errors, else the expected error covers both sides"
    )


def in_time(
    samples: Samples, body: Body, *, fresh: bool = False
) -> tuple[Samples, list[str]]:
    """Bring the clocks of a log along a path together where a delay is clear.

    fresh : whether the body was fitted to these rows, rather than to another log
    Returns the samples with their joints at the times of their positions, and notes.
    """
    trajectory = Trajectory.of(samples)
    if trajectory is None:
        return samples, []
    delay = _delay(samples, trajectory, body, fresh=fresh)
    if delay is None or not delay.clear:
        return samples, []
    return trajectory.samples_before(samples, delay.value), [delay.note()]


def _delay(
    samples: Samples,
    trajectory: Trajectory,
    body: Body,
    *,
    fresh: bool,
) -> Delay | None:
    """Estimate a delay together with the chain and its frame.

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
    total = 0.0
    share = 0.0
    spread = np.inf
    for _ in range(LATE_CLOCK.steps):
        q, speed = trajectory.before(total)
        q = q[some]
        inside = finite_rows(q)
        if inside.mean() < 0.5:
            return None
        q = q[inside]
        seen, slope = structure.predict_and_slope(q, beta)
        residual = structure.residual(samples.x[some][inside], seen)
        before = spread
        spread = float(np.sqrt((residual**2).mean()))
        step = estimate_delay(
            residual,
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
        # while the parameters beside it still move, its deviation is too large
        still = spread > LATE_CLOCK.falls * before
        if still and abs(delay.value) < LATE_CLOCK.settled * delay.sd:
            break
    return Delay(total, delay.sd, delay.unit, share)
