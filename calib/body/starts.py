"""Starts of a fit: the best of a structure's guesses, by short robust runs of damped steps.

Of an arm in space a guess is where the sensor stands, by linear fits.  Where joint origins are free
they are found too, from the drawing's, which is a start and no prior, and from random ones: damped
Gauss-Newton over all of them brings most to a local optimum; the best of 24 was the best there is
in every case tried.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..arm.rotations import exponential, logarithm, nearest_rotation, similarity
from ..common.arrays import Array
from ..common.rows import median_length, thinned
from ..errors import LogError
from .fit import Fit
from .parameters import Prior
from .planar import PlanarStructure
from .planar_starts import framed, planar_starts
from .rows import Rows
from .settings import SIMULATED_FLOOR, START, STUDENT
from .spatial import SpatialStructure
from .structure import Structure

_FRAME = ("view.rotation", "view.shift", "view.scale", "lens")


@dataclass(frozen=True)
class Start:
    """A start of the fit."""

    structure: Structure  # with its signs and mirror
    beta: Array  # (d,)
    cost: float = 0.0  # negative log posterior at the start's own noise
    noise: float = 0.0  # share of the extents that the residuals have

    def run(self, q: Array, z: Array, prior: Prior, steps: int) -> Start:
        """Return the start carried on by damped steps."""
        rows = [Rows(q, z, floor=SIMULATED_FLOOR * self.structure.extents)]
        fit = Fit(self.structure, rows, self.beta, prior, nu=STUDENT)
        return Start(self.structure, *fit.settle(steps))


def best_start(
    structure: Structure, rows: Rows, free: tuple[str, ...]
) -> Start:
    """Return the start that explains rows best.

    free : groups that the runs fit; the gate's chain
    """
    order = np.random.default_rng(0).permutation(len(rows))
    some = rows.take(np.sort(order[: START.rows]))
    runs = candidates(structure, some)
    if len(runs) == 1:  # nothing to choose from: the gate goes on from here
        return runs[0]
    for steps in START.run_steps:
        runs = [
            run.run(some.q, some.z, run.structure.prior(free), steps)
            for run in runs
        ]
        runs = sorted(runs, key=lambda run: run.cost)[: START.runs]
    # A planar arm that turns the other way, seen from behind, fits as well: the drawing's own way.
    most = runs[0].cost + START.tied
    tied = [run for run in runs if not run.cost > most]
    return min(tied, key=lambda run: run.structure.reversals)


def with_other_sensors(start: Start, rows: Sequence[Rows]) -> Start:
    """Return a start with the further sensors placed where its arm, and their rows, say."""
    structure = start.structure
    beta = start.beta
    for further in rows[1:]:
        if not isinstance(further.sensor, str):
            continue
        there = structure.as_seen_by(further.sensor)
        some = further.take(thinned(len(further), START.rows))
        if isinstance(there, PlanarStructure):
            there, beta = framed(there, some.q, some.z, beta)
        elif isinstance(there, SpatialStructure):
            alone = frame(there, some.q, some.z, arm=beta)
            tool = there.groups["tool"]
            alone[there.groups["marker"]] += alone[tool] - beta[tool]
            placed = [there.groups[block] for block in (*_FRAME, "marker")]
            index = np.concatenate(placed)
            beta = beta.copy()
            beta[index] = alone[index]
        structure = there.as_seen_by(structure.viewpoint.name)
    return replace(start, structure=structure, beta=beta)


def candidates(structure: Structure, rows: Rows) -> list[Start]:
    """Return structures (signs, mirror, chain) and parameters to begin with, the best first.

    The noise of `rows` is that of a simulation, where it says so.
    """
    q = rows.q
    z = rows.z
    if isinstance(structure, PlanarStructure):
        return [Start(*start) for start in planar_starts(structure, q, z)]
    assert isinstance(structure, SpatialStructure)  # noqa: S101
    least = START.least_rows
    if structure.informed:
        least = structure.viewpoint.seen_as.least
    if len(q) < least:
        raise LogError(
            f"{len(q)} rows cannot place a spatial arm in its sensor's frame: expected {least} or "
            "more, of poses that differ in every joint"
        )
    size = max(float(np.abs(z).max()), 1e-12)
    if float(np.ptp(z, axis=0).max()) <= 1e-9 * size:
        raise LogError(
            "the positions are the same in every row: the sensor saw no motion"
        )
    if not structure.informed:
        some = thinned(len(q), START.chain_rows)
        noise = 0.0 if rows.noise is None else float(np.max(rows.noise))
        return _chains(structure, q[some], z[some], noise / structure.extent)
    beta = frame(structure, q, z)
    if structure.view == "base pose":
        turn = beta[structure.groups["tool.rotation"]]
        if np.linalg.norm(turn) > START.target:
            structure = structure.with_view("base target")
    return [Start(structure, beta)]


def frame(
    structure: SpatialStructure, q: Array, z: Array, arm: Array | None = None
) -> Array:
    """Return parameters (d,) of an arm in the sensor frame that fits rows best.

    `arm` (d,) are the parameters of the arm, whose sensor and tool are found anew; by default
    the nominal ones.
    Raises LogError where even these leave most of what the rows spread.
    """
    drawn = arm is None
    groups = [group for group in structure.frame_groups if group != "lens"]
    sd = structure.prior(groups).sd
    some = thinned(len(q), START.guessed_rows)
    begin = structure.neutral() if arm is None else arm
    runs = [
        Start(structure, guess).run(
            q[some], z[some], Prior(guess, sd), START.guess_steps
        )
        for guess in _guesses(structure, q, z, begin)
    ]
    best = min(runs, key=lambda run: run.cost)
    best = best.run(q, z, Prior(best.beta, sd), START.steps)
    if structure.camera and drawn:
        # a camera's pose and its focal length help each other
        free = [*groups, "offset"]
        if any(structure.viewpoint.lens_sd):
            free.append("lens")
        sd = structure.prior(free).sd
        sd[structure.groups["offset"]] *= 20.0
        best = best.run(q, z, Prior(best.beta, sd), 60)
    if drawn and not structure.viewpoint.seen_as.scaled:
        _refuse_misfit(structure, q, z, best.beta)
    return best.beta


def _refuse_misfit(
    structure: SpatialStructure, q: Array, z: Array, beta: Array
) -> None:
    """Refuse rows that the nominal arm does not explain; the log's reader says why."""
    misfit = structure.residual(z, structure.predict(q, beta))
    off = median_length(misfit[:, :3])
    middle = np.median(z[:, :3], axis=0)
    size = float(np.linalg.norm(z[:, :3] - middle, axis=1).max())
    most = START.other_arm
    what = "positions"
    if structure.camera:
        most = START.no_camera
        what = "pixels"
    if off > most * size:
        raise LogError(
            f"the robot does not explain the {what}: half of the rows are more than {off:.3g} off, "
            f"of {size:.3g} that they spread; check the order of the joints, their unit and that "
            f"of the {what}, mirrored axes, times, and whether it is this robot"
        )
    turned = median_length(misfit[:, 3:])
    if turned > START.other_turns:
        raise LogError(
            f"the orientations do not turn as the joints do: {np.degrees(turned):.0f} deg are left "
            "(median); check their order and unit, or leave them out"
        )


