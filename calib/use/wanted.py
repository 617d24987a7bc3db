"""Wanted: where the nominal arm would be, in the sensor's frame, as a correction aims for it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arm.rotations import logarithm
from ..body.planar import PlanarStructure
from ..body.spatial import SpatialStructure
from ..common.arrays import Array
from ..common.frozen import frozen
from ..model.model import Model
from ..model.nominal import moves_in_space, nominal_arm, nominal_in_plane, nominal_in_space
from ..model.space import REACHED, Space
from .geometry import fit_geometry, frame_is_free, frames, is_simulated

_POSED = 6  # joints from which on a tool's orientation can be kept


@dataclass(eq=False)
class Wanted:
    """Where a nominal arm would be."""

    predict: Callable[[Array], Array]  # of joint values (n, dof), positions (n, m)
    moved: list[Any] = field(default_factory=list)  # what moves these into the sensor's frame
    free: bool = False  # whether the sensor's frame was fitted
    # of a body in space, parameters of the nominal arm behind a sensor whose frame was fitted
    drawn: Array | None = None
    # where more than what the sensor reads has to be met: the tool's pose, or before a camera,
    # whose pixel does not say how far away the tip is, its place
    space: Space | None = None
    # (dof,) [rad or m], what `correct` usually changes at most, once it was asked
    limits: list[float] = field(default_factory=list)

    def target(self, q: Array) -> Array:
        """Where the nominal arm would be, in the sensor's frame, (n, m)."""
        target = self.predict(q)
        for frame in self.moved:
            target = frame.apply(target)
        return target

    @property
    def posed(self) -> bool:
        """Whether the tool's orientation is kept."""
        return self.space is not None and len(self.space.model.about.lower) >= _POSED

    def near(self, q: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Joints (n, dof) near `q` that put the real tip, or tool, where the nominal one is."""
        assert self.space is not None  # noqa: S101
        place, turn = self._nominal_pose(q)
        found, left = self.space.beside(place, turn if self.posed else None, q)
        return found, left <= REACHED * self.space.length

    def angle(self, q: Array, corrected: Array) -> Array | None:
        """Angle (n,) [rad] between the nominal tool at `q` and the real one at other joints."""
        if self.space is None or not self.posed:
            return None
        turned = self.space.evaluate(corrected)[1] @ np.swapaxes(self._nominal_pose(q)[1], 1, 2)
        return np.asarray(np.linalg.norm(logarithm(turned), axis=1))

    def _nominal_pose(self, q: Array) -> tuple[Array, Array]:
        assert self.space is not None  # noqa: S101
        structure: Any = self.space.body.structure
        place, turn = structure.pose(q, self._nominal)
        return place, turn

    @cached_property
    def _nominal(self) -> Array:
        """Parameters of the nominal arm in the base frame."""
        assert self.space is not None  # noqa: S101
        body: Any = self.space.body
        return frozen(nominal_in_space(body.structure, body.beta))


def wanted(model: Model, view: str, cause: str) -> Wanted:
    """Return it, fitted once for a model: a controller corrects row by row."""
    key = f"wanted {view} {cause}"
    if key not in model.remembered:
        model.remembered[key] = _found(model, view, cause)
    found: Wanted = model.remembered[key]
    return found


def _found(model: Model, view: str, cause: str) -> Wanted:
    free, moved = frame_is_free(model, view), frames(model, cause)
    own: Any = None if model.body is None else model.body.structure
    if isinstance(own, PlanarStructure):
        if free:
            # the body knows the sensor's frame as it is after all adaptations; if the sensor
            # stayed, what they found of its frame is the arm's
            back = [frame.inverse() for frame in reversed(frames(model))]
            moved = back if cause == "joints" else []
        structure, beta = nominal_in_plane(model, based=not free)
        return Wanted(partial(structure.predict, beta=frozen(beta)), moved, free)
    in_space = moves_in_space(model)
    if in_space and not is_simulated(model):
        fitted = free or own is None or own.view == "base"
        if model.body is not None and isinstance(own, SpatialStructure) and own.informed and fitted:
            beta = frozen(nominal_in_space(own, model.body.beta))
            kept = own.dof >= _POSED or own.camera
            space = Space.of(model) if kept else None
            return Wanted(partial(own.predict, beta=beta), [], free, beta, space)
        fit = fit_geometry(model, view=view, cause=cause)
        beta = frozen(nominal_in_space(fit.structure, fit.beta))
        return Wanted(partial(fit.structure.predict, beta=beta), moved, free)
    geometry = fit_geometry(model, view=view, cause=cause) if free and not in_space else None
    seen = None if geometry is None else geometry.frame
    return Wanted(nominal_arm(model).forward, [*([seen] if seen else []), *moved], free)
