"""Sense: what a model that was read can be, beyond the types and shapes of its fields."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..body.belief import Body
from ..errors import ModelError
from ..maps.association import Association
from ..maps.lattice import Graph
from ..maps.local_models import MOST_DEGREE, LocalModels, exponents
from ..maps.map import Map
from ..model.about import MOST_ROWS, About
from ..model.alignment import Alignment
from ..model.facts import shown_errors
from ..model.parts import Parts

_TINY = 1e-300  # the least number above zero
_WIDEST = 1e9  # range of a joint [rad or m]


def check(model: Parts) -> None:
    """Refuse a model whose parts are none, or are not of one; ModelError or what breaks of it."""
    about, motor, body, models = model.about, model.motor, model.body, model.local
    # joints are asked in the unit box of the map: other limits would shift every answer
    span = motor.scale.span
    apart = np.abs([about.lower - motor.scale.lower, about.upper - about.lower - span])
    if not (
        _about(about)
        and _maps(model.association)
        and (apart <= 1e-6 * span).all()
        and (models.degree < 0 or _local(models, model.association))
        and (body is None or _body(body, len(about.lower)))
        and min(model.bounds.min(), model.model_bounds.min()) >= 0.0
        and model.visited.any()
        and (model.rows is None or len(model.rows) <= MOST_ROWS)
        and (model.approach is None or not (model.approach.play < 0.0).any())
    ):
        raise ModelError("its parts do not fit together")
    for state in model.history:
        if state.get("frame") is not None:
            Alignment.from_json(state["frame"])
    tuple(shown_errors(about, about.errors) if about.errors else ())
    middle = np.full((1, len(about.lower)), 0.5)
    answer = model.predictor.value(middle)  # what makes no sense breaks here, if nowhere before
    bound = 0.0 if body is None else body.bound(motor.scale.from_unit(middle))
    if not np.isfinite(answer + bound).all():
        raise ModelError("it has no answer in the middle of its range")


def _about(own: About) -> bool:
    names, sizes = own.joint_names, own.upper - own.lower
    return (
        all(names)
        and 1 <= len(set(names)) == len(names) == len(own.revolute) == len(sizes)
        and bool(((sizes > 0.0) & (sizes < _WIDEST)).all())
        and (own.plane is None or {"origin", "x", "y"} <= set(own.plane))
        and all(isinstance(each, str) for each in (own.simulation or {}).get("changes", ()))
        and min(*(own.picture or (1,)), own.samples - 1, own.seed, own.tested, own.left_out) >= 0
        and {"map", "rule", "epochs", "sigma"} <= set(own.options)
        and all(
            {"x", "y", "distance"} <= set(told["forward"])
            and {*names, "distance"} <= set(told["inverse"])
            for told in own.errors.values()
        )
    )


def _maps(own: Association) -> bool:
    links, first = own.linked, own.linked.indptr.astype(np.int64)
    return (
        all(map(_map, (own.motor, own.sensory)))
        and own.sensory.units.shape[1] in (2, 3)
        and links.shape == (own.motor.size, own.sensory.size)
        and len(first) == own.motor.size + 1
        and (first[0], first[-1]) == (0, len(links.data))
        and bool((np.diff(first) >= 0).all() and (links.data > 0.0).all() and len(links.data))
        and bool((links.indices >= 0).all() and (links.indices < own.sensory.size).all())
        and 1e-3 <= own.wiring.bandwidth <= 100.0
    )


def _map(own: Map) -> bool:
    lattice: Any = own.lattice
    return bool(
        lattice.size == len(own.units)
        and (not isinstance(lattice, Graph) or lattice.pairs.max(initial=0) < lattice.size)
        and not (own.scale.span < _TINY).any()
        and own.spacing > 0.0  # steps and cells are counted in the distance of nodes
    )


def _local(own: LocalModels, maps: Association) -> bool:
    (nodes, dof), width = maps.motor.units.shape, maps.sensory.units.shape[1]
    return (
        own.degree <= MOST_DEGREE
        and own.coefficients.shape == (nodes, len(exponents(dof, own.degree)), width)
        and len(own.radius) == nodes
        and not (own.radius < _TINY).any()
    )


def _body(own: Body, dof: int) -> bool:
    structure, beliefs = own.structure, tuple(each for each in (own, own.second) if each)
    return (
        structure.dof == dof
        and all(
            (len(each.beta), len(each.noise)) == (structure.size, structure.outputs)
            and (np.diff(each.active) > 0).all()
            and each.root.any(axis=1).all()
            and not (each.noise < _TINY).any()
            for each in beliefs
        )
        and 1.0 <= own.kappa < np.inf
        and own.nu >= 2.0
        and min(own.autocorrelation, own.repeat, own.rows, own.tau.min(), own.residual.min()) >= 0.0
    )