def _guesses(
    structure: SpatialStructure, q: Array, z: Array, arm: Array
) -> Iterator[Array]:
    """Yield rough parameters from which the sensor's place is fitted."""
    beta = arm.copy()
    neutral = structure.neutral()
    for group in (*_FRAME, "tool", "tool.rotation"):
        indices = structure.groups[group]
        beta[indices] = neutral[indices]
    points, rotations = structure.pose(q, beta)
    if structure.camera:
        yield from _cameras(structure, points, z, beta)
        return
    if structure.view.startswith("base"):
        yield _with_hand(structure, beta, rotations, z)
        return
    aside = START.tool * structure.chain.reach
    sides = np.vstack([np.zeros(3), np.eye(3), -np.eye(3)])
    tools = aside * sides
    turns = [
        similarity(points + rotations @ tool, z[:, :3])[0] for tool in tools
    ]
    if structure.outputs == 6:
        # without it 2 of 48 mountings of long tools were not found
        turns.append(_turn_of_poses(rotations, exponential(z[:, 3:])))
        tools = np.vstack([tools, np.zeros(3)])
    groups = structure.groups
    for tool, turn in zip(tools, turns, strict=True):
        tip = points + rotations @ tool
        scale = structure.metre
        if structure.viewpoint.seen_as.scaled:
            scale = similarity(tip, z[:, :3])[2]
        shifts = z[:, :3] - scale * tip @ turn.T
        guess = beta.copy()
        guess[groups["tool"]] = tool
        guess[groups["view.rotation"]] = logarithm(turn)
        guess[groups["view.scale"]] = np.log(scale / structure.metre)
        guess[groups["view.shift"]] = shifts.mean(axis=0)
        yield _with_hand(structure, guess, turn @ rotations, z)


def _with_hand(
    structure: SpatialStructure, guess: Array, turned: Array, z: Array
) -> Array:
    """Return parameters (d,) with the turn of the tool, of orientations (n, 3, 3) without it."""
    out = guess.copy()
    if structure.outputs == 6:
        # A' X' Z of every row, averaged and made a rotation again
        back = np.swapaxes(turned, 1, 2)
        turns = back @ exponential(z[:, 3:])
        hand = nearest_rotation(turns.sum(axis=0))
        out[structure.groups["tool.rotation"]] = logarithm(hand)
    return out


