"""The one fit of a body: start, gate, final step over all rows, second fit, bound.

`fit` takes any structure, which is a chain, what is measured of it, and their prior; `fit_sensors`
takes what several sensors measured of one chain.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..common.arrays import Array
from . import settings
from .belief import Body, Second
from .covariance import as_kept
from .fit import Fit
from .gate import Passed, leave_blocks_out, pass_gate
from .gravity import other_direction
from .parameters import Hyper, Indices, Prior
from .rows import Rows, view_of
from .sensors import joined
from .starts import Start, best_starts, with_other_sensors
from .structure import Structure


@dataclass(frozen=True)
class BodyFit:
    """A fitted body and how it was found."""

    body: Body
    # (n, m), residuals of the sensor's contiguous blocks of rows predicted from the others
    held_out: Array
    notes: tuple[str, ...] = ()  # what the rows cannot tell
    # (n,), held-out errors of orientation, where they were measured
    turned: Array | None = None
    beside: tuple[BodyFit, ...] = ()  # the same body as further sensors see it

    def of_positions(self) -> BodyFit:
        """A fit to poses as one of positions, with the orientations' errors beside it.

        The parameters that the orientations told are kept, the tool's rotation among them.
        """
        body = self.body
        view = "base" if body.structure.view.startswith("base") else "rigid"
        second = body.second
        if second is not None:
            second = replace(second, noise=second.noise[:3])
        positions = replace(
            body,
            structure=replace(body.structure, view=view),  # type: ignore[type-var]
            noise=body.noise[:3],
            tau=body.tau[:3],
            residual=body.residual[:3],
            second=second,
        )
        turned = np.linalg.norm(self.held_out[:, 3:], axis=1)
        return replace(
            self, body=positions, held_out=self.held_out[:, :3], turned=turned
        )


def fit(
    structure: Structure,
    rows: Sequence[Rows],
    *,
    begin: Array | None = None,
    seed: int = 0,
) -> BodyFit:
    """Fit a structure to what one sensor or several saw of its chain.

    structure : the chain and its priors; signs and mirror are found, and without a drawing the
        chain.  Of several sensors it is what `rows.together` or `sensors.joined` makes of it.
    rows : of each sensor; the first one's are what the belief predicts
    begin : (d,), parameters to begin with; by default they are found from the first sensor's rows
    seed : chooses the rows of the gate where there are many
    """
    fitted = _fitted(structure, rows, begin, seed)
    undrawn = structure.undrawn()
    typical = np.median(np.linalg.norm(fitted.held_out, axis=1))
    if undrawn is None or typical < settings.DOUBTED * structure.extent:
        return fitted
    free = _fitted(undrawn, rows, begin, seed)
    if not np.median(np.linalg.norm(free.held_out, axis=1)) < typical / 2:
        return fitted
    note = "the nominal geometry does not fit the rows, even with its frame free: it is not used"
    return replace(free, notes=(note,))


def fit_sensors(
    structures: Mapping[str, Structure], rows: Mapping[str, Rows], *, seed: int = 0
) -> dict[str, BodyFit]:
    """Fit one chain to what several sensors saw of it: one belief, as each sensor sees it.

    structures : of each sensor by its name, as it would be alone; the first one's drawing counts
    rows : of each sensor by its name, in the same order
    """
    named = [replace(rows[name], sensor=name) for name in structures]
    first = fit(joined(structures), named, seed=seed)
    fits = (replace(first, beside=()), *first.beside)
    return dict(zip(structures, fits, strict=True))


def _fitted(
    structure: Structure, rows: Sequence[Rows], begin: Array | None, seed: int
) -> BodyFit:
    """The fit; samples of a simulation have Gaussian weights and a lower noise floor."""
    rows = [replace(each, floor=_least_noise(structure, each)) for each in rows]
    nu = np.inf if structure.simulated else settings.STUDENT
    members = structure.members()
    chain = next((free for name, free in members if name == "chain"), members[0][1])
    rng = np.random.default_rng(seed)
    some: list[Rows] = []
    for each in rows:  # a draw in the order of the log
        drawn = np.sort(rng.permutation(len(each))[: structure.gate_rows])
        some.append(each.take(drawn))
    if begin is None:
        starts = [
            with_other_sensors(start, rows)
            for start in best_starts(structure, rows[0], chain)
        ]
    else:
        starts = [Start(structure, begin)]
    candidates = [pass_gate(start, chain, some, nu) for start in starts]
    passed = max(candidates, key=lambda candidate: candidate.fit.evidence)
    whole = _over_all_rows(passed.fit, rows)
    second = None
    if not structure.simulated and not structure.zeros_alone:
        second = _second(passed, chain, some)
    root = as_kept(whole.covariance)
    first, *others = [
        _seen_by(k, passed, whole, second, rows[k], root) for k in range(len(rows))
    ]
    direction = other_direction(passed, some)
    notes = first.notes if direction is None else (*first.notes, direction)
    return replace(first, beside=tuple(others), notes=notes)


def _least_noise(structure: Structure, rows: Rows) -> Array:
    """Least noise (m,) [unit, rad] that rows are taken to have."""
    share = settings.SIMULATED_FLOOR if structure.simulated else settings.LOG_FLOOR
    extent = view_of(structure, rows).extent
    sizes = np.array([extent, extent, extent, 1.0, 1.0, 1.0])
    return share * sizes[: rows.z.shape[1]]


def _over_all_rows(fit: Fit, rows: Sequence[Rows]) -> Fit:
    """A fit of the gate's rows carried on over all, its scales kept."""
    if max(map(len, rows)) <= fit.structure.gate_rows:
        return fit
    sd = np.zeros(len(fit.beta))
    sd[fit.active] = fit.sd
    # exact rows leave nothing to learn of their noise
    learn = bool((fit.noise > fit.parts[0].floor).any())
    whole = fit.beginning(rows, Prior(fit.mean, sd))
    return whole.maximise(learn=learn, steps=4, tolerance=settings.SETTLED)


