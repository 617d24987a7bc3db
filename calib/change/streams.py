"""A stream followed for life: changes are noticed, learned, kept, and recognised again.

Use :class:`Follower` where samples keep coming from an arm that changes now and then, such
as one that picks up a tool and puts it down.  A change that was met before is recalled
from some tens of samples; a new one is learned by the paper's rule (eq. 9 to 12, see
:mod:`calib.change.follow`) and kept as a schema.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..common.arrays import Array
from ..common.parallel import one_blas_thread
from ..common.rows import checked_rows
from ..errors import OptionError
from ..model.model import Model
from ..model.schemas import Schema
from .follow import HORIZON, check_followable
from .learning import SETTLED_AFTER, Learning
from .schemas import MOST_SCHEMAS, OUTSIDE, fits_of, in_state
from .watch import Step

_WINDOW = 20  # latest samples that tell whether the present schema still fits
_AGAINST = 13  # of them that contradict it: at a share of 10 % once in 10^8 windows
_STEP = 5  # samples between two looks
_RECALL = 10  # samples since a change that a schema is recognised from
_NATS = 15.0  # log likelihood ratio for a kept schema: by chance once in 3 million windows
_STILL = 60  # a change of many small steps may end in a known schema that much later


@dataclass(frozen=True)
class Followed:
    """The state of a follower after some samples.

    Attributes
    ----------
    samples : int
        Samples seen so far.
    schema : str
        Name of the present schema, the one that is being learned included.
    learning : bool
        Whether it is being learned.
    recalled : bool
        Whether a kept schema became the present one with these samples.
    changed : bool
        Whether a change was noticed with these samples.
    since : int
        Samples that count as after the latest change, 0 before the first.
    error : float [unit]
        Mean distance from these samples to what the present model said of them before it
        learned them; NaN where it had no answer.
    step : Step or None
        Distortions and schedules while maps and links re-form.
    """

    samples: int
    schema: str
    learning: bool
    recalled: bool
    changed: bool
    since: int
    error: float
    step: Step | None


class Follower:
    """A model that follows a stream for life.

    It waits until 13 of the latest 20 samples lie beyond 1.5 times the bound of the
    present schema, or a kept one explains them better by 15 nats.  If a kept one fits the
    samples since then, that one is recalled.  Else a new one is learned: a first model after
    30 samples, a better one whenever their number has tripled, while maps and links re-form.
    After `horizon` samples it stays as it is.  A change to a new state that stays within 1.5
    times the bound is :class:`calib.Monitor`'s to tell.

    Parameters
    ----------
    model : Model
        Where to start, with the schemas that it keeps; it is left as it is.
    most : int
        Schemas that are kept, the present one among them; the one that was not present
        for longest is dropped.
    horizon : int
        Samples over which a new state settles.

    Examples
    --------
    >>> import calib
    >>> from calib.change.streams import Follower
    >>> arm = calib.load_arm("two_link")
    >>> follower = Follower(calib.train(calib.babble(arm, 2000), size=15), horizon=1000)
    >>> for k, tool in enumerate(("0.05,0", "0,0", "0.05,0")):
    ...     log = calib.babble(arm, 1200, seed=k + 1, changes=[f"tip.offset={tool}"])
    ...     state = follower.update(log.q, log.x)
    >>> state.schema, state.learning, [s.name for s in follower.model.schemas]
    ('schema 2', False, ['schema 1'])
    """

    def __init__(self, model: Model, *, most: int = MOST_SCHEMAS, horizon: int = HORIZON) -> None:
        if most < 1:
            raise OptionError(f"most {most}: expected one or more schemas")
        if horizon < SETTLED_AFTER:
            raise OptionError(f"horizon {horizon}: expected {SETTLED_AFTER} or more samples")
        check_followable(model)
        self._most, self._horizon = most, horizon
        self._present = replace(model, schemas=())
        self._state = Schema.of(model)
        self._kept: list[Schema] = list(model.schemas)
        self._models: dict[str, Model] = {}  # of the schemas that were present
        self._learning: Learning | None = None
        self._seen = 0
        self._since = 0
        self._u: Array = np.zeros((0, model.motor.scale.span.size))
        self._x: Array = np.zeros((0, model.sensory.units.shape[1]))
        self._against: NDArray[np.bool_] = np.zeros(0, dtype=bool)

    @property
    def model(self) -> Model:
        """The model as it stands: the present schema, and the others kept with it."""
        return replace(self._present, schemas=tuple(self._kept))

    @property
    def learning(self) -> bool:
        """Whether a new state is being learned."""
        return self._learning is not None

    def update(self, q: ArrayLike, x: ArrayLike) -> Followed:
        """Take the next samples, (n, dof) or (dof,) and (n, 2) or (2,), and learn from them."""
        present = self._present
        rows, _ = checked_rows(q, present.about.joint_names, "joint values")
        points, _ = checked_rows(x, present.axes, "positions")
        if len(rows) != len(points) or not len(rows):
            raise OptionError(
                f"{len(rows)} rows of joints and {len(points)} positions: expected as many, one or "
                "more"
            )
        u = present.motor.scale.to_unit(rows)
        errors, changed, recalled = [], False, False
        with one_blas_thread():
            for k in range(0, len(u), _STEP):
                distance, new, known = self._look(u[k : k + _STEP], points[k : k + _STEP])
                errors.append(distance)
                changed |= new
                recalled |= known
        error = np.concatenate(errors)
        error = error[np.isfinite(error)]
        state, mean = self._learning, float(error.mean()) if len(error) else math.nan
        name, step = (self._present.schema, None) if state is None else (state.name, state.step)
        return Followed(self._seen, name, self.learning, recalled, changed, self._since, mean, step)

    def _look(self, u: Array, x: Array) -> tuple[Array, bool, bool]:
        """Take some samples; their errors, whether a change was noticed, and recalled."""
        ratio, distance, _ = self._state.contradictions(u, x)
        against = np.nan_to_num(ratio, nan=0.0) > OUTSIDE
        self._seen += len(u)
        self._since += len(u) if self._since else 0
        recent = slice(-2 * _WINDOW, None)
        self._u = np.concatenate([self._u, u])[recent]
        self._x = np.concatenate([self._x, x])[recent]
        self._against = np.concatenate([self._against, against])[recent]
        if self._learning is not None:
            self._learn(u, x)
        # while a new state has no model yet, the old one's contradictions are no news
        waiting = self._learning is not None and not self._learning.known
        if not waiting and int(self._against[-_WINDOW:].sum()) >= _AGAINST:
            # the first that contradicts: the sum of +1 and -2 from there on is largest
            start = int(np.argmax(np.where(self._against, 1, -2)[::-1].cumsum()[::-1]))
            u, x = self._u[start:], self._x[start:]
            self._since = len(u)
            return distance, True, self._recalled(u, x) or self._begin(u, x)
        if self._learning is not None and self._learning.samples <= _STILL:
            return distance, False, self._recalled(self._u[-_RECALL:], self._x[-_RECALL:])
        if self._learning is None and self._kept and self._another_is_likelier():
            self._since = min(len(self._u), _WINDOW)
            return distance, True, self._recalled(self._u[-_WINDOW:], self._x[-_WINDOW:])
        return distance, False, False

    def _another_is_likelier(self) -> bool:
        """Whether a kept schema explains the latest samples far better than the present one.

        It tells schemas apart that differ by less than the bound.
        """
        u, x = self._u[-_WINDOW:], self._x[-_WINDOW:]
        if len(u) < _RECALL:
            return False
        name, fits = fits_of([self._state, *self._kept], u, x)
        told = {fit.name: fit.likelihood * len(u) for fit in fits}
        own = self._state.name
        return name not in (None, own) and told[str(name)] > told[own] + _NATS

    def _recalled(self, u: Array, x: Array) -> bool:
        """Make the kept schema that fits the samples the present one, if one does."""
        if not self._kept or len(u) < _RECALL:
            return False
        name, _ = fits_of(self._kept, u[-_WINDOW:], x[-_WINDOW:])
        if name is None:
            return False
        schema = next(s for s in self._kept if s.name == name)
        self._kept.remove(schema)
        self._keep_present()
        self._show(self._models.get(name) or in_state(self._present, schema))
        return True

    def _begin(self, u: Array, x: Array) -> bool:
        """Learn a new state from the samples since a change; returns that none was recalled."""
        self._keep_present()
        names = {self._present.schema, *(s.name for s in self._kept)}
        k = len(names) + 1
        while f"schema {k}" in names:
            k += 1
        self._learning = Learning(self._present, f"schema {k}", self._horizon)
        self._forget()
        self._learn(u, x)
        return False

    def _learn(self, u: Array, x: Array) -> None:
        assert self._learning is not None  # noqa: S101
        model = self._learning.take(u, x)
        if model is not None:
            self._show(model)
        if self._learning.samples >= self._horizon:
            self._learning = None

    def _keep_present(self) -> None:
        """Keep the present state as a schema, if it was known long enough."""
        unknown = self._learning is not None and not self._learning.settled
        self._learning = None
        name = self._present.schema
        if unknown or any(s.name == name for s in self._kept):
            return
        self._models[name] = self._present
        self._kept = [self._state, *self._kept][: self._most - 1]
        self._models = {s.name: self._models[s.name] for s in self._kept if s.name in self._models}

    def _show(self, model: Model) -> None:
        """Let a model be the present one."""
        self._present, self._state = model, Schema.of(model)
        self._forget()

    def _forget(self) -> None:
        """Samples so far say nothing of the state that is the present one now."""
        self._u, self._x, self._against = self._u[:0], self._x[:0], self._against[:0]
