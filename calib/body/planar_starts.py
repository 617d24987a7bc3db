"""Starts of a planar arm: the signs of its joints, the side that it is seen from, its frame."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np

from ..arm.rotations import similarity
from ..common.arrays import Array
from .drawing import PlanarDrawing, drawing_of, waves
from .planar import PlanarStructure
from .settings import FIT, START
from .start import Start


def planar_starts(
    structure: PlanarStructure, q: Array, z: Array
) -> list[Start]:
    """Candidates of signs, mirror and parameters (d,), the best linear fits first."""
    drawing = structure.nominal
    if drawing is None:
        starts = [*_free_starts(structure, q, z)]
    else:
        starts = [*_starts_of_drawing(structure, drawing, q, z)]
    starts.sort(key=lambda start: _miss(start, q, z))
    if drawing is not None and not structure.viewpoint.view_kind.has_scale:
        # lengths tell whether the joints turn as drawn; a camera says nothing of the servos
        as_drawn = [
            start
            for start in starts
            if start.structure.directions == drawing.signs
        ]
        if _miss(as_drawn[0], q, z) <= FIT.doubted * structure.extent:
            return as_drawn
    return starts[: START.turned_ways]


def _free_starts(
    structure: PlanarStructure, q: Array, z: Array
) -> Iterator[Start]:
    """Chains of all signs and both sides that they are seen from."""
    for signs in product((1, -1), repeat=structure.dof):
        if _differs(signs, structure.revolute):
            turned = structure.with_fields(signs=signs)
            for mirror in (1, -1):
                side = turned.with_sensor(mirror=mirror)
                yield Start(side, _linear(side, q, z))


def _starts_of_drawing(
    structure: PlanarStructure, drawing: PlanarDrawing, q: Array, z: Array
) -> Iterator[Start]:
    """The drawing with all signs of its joints, in front of the sensor."""
    for turns in product((1, -1), repeat=structure.dof):
        signs = np.multiply(turns, drawing.signs).tolist()
        turned = structure.with_fields(signs=tuple(signs))
        turned = turned.with_sensor(mirror=drawing.mirror)
        side, beta = side_and_frame(turned, q, z, turned.neutral())
        yield Start(side, beta)


def side_and_frame(
    structure: PlanarStructure, q: Array, z: Array, arm: Array
) -> tuple[PlanarStructure, Array]:
    """The side and the frame from which a sensor sees an arm of parameters (d,)."""
    if structure.view == "base":
        return structure, arm
    motion, _ = structure.motion_and_sight(q, arm)
    points = motion.position.T
    turn, _, scale = similarity(points, z, mirrored=True)
    if not structure.viewpoint.view_kind.has_scale:
        scale = structure.metre
    beta = arm.copy()
    groups = structure.groups
    cosine, sine = turn[:, 0]
    beta[groups["view.rotation"]] = np.arctan2(sine, cosine)
    beta[groups["view.scale"]] = np.log(scale / structure.metre)
    shifts = z - scale * points @ turn.T
    beta[groups["view.shift"]] = shifts.mean(axis=0)
    side = 1 if np.linalg.det(turn) > 0 else -1
    return structure.with_sensor(mirror=side), beta


def _miss(start: Start, q: Array, z: Array) -> float:
    """Error [unit] of a start, rms."""
    miss = z - start.structure.predict(q, start.beta)
    total = np.linalg.norm(miss)
    return float(total / np.sqrt(len(z)))


def _differs(signs: tuple[int, ...], revolute: tuple[bool, ...]) -> bool:
    """Whether signs are a way of its own.

    A first turning joint that turns the other way is a mirror; a slide that is reversed is another
    offset.
    """
    first = revolute.index(True) if any(revolute) else 0
    return all(
        sign > 0
        for k, sign in enumerate(signs)
        if k == first or not revolute[k]
    )


def _linear(structure: PlanarStructure, q: Array, z: Array) -> Array:
    """Parameters of the chain that fits positions (n, 2) best."""
    beta = structure.neutral()
    groups = structure.groups
    joints = (structure.signs, structure.mirror, structure.revolute)
    columns = waves(q, *joints)
    columns = np.column_stack([columns, np.ones(len(q))])
    size = np.linalg.norm(columns, axis=0) + 1e-300
    # a joint that hardly moves makes columns alike: they share what they cannot tell apart
    tip = z @ (1, 1j)
    fit, *_ = np.linalg.lstsq(columns / size, tip, rcond=START.one_column)
    solution = np.asarray(fit / size, dtype=complex)
    links = solution[:-1]
    shift = complex(solution[-1])
    drawing = drawing_of(links, shift, *joints)
    turning = np.asarray(structure.revolute)
    # of a slide how far it moves the tip
    sizes = np.abs(links) / structure.metre
    if structure.viewpoint.view_kind.has_scale:
        # in the first length, or where joints slide in metres
        unit = float(sizes[0])
        if not turning.all():
            logarithms = np.log(sizes[~turning] + 1e-300)
            unit = float(np.exp(logarithms.mean()))
        unit = max(unit, 1e-9 * structure.extent)
        beta[groups["view.scale"]] = np.log(unit)
        sizes = sizes / unit
    beta[groups["length"]] = np.where(turning, sizes, 0.0)
    beta[groups["offset"]] = drawing.offsets
    beta[groups["view.rotation"]] = drawing.rotation
    beta[groups["view.shift"]] = drawing.shift
    return beta