def _seen_by(
    k: int,
    passed: Passed,
    whole: Fit,
    second: tuple[Fit, Second] | None,
    rows: Rows,
    root: Array,
) -> BodyFit:
    """The body as the k-th sensor sees it, with its held-out errors."""
    part = whole.parts[k]
    measured = isinstance(rows.sensor, str) or k == 0
    held = (
        leave_blocks_out(whole, sensor=k)
        if measured
        else leave_blocks_out(whole, (), sensor=k)
    )
    simulated = whole.structure.simulated
    body = Body(
        structure=part.structure,
        beta=whole.beta,
        active=whole.active,
        root=root,
        noise=part.noise,
        kappa=max(1.0, held.ratio()) if measured else settings.UNKNOWN_KAPPA,
        tau=held.tau(part),
        residual=np.zeros(part.structure.outputs),
        nu=whole.nu,
        autocorrelation=whole.autocorrelation,
        scales=passed.fit.scales,
        rows=len(rows),
        simulated=simulated,
        member=passed.name,
        second=None
        if second is None
        else replace(second[1], noise=second[0].parts[k].noise),
        repeat=0.0
        if simulated
        else _repeatability(rows.q, rows.z[:, : part.structure.blocks[0]]),
    )
    # Where the other blocks determine nothing, they predict their mean.
    residual = np.where(
        np.isfinite(held.residual), held.residual, rows.z - rows.z.mean(axis=0)
    )
    return BodyFit(body, residual)


def _repeatability(q: Array, z: Array) -> float:
    """Sd of readings `z` (n, p) [unit] along an axis where joints (n, dof) are the same; else 0."""
    _, pose, count = np.unique(
        q.round(6), axis=0, return_inverse=True, return_counts=True
    )
    pose = pose.ravel()
    freedom = len(q) - len(count)
    if freedom < settings.REPEATS:
        return 0.0
    means = np.stack([np.bincount(pose, axis) for axis in z.T], axis=1) / count[:, None]
    return float(np.sqrt(((z - means[pose]) ** 2).sum() / (freedom * z.shape[1])))


def _second(
    passed: Passed, chain: tuple[str, ...], rows: Sequence[Rows]
) -> tuple[Fit, Second] | None:
    """What the member left out, for the bound: the whole chain, curves under a wider hyperprior.

    Lens and elasticity too.  None where the member has them and the rows speak against curves.
    """
    first = passed.fit
    groups = first.structure.groups
    count = len(rows[0])
    bends = "curve" in passed.free or passed.against("curves") < settings.NO_CURVES
    guarded: list[str] = []
    if count >= settings.GUARDED_ROWS:
        guarded = [
            name for name in ("elastic", "gravity", "lens") if len(groups.get(name, ()))
        ]
    if not bends and {*chain, *guarded} <= set(passed.free):
        return None
    free = (*passed.free, *chain, *guarded)
    if bends:
        free = (*free, "curve")
    prior = first.structure.prior(tuple(dict.fromkeys(free)))
    sd = prior.sd.copy()
    for block in guarded:
        guard = first.structure.guard(block)
        if guard is not None:
            sd[groups[block]] = guard
    sd[first.active] = first.sd
    hypers = _wider(prior.hypers, first.structure.wide, first.active)
    for hyper in hypers:
        sd[hyper.indices] = hyper.scale * np.sqrt(hyper.shape)
    wide = first.beginning(rows, Prior(prior.mean, sd, tuple(hypers))).maximise(steps=4)
    share = 1.0
    if count < first.structure.few_rows:
        share = float(
            np.clip(leave_blocks_out(wide).ratio(), settings.LEAST_SHARE, 1.0)
        )
    root = as_kept(share**2 * wide.covariance)
    return wide, Second(wide.beta, wide.active, root, wide.noise)


def _wider(
    hypers: Sequence[Hyper], wide: tuple[float, float], fitted: Indices
) -> list[Hyper]:
    """Scales of curves held by many pseudo-observations of a large one, and those left out."""
    pseudo, rms = wide
    out: list[Hyper] = []
    for hyper in hypers:
        if hyper.name.startswith("curve"):
            scale = rms / float(np.sqrt(len(hyper.indices)))
            out.append(hyper._replace(pseudo=pseudo, scale=scale))
        elif not np.isin(hyper.indices, fitted).any():
            out.append(hyper)
    return out
