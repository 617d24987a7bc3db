"""Sound rows of a log: what a first fit shows to be wrong with it is mended, and fitted again."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from ..common.arrays import Array
from ..common.rows import thinned
from ..common.scale import Scale
from ..errors import LogError
from ..model.model import Model
from ..samples.alignment import aligned, rows_behind
from ..samples.delays import Delay, Trajectory, estimate_delay
from ..samples.samples import Samples
from ..samples.settings import FAR_BETTER, FEWEST_ROWS
from ..samples.wrong_rows import contradicting_corner, contradictions
from .smooth import NO_ARM, SmoothPart

_Fit = Callable[[Samples], SmoothPart]
_ROUNDS = 3  # fits after which a delay is as sure as it gets
_STEPS = 8  # of a delay and the parameters beside it, from one fit
_ORDERED_ROWS = 150  # rows that orders of joints are compared by
_MANY_TIMES = 30.0  # the stated noise of a log: such errors are no calibration's
_ROWS = 4_000  # neighbouring rows that a delay rests on


def fit_sound_rows(
    samples: Samples, scale: Scale, fit: _Fit
) -> tuple[Samples, SmoothPart, list[str]]:
    """Fit samples; of a log without its delay and without the rows that contradict the others.

    fit : finds the smooth part of samples; called again where something was mended
    Returns the samples that are learned from, their smooth part and notes.
    """
    if samples.simulation is not None:
        return samples, fit(samples), []
    samples, notes = _rows_aligned(samples)
    part = fit(samples)
    samples, part, told = _without_delay(samples, part, fit)
    notes += told + _other_order(samples, part, fit)
    residual = samples.x - part.candidate.smooth.value(scale.to_unit(samples.q))
    kept, told = contradictions(samples, residual)
    notes += told
    if not kept.all():
        samples = samples.take(kept)
        part = fit(samples)
        residual = samples.x - part.candidate.smooth.value(scale.to_unit(samples.q))
    corner = contradicting_corner(samples, residual)
    return samples, part, [*notes, corner] if corner else notes


def _other_order(samples: Samples, part: SmoothPart, fit: _Fit) -> list[str]:
    """Say that joints without a robot fit far better in another order from base to tip."""
    dof, stated = samples.dof, samples.source.get("noise")
    error = _body_error(part)
    extent = float(np.linalg.norm(np.ptp(samples.x, axis=0)))
    noisy = isinstance(stated, float) and error > _MANY_TIMES * stated
    if samples.arm is not None or not 2 <= dof <= 3 or not (noisy or error > NO_ARM * extent):
        return []
    some = samples.take(thinned(len(samples), _ORDERED_ROWS))
    tried = {}
    for order in itertools.permutations(range(dof)):
        rows, names = list(order), tuple(samples.joint_names[k] for k in order)
        other = replace(
            some,
            q=some.q[:, rows],
            joint_names=names,
            lower=some.lower[rows],
            upper=some.upper[rows],
            revolute=tuple(some.revolute[k] for k in rows),
        )
        tried[names] = _body_error(fit(other))
    best = min(tried, key=lambda names: tried[names])
    if not tried[best] < min(FAR_BETTER * tried[samples.joint_names], NO_ARM * extent):
        return []
    return [
        f"the rows fit far better with the joints in the order {', '.join(best)}: name them so in "
        "`joints`, from base to tip"
    ]


def _body_error(part: SmoothPart) -> float:
    """Mean distance of held-out rows from the body."""
    return float(np.linalg.norm(part.fit.held_out, axis=1).mean())


def sound_log(model: Model, samples: Samples) -> tuple[Samples, list[str]]:
    """A log that a model is compared with, in time and without rows that contradict the others."""
    samples, notes = in_time(model, samples)
    predicted = model.forward(samples.q)
    known = np.asarray(np.isfinite(predicted).all(axis=1))
    residual = np.where(known[:, None], samples.x - predicted, np.nan)
    if known.sum() >= FEWEST_ROWS:
        # a sensor that was moved is no reason to leave rows out
        moved = residual.copy()
        moved[known] = samples.x[known] - aligned(
            predicted[known], samples.x[known], affine=samples.unit == "px"
        )
        far, near = (np.nanmedian(np.linalg.norm(r, axis=1)) for r in (residual, moved))
        residual = moved if near < 0.5 * far else residual
        kept, told = contradictions(samples, residual)
        left_out = samples.left_out + int(np.count_nonzero(~kept))
        samples, notes = replace(samples.take(kept), left_out=left_out), notes + told
    return samples, notes


def in_time(model: Model, samples: Samples) -> tuple[Samples, list[str]]:
    """A log that a model is compared with, without the delay of its positions.

    samples : in the model's unit; the arm or its sensor may have changed
    Returns the samples, their joints in the model's order, and what is told of their clock.
    """
    if samples.touch is not None:
        raise LogError(
            "the log holds touches of sockets, whose places nobody measured: `calib.evaluate` "
            "tells how they scatter; train anew with them, and with those of before"
        )
    samples = replace(
        samples,
        q=model.about.joints_of(samples),
        joint_names=model.about.joint_names,
        lower=model.about.lower,
        upper=model.about.upper,
        revolute=model.about.revolute,
    )
    notes: list[str] = []
    motion = Trajectory.of(samples) if model.body is not None else None
    if motion is not None:
        delay = _delay(samples, motion, model.body, 0.0, fresh=False)
        for _ in range(_ROUNDS):  # where joints jump, a step of rows is found by several
            if delay is None or not delay.clear:
                break
            found = _delay(samples, motion, model.body, delay.value, fresh=False)
            if found is None or abs(found.value - delay.value) < found.sd:
                break
            delay = replace(found, share=delay.share)
        if delay is not None and delay.clear:
            q = motion.before(delay.value)
            known = np.asarray(np.isfinite(q).all(axis=1))
            samples = replace(samples.take(known), q=q[known])
        if delay is not None and delay.note():
            notes.append(delay.note())
    return samples, notes


def _rows_aligned(samples: Samples) -> tuple[Samples, list[str]]:
    """The log with its positions moved by whole rows, where the robot says that they have to be."""
    if samples.arm is None or samples.in_time:
        return samples, []
    shift = rows_behind(samples.arm.forward, samples.q, samples.x, samples.unit)
    if not shift:
        return samples, []
    n = len(samples)
    rows = np.arange(max(shift, 0), n + min(shift, 0))
    moved = replace(samples.take(rows), q=samples.q[rows - shift])
    return moved, [f"positions are moved by {-shift:+d} rows to those of their joints"]


def _without_delay(
    samples: Samples, part: SmoothPart, fit: _Fit
) -> tuple[Samples, SmoothPart, list[str]]:
    """The log with its joints at the times of its positions, where a delay is clear."""
    motion = Trajectory.of(samples)
    if motion is None:
        return samples, part, []
    delay, moved, now = None, samples, part
    for _ in range(_ROUNDS):
        start = 0.0 if delay is None else delay.value
        found = _delay(samples, motion, now.fit.body, start, fresh=delay is None)
        if found is None:
            break
        if delay is None and not found.clear:
            return samples, part, [found.note()] if found.note() else []
        settled = delay is not None and abs(found.value - delay.value) < found.sd
        delay = found if delay is None else replace(found, share=delay.share)
        if settled:
            break
        q = motion.before(delay.value)
        known = np.asarray(np.isfinite(q).all(axis=1))
        moved = replace(samples.take(known), q=q[known])
        now = fit(moved)
    return moved, now, [delay.note()] if delay is not None else []


def _delay(
    samples: Samples, motion: Trajectory, body: Any, start: float, *, fresh: bool
) -> Delay | None:
    """Estimate a delay from `start` on, together with the chain and its frame.

    fresh : whether the body was fitted to these rows as they are: then its curves may have followed
        the delay along a path, and are left out
    """
    structure, total, share = body.structure, start, 0.0
    if structure.outputs != samples.x.shape[1]:
        return None
    members = dict(structure.members())
    prior = structure.prior(members.get("chain", structure.members()[0][1]))
    active, beta = prior.active, body.beta.copy()
    if fresh:
        beta[np.setdiff1d(np.arange(len(beta)), active)] = 0.0
        fixed = prior.sd == 0
        beta[fixed] = prior.mean[fixed]
    middle = len(motion.time) // 2
    some = slice(max(0, middle - _ROWS // 2), middle + _ROWS // 2)
    for _ in range(_STEPS):
        q = motion.before(total)[some]
        known = np.asarray(np.isfinite(q).all(axis=1))
        if known.sum() < len(known) // 2:
            return None
        q, x = q[known], samples.x[some][known]
        seen, slope = structure.predict_and_slope(q, beta)
        columns = structure.linearise(q, beta, active)[1]
        speed = Trajectory(motion.time[some][known], q, motion.unit).velocity
        residual = structure.residual(x, seen)
        pull = (prior.mean - beta)[active]
        precision = prior.sd[active] ** -2.0
        found = estimate_delay(q, speed, residual, slope, columns, precision, pull, motion.unit)
        if found is None:
            return None
        step, change = found
        share = share or step.share
        full: Array = np.zeros(len(beta))
        full[active] = change
        beta, total = structure.retract(beta, full), total + step.value
        if abs(step.value) < 0.05 * step.sd:
            break
    return Delay(total, step.sd, step.unit, share)
