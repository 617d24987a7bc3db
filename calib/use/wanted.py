"""Wanted: where the nominal arm would be, in the sensor's frame, as a correction aims for it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from ..body.planar import PlanarStructure
from ..body.spatial import SpatialStructure, structure_of
from ..body.views import is_camera
from ..common.arrays import Array
from ..model.alignment import Alignment
from ..model.model import Model
from ..model.nominal import (
    NominalPose,
    moves_in_space,
    nominal_arm,
    nominal_in_plane,
    nominal_in_space,
)
from ..model.space import REACHED, Space
from .geometry import fit_geometry, frame_is_free, frames, is_simulated


@dataclass(eq=False)
class Wanted:
    """Where a nominal arm would be."""

    # joint values (n, dof) to positions (n, m) of the nominal arm
    forward: Callable[[Array], Array]
    frames: tuple[Alignment, ...]  # what moves these positions into the sensor's frame
    free: bool  # whether the sensor's frame was fitted
    pose: NominalPose | None = None  # of an arm in space with six joints or more
    # of an arm that a camera sees: joints (n, dof) whose tip stands in space where the nominal one
    # would, since a pixel alone does not say how far away that is, and whether it can
    near: Callable[[Array], tuple[Array, NDArray[np.bool_]]] | None = None
    # (dof,) [rad or m], what `correct` usually changes at most, once it was asked
    limits: list[float] = field(default_factory=list)
    # parameters of the nominal arm behind a sensor whose frame was fitted, of a body in space
    drawn: Array | None = None

    def target(self, q: Array) -> Array:
        """Where the nominal arm would be, in the sensor's frame, (n, m)."""
        target = self.forward(q)
        for frame in self.frames:
            target = frame.apply(target)
        return target


_kept: WeakKeyDictionary[Model, dict[str, Wanted]] = WeakKeyDictionary()


def wanted(model: Model, view: str, cause: str) -> Wanted:
    """Return it, fitted once for a model: a controller corrects row by row."""
    kept = _kept.setdefault(model, {})
    key = f"{view} {cause}"
    if key not in kept:
        kept[key] = _found(model, view, cause)
    return kept[key]


def _found(model: Model, view: str, cause: str) -> Wanted:
    free, moved = frame_is_free(model, view), tuple(frames(model, cause))
    if model.body is not None and isinstance(model.body.structure, PlanarStructure):
        if free:
            # the body knows the sensor's frame as it is after all adaptations; if the sensor
            # stayed, what they found of its frame is the arm's
            back = tuple(frame.inverse() for frame in reversed(frames(model)))
            moved = back if cause == "joints" else ()
        return _of(*nominal_in_plane(model, based=not free), moved, free)
    if moves_in_space(model):
        return _in_space(model, view, cause, free)
    geometry = fit_geometry(model, view=view, cause=cause) if free else None
    own = (geometry.frame,) if geometry is not None and geometry.frame is not None else ()
    return Wanted(nominal_arm(model).forward, (*own, *moved), free)


def _in_space(model: Model, view: str, cause: str, free: bool) -> Wanted:
    """The nominal arm of a model whose arm moves in space, with the sensed point at its tip."""
    body, moved = model.body, tuple(frames(model, cause))
    pose = None
    own = None if body is None else body.structure
    if is_simulated(model):
        arm = nominal_arm(model)
        structure = structure_of(arm, "base")
        return replace(_of(structure, structure.neutral(), moved, free), forward=arm.forward)
    if (
        body is not None
        and isinstance(own, SpatialStructure)
        and own.informed
        and (free or own.view == "base")
    ):
        structure, beta, moved = own, nominal_in_space(own, body.beta), ()
        pose = NominalPose.of(own, body.beta, beta)
    else:
        geometry = fit_geometry(model, view=view, cause=cause)
        structure = geometry.structure
        beta = nominal_in_space(structure, geometry.beta)
    found = _of(structure, beta, moved, free)
    found.drawn = beta if own is structure else None
    if pose is not None:
        return replace(found, pose=pose)
    if body is None or not is_camera(body.structure.view):
        return found
    return replace(found, near=_near(model, structure, beta))


def _near(
    model: Model, structure: SpatialStructure, beta: Array
) -> Callable[[Array], tuple[Array, NDArray[np.bool_]]]:
    """Joints near given ones that put the real tip where the nominal one would be."""
    space = Space.of(model)

    # a pixel is met by a whole line of sight: the place in space decides where on it
    def near(q: Array) -> tuple[Array, NDArray[np.bool_]]:
        place = structure.pose(q, beta)[0]
        found = space.at_positions(place, q)
        distance = np.linalg.norm(space.evaluate(found)[0] - place, axis=1)
        return found, distance <= REACHED * space.length

    return near


def _of(
    structure: PlanarStructure | SpatialStructure,
    beta: Array,
    moved: tuple[Alignment, ...],
    free: bool,
) -> Wanted:
    """The arm of some parameters (d,)."""
    return Wanted(lambda q: structure.predict(q, beta), moved, free)
