"""Contents of a model file: what of a model is kept, and what no model can be."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from ..arm.spatial_chain import SpatialChain
from ..body.approach import Approach
from ..body.belief import Body, Second
from ..body.planar import PlanarStructure
from ..body.spatial import SpatialStructure
from ..body.structure import Structure
from ..body.views import VIEWS_OF_BODIES
from ..common.arrays import Array, Index, Mask, Own, Shape
from ..common.scale import Scale
from ..errors import ModelError
from ..maps.association import Association
from ..maps.lattice import Graph, Lattice
from ..maps.linear_models import from_shifts, to_shifts
from ..maps.links import Compressed, Wiring
from ..maps.local_models import MOST_DEGREE, NO_MODELS, LocalModels, exponents
from ..maps.map import HISTORY, Map
from ..maps.predictor import BodyInBox, Predictor
from ..model.about import About
from ..model.alignment import Alignment
from ..model.baseline import Baseline
from ..model.measured import MOST_ROWS, Photo, Rows
from ..model.parts import Parts
from .fields import Format

_MOST_JOINTS = 64
_TINY = 1e-300  # the least number above zero


@dataclass(frozen=True)
class Links:
    """The links as sparse rows, and how they were learned and are read."""

    counts: Annotated[Index, Shape("nodes")]  # links of each motor node
    nodes: Annotated[Index, Shape("links")]  # sensory node of each link
    strengths: Annotated[Array, Shape("links", kept="f4")]
    local: bool
    mutual: bool
    bandwidth: float  # [node spacings]


@dataclass(frozen=True)
class Kept:
    """What a model file holds; axes are those of the motor map's `nodes` and `places`."""

    about: About
    motor: Annotated[Map, Own(nodes="nodes", d="dof")]
    sensory: Annotated[Map, Own(nodes="places", d="width")]
    # mean position of the samples at which a node was active, less its weight [node spacings]
    motor_shifts: Annotated[Array, Shape("nodes", "dof", kept="f2")] | None
    sensory_shifts: Annotated[Array, Shape("places", "width", kept="f2")] | None
    links: Annotated[Links, Own(nodes="nodes")]
    body: Annotated[Body, Own()] | None
    local: LocalModels | None
    bounds: Annotated[Array, Shape("nodes")]
    model_bounds: Annotated[Array, Shape("nodes")] | None  # where they are others
    visited: Annotated[Mask, Shape("nodes")]
    rows: Rows | None
    baseline: Baseline | None
    approach: Approach | None
    photo: Annotated[Photo, Own()] | None
    history: tuple[Mapping[str, Any], ...]


def kept_of(model: Parts) -> Kept:
    """What of a model is kept."""
    association, models = model.association, model.predictor.models
    links, wiring = association.linked, association.wiring
    same = np.array_equal(model.model_bounds, model.bounds)
    return Kept(
        model.about,
        model.motor,
        model.sensory,
        _shifts(model.motor, association.motor_means),
        _shifts(model.sensory, association.sensory_means),
        Links(
            np.diff(links.indptr).astype(np.intp),
            np.asarray(links.indices, dtype=np.intp),
            links.data,
            wiring.local,
            wiring.mutual,
            wiring.bandwidth,
        ),
        model.body,
        models if models.degree >= 0 else None,
        model.bounds,
        None if same else model.model_bounds,
        model.visited,
        model.rows,
        model.baseline,
        model.approach,
        model.photo,
        model.history,
    )


def _shifts(part: Map, means: Array | None) -> Array | None:
    return None if means is None else to_shifts(part, means).astype(float)


