"""Starts of a spatial body: where the sensor stands, by linear fits and a few damped steps.

Without a drawing the joint origins are found too, from random ones: each start turns every joint
about an axis drawn at random.  Damped Gauss-Newton over all origins brings most of them to a local
optimum; the best of 24 was the best there is in every case tried.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..arm.rotations import exponential, logarithm, nearest_rotation, similarity
from ..common.arrays import Array
from ..common.rows import thinned
from ..errors import LogError
from .belief import Body
from .fit import Fit
from .parameters import Prior
from .rows import Rows
from .settings import CLEAR, HELD_TOOL, OTHER_ARM, OTHER_TURNS, SIMULATED_FLOOR, STUDENT, TARGET
from .spatial import SpatialStructure
from .structure import Structure

#: Rows that a start is fitted to, and of a chain without a drawing.
_ROWS, _ROWS_ALONE = 400, 150
#: Rows that are enough to tell the best of its guesses.
_GUESSED = 60
#: Damped steps of a start, and of its guesses.
_STEPS, _FIRST = 40, 10
#: Fewest rows that tell a chain of which only the joints are known.
_LEAST = 10
#: Tools, as shares of the reach, from which tool and frame are fitted by turns, and how often.
_TOOL, _TURNS = 0.1, 8
#: A median residual beyond this share of the pixels' extent is no calibration error.
_PIXELS = 0.05
#: Random starts; the few that are best are carried on.  So many that end alike need no others.
_STARTS, _KEPT, _AGREE, _SAME = 24, 4, 4, 0.5


def spatial_starts(
    structure: SpatialStructure, q: Array, z: Array
) -> Sequence[tuple[Structure, Array]]:
    """Candidate starts of a fit: structures with their parameters (d,), the best one first."""
    least = structure.seen_as.least if structure.informed else _LEAST
    if len(q) < least:
        raise LogError(
            f"{len(q)} rows cannot place a spatial arm in its sensor's frame: expected {least} or "
            "more, of poses that differ in every joint"
        )
    if float(np.ptp(z, axis=0).max()) <= 1e-9 * max(float(np.abs(z).max()), 1e-12):
        raise LogError("the positions are the same in every row: the sensor saw no motion")
    rows = thinned(len(q), _ROWS)
    q, z = q[rows], z[rows]
    if not structure.informed:
        return _random_chains(structure, q, z)
    beta, view = frame(structure, q, z), structure.view
    if view == "base pose" and np.linalg.norm(beta[structure.groups["tool.rotation"]]) > TARGET:
        view = "base target"
    return [(replace(structure, view=view), beta)]


def frame(structure: SpatialStructure, q: Array, z: Array, arm: Array | None = None) -> Array:
    """Parameters (d,) of an arm in the sensor frame that fits rows best.

    `arm` (d,) are the parameters of the arm, whose sensor and tool are found anew; by default
    the nominal ones.
    """
    neutral = structure.neutral()
    arm = neutral if arm is None else arm
    groups = [group for group in structure.frame_groups if group != "lens"]
    sd = structure.prior(groups).sd
    some = thinned(len(q), _GUESSED)
    guesses = [
        _settled(structure, q[some], z[some], beta, Prior(beta, sd), _FIRST)
        for beta in _guesses(structure, q, z, arm)
    ]
    beta = min(guesses, key=lambda found: found[1])[0]
    beta = _settled(structure, q, z, beta, Prior(beta, sd), _STEPS)[0]
    if not (structure.camera or structure.seen_as.scaled):
        _refuse_misfit(structure, q, z, beta)
    if structure.camera and not (arm - neutral).any():
        # a camera's pose and its focal length help each other
        free = [*groups, "offset", *(["lens"] if any(structure.lens_sd) else [])]
        sd = structure.prior(free).sd
        sd[structure.groups["offset"]] *= 20.0
        beta = _settled(structure, q, z, beta, Prior(beta, sd), 60)[0]
    return beta


def _settled(
    structure: Structure, q: Array, z: Array, beta: Array, prior: Prior, steps: int
) -> tuple[Array, float, float]:
    rows = [Rows(q, z, floor=SIMULATED_FLOOR * structure.extents)]
    return Fit(structure, rows, beta, prior, nu=STUDENT).settle(steps)


def _refuse_misfit(structure: SpatialStructure, q: Array, z: Array, beta: Array) -> None:
    """Refuse rows that no rigid motion of the nominal arm explains; the log's reader says why."""
    misfit = structure.residual(z, structure.predict(q, beta))
    residual = float(np.median(np.linalg.norm(misfit[:, :3], axis=1)))
    size = max(float(np.linalg.norm(z[:, :3] - np.median(z[:, :3], axis=0), axis=1).max()), 1e-300)
    if residual > OTHER_ARM * size:
        raise LogError(
            f"the robot does not explain the positions: in the best frame half of the rows are "
            f"more than {residual:.3g} off, of {size:.3g} that they spread; check the order of "
            "the joints, their unit and the positions', mirrored axes, and whether it is this robot"
        )
    turned = float(np.median(np.linalg.norm(misfit[:, 3:], axis=1)))
    if turned > OTHER_TURNS:
        raise LogError(
            f"the orientations do not turn as the joints do: {np.degrees(turned):.0f} deg are left "
            "(median); check their order, their unit, and that they are of the tip, or leave them "
            "out"
        )


