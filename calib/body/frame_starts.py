"""Where the sensor of an arm in space is: linear fits, then damped steps.

The arm is as drawn, or as a belief has it; the sensor's frame, the tool and a camera's lens are
fitted from scratch.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..arm.rotations import exponential, logarithm, nearest_rotation, similarity
from ..common.arrays import Array
from ..common.rows import median_length, row_lengths
from ..errors import LogError
from .fit import Start
from .parameters import Prior
from .rows import Rows
from .sensors import SENSOR_BLOCKS
from .settings import START
from .spatial import SpatialStructure


def best_frame(structure: SpatialStructure, rows: Rows, arm: Array) -> Start:
    """The start with sensor and tool fitted from scratch.

    arm : (d,), parameters of the arm, which are kept
    """
    groups = [group for group in structure.frame_groups if group != "lens"]
    sd = structure.prior(groups).sd
    subset = rows.spread(START.guessed_rows)
    runs = [
        Start(structure, guess).run(subset, Prior(guess, sd), START.guess_steps)
        for guess in _guesses(structure, rows, arm)
    ]
    best = min(runs, key=lambda run: run.cost)
    prior = Prior(best.beta, sd)
    return best.run(rows, prior, START.steps)


def frame_of_drawing(structure: SpatialStructure, rows: Rows) -> Array:
    """Parameters (d,) of the nominal arm in the sensor frame that fits rows best.

    Raises LogError where the residuals are still large compared with the rows' spread.
    """
    start = best_frame(structure, rows, structure.neutral())
    if structure.camera:
        # pose, lens and offsets depend on each other: they are fitted together
        free = [*structure.frame_groups, "offset"]
        sd = structure.prior(free).sd
        sd[structure.groups["offset"]] *= 20.0
        prior = Prior(start.beta, sd)
        start = start.run(rows, prior, 60)
    if not structure.viewpoint.view_kind.has_scale:
        _refuse_misfit(structure, rows, start.beta)
    return start.beta


def _refuse_misfit(
    structure: SpatialStructure, rows: Rows, beta: Array
) -> None:
    """Refuse rows that the nominal arm does not explain; the log's reader adds the reason."""
    predicted = structure.predict(rows.q, beta)
    misfit = structure.residual(rows.z, predicted)
    error = median_length(misfit[:, :3])
    positions = rows.z[:, :3]
    lengths = row_lengths(positions - np.median(positions, axis=0))
    size = float(lengths.max())
    most_share = START.share_of_other_arm
    what = "positions"
    if structure.camera:
        most_share = START.share_of_no_camera
        what = "pixels"
    if error > most_share * size:
        raise LogError(
            f"the robot does not explain the {what}: half of the rows are more than {error:.3g} "
            f"off, of {size:.3g} that they spread; check the order of the joints, their unit and "
            f"that of the {what}, mirrored axes, times, and whether it is this robot"
        )
    turn = median_length(misfit[:, 3:])
    if turn > START.other_turns:
        raise LogError(
            f"the orientations do not turn as the joints do: {np.degrees(turn):.0f} deg are left "
            "(median); check their order and unit, or leave them out"
        )


def _guesses(
    structure: SpatialStructure, rows: Rows, arm: Array
) -> Iterator[Array]:
    """Yield rough parameters (d,) from which the sensor's place is fitted."""
    beta = arm.copy()
    neutral = structure.neutral()
    for group in (*SENSOR_BLOCKS, "tool", "tool.rotation"):
        indices = structure.groups[group]
        beta[indices] = neutral[indices]
    points, rotations = structure.pose(rows.q, beta)
    if structure.camera:
        yield from _cameras(structure, points, rows.z, beta)
    elif structure.view.startswith("base"):
        yield _with_tool_turn(structure, beta, rotations, rows.z)
    else:
        yield from _trackers(structure, points, rotations, rows.z, beta)


def _trackers(
    structure: SpatialStructure,
    points: Array,
    rotations: Array,
    z: Array,
    arm: Array,
) -> Iterator[Array]:
    """Yield frames of a tracker for tools at the tip and to two sides of it.

    points, rotations : (n, 3) [m] and (n, 3, 3), the arm's tip in its root frame
    """
    readings = z[:, :3]
    side = START.tool * structure.chain.reach
    # from the tip alone 2 of 96 mountings of long tools were not found
    sides = [0.0, side, -side]
    tools = np.outer(sides, [1.0, 0.0, 0.0])
    turns = [
        similarity(points + rotations @ tool, readings)[0] for tool in tools
    ]
    if structure.outputs == 6:
        # without it 2 of 48 mountings of long tools were not found
        orientations = exponential(z[:, 3:])
        turns.append(_turn_of_poses(rotations, orientations))
        tools = np.vstack([tools, np.zeros(3)])
    for tool, turn in zip(tools, turns, strict=True):
        tip = points + rotations @ tool
        scale = structure.known_scale
        if scale is None:
            _, _, scale = similarity(tip, readings)
        middle = tip.mean(axis=0)
        shift = readings.mean(axis=0) - scale * turn @ middle
        guess = structure.with_sensor_at(arm, turn, shift, scale)
        guess[structure.groups["tool"]] = tool
        yield _with_tool_turn(structure, guess, turn @ rotations, z)


def _with_tool_turn(
    structure: SpatialStructure, guess: Array, flange: Array, z: Array
) -> Array:
    """Parameters (d,) with the turn of the tool.

    flange : (n, 3, 3), orientations without it, in the sensor's frame
    """
    out = guess.copy()
    if structure.outputs == 6:
        # A' X' Z of every row, averaged and made a rotation again
        back = np.swapaxes(flange, 1, 2)
        turns = back @ exponential(z[:, 3:])
        mean = nearest_rotation(turns.sum(axis=0))
        out[structure.groups["tool.rotation"]] = logarithm(mean)
    return out


def _turn_of_poses(rotations: Array, seen: Array) -> Array:
    """The turn X (3, 3) of the sensor of orientations (n, 3, 3): Z_k = X A_k Y.

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
    camera = structure.viewpoint
    principal = np.asarray(camera.lens[1:3])
    middle = points.mean(axis=0)
    centred = points - middle
    mean_pixel = z.mean(axis=0)
    # points in a plane determine nothing across it
    affine, *_ = np.linalg.lstsq(centred, z - mean_pixel, rcond=1e-3)
    # the rotation nearest to the affine camera's two rows; its third axis looks ahead
    u, s, vt = np.linalg.svd(affine.T, full_matrices=False)
    right, down = u @ vt
    ahead = np.cross(right, down)
    turn = np.array([right, down, ahead])
    factors = [1.0]
    if camera.lens_sd[0]:
        factors += [0.7, 1.4]
    for factor in factors:
        focal = factor * camera.lens[0]
        pixels_a_metre = max(float(s.mean()), 1e-9)
        depth = focal / pixels_a_metre
        centre = np.append((mean_pixel - principal) / focal, 1.0) * depth
        shift = centre - turn @ middle
        guess = structure.with_sensor_at(arm, turn, shift, structure.metre)
        guess[structure.groups["lens"][0]] = focal
        yield guess