def model_of(kept: Kept) -> Parts:
    """The model that a file keeps; each part makes sense, here they are compared."""
    motor, sensory, about, links = kept.motor, kept.sensory, kept.about, kept.links
    places, width = sensory.units.shape
    linked = Compressed(
        links.strengths,
        links.nodes.astype(np.int32),
        np.concatenate([[0], np.cumsum(links.counts)]).astype(np.int32),
        (motor.size, places),
    )
    models = kept.local or NO_MODELS
    body, terms = kept.body, len(exponents(len(about.lower), models.degree)) if kept.local else 0
    # joints are asked in the unit box of the map: other limits would shift every answer
    span, low = motor.scale.span, np.abs(about.lower - motor.scale.lower)
    other = (np.abs((about.upper - about.lower) / span - 1.0) > 1e-6) | (low > 1e-6 * span)
    _refuse(
        {
            "a motor map of the joints' limits": bool(other.any()),
            "positions of 2 or 3 coordinates": width not in (2, 3),
            "links that end at nodes": bool((links.nodes >= places).any())
            or links.counts.sum() != len(links.nodes),
            "as many coefficients as a degree has": terms != models.coefficients.shape[1],
            "a body of this arm": body is not None and body.structure.dof != len(about.lower),
            "errors within bounds of 0 or more": min(
                b.min() for b in (kept.bounds, kept.model_bounds) if b is not None
            ) < 0.0,
            "a node that was visited": not kept.visited.any(),
        }
    )  # fmt: skip
    for state in kept.history:
        if state.get("frame") is not None:
            Alignment.from_json(state["frame"])
    means = [
        None if shift is None else from_shifts(part, shift)
        for part, shift in ((motor, kept.motor_shifts), (sensory, kept.sensory_shifts))
    ]
    wiring = Wiring(links.local, links.mutual, links.bandwidth)
    association = Association(motor, sensory, linked, wiring, *means)
    smooth = association.linear if body is None else BodyInBox(body, motor.scale)
    wider = kept.bounds if kept.model_bounds is None else kept.model_bounds
    return Parts(
        about, association, Predictor(motor, smooth, models), kept.bounds, wider, kept.visited,
        body, kept.rows, tuple(dict(state) for state in kept.history), kept.baseline,
        approach=kept.approach, photo=kept.photo,
    )  # fmt: skip


def _refuse(impossible: Mapping[str, bool]) -> None:
    for expected, wrong in impossible.items():
        if wrong:
            raise ModelError(f"expected {expected}")


# --- what no part of a model can be, by what is expected ---------------------------------------


def _map(own: Map) -> dict[str, bool]:
    nodes = own.lattice.size == len(own.units)
    return {
        "a node for each place of the lattice": not nodes,
        f"a history of {len(HISTORY)} columns": own.history.shape[1:] != (len(HISTORY),),
        # steps and cells are counted in the distance of nodes
        "nodes in several places": nodes and not own.spacing > 0.0,
    }


def _links(own: Links) -> dict[str, bool]:
    return {
        "links above zero": not len(own.strengths) or not bool((own.strengths > 0.0).all()),
        "a bandwidth of 0.001 to 100": not 1e-3 <= own.bandwidth <= 100.0,
    }


def _local(own: LocalModels) -> dict[str, bool]:
    return {
        f"a degree up to {MOST_DEGREE}": not 0 <= own.degree <= MOST_DEGREE,
        "samples and radii above zero": own.samples < 0 or bool((own.radius < _TINY).any()),
    }


def _belief(own: Body | Second) -> dict[str, bool]:
    active, root = own.active, own.root
    return {
        "rising numbers of parameters": not bool((np.diff(active) > 0).all())
        or (len(active) > 0 and active[-1] >= len(own.beta)),
        "the root of a covariance": not bool(root.any(axis=1).all()),
        "noise above zero": bool((own.noise < _TINY).any()),
    }  # fmt: skip


