"""The one fit of a body: start, gate, final step over all rows, second fit, bound.

`fit` takes any structure, which is a chain, what is measured of it, and their prior.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..common.arrays import Array
from . import settings
from .belief import Body, Second
from .covariance import as_kept
from .gate import Passed, leave_blocks_out, pass_gate
from .parameters import Prior
from .planar import PlanarStructure
from .rows import Rows
from .starts import Start, best_starts
from .structure import Structure


@dataclass(frozen=True)
class BodyFit:
    """A fitted body and how it was found."""

    body: Body
    # (n, m), residuals of the first sensor's contiguous blocks of rows predicted from the others
    held_out: Array
    notes: tuple[str, ...] = ()  # what the rows cannot tell
    turned: Array | None = None  # (n,), held-out errors of orientation, where they were measured
    beside: tuple[Array, ...] = ()  # the same of further sensors

    def of_positions(self) -> BodyFit:
        """A fit to poses as one of positions, with the orientations' errors beside it.

        The parameters that the orientations told are kept, the tool's rotation among them.
        """
        body = self.body
        three = {name: getattr(body, name)[:3] for name in ("noise", "tau", "residual")}
        second = body.second and replace(body.second, noise=body.second.noise[:3])
        view = "base" if body.structure.view.startswith("base") else "rigid"
        structure = replace(body.structure, view=view)  # type: ignore[type-var]
        body = replace(body, structure=structure, second=second, **three)
        turned = np.linalg.norm(self.held_out[:, 3:], axis=1)
        return replace(self, body=body, held_out=self.held_out[:, :3], turned=turned)


def fit(
    structure: Structure, rows: Sequence[Rows], *, begin: Array | None = None, seed: int = 0
) -> BodyFit:
    """Fit a structure to what one sensor or several saw of its chain.

    structure : the chain and its priors; signs and mirror are found, and without a drawing the
        chain.  Of several sensors it is what `rows.together` makes of it.
    rows : of each sensor; the first one's are what the belief predicts
    begin : (d,), parameters to begin with; by default they are found from the first sensor's rows
    seed : chooses the rows of the gate where there are many
    """
    found = _fitted(structure, rows, begin, seed)
    if not isinstance(structure, PlanarStructure) or structure.nominal is None:
        return found
    typical = np.median(np.linalg.norm(found.held_out, axis=1))
    if structure.view == "base" or typical < settings.DOUBTED * structure.extent:
        return found
    free = _fitted(replace(structure, nominal=None), rows, begin, seed)
    if not np.median(np.linalg.norm(free.held_out, axis=1)) < typical / 2:
        return found
    note = "the nominal geometry does not fit the rows, even with its frame free: it is not used"
    return replace(free, notes=(note,))


def _fitted(structure: Structure, rows: Sequence[Rows], begin: Array | None, seed: int) -> BodyFit:
    """The fit; samples of a simulation have Gaussian weights and a lower noise floor."""
    floor, nu = settings.LOG_FLOOR, settings.STUDENT
    if structure.simulated:
        floor, nu = settings.SIMULATED_FLOOR, np.inf
    sizes = floor * np.array([*[structure.extent] * 3, 1.0, 1.0, 1.0])  # rotations in rad
    rows = [replace(each, floor=sizes[: each.z.shape[1]]) for each in rows]
    members, rng = structure.members(), np.random.default_rng(seed)
    chain = next((free for name, free in members if name == "chain"), members[0][1])
    # a draw in the order of the log
    drawn = [np.sort(rng.permutation(len(each))[: structure.gate_rows]) for each in rows]
    some = [each.take(own) for each, own in zip(rows, drawn, strict=True)]
    starts = (
        [Start(structure, begin)] if begin is not None else best_starts(structure, rows[0], chain)
    )
    tried = [pass_gate(start, chain, some, nu) for start in starts]
    passed = max(tried, key=lambda each: each.fit.evidence)
    whole = passed.fit
    if max(map(len, rows)) > structure.gate_rows:  # carried on over all rows, its scales kept
        sd = np.zeros(len(whole.beta))
        sd[whole.active] = whole.sd
        # exact rows leave nothing to learn of their noise
        learn = bool((whole.noise > whole.parts[0].floor).any())
        whole = whole.beginning(rows, Prior(whole.mean, sd))
        whole.maximise(learn=learn, steps=4, tolerance=settings.SETTLED)
    held, own, first = leave_blocks_out(whole), whole.structure, rows[0]
    body = Body(
        own, whole.beta, whole.active, as_kept(whole.covariance), whole.noise,
        kappa=max(1.0, held.ratio()), tau=held.tau(whole), residual=np.zeros(own.outputs), nu=nu,
        autocorrelation=whole.autocorrelation, scales=passed.fit.scales, rows=len(first),
        simulated=structure.simulated, member=passed.name,
    )  # fmt: skip
    if not structure.simulated:
        repeat = _repeatability(first.q, first.z[:, : own.blocks[0]])
        body = replace(body, second=_second(passed, chain, some), repeat=repeat)
    # Where the other blocks determine nothing, they predict their mean.
    residuals = [
        np.where(np.isfinite(residual), residual, each.z - each.z.mean(axis=0))
        for residual, each in zip(held.residuals, rows, strict=True)
    ]
    return BodyFit(body, residuals[0], beside=tuple(residuals[1:]))


def _repeatability(q: Array, z: Array) -> float:
    """Sd of readings `z` (n, p) [unit] along an axis where joints (n, dof) are the same; else 0."""
    _, pose, count = np.unique(q.round(6), axis=0, return_inverse=True, return_counts=True)
    freedom, pose = len(q) - len(count), pose.ravel()
    if freedom < settings.REPEATS:
        return 0.0
    means = np.stack([np.bincount(pose, axis) for axis in z.T], axis=1) / count[:, None]
    return float(np.sqrt(((z - means[pose]) ** 2).sum() / (freedom * z.shape[1])))


def _second(passed: Passed, chain: tuple[str, ...], rows: Sequence[Rows]) -> Second | None:
    """What the member left out, for the bound: the whole chain, curves under a wider hyperprior.

    Lens and elasticity too.  None where the member has them and the rows speak against curves.
    """
    fit, groups, count = passed.fit, passed.fit.structure.groups, len(rows[0])
    bends = "curve" in passed.free or passed.against("curves") < settings.NO_CURVES
    guarded = [name for name in ("elastic", "gravity", "lens") if len(groups.get(name, ()))]
    more = guarded if count >= settings.GUARDED_ROWS else []
    if not bends and {*chain, *more} <= set(passed.free):
        return None
    free = tuple(dict.fromkeys((*passed.free, *chain, *more, *(("curve",) if bends else ()))))
    prior = fit.structure.prior(free)
    sd = prior.sd.copy()
    if "lens" in more and fit.structure.kind == "planar":
        sd[groups["lens"]] = settings.GUARD_LENS, 0.0, 0.0
    sd[fit.active] = fit.sd
    (pseudo, rms), hypers = fit.structure.wide, []
    for h in prior.hypers:
        if h.name.startswith("curve"):  # many pseudo-observations of a large one
            hypers.append(h._replace(pseudo=pseudo, scale=rms / np.sqrt(len(h.indices))))
        elif not np.isin(h.indices, fit.active).any():  # a group that the member left out
            hypers.append(h)
    for h in hypers:
        sd[h.indices] = h.scale * np.sqrt(h.shape)
    made = fit.beginning(rows, Prior(prior.mean, sd, tuple(hypers))).maximise(steps=4)
    # Few rows of an arm in space tell how large its curves are altogether, if not where.
    few = count < settings.SHARED_ROWS and fit.structure.kind == "spatial"
    share = np.clip(leave_blocks_out(made).ratio(), settings.LEAST_SHARE, 1.0) if few else 1.0
    root = as_kept(float(share) ** 2 * made.covariance)
    return Second(made.beta, made.active, root, made.noise)
