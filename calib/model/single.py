"""One query at a time, for a control loop: plain floats instead of arrays of one row.

Answers are those of the batch methods to rounding; what this path does not cover it leaves to
them.  Everything is compiled when it is first asked for, or by `Model.warm_up`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import count
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..body.planar import PlanarStructure
from ..body.scalar import ScalarBody
from ..body.scalar_slope import Sloped, compile_slope
from ..maps.node_cells import NodeCells
from ..maps.node_models import NodeModels
from ..maps.predictor import BodyInBox

if TYPE_CHECKING:
    from .model import Model

Array = NDArray[np.float64]

_FEW = 20  # queries that take less than the cells take to make
_SLACK = 1e-9  # as `Trust` has it
_STEPS = 8  # of Newton; four lead from a wide start to rounding
_MET, _CLOSE = 1e-15, 1e-12  # shares of the extent: a target is met; a stalled step is
_FURTHEST = 0.1  # rad or share of a range: a solution further away may not be the nearest branch
_UNFOLDED = 0.2  # of the sine between the Jacobian's columns: no fold lies between start and answer


@dataclass(frozen=True, eq=False)
class Single:
    """Queries of one row.

    Attributes
    ----------
    model : Model
        With a planar body.
    """

    model: Model
    _asked: Iterator[int] = field(default_factory=count)

    @staticmethod
    def of(model: Model) -> Single | None:
        """The single queries of a model; None where only the batch path answers."""
        body, smooth = model.body, model.predictor.smooth
        if body is None or not isinstance(body.structure, PlanarStructure):
            return None
        if not isinstance(smooth, BodyInBox) or smooth.body is not body:
            return None
        return Single(model)

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
        """Whether positions are answered here: local models and gaps want cells."""
        return self._smooth or self._has_cells()

    @cached_property
    def _smooth(self) -> bool:
        return self._everywhere and self.model.predictor.models.degree < 0

    def forward(self, q: Any) -> Array | None:
        """Position (2,) for joint values (dof,); None where the batch path has to answer."""
        row = self._row(q)
        if row is None or not self._ready():
            return None
        if not self._in_range(row):
            return np.full(2, np.nan)
        if not self._known(row):
            return None  # the posterior has to be asked
        return np.array(self._position(row))

    def bound(self, q: Any, values: str) -> float | None:
        """Bound at joint values, from ``"bounds"`` or ``"model_bounds"``; None as above."""
        row = self._row(q)
        if row is None or not self._has_cells():
            return None
        if not self._in_range(row):
            return math.nan
        assert self.cells is not None  # noqa: S101
        bound = self.cells.blend(self._unit(row), self._nodes[values])
        return bound if self._known(row) and bound <= self.model.trust.most else None

    def inverse(self, x: Any, near: Any) -> Array | None:
        """Joints (2,) that reach a position, next to `near`; None as above, or if unsure."""
        target, start = _floats(x, 2), self._row(near)
        if target is None or start is None or len(start) != 2 or not self._in_range(start):
            return None
        found = self._newton(target, start)
        return None if found is None else np.array(found)

    def towards(
        self, q: Any, target_of: Callable[[Sequence[float]], Sequence[float]]
    ) -> list[float] | None:
        """Joints next to `q`, on its own turn, that reach what a function says of `q`."""
        asked = _floats(q, len(self._lower))
        if asked is None or len(asked) != 2:
            return None
        row = self._wrapped(list(asked))
        if not self._in_range(row):
            return None
        found = self._newton(target_of(row), row)
        if found is None:
            return None
        return [f + (a - r) for f, a, r in zip(found, asked, row, strict=True)]

    def _newton(self, target: Sequence[float], start: list[float]) -> list[float] | None:
        """Newton's steps of two joints from a start; None where they may lead elsewhere."""
        if not self._ready():
            return None
        a, b = start
        tx, ty = target
        least, stalled = _MET * self._extent, _CLOSE * self._extent
        last = math.inf
        facing = 0.0
        for _ in range(_STEPS):
            x, y, (xa, xb), (ya, yb) = self._sloped((a, b))
            gx, gy = tx - x, ty - y
            distance = math.sqrt(gx * gx + gy * gy)
            det = xa * yb - xb * ya
            size = math.sqrt((xa * xa + ya * ya) * (xb * xb + yb * yb))
            sine = det / size if size > 0.0 else 0.0
            if facing == 0.0:
                facing = sine
            if sine * facing <= 0.0:
                return None
            if distance <= least or (distance >= 0.5 * last and distance <= stalled):
                room = _UNFOLDED * min(abs(sine), abs(facing))
                moved_a, moved_b = abs(a - start[0]), abs(b - start[1])
                far = max(moved_a / self._wide[0], moved_b / self._wide[1])
                if far > _FURTHEST or max(moved_a, moved_b) > room:
                    return None
                if self._across((a, b)) or not self._known([a, b]):
                    return None
                return [a, b]
            if distance > 2.0 * last:
                return None
            last = distance
            a += (yb * gx - xb * gy) / det
            b += (xa * gy - ya * gx) / det
            if not self._in_range((a, b)):
                return None
        return None

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
        for value, (low, high) in zip(row, self._limits, strict=True):
            if not low <= value <= high:
                return False
        return True

    def _known(self, row: list[float]) -> bool:
        if not self._in_range(row):
            return False
        if self._everywhere:
            return True
        assert self.cells is not None  # noqa: S101
        bound = self.cells.blend(self._unit(row), self._nodes["model_bounds"])
        return bound <= self.model.trust.most

    def _unit(self, row: Sequence[float]) -> list[float]:
        return [
            (value - low) / span
            for value, low, span in zip(row, self._lower, self._span, strict=True)
        ]

    @cached_property
    def _position(self) -> Callable[[Sequence[float]], Sequence[float]]:
        assert self.model.body is not None  # noqa: S101
        body = ScalarBody.compile(self.model.body).predict
        models = self._models
        if models is None:
            return body

        def position(row: Sequence[float]) -> Sequence[float]:
            x, y = body(row)
            more_x, more_y = models.value(self._unit(row))
            return x + more_x, y + more_y

        return position

    @cached_property
    def _sloped(self) -> Callable[[Sequence[float]], Sloped]:
        body = self.model.body
        assert body is not None  # noqa: S101
        assert isinstance(body.structure, PlanarStructure)  # noqa: S101
        sloped = compile_slope(body.structure, body.beta)
        models = self._models
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
    def _models(self) -> NodeModels | None:
        models = self.model.predictor.models
        if models.degree < 0 or self.cells is None:
            return None
        return NodeModels.of(models, self.model.motor, self.cells)

    @cached_property
    def _nodes(self) -> dict[str, list[float]]:
        return {name: getattr(self.model, name).tolist() for name in ("bounds", "model_bounds")}

    @cached_property
    def _everywhere(self) -> bool:
        return bool((self.model.model_bounds <= self.model.trust.most).all())

    @cached_property
    def _lower(self) -> list[float]:
        return list(map(float, self.model.motor.scale.lower))

    @cached_property
    def _span(self) -> list[float]:
        return list(map(float, self.model.motor.scale.span))

    @cached_property
    def _turning(self) -> list[int]:
        return list(map(int, np.flatnonzero(self.model.motor.scale.periodic)))

    @cached_property
    def _wide(self) -> list[float]:
        """Unit of a joint's distance: a radian, or the range of a slide."""
        kinds = zip(self._span, self.model.about.revolute, strict=True)
        return [1.0 if turns else span for span, turns in kinds]

    @cached_property
    def _limits(self) -> list[tuple[float, float]]:
        return [
            (-math.inf, math.inf) if turns else (low - _SLACK * span, low + (1.0 + _SLACK) * span)
            for low, span, turns in zip(
                self._lower, self._span, self.model.motor.scale.periodic, strict=True
            )
        ]

    @cached_property
    def _extent(self) -> float:
        return self.model.solver.extent


def _floats(values: Any, count: int) -> list[float] | None:
    """Values as a list of so many finite floats; None if they are anything else."""
    if type(values) is np.ndarray:
        if values.ndim != 1 or values.dtype != np.float64:
            return None
        row: list[float] = values.tolist()
    elif type(values) in (list, tuple):
        row = [float(v) if type(v) is int else v for v in values]
    else:
        return None
    if len(row) != count:
        return None
    for value in row:
        if not isinstance(value, float) or not math.isfinite(value):
            return None
    return row
