"""Sound rows of a log: what a first fit shows to be wrong with it is mended, and fitted again."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from ..body.belief import Body
from ..common.rows import thinned
from ..errors import LogError
from ..model.model import Model
from ..model.prediction import predict
from ..samples.delays import Delay, Trajectory, estimate_delay
from ..samples.diagnosis import aligned, rows_behind
from ..samples.joint_values import directions
from ..samples.motion import Motion
from ..samples.samples import Samples
from ..samples.settings import FAR_BETTER, FEWEST_ROWS
from ..samples.wrong_rows import contradicting_corner, contradictions
from .smooth import NO_ARM, SmoothPart

_Fit = Callable[[Samples], SmoothPart]
_ROUNDS = 3  # after which a delay is as sure as it gets
_STEPS = 8  # of a delay and the parameters beside it, from one fit
_ORDERED_ROWS = 150  # rows that orders of joints are compared by
_MANY_TIMES = 30.0  # the stated noise of a log: such errors are no calibration's
_ROWS = 4_000  # neighbouring rows that a delay rests on


def fit_sound_rows(
    samples: Samples, fit: _Fit
) -> tuple[Samples, SmoothPart, list[str]]:
    """Fit samples; of a log without its delay and without the rows that contradict the others.

    fit : finds the smooth part of samples; called again where something was mended
    Returns the samples that are learned from, their smooth part and notes.
    """
    if samples.simulation is not None:
        return samples, fit(samples), []
    notes: list[str] = []
    motion = Trajectory.of(samples)
    start = 0.0
    if samples.arm is not None and not samples.in_time:
        shift = rows_behind(samples.arm.forward, samples.q, samples.x, samples.unit)
        if shift and motion is None:  # poses beside the positions of others
            rows = np.arange(max(shift, 0), len(samples) + min(shift, 0))
            samples = replace(samples.take(rows), q=samples.q[rows - shift])
            notes = [
                f"positions are moved by {-shift:+d} rows to those of their joints"
            ]
        elif motion is not None:
            start = shift * motion.step
    part = fit(motion.moved(samples, start) if motion and start else samples)
    samples, again, told = _without_delay(samples, motion, part.fit.body, fit, start)
    part = again or part
    notes += told + _other_order(samples, part, fit)
    kept, told = contradictions(samples, samples.x - part.fit.body.predict(samples.q))
    if not kept.all():
        samples = samples.take(kept)
        part = fit(samples)
    corner = contradicting_corner(samples, samples.x - part.fit.body.predict(samples.q))
    return samples, part, [*notes, *told, *([corner] if corner else ())]


def _other_order(samples: Samples, part: SmoothPart, fit: _Fit) -> list[str]:
    """Say that joints without a robot fit far better in another order from base to tip."""
    dof = samples.dof
    stated = samples.source.get("noise")
    most = NO_ARM * float(np.linalg.norm(np.ptp(samples.x, axis=0)))
    far = min(most, _MANY_TIMES * stated if isinstance(stated, float) else most)
    if samples.arm is not None or not 2 <= dof <= 3 or part.error <= far:
        return []
    some = samples.take(thinned(len(samples), _ORDERED_ROWS))
    tried = {}
    for order in itertools.permutations(range(dof)):
        k = list(order)
        names = tuple(samples.joint_names[j] for j in order)
        told: dict[str, Any] = {
            name: getattr(some, name)[k] for name in ("lower", "upper")
        }
        told |= {
            "joint_names": names,
            "revolute": tuple(some.revolute[j] for j in order),
        }
        tried[names] = fit(replace(some, q=some.q[:, k], **told)).error
    best = min(tried, key=lambda names: tried[names])
    if tried[best] >= min(FAR_BETTER * tried[samples.joint_names], most):
        return []
    return [
        f"the rows fit far better with the joints in the order {', '.join(best)}: name them so in "
        "`joints`, from base to tip"
    ]


def sound_log(model: Model, samples: Samples) -> tuple[Samples, list[str]]:
    """A log that a model is compared with, in time and without rows that contradict the others.

    samples : in the model's unit; the arm or its sensor may have changed
    Returns the samples, their joints in the model's order, and what is told of them.
    """
    if samples.touch is not None:
        raise LogError(
            "the log holds touches of sockets, whose places nobody measured: `calib.evaluate` "
            "tells how they scatter; train anew with them, and with those of before"
        )
    names = ("joint_names", "lower", "upper", "revolute")
    limits: dict[str, Any] = {name: getattr(model.about, name) for name in names}
    samples = replace(samples, q=model.about.joints_of(samples), **limits)
    notes: list[str] = []
    if model.body is not None:
        samples, _, notes = _without_delay(samples, Trajectory.of(samples), model.body)
    predicted = predict(model, Motion.of(samples)).value
    residual = samples.x - predicted
    known = np.asarray(np.isfinite(predicted).all(axis=1))
    if known.sum() < FEWEST_ROWS:
        return samples, notes
    # a sensor that was moved is no reason to leave rows out
    there = samples.x[known]
    affine = samples.unit == "px"
    moved = there - aligned(predicted[known], there, affine=affine)
    far, near = (np.median(np.linalg.norm(r, axis=1)) for r in (residual[known], moved))
    if near < 0.5 * far:
        residual[known] = moved
    kept, told = contradictions(samples, residual)
    left_out = samples.left_out + int(np.count_nonzero(~kept))
    return replace(samples.take(kept), left_out=left_out), notes + told


def _without_delay(
    samples: Samples,
    motion: Trajectory | None,
    body: Body,
    fit: _Fit | None = None,
    start: float = 0.0,
) -> tuple[Samples, SmoothPart | None, list[str]]:
    """The log with its joints at the times of its positions, where a delay is clear.

    fit : fits the body anew to moved samples; without it the body is that of another log
    start : a delay that rows have shown, with which the body was fitted
    Returns the samples, the smooth part of moved ones, and notes.
    """
    delay = (
        None
        if motion is None
        else _delay(samples, motion, body, start, fresh=fit is not None)
    )
    if (
        motion is not None and start
    ):  # beside which its rest explains little, or nothing
        told = delay or Delay(start, 0.1 * motion.step, motion.unit, 1.0)
        delay = replace(told, share=1.0)
    if motion is None or delay is None or not delay.clear:
        return (
            samples,
            None,
            [delay.note()] if delay is not None and delay.note() else [],
        )

    moved = samples
    part = None
    for _ in range(_ROUNDS):  # where joints jump, a delay by rows is found by several
        moved = motion.moved(samples, delay.value)
        if fit is not None:  # with curves that have not followed the delay
            part = fit(moved)
            body = part.fit.body
        again = _delay(samples, motion, body, delay.value, fresh=False)
        if again is None or abs(again.value - delay.value) < again.sd:
            break
        delay = replace(again, share=delay.share)
    return moved, part, [delay.note()]


def _delay(
    samples: Samples, motion: Trajectory, body: Body, start: float, *, fresh: bool
) -> Delay | None:
    """Estimate a delay from `start` on, together with the chain and its frame.

    fresh : whether the body was fitted to these rows as they are: then its curves may have followed
        the delay along a path, and are left out
    """
    structure: Any = body.structure
    total = start
    share = 0.0
    if structure.outputs != samples.x.shape[1]:
        return None
    members = dict(structure.members())
    prior = structure.prior(members.get("chain", structure.members()[0][1]))
    active = prior.active
    beta = body.beta.copy()
    if fresh:
        beta[np.setdiff1d(np.arange(len(beta)), active)] = 0.0
        fixed = prior.sd == 0
        beta[fixed] = prior.mean[fixed]
    middle = len(motion.time) // 2
    some = slice(max(0, middle - _ROWS // 2), middle + _ROWS // 2)
    for _ in range(_STEPS):
        q, speed = (each[some] for each in motion.before(total))
        known = np.asarray(np.isfinite(q).all(axis=1))
        if known.sum() < len(known) // 2:
            return None
        q = q[known]
        speed = speed[known]
        x = samples.x[some][known]
        seen, slope = structure.predict_and_slope(q, beta)
        found = estimate_delay(
            structure.residual(x, seen),
            np.einsum("nmk,nk->nm", slope, speed),
            structure.linearise(q, beta, active)[1],
            prior.sd[active] ** -2.0,
            (prior.mean - beta)[active],
            play=slope
            * directions(q)[:, None],  # joints with play err by their direction
            unit=motion.unit,
        )
        if found is None:
            return None
        step, change = found
        share = share or step.share
        full = np.zeros(len(beta))
        full[active] = change
        beta = structure.retract(beta, full)
        total = total + step.value
        if abs(step.value) < 0.05 * step.sd:
            break
    return Delay(total, step.sd, step.unit, share)
