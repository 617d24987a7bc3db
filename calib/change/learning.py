"""A new state of an arm while it is learned from a stream: models from few samples to many."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..common.arrays import Array
from ..model.baseline import learn_baseline
from ..training.evaluate import figures
from .follow import BLOCK, OnlineAdapter
from .watch import Step

if TYPE_CHECKING:
    from ..model.about import About
    from ..model.model import Model

SETTLED = 100
"""Samples that a state must have lasted to be kept as a schema."""

_FIRST = 30  # samples that a first model of a new state rests on
_GROWTH = 3.0  # it is made anew whenever there are so many times the samples
_JUDGED = 2000  # latest samples whose errors are told


class Learning:
    """The maps that re-form, and the models on the way.

    base : where to start
    name : name of the schema that is learned
    horizon : samples over which the state settles
    """

    def __init__(self, base: Model, name: str, horizon: int) -> None:
        self.name = name
        self.samples = 0
        self.step: Step | None = None
        # from now on it rests on what a sensor reads
        self._base = replace(base, about=replace(base.about, bound_of="sensor reading"))
        self._adapter = OnlineAdapter(self._base, horizon, force=True)
        self._horizon = horizon
        self._u: list[Array] = []
        self._x: list[Array] = []
        self._fed = 0
        self._next = _FIRST
        self._made: Model | None = None
        self._judged: list[Array] = []  # distances to samples before they were learned

    @property
    def known(self) -> bool:
        """Whether there is a first model of the state."""
        return self._made is not None

    @property
    def settled(self) -> bool:
        """Whether the state lasted long enough to be kept."""
        return self.known and self.samples >= SETTLED

    def take(self, u: Array, x: Array) -> Model | None:
        """Take samples (n, dof) and (n, m); a new model where it is time for one."""
        self._u.append(u)
        self._x.append(x)
        self.samples += len(u)
        if self._made is not None:
            predicted = self._made.predictor.value(u)
            self._judged.append(np.linalg.norm(x - predicted, axis=1))
        block = _FIRST if not self._fed else BLOCK
        last = self.samples >= self._horizon
        if self.samples - self._fed >= block or last:
            self._feed()
        if self.samples >= self._next or last:
            self._next = math.ceil(_GROWTH * self.samples)
            self._feed()
            return self._make(last)
        return None

    def _feed(self) -> None:
        if self._fed < self.samples:
            u, x = np.concatenate(self._u), np.concatenate(self._x)
            fresh = slice(self._fed - self.samples, None)
            q = self._base.motor.scale.from_unit(u[fresh])
            self.step = self._adapter.feed(q, x[fresh])
            self._fed = self.samples

    def _make(self, last: bool) -> Model:
        """The model of the samples so far, and the errors that were made on the way."""
        made = self._adapter.model()
        u, x = np.concatenate(self._u), np.concatenate(self._x)
        noise = np.linalg.norm(x - made.predictor.value(u), axis=1)
        # what it did not know when it met it; the first model has met nothing
        errors = np.concatenate(self._judged)[-_JUDGED:] if self._judged else noise
        self._made = replace(
            made,
            about=self._told(errors),
            baseline=learn_baseline(made.association, u, x, noise),
            schema=self.name,
            history=(*self._base.history, self._event(errors)) if last else self._base.history,
            seconds={},
        )
        return self._made

    def _event(self, errors: Array) -> dict[str, Any]:
        after = figures(errors) if len(errors) else {}
        return {
            "event": "followed",
            "method": "online",
            "schema": self.name,
            "samples": self.samples,
            "after": {name: value for name, value in after.items() if name != "p99"},
            "frame": None,
        }

    def _told(self, errors: Array) -> About:
        """Facts with the errors of a model that was followed."""
        about, found = self._base.about, dict(self._base.about.errors)
        if len(errors) and "local" in found:
            forward = {**found["local"]["forward"], "distance": figures(errors)}
            found["local"] = {**found["local"], "forward": forward}
        return about.measured(samples=self.samples, errors=found)
