"""The fit of a body: start, gate, all rows, second fit, bound; `fit` goes through them in order.

`fit` takes any structure, which is a chain, what is measured of it, and their prior; `fit_sensors`
takes what several sensors measured of one chain.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..common.arrays import Array
from ..common.rows import median_length, row_lengths
from .belief import Body, GuardFit
from .covariance import as_kept, root_of
from .fit import Fit, Start
from .gate import Member, pass_gate
from .held_out import leave_blocks_out
from .layout import with_all_sensors
from .parameters import Hyper, Prior
from .rows import Rows
from .settings import FIT, LOG_FLOOR, POSE_FLOOR, SIMULATED_FLOOR
from .starts import best_start, with_other_sensors
from .structure import Structure

_GUARDED = ("elastic", "gravity", "lens")
"""Blocks that the bound counts with, whether or not the member has them."""


@dataclass(frozen=True)
class BodyFit:
    """A fitted body and how well it predicts."""

    body: Body
    # (n, m), residuals of contiguous blocks of the sensor's rows, each predicted from the others
    held_out: Array
    # (n,), factor on the body's bound for these predictions, which rest on fewer rows
    widening: Array
    notes: tuple[str, ...] = ()  # what the rows cannot determine
    # (n,), held-out errors of orientation, where they were measured
    orientation_errors: Array | None = None
    # the body as further sensors see it
    other_sensors: tuple[BodyFit, ...] = ()

    def of_positions(self) -> BodyFit:
        """The fit to poses as a fit to positions, with the errors of orientations.

        Parameters that only orientations determine stay, such as the tool's rotation.
        """
        body = self.body
        view = "base" if body.structure.view.startswith("base") else "rigid"
        positions = replace(
            body,
            structure=body.structure.with_sensor(view=view),
            noise=body.noise[:3],
            tau=body.tau[:3],
            residual=body.residual[:3],
        )
        errors = row_lengths(self.held_out[:, 3:])
        held_out = self.held_out[:, :3]
        return replace(
            self, body=positions, held_out=held_out, orientation_errors=errors
        )


def fit(
    structure: Structure,
    rows: Sequence[Rows],
    *,
    begin: Array | None = None,
    seed: int = 0,
) -> BodyFit:
    """Fit a structure to what one sensor or several saw of its chain.

    A planar arm whose drawing the rows contradict is fitted again without it.

    structure : the chain and its priors; signs and mirror are found, and without a drawing the
        chain.  Of several sensors it is what `rows.with_measurements` or
        `layout.with_all_sensors` makes of it.
    rows : of each sensor; the first one's are what the belief predicts
    begin : (d,), initial parameters; by default those that the first sensor's rows suggest
    seed : chooses the rows of the gate where there are many
    """
    drawn = _fit(structure, rows, begin, seed)
    undrawn = structure.undrawn()
    error = median_length(drawn.held_out)
    if undrawn is None or error < FIT.doubted * structure.extent:
        return drawn
    free = _fit(undrawn, rows, begin, seed)
    if not median_length(free.held_out) < error / 2:
        return drawn
    note = "the nominal geometry does not fit the rows, even with its frame free: it is not used"
    return replace(free, notes=(note,))


def _fit(
    structure: Structure, rows: Sequence[Rows], begin: Array | None, seed: int
) -> BodyFit:
    """Fit a structure, whose drawing counts: start, gate, all rows, second fit, bound."""
    rows = [
        replace(rows_of_sensor, floor=_least_noise(structure, rows_of_sensor))
        for rows_of_sensor in rows
    ]
    chain = structure.chain_blocks
    if begin is None:
        best = best_start(structure, rows[0], chain)
        start = with_other_sensors(best, rows)
    else:
        start = Start(structure, begin)
    gate_rows = _gate_rows(structure, rows, seed)
    member = pass_gate(start, chain, gate_rows)
    final = _over_all_rows(member.fit, rows)
    root = as_kept(root_of(final.covariance))
    second = _second_fit(member, chain, gate_rows)
    first, *other_sensors = [
        _with_bound(member, final, root, sensor, second)
        for sensor in range(len(rows))
    ]
    return replace(first, other_sensors=tuple(other_sensors))


def fit_sensors(
    structures: Mapping[str, Structure],
    rows: Mapping[str, Rows],
    *,
    seed: int = 0,
) -> dict[str, BodyFit]:
    """Fit one chain to the rows of several sensors; return the body as each of them sees it.

    structures : of each sensor by its name, as it would be alone; the first one's drawing counts
    rows : of each sensor by its name, in the same order
    """
    named = [replace(rows[name], sensor=name) for name in structures]
    first = fit(with_all_sensors(structures), named, seed=seed)
    fits = (replace(first, other_sensors=()), *first.other_sensors)
    return dict(zip(structures, fits, strict=True))


def _gate_rows(
    structure: Structure, rows: Sequence[Rows], seed: int
) -> list[Rows]:
    """Those rows of each sensor that the gate uses, in the order of the log."""
    rng = np.random.default_rng(seed)
    gate_rows: list[Rows] = []
    for rows_of_sensor in rows:
        order = rng.permutation(len(rows_of_sensor))
        first = order[: structure.gate_rows]
        gate_rows.append(rows_of_sensor.take(np.sort(first)))
    return gate_rows


def _least_noise(structure: Structure, rows: Rows) -> Array:
    """The least noise (m,) [unit, rad] that rows are taken to have."""
    as_seen = structure.as_seen_by(rows.sensor)
    share = LOG_FLOOR if as_seen.outputs <= 3 else POSE_FLOOR
    if structure.simulated:
        share = SIMULATED_FLOOR
    return share * as_seen.extents


def _over_all_rows(fit: Fit, rows: Sequence[Rows]) -> Fit:
    """A fit of the gate's rows continued on all rows, with its scales unchanged."""
    if max(map(len, rows)) <= fit.structure.gate_rows:
        return fit
    sd = np.zeros(len(fit.beta))
    sd[fit.active] = fit.sd
    prior = Prior(fit.mean, sd)
    return fit.continued_on(rows, prior).maximise(
        steps=4, tolerance=FIT.settled
    )


