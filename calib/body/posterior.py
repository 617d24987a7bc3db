"""The posterior of any structure: start, gate, final step over all rows, second fit, bound."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..common.arrays import Array
from .belief import Body, Second
from .covariance import as_kept
from .fit import MANY, Fit, maximise
from .gate import Passed, pass_gate
from .held_out import HeldOut, leave_blocks_out, own_ratio
from .parameters import Prior
from .settings import (
    GUARD_LENS,
    GUARDED_ROWS,
    LEAST_SHARE,
    LOG_FLOOR,
    NO_CURVES,
    REPEATS,
    SAME_POSE,
    SETTLED,
    SHARED_ROWS,
    SIMULATED_FLOOR,
    STUDENT,
)
from .starts import best_starts
from .structure import Structure


@dataclass(frozen=True)
class BodyFit:
    """A fitted body and how it was found."""

    body: Body
    held_out: Array  # (n, m), residuals of contiguous blocks predicted from the others
    notes: tuple[str, ...]  # what the rows cannot tell
    turned: Array | None = None  # (n,), held-out errors of orientation, where they were measured


def fit_structure(
    template: Structure,
    q: Array,
    z: Array,
    *,
    simulated: bool | None = None,
    seed: int = 0,
    notes: Sequence[str] = (),
) -> BodyFit:
    """Fit any structure: start, gate, final step over all rows, second fit, bound.

    template : signs and mirror are found by its starts
    q : (n, dof)
    z : (n, m)
    simulated : as in `fit_body`; by default what the template says, else False
    notes : passed on
    """
    simulated = template.simulated if simulated is None else simulated
    floor = (SIMULATED_FLOOR if simulated else LOG_FLOOR) * template.extents
    nu = np.inf if simulated else STUDENT
    members = template.members()
    chain = next((free for name, free in members if name == "chain"), members[0][1])
    sub_q, sub_z, few = q, z, len(q) <= template.gate_rows
    if not few:  # a draw in the order of the log
        rows = np.sort(np.random.default_rng(seed).permutation(len(q))[: template.gate_rows])
        sub_q, sub_z = q[rows], z[rows]
    passed = max(
        (
            pass_gate(start, chain, sub_q, sub_z, nu, floor)
            for start in best_starts(template, q, z, chain)
        ),
        key=lambda each: each.fit.evidence,
    )
    whole = passed.fit if few else _over_all_rows(passed, q, z, floor)
    held = leave_blocks_out(whole)
    body = _body(whole, held, passed.name, simulated)
    if not simulated:
        body = replace(
            body,
            repeat=repeatability(q, z[:, : template.blocks[0]]),
            second=_second(passed, chain, sub_q, sub_z, floor),
        )
    # Where the other blocks determine nothing, they predict their mean.
    residual = np.where(np.isfinite(held.residual), held.residual, z - z.mean(axis=0))
    return BodyFit(body, residual, tuple(notes))


def repeatability(q: Array, z: Array) -> float:
    """Sd of readings `z` (n, p) [unit] along an axis where joints (n, dof) are the same; else 0."""
    _, pose, count = np.unique(
        np.round(q / SAME_POSE), axis=0, return_inverse=True, return_counts=True
    )
    freedom = int((count - 1).sum())
    if freedom < REPEATS:
        return 0.0
    means = np.zeros((len(count), z.shape[1]))
    np.add.at(means, pose.ravel(), z)
    away = z - (means / count[:, None])[pose.ravel()]
    return float(np.sqrt((away**2).sum() / (freedom * z.shape[1])))


def _over_all_rows(passed: Passed, q: Array, z: Array, floor: Array) -> Fit:
    """The member's fit carried on over all rows, with its prior scales kept."""
    fit = passed.fit
    prior = fit.structure.prior(passed.free)
    sd = np.zeros(len(prior.sd))
    sd[fit.active] = fit.sd
    learn = bool((fit.noise > floor).any())  # exact rows leave nothing to learn of their noise
    steps = 4 if len(fit.active) > MANY else 10
    whole = maximise(
        fit.structure, q, z, fit.beta, Prior(prior.mean, sd),
        nu=fit.nu, floor=floor, noise=fit.noise, learn=learn, steps=steps, tolerance=SETTLED,
    )  # fmt: skip
    return replace(whole, scales=fit.scales)


def _body(fit: Fit, held: HeldOut, member: str, simulated: bool) -> Body:
    """The belief of a fit."""
    structure = fit.structure
    return Body(
        structure,
        fit.beta,
        fit.active,
        as_kept(fit.covariance),
        fit.noise,
        max(1.0, held.ratio(), own_ratio(fit)),
        held.tau(fit.noise, structure.blocks),
        np.zeros(structure.outputs),
        fit.nu,
        fit.autocorrelation,
        {k: float(v) for k, v in fit.scales.items()},
        len(fit.residual),
        simulated,
        member,
    )


def _second(
    passed: Passed, chain: tuple[str, ...], q: Array, z: Array, floor: Array
) -> Second | None:
    """What the member left out, for the bound: the whole chain, curves under a wider hyperprior.

    None where the member has the chain and the rows speak against curves.
    """
    fit = passed.fit
    bends = "curve" in passed.free or passed.against("curves") < NO_CURVES
    groups = fit.structure.groups
    more = [
        name for name in ("elastic", "lens") if len(groups.get(name, ())) and len(q) >= GUARDED_ROWS
    ]
    if not bends and {*chain, *more} <= set(passed.free):
        return None
    free = tuple(dict.fromkeys((*passed.free, *chain, *more, *(("curve",) if bends else ()))))
    prior = fit.structure.prior(free)
    sd = prior.sd.copy()
    if "lens" in more and fit.structure.kind == "planar":
        sd[groups["lens"]] = GUARD_LENS, 0.0, 0.0
    sd[fit.active] = fit.sd
    (pseudo, rms), hypers = fit.structure.wide, []
    for h in prior.hypers:
        if h.name.startswith("curve"):  # many pseudo-observations of a large one
            hypers.append(replace(h, pseudo=pseudo, scale=rms / np.sqrt(len(h.indices))))
        elif not np.isin(h.indices, fit.active).any():  # a group that the member left out
            hypers.append(h)
    for h in hypers:
        sd[h.indices] = h.scale * np.sqrt(h.shape)
    made = maximise(
        fit.structure, q, z, fit.beta, Prior(prior.mean, sd, tuple(hypers)),
        nu=fit.nu, floor=floor, noise=fit.noise, steps=4, begun=fit,
    )  # fmt: skip
    # Few rows of an arm in space tell how large its curves are altogether, if not where.
    few = len(q) < SHARED_ROWS and fit.structure.kind == "spatial"
    share = np.clip(leave_blocks_out(made).ratio(), LEAST_SHARE, 1.0) if few else 1.0
    root = as_kept(float(share) ** 2 * made.covariance)
    return Second(made.beta, made.active, root, made.noise)
