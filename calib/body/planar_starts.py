"""Starts of a planar arm: the signs of its joints, the side that it is seen from, its frame.

Which way joints turn is not known.  For each choice of signs positions x + i y are linear in the
links, so that links, offsets and frame follow from least squares; where a drawing has the links,
the frame alone is fitted.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np

from ..arm.rotations import similarity
from ..common.arrays import Array
from .drawing import Complex, PlanarDrawing, offsets_of
from .fit import Start
from .planar import PlanarStructure
from .rows import Rows
from .settings import FIT, START


def planar_starts(structure: PlanarStructure, rows: Rows) -> list[Start]:
    """Starts of rows of positions (n, 2) [unit], the best fits first."""
    drawing = structure.nominal
    if drawing is None:
        starts = [*_free_starts(structure, rows)]
    else:
        starts = [*_starts_of_drawing(structure, drawing, rows)]
    starts.sort(key=lambda start: _miss(start, rows))
    if drawing is not None and not structure.viewpoint.view_kind.has_scale:
        # lengths show whether the joints turn as drawn; a camera does not
        signs = drawing.signs
        as_drawn = [s for s in starts if s.structure.directions == signs]
        miss = _miss(as_drawn[0], rows)
        if miss <= FIT.doubted * structure.extent:
            return as_drawn
    return starts[: START.turned_ways]


def _miss(start: Start, rows: Rows) -> float:
    """Root mean square error of a start [unit]."""
    predicted = start.structure.predict(rows.q, start.beta)
    total = np.linalg.norm(rows.z - predicted)
    return float(total / np.sqrt(len(rows)))


def _free_starts(structure: PlanarStructure, rows: Rows) -> Iterator[Start]:
    """Chains of all signs, seen from both sides.

    The first turning joint and all slides have the sign +1: reversed, the former is a mirror and
    the latter another offset.
    """
    revolute = structure.revolute
    choices = [(1, -1) if turns else (1,) for turns in revolute]
    if any(revolute):
        choices[revolute.index(True)] = (1,)
    for signs in product(*choices):
        with_signs = structure.with_fields(signs=signs)
        for mirror in (1, -1):
            side = with_signs.with_sensor(mirror=mirror)
            yield Start(side, _linear_fit(side, rows))


def _starts_of_drawing(
    structure: PlanarStructure, drawing: PlanarDrawing, rows: Rows
) -> Iterator[Start]:
    """The drawing with all signs of its joints, in front of the sensor."""
    for turns in product((1, -1), repeat=structure.dof):
        signs = np.multiply(turns, drawing.signs)
        candidate = structure.with_fields(signs=tuple(signs.tolist()))
        candidate = candidate.with_sensor(mirror=drawing.mirror)
        side, beta = side_and_frame(candidate, rows, candidate.neutral())
        yield Start(side, beta)


def side_and_frame(
    structure: PlanarStructure, rows: Rows, arm: Array
) -> tuple[PlanarStructure, Array]:
    """The side and the frame from which a sensor sees an arm.

    arm : (d,), the arm's parameters, which stay
    Returns the structure with its mirror, and parameters (d,) with the sensor's frame.
    """
    if structure.view == "base":
        return structure, arm
    state, _ = structure.state_and_sight(rows.q, arm)
    turn, shift, scale = similarity(
        state.position.T,
        rows.z,
        mirrored=True,
        scale=structure.known_scale,
    )
    beta = structure.with_sensor_at(arm, turn, shift, scale)
    side = 1 if np.linalg.det(turn) > 0 else -1
    return structure.with_sensor(mirror=side), beta


def _linear_fit(structure: PlanarStructure, rows: Rows) -> Array:
    """Parameters (d,) of the chain that fits rows of positions (n, 2) best.

    As complex numbers positions are the sum of links, each turned by the joints before it as one
    of unit length, and of the base's shift; seen from behind they are conjugate::

        x + i y = sum_k link_k unit_k(q) + shift
    """
    groups = structure.groups
    revolute = structure.revolute
    mirror = structure.mirror
    beta = structure.neutral()
    beta[groups["length"]] = revolute
    values = structure.joint_values(rows.q, beta)
    state = structure.move(values, beta)
    ones = np.ones(len(rows))
    columns = np.vstack([state.terms, ones])
    number = np.array([1, 1j * mirror])
    tip: Complex = rows.z @ number
    *links, shift = _shared_solution(columns.T, tip)
    # of a slide how far it moves the tip
    sizes = np.abs(links) / structure.metre
    if structure.viewpoint.view_kind.has_scale:
        unit = _unit_length(structure, sizes)
        beta[groups["view.scale"]] = np.log(unit)
        sizes = sizes / unit
    beta[groups["length"]] = np.where(revolute, sizes, 0.0)
    beta[groups["offset"]] = offsets_of(np.array(links), revolute)
    angle = np.angle(links[0])
    beta[groups["view.rotation"]] = mirror * angle
    beta[groups["view.shift"]] = (shift.real, mirror * shift.imag)
    return beta


def _shared_solution(columns: Complex, tip: Complex) -> Complex:
    """Least squares (k,) of columns (n, k); columns that are alike share theirs.

    A joint that hardly moves makes columns alike.
    """
    size = np.linalg.norm(columns, axis=0) + 1e-300
    unit_columns = columns / size
    alike = START.one_column
    fit, *_ = np.linalg.lstsq(unit_columns, tip, rcond=alike)
    solution: Complex = fit / size
    return solution


def _unit_length(structure: PlanarStructure, sizes: Array) -> float:
    """Unit of a camera's lengths (dof,) [px]: the first, or metres where joints slide."""
    slides = ~structure.is_revolute
    unit = float(sizes[0])
    if slides.any():
        logarithms = np.log(sizes[slides] + 1e-300)
        mean = logarithms.mean()
        unit = float(np.exp(mean))
    return max(unit, 1e-9 * structure.extent)