def _body(own: Body) -> dict[str, bool]:
    structure, second = own.structure, own.second
    beliefs: list[Any] = [own] if second is None else [own, second]
    sizes = {(len(each.beta), len(each.noise)) for each in beliefs}
    numbers = (own.kappa, own.autocorrelation, own.repeat, *own.scales.values())
    return _belief(own) | {
        "parameters and outputs of its structure": sizes != {(structure.size, structure.outputs)},
        "a finite kappa of at least 1": not 1.0 <= own.kappa < np.inf,
        "nu of at least 2": not own.nu >= 2.0,
        "rows, times and scales of 0 or more": not (min(*numbers, own.rows) >= 0.0
                                                    and max(numbers) < np.inf),
        "deviations of 0 or more": min(own.tau.min(), own.residual.min()) < 0.0,
    }  # fmt: skip


def _structure(own: Any) -> dict[str, bool]:
    names, kinds = own.joint_names, VIEWS_OF_BODIES[own.kind]
    sizes = own.metre, own.extent
    return {
        f"1 to {_MOST_JOINTS} different joint names": not 1 <= len(names) <= _MOST_JOINTS
        or len(set(names)) < len(names),
        "a kind of each joint": len(own.revolute) != len(names),
        f"one of the views {', '.join(kinds)}": own.view not in kinds,
        "sizes above zero": not (min(sizes) > _TINY and sizes[0] >= 1e-12 and max(sizes) < np.inf),
    }


def _planar(own: PlanarStructure) -> dict[str, bool]:
    drawn, n = own.nominal, len(own.joint_names)
    told = [own.signs, *((drawn.lengths, drawn.offsets, drawn.signs) if drawn else ())]
    signs = {*own.signs, own.mirror, *((drawn.mirror, *drawn.signs) if drawn else ())}
    return _structure(own) | {
        "values of each joint": any(len(values) != n for values in told),
        "signs that are 1 or -1": not signs <= {1, -1},
    }


def _spatial(own: SpatialStructure) -> dict[str, bool]:
    chain, names, dof = own.chain, own.chain_names, len(own.joint_names)
    joints = len(names), len(chain.revolute), len(chain.axes)
    return _structure(own) | {
        "different joint names of the chain": len(set(joints)) > 1
        or len(set(names)) < len(names)
        or chain.coupling.shape[1] != dof
        or not dof <= len(names) <= _MOST_JOINTS,
    }


def _chain(own: SpatialChain) -> dict[str, bool]:
    turned, lengths = own.rotation @ own.rotation.T, np.linalg.norm(own.axes, axis=1)
    return {
        "axes of length 1": bool(np.abs(lengths - 1.0).max(initial=0.0) > 1e-6),
        "a rotation of the tip": bool(np.abs(turned - np.eye(3)).max() > 1e-6),
        "all masses or none": len(own.masses) not in (0, len(own.axes)),
    }


FORMAT = Format(
    {Structure: (PlanarStructure, SpatialStructure)},
    {
        Map: _map,
        Graph: lambda own: {"edges that end at nodes": not own.pairs.size > 0
                            or own.pairs.max() >= own.size},
        Lattice: lambda own: {"nodes along each axis": not own.shape or min(own.shape) < 1},
        Scale: lambda own: {"a range above zero": bool((own.span < _TINY).any())},
        Links: _links,
        LocalModels: _local,
        Body: _body,
        Second: _belief,
        PlanarStructure: _planar,
        SpatialStructure: _spatial,
        SpatialChain: _chain,
        About: lambda own: own.impossible(),
        Rows: lambda own: {f"at most {MOST_ROWS} rows": len(own) > MOST_ROWS},
        Baseline: lambda own: {"variances of 0 or more": min(*own.spread, own.noise) < 0.0},
        Approach: lambda own: {"plays of 0 or more": bool((own.play < 0.0).any())},
    },
)  # fmt: skip
"""How the classes of a model are written and read."""


def described(model: Parts) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """The description of a model and its tensors."""
    return FORMAT.write(kept_of(model), Kept)


def build(header: Mapping[str, Any], tensors: Mapping[str, NDArray[Any]]) -> Parts:
    """Rebuild the model that a file describes; ModelError and others where it makes no sense."""
    return model_of(FORMAT.read(Kept, header, tensors))
