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
from .fit import Fit
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
    structure: Structure,
    rows: Sequence[Rows],
    *,
    begin: Array | None = None,
    simulated: bool | None = None,
    seed: int = 0,
) -> BodyFit:
    """Fit a structure to what one sensor or several saw of its chain.

    structure : the chain and its priors; signs and mirror are found, and without a drawing the
        chain.  Of several sensors it is what `rows.together` makes of it.
    rows : of each sensor; the first one's are what the belief predicts, and what is held out
    begin : (d,), parameters to begin with; by default they are found from the first sensor's rows
    simulated : whether the rows are samples of a simulation: Gaussian weights, a lower noise
        floor; by default what the structure says
    seed : chooses the rows of the gate where there are many
    """
    simulated = structure.simulated if simulated is None else simulated
    share = settings.SIMULATED_FLOOR if simulated else settings.LOG_FLOOR
    size = share * np.array([*[structure.extent] * 3, 1.0, 1.0, 1.0])  # rotations in rad
    rows = [replace(each, floor=size[: each.z.shape[1]]) for each in rows]
    found = _fitted(structure, rows, begin, simulated, seed)
    if not isinstance(structure, PlanarStructure) or structure.nominal is None:
        return found
    if structure.view == "base" or _typical(found) < settings.DOUBTED * structure.extent:
        return found
    free = _fitted(replace(structure, nominal=None), rows, begin, simulated, seed)
    if not _typical(free) < _typical(found) / 2:
        return found
    note = "the nominal geometry does not fit the rows, even with its frame free: it is not used"
    return replace(free, notes=(note,))


def _typical(found: BodyFit) -> float:
    """Median length of held-out residuals."""
    return float(np.median(np.linalg.norm(found.held_out, axis=1)))


def _fitted(
    structure: Structure, rows: Sequence[Rows], begin: Array | None, simulated: bool, seed: int
) -> BodyFit:
    q, z = rows[0].q, rows[0].z
    nu = np.inf if simulated else settings.STUDENT
    members = structure.members()
    chain = next((free for name, free in members if name == "chain"), members[0][1])
    some, rng = list(rows), np.random.default_rng(seed)
    for k, each in enumerate(rows):
        if len(each) > structure.gate_rows:  # a draw in the order of the log
            some[k] = each.take(np.sort(rng.permutation(len(each))[: structure.gate_rows]))
    starts = (
        (Start(structure, begin),) if begin is not None else best_starts(structure, q, z, chain)
    )
    tried = [pass_gate(start, chain, some, nu) for start in starts]
    passed = max(tried, key=lambda each: each.fit.evidence)
    whole = passed.fit
    if any(len(few) < len(every) for few, every in zip(some, rows, strict=True)):
        whole = _over_all_rows(passed.fit, rows)
    held, own = leave_blocks_out(whole), whole.structure
    repeat, second = 0.0, None
    if not simulated:
        repeat = repeatability(q, z[:, : own.blocks[0]])
        second = _second(passed, chain, some)
    body = Body(
        own, whole.beta, whole.active, as_kept(whole.covariance), whole.noise,
        kappa=max(1.0, held.ratio()), tau=held.tau(whole), residual=np.zeros(own.outputs), nu=nu,
        autocorrelation=whole.autocorrelation, scales=passed.fit.scales, rows=len(z),
        simulated=simulated, member=passed.name, second=second, repeat=repeat,
    )  # fmt: skip
    # Where the other blocks determine nothing, they predict their mean.
    first, *others = (
        np.where(np.isfinite(residual), residual, each.z - each.z.mean(axis=0))
        for residual, each in zip(held.residuals, rows, strict=True)
    )
    return BodyFit(body, first, beside=tuple(others))


def repeatability(q: Array, z: Array) -> float:
    """Sd of readings `z` (n, p) [unit] along an axis where joints (n, dof) are the same; else 0."""
    _, pose, count = np.unique(q.round(6), axis=0, return_inverse=True, return_counts=True)
    freedom, pose = len(q) - len(count), pose.ravel()
    if freedom < settings.REPEATS:
        return 0.0
    means = np.stack([np.bincount(pose, axis) for axis in z.T], axis=1) / count[:, None]
    return float(np.sqrt(((z - means[pose]) ** 2).sum() / (freedom * z.shape[1])))


def _over_all_rows(fit: Fit, rows: Sequence[Rows]) -> Fit:
    """The member's fit carried on over all rows, with its prior scales kept."""
    sd = np.zeros(len(fit.beta))
    sd[fit.active] = fit.sd
    # exact rows leave nothing to learn of their noise
    learn = bool((fit.noise > fit.parts[0].floor).any())
    rows = fit.with_noise(rows)
    whole = Fit(fit.structure, rows, fit.beta, Prior(fit.mean, sd), nu=fit.nu)
    return whole.maximise(learn=learn, steps=4, tolerance=settings.SETTLED)


def _second(passed: Passed, chain: tuple[str, ...], rows: Sequence[Rows]) -> Second | None:
    """What the member left out, for the bound: the whole chain, curves under a wider hyperprior.

    Lens and elasticity too.  None where the member has them and the rows speak against curves.
    """
    fit, groups, count = passed.fit, passed.fit.structure.groups, len(rows[0])
    bends = "curve" in passed.free or passed.against("curves") < settings.NO_CURVES
    guarded = [name for name in ("elastic", "lens") if len(groups.get(name, ()))]
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
    wider = Prior(prior.mean, sd, tuple(hypers))
    made = Fit(fit.structure, fit.with_noise(rows), fit.beta, wider, nu=fit.nu).maximise(steps=4)
    # Few rows of an arm in space tell how large its curves are altogether, if not where.
    few = count < settings.SHARED_ROWS and fit.structure.kind == "spatial"
    share = np.clip(leave_blocks_out(made).ratio(), settings.LEAST_SHARE, 1.0) if few else 1.0
    root = as_kept(float(share) ** 2 * made.covariance)
    return Second(made.beta, made.active, root, made.noise)
