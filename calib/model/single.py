"""One query at a time, for a control loop: plain floats instead of arrays of one row.

Answers are those of the batch methods to rounding; what this path does not cover it leaves to
them.  Everything is compiled when it is first asked for, or by `Model.warm_up`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cached_property
from itertools import count
from operator import le, sub, truediv
from typing import TYPE_CHECKING, Any

import numpy as np

from ..body.planar_row import PlanarRow, Sloped
from ..common.arrays import Array
from ..inverse.one_row import FURTHEST, nearest_joints, two_joints
from ..maps.node_cells import NodeCells
from ..maps.node_models import NodeModels
from ..maps.predictor import BodyInBox
from .trust import MOST_BLENDED, ROUNDED

if TYPE_CHECKING:  # what only arms in space need is imported when one asks
    from ..body.spatial_bound_row import SpatialBoundRow
    from ..body.spatial_row import SpatialRow
    from .model import Model

_FEW = 20  # queries that take less than the cells take to make


class Single:
    """Queries of one row.

    model : with a planar body, or one in space without local models
    """

    def __init__(self, model: Model) -> None:
        scale, body = model.motor.scale, model.body
        self.model, self._asked = model, count()
        self._planar = body is not None and body.structure.kind == "planar"
        self._everywhere = bool((model.model_bounds <= model.trust.most).all())
        self._smooth = self._everywhere and model.predictor.models.degree < 0
        self._lower: list[float] = scale.lower.tolist()
        self._span: list[float] = scale.span.tolist()
        self._turning: list[int] = np.flatnonzero(scale.periodic).tolist()
        ranges = list(zip(self._lower, self._span, strict=True))
        limits = [
            (-math.inf, math.inf) if turns else (low - ROUNDED * span, low + (1.0 + ROUNDED) * span)
            for (low, span), turns in zip(ranges, scale.periodic, strict=True)
        ]
        self._least, self._most = ([limit[k] for limit in limits] for k in (0, 1))
        # unit of a joint's distance: a radian, or the range of a slide
        kinds = zip(self._span, model.about.revolute, strict=True)
        self._wide = [1.0 if turns else span for span, turns in kinds]

    @staticmethod
    def of(model: Model) -> Single | None:
        """The single queries of a model; None where only the batch path answers."""
        body, smooth = model.body, model.predictor.smooth
        if body is None or not isinstance(smooth, BodyInBox) or smooth.body is not body:
            return None
        alone = body.structure.kind == "spatial" and model.predictor.models.degree < 0
        return Single(model) if body.structure.kind == "planar" or alone else None

    @cached_property
    def cells(self) -> NodeCells | None:
        """Nodes by cells."""
        return NodeCells.of(self.model.motor)

    def _has_cells(self) -> bool:
        """Whether the cells are there; a few queries alone are not worth making them."""
        if "cells" not in self.__dict__ and next(self._asked) < _FEW:
            return False
        return self.cells is not None

    def _ready(self) -> bool:
        """Whether positions are answered here: local models and gaps want cells.

        An arm in space wants Pinocchio, whose import a few queries alone do not repay.
        """
        if not self._planar and "_compiled" not in self.__dict__ and next(self._asked) < _FEW:
            return False
        return self._smooth or self._has_cells()

    def forward(self, q: Any) -> Array | None:
        """Position (m,) for joint values (dof,); None where the batch path has to answer."""
        row = self._row(q)
        if row is None or not self._ready():
            return None
        if not self._in_range(row):
            return np.full(len(self.model.axes), np.nan)
        if not self._known(row):
            return None  # the posterior has to be asked
        return np.array(self._position(row))

    def bound(self, q: Any, values: str, *, noise: bool) -> float | None:
        """Bound at joint values, from ``"bounds"`` or ``"model_bounds"``; None as above.

        `noise` says whether it counts the noise of a single reading.
        """
        row = self._row(q)
        if row is None:
            return None
        if self._posterior is not None:
            if not (self._everywhere and self._ready()):
                return None
            return self._posterior.bound(row, noise=noise) if self._in_range(row) else math.nan
        if not self._has_cells():
            return None
        if not self._in_range(row):
            return math.nan
        assert self.cells is not None  # noqa: S101
        bound = self.cells.blend(self._unit(row), self._nodes[values])
        return bound if self._known(row) and bound <= self.model.trust.most else None

    def inverse(self, x: Any, near: Any) -> Array | None:
        """Joints (dof,) that reach a position, next to `near`; None as above, or if unsure."""
        target, start = _floats(x, len(self.model.axes)), self._row(near)
        if target is None or start is None or not self._in_range(start):
            return None
        found = self.reach(target, start)
        return None if found is None else np.array(found)

    def beside(
        self, q: Any, solve: Callable[[list[float]], list[float] | None]
    ) -> list[float] | None:
        """Joints next to `q`, on its own turn, that a function finds from `q` in its range."""
        asked = _floats(q, len(self._lower))
        if asked is None or not self._ready():
            return None
        row = self._wrapped(list(asked))
        found = solve(row) if self._in_range(row) else None
        if found is None or not self._in_range(found):
            return None
        return [f + (a - r) for f, a, r in zip(found, asked, row, strict=True)]

    def reach(self, target: Sequence[float], start: list[float]) -> list[float] | None:
        """Joints next to a start that reach a target; None where others may be nearer."""
        if not self._ready():
            return None
        if self._planar and len(start) == 2:
            found = two_joints(
                self._sloped, target, start, self.model.solver.extent, self._in_range
            )
        else:
            found = nearest_joints(
                self._rows, target, start, self.model.motor.scale.span, self._in_range
            )
        if found is None or self._across(found):
            return None
        if not (self._in_range(found) and self._known(found)):
            return None
        far = max(abs(f - s) / w for f, s, w in zip(found, start, self._wide, strict=True))
        return found if far <= FURTHEST else None

    def _row(self, q: Any) -> list[float] | None:
        """Joint values as floats, those of full turns in their range."""
        row = _floats(q, len(self._lower))
        return None if row is None else self._wrapped(row)

    def _wrapped(self, row: list[float]) -> list[float]:
        """The same row, joints of full turns moved into their range."""
        for k in self._turning:
            u = (row[k] - self._lower[k]) / self._span[k]
            if not 0.0 <= u < 1.0:
                row[k] = self._lower[k] + (u % 1.0) * self._span[k]
        return row

    def _across(self, row: Sequence[float]) -> bool:
        """Whether a joint of a full turn has left its range: a gain jumps at the seam."""
        lower, span = self._lower, self._span
        return any(not 0.0 <= row[k] - lower[k] < span[k] for k in self._turning)

    def _in_range(self, row: Sequence[float]) -> bool:
        return all(map(le, self._least, row)) and all(map(le, row, self._most))

    def _known(self, row: Sequence[float]) -> bool:
        """Whether joints within their range are answered."""
        if self._everywhere:
            return True
        assert self.cells is not None  # noqa: S101
        bound = self.cells.blend(self._unit(row), self._nodes["model_bounds"])
        return bound <= self.model.trust.most

    def _unit(self, row: Sequence[float]) -> list[float]:
        return list(map(truediv, map(sub, row, self._lower), self._span))

    @cached_property
    def _compiled(self) -> PlanarRow | SpatialRow:
        body: Any = self.model.body
        if self._planar:
            return PlanarRow.of(body.structure, body.beta)
        from ..body.spatial_row import SpatialRow  # eight modules of arms in space

        return SpatialRow(body.structure, body.beta)

    @cached_property
    def _position(self) -> Callable[[Sequence[float]], Sequence[float]]:
        body, models = self._compiled.predict, self._models
        if models is None:
            return body

        def position(row: Sequence[float]) -> Sequence[float]:
            x, y = body(row)
            more_x, more_y = models.value(self._unit(row))
            return x + more_x, y + more_y

        return position

    @cached_property
    def _sloped(self) -> Callable[[Sequence[float]], Sloped]:
        """Position and derivatives of a planar arm."""
        assert isinstance(self._compiled, PlanarRow)  # noqa: S101
        sloped, models = self._compiled.sloped, self._models
        if models is None:
            return sloped

        def both(row: Sequence[float]) -> Sloped:
            x, y, gx, gy = sloped(row)
            more_x, more_y, slope_x, slope_y = models.value_and_slope(self._unit(row))
            for k, span in enumerate(self._span):
                gx[k] += slope_x[k] / span
                gy[k] += slope_y[k] / span
            return x + more_x, y + more_y, gx, gy

        return both

    @cached_property
    def _rows(self) -> Callable[[Sequence[float]], tuple[Sequence[float], Array]]:
        """Position and its derivative (m, dof) of any arm."""
        if not isinstance(self._compiled, PlanarRow):
            return self._compiled.sloped

        def sloped(row: Sequence[float]) -> tuple[Sequence[float], Array]:
            x, y, gx, gy = self._sloped(row)
            return (x, y), np.array([gx, gy])

        return sloped

    @cached_property
    def _posterior(self) -> SpatialBoundRow | None:
        """Of more than three joints in space, unless a camera sees them: the posterior's bound."""
        body: Any = self.model.body
        if self._planar or body.structure.outputs != 3 or len(self._lower) <= MOST_BLENDED:
            return None
        from ..body.spatial_bound_row import SpatialBoundRow  # the same

        return SpatialBoundRow(body)

    @cached_property
    def _models(self) -> NodeModels | None:
        models = self.model.predictor.models
        if models.degree < 0 or self.cells is None:
            return None
        return NodeModels.of(models, self.model.motor, self.cells)

    @cached_property
    def _nodes(self) -> dict[str, list[float]]:
        return {name: getattr(self.model, name).tolist() for name in ("bounds", "model_bounds")}


def _floats(values: Any, count: int) -> list[float] | None:
    """Values as a list of so many finite floats; None if they are anything else."""
    if type(values) is np.ndarray:
        if values.ndim != 1 or values.dtype != np.float64:
            return None
        row: list[float] = values.tolist()
    elif type(values) in (list, tuple):
        row = [float(v) if type(v) is int else v for v in values]
        if not all(isinstance(value, float) for value in row):
            return None
    else:
        return None
    # one sum tells whether any is infinite or NaN; where it overflows the batch answers
    return row if len(row) == count and math.isfinite(sum(row)) else None