def refuse_pixels(body: Body, q: Array, pixels: Array) -> None:
    """Refuse pixels (n, 2) that the arm does not explain, and say whether mirrored ones would."""
    structure: Any = body.structure
    extent = float(np.linalg.norm(pixels - pixels.mean(axis=0), axis=1).mean())
    residual = float(np.median(np.linalg.norm(pixels - body.predict(q), axis=1)))
    if residual < _PIXELS * extent:
        return
    mirrored = pixels * (-1, 1) + (2 * structure.lens[1], 0)
    seen = structure.predict(q, frame(structure, q, mirrored))
    if np.median(np.linalg.norm(mirrored - seen, axis=1)) < CLEAR * residual:
        raise LogError(
            "the pixels are of a mirrored picture: u or v runs the wrong way, or they are swapped; "
            "write u as the picture's width less u, or v from the top"
        )
    raise LogError(
        f"no camera explains the pixels: it misses them by {residual:.3g} px (median) of "
        f"{extent:.3g}; check the joints' order and unit, and that each row's joints and pixels "
        "are of one moment"
    )


def _guesses(structure: SpatialStructure, q: Array, z: Array, arm: Array) -> list[Array]:
    """Rough parameters from which the sensor's place is fitted."""
    beta, neutral = arm.copy(), structure.neutral()
    for group in ("view.rotation", "view.shift", "view.scale", "tool", "tool.rotation", "lens"):
        beta[structure.groups[group]] = neutral[structure.groups[group]]
    if structure.view == "base":
        return [beta]
    points, rotations = structure.pose(q, beta)
    if structure.camera:
        return _cameras(structure, points, z, beta)
    if structure.outputs < 6:
        reach = _TOOL * structure.chain.reach
        tools = np.vstack([np.zeros(3), reach * np.eye(3), -reach * np.eye(3)])
        placed = [_placed(structure, points, rotations, z, tool) for tool in tools]
        _, tool, turn, shift, factor = min(placed, key=lambda each: each[0])
        beta[structure.groups["tool"]], beta[structure.groups["view.shift"]] = tool, shift
        beta[structure.groups["view.rotation"]] = logarithm(turn)
        if structure.seen_as.scaled:
            beta[structure.groups["view.scale"]] = np.log(factor / structure.metre)
        return [beta]
    seen = exponential(z[:, 3:])
    turns = [np.eye(3)]
    if not structure.based:
        # of a tool that keeps one orientation relative rotations are noise: positions tell more
        turns = [
            _turn_of_poses(rotations, seen),
            _placed(structure, points, rotations, z[:, :3], np.zeros(3))[2],
        ]
    return [_turned(structure, points, rotations, z, seen, beta, turn) for turn in turns]


def _placed(
    structure: SpatialStructure, points: Array, rotations: Array, z: Array, tool: Array
) -> tuple[float, Array, Array, Array, float]:
    """Median distance, tool, turn, shift and scale that fit rows, by turns, from a tool."""
    for _ in range(_TURNS):
        turn, shift, factor = similarity(points + rotations @ tool, z)
        if not structure.seen_as.scaled:
            factor = structure.metre
        tool, shift = _tool(points, rotations, z, turn, factor)
    miss = z - factor * (points + rotations @ tool) @ turn.T - shift
    return float(np.median(np.linalg.norm(miss, axis=1))), tool, turn, shift, factor


def _tool(
    points: Array, rotations: Array, z: Array, turn: Array, factor: float
) -> tuple[Array, Array]:
    """Tool (3,) and shift (3,) of z = shift + factor turn (p + R tool), which is linear in both."""
    arms, target = factor * (turn @ rotations), z[:, :3] - factor * points @ turn.T
    a, b = (each - each.mean(axis=0) for each in (arms, target))
    # where the tool keeps one orientation the frame's shift is the same: the tool stays where drawn
    gram = np.einsum("nij,nik->jk", a, a) + len(a) * (HELD_TOOL * factor) ** 2 * np.eye(3)
    tool = np.linalg.solve(gram, np.einsum("nij,ni->j", a, b))
    return tool, (target - arms @ tool).mean(axis=0)


def _turn_of_poses(rotations: Array, seen: Array) -> Array:
    """Turn X (3, 3) of the sensor of orientations (n, 3, 3): Z_k = X A_k Y.

    Relative rotations of any two rows are conjugate, so that X turns the axes of A_k A_l' into
    those of Z_k Z_l' (Park and Martin 1994); rows are paired with their neighbours.
    """
    nominal, observed = (
        logarithm(each[1:] @ np.swapaxes(each[:-1], 1, 2)) for each in (rotations, seen)
    )
    sane = np.abs(np.linalg.norm(nominal, axis=1) - np.linalg.norm(observed, axis=1)) < 0.2
    if sane.sum() < 3:
        sane[:] = True
    return nearest_rotation(observed[sane].T @ nominal[sane])


