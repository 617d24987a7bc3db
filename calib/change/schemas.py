"""Body schemas: states of one arm that a model keeps, such as a tool on and a tool off.

Use it where an arm changes back and forth: :func:`keep` adds a state under a name,
:func:`recognise` tells which one a log fits, :func:`recall` makes it the present one.
A schema holds what distinguishes it: where the nodes stand, how joints lead to positions,
and how far that can be trusted.  Links are at rest for it, so they are learned again from
its own map when it is recalled.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..common.arrays import Array
from ..errors import OptionError
from ..maps.association import Association
from ..model.model import Model
from ..model.schemas import Schema, check_name
from ..samples.samples import Samples

MOST_SCHEMAS = 4
"""Schemas that a follower keeps, the present one among them."""

OUTSIDE = 1.5
"""A sample contradicts a schema beyond so many times its 95 % bound.

For normal errors one in 800; it leaves room for bounds that are too narrow by half."""

IMAGINED = 20_000
"""Samples that a model imagines to learn its links from."""

_CHANCE = 0.05  # share of samples that may contradict the schema that is right
_UNLIKELY = 1e-3  # a schema fits unless so many contradictions are that improbable
_FREEDOM = 6.0  # of the Student distribution that compares schemas


@dataclass(frozen=True)
class SchemaFit:
    """How a log fits one schema."""

    name: str  # the schema
    fits: bool  # whether the log does not contradict it
    outside: float  # share of the rows beyond 1.5 times its 95 % bound
    distance: float  # [unit], median distance from predicted to measured position
    likelihood: float  # mean log density of a row [1 / unit^2]; the larger one fits better


@dataclass(frozen=True)
class Recognition:
    """Which schema a log fits.

    Attributes
    ----------
    name : str or None
        The schema that fits best, None where each is contradicted.
    present : bool
        Whether that is the model's present one.
    samples : int
        Rows that were compared.
    fits : tuple of SchemaFit
        All schemas, the most likely first.
    """

    name: str | None
    present: bool
    samples: int
    fits: tuple[SchemaFit, ...]

    @property
    def words(self) -> str:
        """One line for people."""
        if self.name is None:
            names = ", ".join(repr(f.name) for f in self.fits)
            return f"none of the kept schemas fits ({names})"
        return f"schema {self.name!r} fits" + (", the present one" if self.present else "")


def schemas_of(model: Model) -> tuple[Schema, ...]:
    """All schemas of a model, the present one first."""
    return (Schema.of(model), *model.schemas)


def keep(model: Model, other: Model, name: str, *, most: int | None = None) -> Model:
    """The model with the state of another one of the same arm kept as a schema.

    Parameters
    ----------
    model : Model
        Its present state stays the present one.
    other : Model
        Such as the model adapted with a tool mounted.
    name : str
        A schema of that name is replaced; the present one's name is refused.
    most : int, optional
        Schemas that are kept in all, the present one among them; those that were kept
        longest are dropped.

    Raises
    ------
    OptionError
        If the models are of different arms, or the name is empty or that of the present.

    Examples
    --------
    >>> import calib
    >>> from calib.change.schemas import keep, recognise
    >>> arm = calib.load_arm("two_link")
    >>> plain = calib.train(calib.babble(arm, 2000), size=15)
    >>> log = calib.babble(arm, 2000, changes=["tip.offset=0.05,0"])
    >>> both = keep(plain, calib.train(log, size=15), "tool on")
    >>> recognise(both, log.take(slice(30))).words
    "schema 'tool on' fits"
    """
    mine, its = model.about, other.about
    alike = mine.joint_names == its.joint_names and mine.unit == its.unit
    for a, b in ((model.motor, other.motor), (model.sensory, other.sensory)):
        alike = alike and a.lattice.shape == b.lattice.shape and np.array_equal(a.edges, b.edges)
    first, second = ([m.motor.scale.lower, m.motor.scale.span] for m in (model, other))
    if not alike or not np.allclose(first, second):
        raise OptionError(
            f"schema {name!r} has other joints, joint ranges, units or maps than the model: adapt "
            "the model, or train both alike"
        )
    check_name(name)
    if name == model.schema:
        raise OptionError(f"schema {name!r} is the model's present one: give another name")
    others = [s for s in model.schemas if s.name != name]
    schema = Schema.of(other, name)
    units = model.sensory.scale.to_unit(other.sensory.weights)
    sensory = replace(model.sensory, units=units)
    kept = (replace(schema, sensory=sensory), *others)
    return replace(model, schemas=kept if most is None else kept[: max(0, most - 1)])


def as_schema(adapted: Model, old: Model, name: str) -> Model:
    """An adapted model under a name of its own, with the old state kept as a schema.

    Raises OptionError if the name is that of the old state, or empty.
    """
    kept = keep(old, adapted, name).schemas  # checks the name and that the arm is the same
    others = tuple(s for s in kept if s.name != name)
    return replace(adapted, schema=name, schemas=(Schema.of(old), *others))


def recall(model: Model, name: str) -> Model:
    """The model with a kept schema as its present state; the former one is kept instead.

    Links are learned from what the schema says of 20,000 joint values in the part of the
    range that it has visited: where eq. 11 comes to rest.

    Raises
    ------
    OptionError
        If there is no such schema.
    """
    if name == model.schema:
        return model
    found = next((s for s in model.schemas if s.name == name), None)
    if found is None:
        names = ", ".join(repr(s.name) for s in schemas_of(model))
        raise OptionError(f"schema {name!r} is unknown, choose one of {names}")
    others = tuple(s for s in model.schemas if s is not found)
    return replace(in_state(model, found), schemas=(Schema.of(model), *others))


def in_state(model: Model, schema: Schema) -> Model:
    """The model in the state of a schema, with the schemas that it keeps."""
    motor, sensory = schema.predictor.motor, schema.sensory
    u = np.random.default_rng(model.about.seed).random((IMAGINED, len(motor.scale.span)))
    u = u[schema.visited[motor.nearest(u)[1][:, 0]]]
    if not len(u):  # hardly anything was visited
        u = np.clip(motor.units[schema.visited], 0.0, 1.0)
    v = sensory.scale.to_unit(schema.predictor.value(u))
    return replace(
        model,
        about=replace(model.about, bound_of=schema.bound_of, samples=schema.samples),
        # links at rest for what the schema says
        association=Association.learn(motor, u, sensory, v, model.association.wiring),
        predictor=schema.predictor,
        body=schema.body,
        bounds=schema.bounds,
        model_bounds=schema.model_bounds,
        visited=schema.visited,
        baseline=schema.baseline,
        schema=schema.name,
    )


def recognise(model: Model, log: Samples) -> Recognition:
    """Tell which schema of a model fits a log; ten to thirty rows do.

    A schema is contradicted where more rows lie beyond 1.5 times its 95 % bound than
    chance allows (binomial, one in 1,000 at a share of 5 %).  Of those that are not the
    most likely one answers.

    Parameters
    ----------
    model : Model
        With its schemas.
    log : Samples
        Rows of the same arm.
    """
    u = model.motor.scale.to_unit(model.about.joints_of(log))
    name, fits = fits_of(schemas_of(model), u, log.x)
    return Recognition(name, name == model.schema, len(log), fits)


def fits_of(
    schemas: Sequence[Schema], u: Array, x: Array
) -> tuple[str | None, tuple[SchemaFit, ...]]:
    """The schema that fits best, None where each is contradicted, and how each fits.

    u, x : (n, dof), (n, 2), joints in the unit box and measured positions
    """
    from scipy.special import bdtrc

    found = []
    for schema in schemas:
        ratio, distance, bound = schema.contradictions(u, x)
        seen = np.isfinite(ratio)
        if not seen.any():
            found.append(SchemaFit(schema.name, False, 1.0, float("inf"), float("-inf")))
            continue
        outside = ratio[seen] > OUTSIDE
        square = (schema.radius * ratio[seen]) ** 2
        sigma, k = bound[seen] / schema.radius, x.shape[1]
        # Student's, so that one wrong detection does not decide
        density = -k * np.log(sigma) - (_FREEDOM + k) / 2 * np.log1p(square / _FREEDOM)
        count = int(outside.sum())
        fits = not count or float(bdtrc(count - 1, len(outside), _CHANCE)) >= _UNLIKELY
        sizes = float(outside.mean()), float(np.median(distance[seen])), float(density.mean())
        found.append(SchemaFit(schema.name, fits, *sizes))
    found.sort(key=lambda f: -f.likelihood)
    return next((f.name for f in found if f.fits), None), tuple(found)
