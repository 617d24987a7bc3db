"""Starts of a fit: the best of a structure's guesses, by short robust runs of damped steps.

Guesses differ in the signs of a planar arm's joints, in where the sensor of an arm in space is,
and, without a drawing, in the whole chain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..common.arrays import Array
from ..errors import LogError
from .chain_starts import chains
from .fit import Start
from .frame_starts import best_frame, frame_of_drawing
from .planar import PlanarStructure
from .planar_starts import planar_starts, side_and_frame
from .rows import Rows
from .sensors import SENSOR_BLOCKS
from .settings import START
from .spatial import SpatialStructure
from .structure import Structure


def best_start(
    structure: Structure, rows: Rows, free: tuple[str, ...]
) -> Start:
    """The start that explains rows best.

    free : groups that the runs fit; the gate's chain
    """
    order = np.random.default_rng(0).permutation(len(rows))
    subset = rows.take(np.sort(order[: START.rows]))
    starts = _candidates(structure, subset)
    if len(starts) == 1:  # nothing to choose from: the gate starts here
        return starts[0]
    for steps in START.run_steps:
        refined = [
            start.run(subset, start.structure.prior(free), steps)
            for start in starts
        ]
        refined.sort(key=lambda start: start.cost)
        starts = refined[: START.runs]
    # a planar arm that turns the other way, seen from behind, fits equally well
    most = starts[0].cost + START.tied_nats
    tied = [start for start in starts if not start.cost > most]
    return min(tied, key=lambda start: start.structure.reversals)


def _candidates(structure: Structure, rows: Rows) -> list[Start]:
    """Structures (signs, mirror, chain) and initial parameters, the best first.

    Rows of a simulation may state their noise.
    """
    if isinstance(structure, PlanarStructure):
        return planar_starts(structure, rows)
    assert isinstance(structure, SpatialStructure)  # noqa: S101
    _refuse_open(structure, rows.z)
    if not structure.informed:
        subset = rows.spread(START.chain_rows)
        return chains(structure, subset)
    return [_start_of_drawing(structure, rows)]


def _refuse_open(structure: SpatialStructure, z: Array) -> None:
    """Refuse readings (n, m) that are too few or too alike to place an arm in space."""
    least = START.least_rows
    if structure.informed:
        least = structure.viewpoint.view_kind.least
    if len(z) < least:
        raise LogError(
            f"{len(z)} rows cannot place a spatial arm in its sensor's frame: expected {least} or "
            "more, of poses that differ in every joint"
        )
    size = float(np.abs(z).max())
    size = max(size, 1e-12)
    spans = np.ptp(z, axis=0)
    spread = float(spans.max())
    if spread <= 1e-9 * size:
        raise LogError(
            "the positions are the same in every row: the sensor saw no motion"
        )


def _start_of_drawing(structure: SpatialStructure, rows: Rows) -> Start:
    """The drawing in front of its sensor."""
    beta = frame_of_drawing(structure, rows)
    if structure.view == "base pose":
        turn = beta[structure.groups["tool.rotation"]]
        if np.linalg.norm(turn) > START.target:
            structure = structure.with_sensor(view="base target")
    return Start(structure, beta)


def with_other_sensors(start: Start, rows: Sequence[Rows]) -> Start:
    """A start with the further sensors placed by their rows, given its arm."""
    structure = start.structure
    beta = start.beta
    for rows_of_sensor in rows[1:]:
        if not isinstance(rows_of_sensor.sensor, str):
            continue
        other = structure.as_seen_by(rows_of_sensor.sensor)
        subset = rows_of_sensor.spread(START.rows)
        if isinstance(other, PlanarStructure):
            other, beta = side_and_frame(other, subset, beta)
        elif isinstance(other, SpatialStructure):
            beta = _with_sensor(other, subset, beta)
        structure = other.as_seen_by(structure.viewpoint.name)
    return replace(start, structure=structure, beta=beta)


def _with_sensor(structure: SpatialStructure, rows: Rows, arm: Array) -> Array:
    """Parameters (d,) of an arm with the sensor and its marker placed by rows."""
    groups = structure.groups
    fitted = best_frame(structure, rows, arm).beta
    beta = arm.copy()
    for block in SENSOR_BLOCKS:
        beta[groups[block]] = fitted[groups[block]]
    tool = groups["tool"]
    marker = groups["marker"]
    beta[marker] = fitted[marker] + fitted[tool] - arm[tool]
    return beta
