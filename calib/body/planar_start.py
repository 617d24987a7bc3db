"""Starts of a planar body: linear least squares for every combination of signs and mirrors."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import product

import numpy as np

from ..common.arrays import Array
from .nominal import Complex, linear_chain, sides
from .planar import PlanarStructure
from .structure import Structure

_MOST = 16
"""Combinations of signs and mirrors that are refined."""


def planar_starts(structure: PlanarStructure, q: Array, z: Array) -> list[tuple[Structure, Array]]:
    """Candidates, the best linear fits first.

    With a nominal geometry its own signs come first; every combination is tried where the view
    is not metric (a camera says nothing of the servos) or where the nominal signs do not fit.
    """
    tip = z[:, 0] + 1j * z[:, 1]
    found = [_linear(each, q, tip) for each in _sided(structure, every=structure.scaled)]
    if structure.nominal is not None and not structure.scaled:
        best = min(error for error, _, _ in found)
        if best > 0.02 * structure.extent:
            found += [_linear(each, q, tip) for each in _sided(structure, every=True)]
    found.sort(key=lambda item: item[0])
    return [(each, beta) for _, each, beta in found[:_MOST]]


def _sided(structure: PlanarStructure, every: bool) -> Iterator[PlanarStructure]:
    """The structure with each combination of signs and mirrors that may differ."""
    nominal = structure.nominal
    pairs: Iterable[tuple[tuple[int, ...], int]] = sides(structure.revolute)
    if nominal is not None:
        mirrors = (nominal.mirror,) if structure.view == "base" else (1, -1)
        flips = product((1, -1) if every else (1,), repeat=structure.dof)
        signs = [tuple(a * b for a, b in zip(nominal.signs, flip, strict=True)) for flip in flips]
        pairs = product(signs, mirrors)
    for signed, mirror in pairs:
        yield replace(structure, signs=signed, mirror=mirror)


def _linear(
    structure: PlanarStructure, q: Array, tip: Complex
) -> tuple[float, PlanarStructure, Array]:
    """Error, structure and parameters of the best similarity of the chain."""
    beta, groups = structure.neutral(), structure.groups
    if structure.nominal is not None:
        if structure.view != "base":
            beta = _placed(structure, beta, q, tip)
        miss = tip - structure.predict(q, beta) @ (1, 1j)
        return float(np.sqrt(np.mean(np.abs(miss) ** 2))), structure, beta
    found, miss = linear_chain(q, tip, structure.signs, structure.mirror, structure.revolute)
    beta[groups["offset"]], beta[groups["view.rotation"]] = found.offsets, found.rotation
    beta[groups["view.shift"]] = found.shift
    turning, sizes = np.asarray(structure.revolute), np.asarray(found.lengths)
    if structure.scaled:
        slides = sizes[~turning]
        unit = float(sizes[0] if structure.anchored else np.exp(np.mean(np.log(slides + 1e-300))))
        unit = max(unit, 1e-9 * structure.extent)
        beta[groups["view.scale"]] = np.log(unit)
        sizes = sizes / unit
    beta[groups["length"]] = np.where(turning, sizes, 0.0)
    return float(np.sqrt(np.mean(miss**2))), structure, beta


def _placed(structure: PlanarStructure, beta: Array, q: Array, tip: Complex) -> Array:
    """`beta` with the rotation, scale and shift that fit its chain best."""
    groups, place = structure.groups, structure.seen(q, beta)[0].position
    p = place[0] + 1j * structure.mirror * place[1]
    centred = p - p.mean()
    t = np.vdot(centred, tip) / (np.vdot(centred, centred).real + 1e-300)
    out = beta.copy()
    scale = np.log(max(abs(t), 1e-12)) if structure.scaled else 0.0
    shift = np.mean(tip - np.exp(scale + 1j * np.angle(t)) * p)
    out[groups["view.rotation"]], out[groups["view.scale"]] = np.angle(t), scale
    out[groups["view.shift"]] = shift.real, shift.imag
    return out
