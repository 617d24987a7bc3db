"""The one fit of a body: start, gate, final step over all rows, second fit, bound.

`fit` takes any structure, which is a chain, what is measured of it, and their prior.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..common.arrays import Array
from . import settings
from .belief import Body, Second
from .covariance import as_kept
from .fit import Fit
from .gate import Passed, pass_gate
from .held_out import leave_blocks_out
from .parameters import Prior
from .planar import PlanarStructure
from .starts import best_starts
from .structure import Structure


@dataclass(frozen=True)
class BodyFit:
    """A fitted body and how it was found."""

    body: Body
    held_out: Array  # (n, m), residuals of contiguous blocks predicted from the others
    notes: tuple[str, ...] = ()  # what the rows cannot tell
    turned: Array | None = None  # (n,), held-out errors of orientation, where they were measured

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
    q: Array,
    z: Array,
    *,
    simulated: bool | None = None,
    seed: int = 0,
) -> BodyFit:
    """Fit a structure to rows.

    structure : its signs and mirror are found, and without a drawing its chain
    q : (n, dof), joint values as they are logged [rad or m]; further columns are the measurement's
    z : (n, m), what the sensor saw
    simulated : whether the rows are samples of a simulation: Gaussian weights, a lower noise
        floor; by default what the structure says
    seed : chooses the rows of the gate where there are many
    """
    q, z = np.asarray(q, dtype=float), np.asarray(z, dtype=float)
    found = _fitted(structure, q, z, simulated, seed)
    if not isinstance(structure, PlanarStructure) or structure.nominal is None:
        return found
    if structure.view == "base" or _typical(found) < settings.DOUBTED * structure.extent:
        return found
    free = _fitted(replace(structure, nominal=None), q, z, simulated, seed)
    if not _typical(free) < _typical(found) / 2:
        return found
    note = "the nominal geometry does not fit the rows, even with its frame free: it is not used"
    return replace(free, notes=(note,))


def _typical(found: BodyFit) -> float:
    """Median length of held-out residuals."""
    return float(np.median(np.linalg.norm(found.held_out, axis=1)))


def _fitted(structure: Structure, q: Array, z: Array, simulated: bool | None, seed: int) -> BodyFit:
    simulated = structure.simulated if simulated is None else simulated
    floor = (settings.SIMULATED_FLOOR if simulated else settings.LOG_FLOOR) * structure.extents
    nu = np.inf if simulated else settings.STUDENT
    members = structure.members()
    chain = next((free for name, free in members if name == "chain"), members[0][1])
    some_q, some_z, few = q, z, len(q) <= structure.gate_rows
    if not few:  # a draw in the order of the log
        rows = np.sort(np.random.default_rng(seed).permutation(len(q))[: structure.gate_rows])
        some_q, some_z = q[rows], z[rows]
    passed = max(
        (
            pass_gate(start, chain, some_q, some_z, nu, floor)
            for start in best_starts(structure, q, z, chain)
        ),
        key=lambda each: each.fit.evidence,
    )
    whole = passed.fit if few else _over_all_rows(passed, q, z, floor)
    held, own = leave_blocks_out(whole), whole.structure
    repeat, second = 0.0, None
    if not simulated:
        repeat = repeatability(q, z[:, : own.blocks[0]])
        second = _second(passed, chain, some_q, some_z, floor)
    body = Body(
        own, whole.beta, whole.active, as_kept(whole.covariance), whole.noise,
        kappa=max(1.0, held.ratio()), tau=held.tau(whole.noise, own.blocks),
        residual=np.zeros(own.outputs), nu=nu, autocorrelation=whole.autocorrelation,
        scales=passed.fit.scales, rows=len(z), simulated=simulated, member=passed.name,
        second=second, repeat=repeat,
    )  # fmt: skip
    # Where the other blocks determine nothing, they predict their mean.
    residual = np.where(np.isfinite(held.residual), held.residual, z - z.mean(axis=0))
    return BodyFit(body, residual)


def repeatability(q: Array, z: Array) -> float:
    """Sd of readings `z` (n, p) [unit] along an axis where joints (n, dof) are the same; else 0."""
    _, pose, count = np.unique(
        np.round(q / settings.SAME_POSE), axis=0, return_inverse=True, return_counts=True
    )
    freedom = int((count - 1).sum())
    if freedom < settings.REPEATS:
        return 0.0
    means = np.zeros((len(count), z.shape[1]))
    np.add.at(means, pose.ravel(), z)
    away = z - (means / count[:, None])[pose.ravel()]
    return float(np.sqrt((away**2).sum() / (freedom * z.shape[1])))


def _over_all_rows(passed: Passed, q: Array, z: Array, floor: Array) -> Fit:
    """The member's fit carried on over all rows, with its prior scales kept."""
    fit = passed.fit
    sd = np.zeros(len(fit.beta))
    sd[fit.active] = fit.sd
    learn = bool((fit.noise > floor).any())  # exact rows leave nothing to learn of their noise
    return Fit(
        fit.structure, q, z, fit.beta, Prior(fit.mean, sd), nu=fit.nu, floor=floor, noise=fit.noise
    ).maximise(learn=learn, steps=4, tolerance=settings.SETTLED)


def _second(
    passed: Passed, chain: tuple[str, ...], q: Array, z: Array, floor: Array
) -> Second | None:
    """What the member left out, for the bound: the whole chain, curves under a wider hyperprior.

    Lens and elasticity too.  None where the member has them and the rows speak against curves.
    """
    fit, groups = passed.fit, passed.fit.structure.groups
    bends = "curve" in passed.free or passed.against("curves") < settings.NO_CURVES
    guarded = [name for name in ("elastic", "lens") if len(groups.get(name, ()))]
    more = guarded if len(q) >= settings.GUARDED_ROWS else []
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
    made = Fit(
        fit.structure, q, z, fit.beta, Prior(prior.mean, sd, tuple(hypers)),
        nu=fit.nu, floor=floor, noise=fit.noise,
    ).maximise(steps=4)  # fmt: skip
    # Few rows of an arm in space tell how large its curves are altogether, if not where.
    few = len(q) < settings.SHARED_ROWS and fit.structure.kind == "spatial"
    share = np.clip(leave_blocks_out(made).ratio(), settings.LEAST_SHARE, 1.0) if few else 1.0
    root = as_kept(float(share) ** 2 * made.covariance)
    return Second(made.beta, made.active, root, made.noise)