def _with_bound(
    member: Member,
    final: Fit,
    root: Array,
    sensor: int,
    second: GuardFit | None,
) -> BodyFit:
    """The body as one sensor sees it, with its bound and held-out errors.

    final : the member's fit to all rows
    root : (k, k), of its covariance
    sensor : number of the sensor
    """
    readings = final.readings[sensor]
    structure = readings.structure
    held_out = leave_blocks_out(final, sensor=sensor)
    body = Body(
        structure=structure,
        beta=final.beta,
        active=final.active,
        root=root,
        noise=readings.noise,
        kappa=max(1.0, held_out.ratio),
        tau=held_out.tau,
        residual=np.zeros(structure.outputs),
        scales=member.fit.scales,
        rows=len(readings.z),
        simulated=structure.simulated,
        member=member.name,
        second=second,
    )
    # rows that the other blocks do not determine are predicted by the mean
    unknown = readings.z - readings.z.mean(axis=0)
    residual = held_out.residual
    errors = np.where(np.isfinite(residual), residual, unknown)
    return BodyFit(body, errors, held_out.widening)


def _second_fit(
    member: Member, chain: tuple[str, ...], rows: Sequence[Rows]
) -> GuardFit | None:
    """A fit of blocks that the member lacks, for the bound: whole chain, lens, elasticity, curves.

    None for exact samples, and where the member lacks only curves, and the evidence is against
    them.
    """
    structure = member.fit.structure
    if structure.simulated or structure.zeros_alone:
        return None
    blocks = {*chain}
    if len(rows[0]) >= FIT.guarded_rows:
        blocks |= {*_GUARDED} & structure.groups.keys()
    if "curve" in member.free or member.against_curves < FIT.no_curves:
        blocks.add("curve")
    elif blocks <= {*member.free}:
        return None
    wide = member.fit.continued_on(rows, _wide_prior(member, blocks))
    wide.maximise(steps=4)
    share = 1.0
    if len(rows[0]) < structure.few_rows:
        ratio = leave_blocks_out(wide).ratio
        share = float(np.clip(ratio, FIT.least_share, 1.0))
    root = as_kept(share * root_of(wide.covariance))
    return GuardFit(wide.beta, wide.active, root)


def _wide_prior(member: Member, blocks: set[str]) -> Prior:
    """The prior of the member's own blocks, unchanged, and of further blocks.

    Curves have the larger rms of `Structure.wide`, and some blocks the sd of `Structure.guards`.
    """
    first = member.fit
    structure = first.structure
    prior = structure.prior([*member.free, *blocks])
    sd = prior.sd.copy()
    for block in blocks & structure.guards.keys():
        indices = structure.groups[block]
        sd[indices] = structure.guards[block]
    sd[first.active] = first.sd
    hypers: list[Hyper] = []
    pseudo, rms = structure.wide
    for hyper in prior.hypers:
        if hyper.name.startswith("curve"):
            # held by many pseudo-observations of a large one
            waves = float(np.sqrt(len(hyper.indices)))
            larger = hyper._replace(pseudo=pseudo, scale=rms / waves)
            hypers.append(larger)
        elif not np.isin(hyper.indices, first.active).any():
            hypers.append(hyper)
    for hyper in hypers:
        relative = np.sqrt(hyper.shape)
        sd[hyper.indices] = hyper.scale * relative
    return Prior(prior.mean, sd, tuple(hypers))
