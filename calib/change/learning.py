"""A new state of an arm while it is learned from a stream: models from few samples to many."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ..common.arrays import Array
from ..model.baseline import learn_baseline
from ..model.model import Model
from ..training.evaluate import figures
from .follow import BLOCK, OnlineAdapter
from .watch import Step

SETTLED_AFTER = 100
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
        self.step: Step | None = None
        # from now on it rests on what a sensor reads
        self._base = replace(base, about=replace(base.about, bound_of="sensor reading"))
        self._adapter = OnlineAdapter(self._base, horizon, force=True)
        self._horizon, self._next, self._fed = horizon, _FIRST, 0
        self._u = np.zeros((0, base.motor.units.shape[1]))
        self._x = np.zeros((0, base.sensory.units.shape[1]))
        self._made: Model | None = None
        self._judged = np.zeros(0)  # distances to samples before they were learned

    @property
    def samples(self) -> int:
        """Samples so far."""
        return len(self._u)

    @property
    def known(self) -> bool:
        """Whether there is a first model of the state."""
        return self._made is not None

    @property
    def settled(self) -> bool:
        """Whether the state lasted long enough to be kept."""
        return self.known and self.samples >= SETTLED_AFTER

    def take(self, u: Array, x: Array) -> Model | None:
        """Take samples (n, dof) and (n, m); a new model where it is time for one."""
        self._u, self._x = np.concatenate([self._u, u]), np.concatenate([self._x, x])
        if self._made is not None:
            miss = np.linalg.norm(x - self._made.predictor.value(u), axis=1)
            self._judged = np.concatenate([self._judged, miss])[-_JUDGED:]
        n, block = self.samples, BLOCK if self._fed else _FIRST
        last = n >= self._horizon
        due = n >= self._next or last
        if n > self._fed and (due or n - self._fed >= block):
            q = self._base.motor.scale.from_unit(self._u[self._fed :])
            self.step = self._adapter.feed(q, self._x[self._fed :])
            self._fed = n
        if not due:
            return None
        self._next = math.ceil(_GROWTH * n)
        made, base = self._adapter.model(), self._base
        noise = np.linalg.norm(self._x - made.predictor.value(self._u), axis=1)
        # what it did not know when it met it; the first model has met nothing
        after = figures(self._judged if len(self._judged) else noise)
        told = dict(base.about.errors)
        if "local" in told:
            told["local"] = {
                **told["local"],
                "forward": {**told["local"]["forward"], "distance": after},
            }
        event = {
            "event": "followed",
            "method": "online",
            "schema": self.name,
            "samples": n,
            "after": {name: value for name, value in after.items() if name != "p99"},
            "frame": None,
        }
        self._made = replace(
            made,
            about=base.about.measured(samples=n, errors=told),
            baseline=learn_baseline(made.association, self._u, self._x, noise),
            schema=self.name,
            history=(*base.history, event) if last else base.history,
            seconds={},
        )
        return self._made
