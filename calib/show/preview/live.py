"""Live: what the page asks while a target is dragged, and where the links are for it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import QueryError
from ..error_scale import length_in_words
from .body import Body
from .placement import place

if TYPE_CHECKING:
    from ...model.model import Model

_MOST = 12  # branches that are drawn


class Live:
    """Answers inverse queries of a page with a model's map."""

    def __init__(self, model: Model) -> None:
        self._model = model
        self._body = Body.of(model.about)
        self._placement = place(model, self._body)

    def answer(self, question: dict[str, Any]) -> dict[str, Any]:
        """Answer with every branch that reaches a point of the scene.

        question : "at", a point of the scene; what is off the drawn plane is left out
        Returns "reachable", "words", "target" (the point in the plane) and "branches", each
        with "words", "joints" in the motor map's unit box, and transforms of "links".
        """
        placement, model = self._placement, self._model
        point = np.asarray(question["at"], dtype=float)
        if point.shape != (3,) or not np.isfinite(point).all():
            raise QueryError(f"a point of {point.size} numbers: expected three finite ones")
        x = (point - placement.origin) @ np.linalg.pinv(placement.axes)
        found = model.solve_all(x[None])[0]
        reachable = bool(found.reachable.any())
        unit = model.about.unit
        branches = []
        for k in range(min(len(found.q), _MOST)):
            bound = length_in_words(float(found.expected_error[k]), unit)
            poses = {} if self._body is None else self._body.poses(found.q[k])
            branches.append(
                {
                    "words": f"{self._words(found.q[k])}\nexpected error {bound}",
                    "joints": model.motor.scale.to_unit(found.q[k : k + 1])[0].tolist(),
                    "links": {name: t[0].T.ravel().tolist() for name, t in poses.items()},
                }
            )
        words = f"{len(branches)} ways to reach it" if len(branches) > 1 else "one way to reach it"
        if not reachable:
            off = length_in_words(float(found.distance[0]), unit)
            words = f"out of reach, the nearest point is {off} away"
        return {
            "reachable": reachable,
            "words": words,
            "target": placement.lift(x[None])[0].tolist(),
            "branches": branches,
        }

    def _words(self, q: Any) -> str:
        about = self._model.about
        parts = []
        for name, turns, value in zip(about.joint_names, about.revolute, q, strict=True):
            text = f"{np.degrees(value):.2f}°" if turns else f"{1e3 * value:.2f} mm"
            parts.append(f"{name} {text}")
        return ", ".join(parts)