def _turn_of_poses(rotations: Array, seen: Array) -> Array:
    """Return the turn X (3, 3) of the sensor of orientations (n, 3, 3): Z_k = X A_k Y.

    Relative rotations of any two rows are conjugate, so that X turns the axes of A_k A_l' into
    those of Z_k Z_l' (Park and Martin 1994); rows are paired with their neighbours.
    """
    nominal = _turns_between(rotations)
    observed = _turns_between(seen)
    return nearest_rotation(observed.T @ nominal)


def _turns_between(rotations: Array) -> Array:
    """Rotation vectors (n - 1, 3) from each of orientations (n, 3, 3) to the next."""
    before = np.swapaxes(rotations[:-1], 1, 2)
    return logarithm(rotations[1:] @ before)


def _cameras(
    structure: SpatialStructure, points: Array, z: Array, arm: Array
) -> Iterator[Array]:
    """Yield cameras that an affine fit of pixels to points suggests, at a few focal lengths."""
    groups = structure.groups
    known_focal = structure.viewpoint.lens[0]
    principal = np.asarray(structure.viewpoint.lens[1:3])
    middle = points.mean(axis=0)
    centred = points - middle
    ridge = 1e-6 * np.trace(centred.T @ centred) * np.eye(3)
    seen = z.mean(axis=0)
    affine = np.linalg.solve(
        centred.T @ centred + ridge, centred.T @ (z - seen)
    ).T
    # the rotation nearest to the affine camera's two rows; its third axis looks ahead
    u, s, vt = np.linalg.svd(affine, full_matrices=False)
    right, down = u @ vt
    upright = np.array([right, down, np.cross(right, down)])
    # an affine camera does not tell before from behind: also a start from elsewhere, tilted
    tilted = exponential([0.6, 0.0, 0.0]) @ upright
    factors = [1.0]
    if structure.viewpoint.lens_sd[0]:
        factors += [0.7, 1.4]
    for factor in factors:
        focal = factor * known_focal
        depth = focal / max(float(s.mean()), 1e-9)
        centre = np.append((seen - principal) / focal, 1.0) * depth
        for turn in (upright, tilted):
            guess = arm.copy()
            guess[groups["lens"][0]] = focal
            guess[groups["view.rotation"]] = logarithm(turn)
            guess[groups["view.shift"]] = centre - turn @ middle
            yield guess


def _chains(
    structure: SpatialStructure, q: Array, z: Array, least: float
) -> list[Start]:
    """Return chains that fit rows, the best first; at their origins the parameters are zero.

    The search begins at the structure's own chain, of a drawing where there is one, and goes on at
    random ones until one leaves no more than the noise or several that explain the rows agree.

    least : noise of the rows, a share of the extents, below which no chain is looked for
    """
    rng = np.random.default_rng(0)
    ends: list[Start] = []
    costs: list[float] = []  # of those that explain the rows
    begin = structure
    for _ in range(START.chains):
        prior = begin.prior(("placement", "tool"))
        end = Start(begin, prior.mean).run(q, z, prior, START.steps)
        there = _absorbed(begin, end.beta)
        ends.append(replace(end, structure=there, beta=there.neutral()))
        if end.noise <= max(START.exact, least):
            break
        if end.noise <= START.explained:
            costs.append(end.cost)
        agreeing = [cost for cost in costs if cost < min(costs) + START.same]
        if len(agreeing) >= START.alike:
            break
        begin = _drawn(structure, z, rng)
    return sorted(ends, key=lambda end: end.cost)[: START.alike]


def _absorbed(structure: SpatialStructure, beta: Array) -> SpatialStructure:
    """Return the structure whose nominal chain is where `beta` puts origins and tip."""
    zero = np.zeros((structure.chain.joints, 1))
    still = structure.move(zero, beta)
    axes = still.axes[..., 0]
    chain = replace(
        structure.chain,
        axes=axes / np.linalg.norm(axes, axis=1, keepdims=True),
        points=still.origins[..., 0],
        tip=still.position[..., 0],
        rotation=still.rotation[..., 0],
    )
    return replace(structure, chain=chain)


def _drawn(
    structure: SpatialStructure, z: Array, rng: np.random.Generator
) -> SpatialStructure:
    """Draw a chain: axes of any direction, links as long as the workspace suggests."""
    dof = structure.dof
    axes = rng.normal(size=(dof, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    link = structure.extent / structure.metre / np.sqrt(3 * dof)
    steps = link * rng.normal(size=(dof, 3))
    middle = z[:, :3].mean(axis=0) / structure.metre
    points = np.cumsum(steps, axis=0)
    points += middle - points.mean(axis=0)
    tip = points[-1] + link * rng.normal(size=3)
    chain = replace(structure.chain, axes=axes, points=points, tip=tip)
    return replace(structure, chain=chain)