def _turned(
    structure: SpatialStructure,
    points: Array,
    rotations: Array,
    z: Array,
    seen: Array,
    arm: Array,
    turn: Array,
) -> Array:
    """Parameters of a sensor that is turned by `turn` (3, 3), with the tool that fits poses."""
    beta, groups = arm.copy(), structure.groups
    # Y = A' X' Z of every row, averaged as a matrix and made a rotation again
    left = np.einsum("nij,jk,nkl->nil", np.swapaxes(rotations, 1, 2), turn.T, seen)
    beta[groups["view.rotation"]] = logarithm(turn)
    beta[groups["tool.rotation"]] = logarithm(nearest_rotation(left.sum(axis=0)))
    if not structure.based:
        placed = _tool(points, rotations, z, turn, structure.metre)
        beta[groups["tool"]], beta[groups["view.shift"]] = placed
    return beta


def _cameras(structure: SpatialStructure, points: Array, z: Array, arm: Array) -> list[Array]:
    """Cameras that an affine fit of pixels to points suggests, at a few focal lengths."""
    groups, (f, u0, v0, _) = structure.groups, structure.lens
    middle = points.mean(axis=0)
    centred = points - middle
    ridge = 1e-6 * np.trace(centred.T @ centred) * np.eye(3)
    rows = np.linalg.solve(centred.T @ centred + ridge, centred.T @ (z - z.mean(axis=0))).T
    # the rotation nearest to the affine camera's two rows; its third axis looks ahead
    u, s, vt = np.linalg.svd(rows, full_matrices=False)
    two = u @ vt
    turn = np.vstack([two, np.cross(two[0], two[1])])
    guesses = []
    for focal in (f,) if not structure.lens_sd[0] else (f, 0.7 * f, 1.4 * f):
        depth = focal / max(float(s.mean()), 1e-9)
        centre = np.array([*((z.mean(axis=0) - (u0, v0)) / focal), 1.0]) * depth
        # an affine camera does not tell before from behind: also a start from elsewhere, tilted
        for own in (turn, exponential([0.6, 0.0, 0.0]) @ turn):
            guess = arm.copy()
            guess[groups["lens"][0]] = focal
            guess[groups["view.rotation"]] = logarithm(own)
            guess[groups["view.shift"]] = centre - own @ middle
            guesses.append(guess)
    return guesses


def _random_chains(
    structure: SpatialStructure, q: Array, z: Array
) -> Sequence[tuple[Structure, Array]]:
    """Chains that fit rows, the best first: structures at whose origins the parameters are zero."""
    rows = thinned(len(q), _ROWS_ALONE)
    q, z = q[rows], z[rows]
    rng = np.random.default_rng(0)
    free = structure.prior(("placement", "tool"))

    def settled(each: SpatialStructure, steps: int) -> tuple[float, SpatialStructure]:
        beta, cost, _ = _settled(each, q, z, each.neutral(), free, steps)
        return cost, _absorbed(each, beta)

    tried: list[tuple[float, SpatialStructure]] = []
    for _ in range(_STARTS):
        tried.append(settled(_drawn(structure, z, rng), _STEPS))
        best = min(cost for cost, _ in tried)
        if sum(cost < best + _SAME for cost, _ in tried) >= _AGREE:
            break
    tried.sort(key=lambda pair: pair[0])
    found = sorted(
        (settled(each, 2 * _STEPS) for _, each in tried[:_KEPT]), key=lambda pair: pair[0]
    )
    return [(each, each.neutral()) for _, each in found[:2]]


def _absorbed(structure: SpatialStructure, beta: Array) -> SpatialStructure:
    """Return the structure whose nominal chain is where `beta` puts origins and tip."""
    still = structure.move(np.zeros((structure.chain.joints, 1)), beta)
    axes = still.axes[..., 0] / np.linalg.norm(still.axes[..., 0], axis=1, keepdims=True)
    tip, rotation = still.position[..., 0], still.rotation[..., 0]
    chain = replace(
        structure.chain, axes=axes, points=still.origins[..., 0], tip=tip, rotation=rotation
    )
    return replace(structure, chain=chain)


def _drawn(structure: SpatialStructure, z: Array, rng: np.random.Generator) -> SpatialStructure:
    """Draw a chain: axes of any direction, links as long as the workspace suggests."""
    chain, dof = structure.chain, structure.dof
    axes = rng.normal(size=(dof, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    link = structure.extent / structure.metre / np.sqrt(dof)
    steps = rng.normal(0.0, link / np.sqrt(3), size=(dof, 3))
    middle = z[:, :3].mean(axis=0) / structure.metre
    points = middle + np.cumsum(np.vstack([np.zeros(3), steps[1:]]), axis=0)
    points = points - points.mean(axis=0) + middle
    tip = points[-1] + rng.normal(0.0, link / np.sqrt(3), size=3)
    return replace(structure, chain=replace(chain, axes=axes, points=points, tip=tip))
