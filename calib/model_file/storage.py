"""The model file: safetensors, one canonical JSON string, a checksum; nothing that can run."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from ..body.belief import Body, Second
from ..body.planar import PlanarStructure
from ..body.spatial import SpatialStructure
from ..body.structure import Structure
from ..common.atomic import atomic_write
from ..common.parallel import one_blas_thread
from ..errors import CalibError, ModelError
from ..maps.association import Association
from ..maps.lattice import Graph
from ..maps.local_models import LocalModels, exponents
from ..maps.map import Map
from ..maps.settings import LOCAL
from ..model.about import MOST_ROWS, About
from ..model.alignment import Alignment
from ..model.facts import shown_errors
from ..model.parts import Parts
from .container import check_sum, pack, unpack
from .fields import Kinds, Tensors, read, write

VERSION = 8  # of the format, as ``docs/format.md`` describes it
KINDS: Kinds = {Structure: (PlanarStructure, SpatialStructure)}
# what building a model from a description without sense raises
_NONSENSE = (
    CalibError,
    ArithmeticError,
    AttributeError,
    LookupError,
    TypeError,
    ValueError,
)
_M = TypeVar("_M", bound=Parts)


@dataclass(frozen=True)
class FileLimits:
    """What no model has."""

    least: float = 1e-300  # above zero
    widest: float = 1e9  # range of a joint [rad or m]


LIMITS = FileLimits()


def save(model: Parts, path: str | os.PathLike[str]) -> None:
    """Write a model into one file, whole or not at all, once it could be read back.

    The same model gives the same bytes: there are no times, dates or paths inside.  Raises
    ModelError if the model's numbers make no file that could be read; an older file stays.
    """
    data = to_bytes(model)
    try:
        parts_of(Parts, data, os.fspath(path))
    except ModelError as error:
        raise ModelError(
            f"the new model cannot be read back, so nothing was written: {error.message}",
            hint="an older file was left as it was; please report it with the log",
        ) from error
    atomic_write(path, data)


def to_bytes(model: Parts) -> bytes:
    """Content of a model file."""
    with one_blas_thread():  # a covariance is factored on the way into the file
        header, tensors = write(model, Parts, KINDS)
    tensors, shared = _without_copies(tensors)
    header["shared"] = shared
    return pack({**header, "format": VERSION}, tensors)


def _without_copies(tensors: Tensors) -> tuple[Tensors, list[str]]:
    """Tensors without those of further sensors that the first one has too, and their names."""
    shared: list[str] = []
    for name, tensor in tensors.items():
        original = tensors.get(_in_first(name))
        if (
            original is not None
            and original is not tensor
            and np.array_equal(original, tensor)
        ):
            shared.append(name)
    rest = {
        name: tensor for name, tensor in tensors.items() if name not in shared
    }
    return rest, sorted(shared)


def _in_first(name: str) -> str:
    """Name of the tensor of the first sensor that stands where one of a further sensor does."""
    return re.sub(r"^others\.\d+\.", "", name)


def parts_of(kind: type[_M], data: bytes, name: str) -> _M:
    """A model of a class from the content of its file; `name` is for messages."""
    header, tensors = unpack(data, name)
    version = header.get("format")
    if header.get("kind") == "rig":
        raise ModelError(
            f"{name}: a rig of flange poses, no model: calib report, calib preview and calib plan "
            "take it"
        )
    if version != VERSION:
        remedy = "an older program wrote it, train the model again"
        if isinstance(version, int) and version > VERSION:
            remedy = "a newer program wrote it, upgrade this one with 'pip install -U calib-arm'"
        raise ModelError(
            f"{name}: model format {version!r}, expected {VERSION}: {remedy}"
        )
    check_sum(header, tensors, name)
    try:
        shared = header["shared"]
        for copy in shared if isinstance(shared, list) else ():
            tensors[copy] = tensors[_in_first(copy)]
        model = read(kind, header, tensors, KINDS)
        _check(model)
        for other in model.others:
            _check(other)
    except _NONSENSE as error:
        reason = " ".join(str(error).split())[:120]
        raise ModelError(
            f"{name}: not a complete model ({reason}), train it again"
        ) from error
    return model


def _check(model: Parts) -> None:
    """Refuse a model whose parts are none, or are not of one; ModelError or what breaks of it."""
    about = model.about
    body = model.body
    scale = model.motor.scale
    # joints are asked in the unit box of the map: other limits would shift every answer
    apart = np.abs(
        [about.lower - scale.lower, about.upper - about.lower - scale.span]
    )
    seen = None if model.baseline is None else model.baseline.seen
    facts = (
        _about_fits(about),
        _maps_fit(model.association),
        bool((apart <= 1e-6 * scale.span).all()),
        model.local.degree < 0 or _local_fits(model.local, model.association),
        body is None or _body_fits(body, len(about.lower)),
        min(model.bounds.min(), model.model_bounds.min()) >= 0.0,
        bool(model.visited.any()),
        model.rows is None or len(model.rows) <= MOST_ROWS,
        seen is None or bool(seen.places.size),
    )
    if not all(facts):
        raise ModelError("its parts do not fit together")
    for state in model.history:
        if state.get("frame") is not None:
            Alignment.from_json(state["frame"])
    if about.errors:
        tuple(shown_errors(about, about.errors))
    middle = np.full((1, len(about.lower)), 0.5)
    answer = model.predictor.value(
        middle
    )  # what makes no sense breaks here, if nowhere before
    if body is not None:
        answer = answer + body.bound(scale.from_unit(middle))
    if not np.isfinite(answer).all():
        raise ModelError("it has no answer in the middle of its range")


def _about_fits(about: About) -> bool:
    names = about.joint_names
    sizes = about.upper - about.lower
    counts = [
        about.samples - 1,
        about.seed,
        about.tested,
        about.left_out,
        *(about.picture or ()),
    ]
    changes = (about.simulation or {}).get("changes", ())
    return (
        all(names)
        and 1
        <= len(set(names))
        == len(names)
        == len(about.revolute)
        == len(sizes)
        and bool(((sizes > 0.0) & (sizes < LIMITS.widest)).all())
        and (about.plane is None or {"origin", "x", "y"} <= set(about.plane))
        and all(isinstance(change, str) for change in changes)
        and min(counts) >= 0
        and {"map", "rule", "epochs", "sigma"} <= set(about.options)
        and all(
            {"x", "y", "distance"} <= set(errors["forward"])
            and {*names, "distance"} <= set(errors["inverse"])
            for errors in about.errors.values()
        )
    )


def _maps_fit(maps: Association) -> bool:
    links = maps.linked
    starts = links.indptr.astype(np.int64)
    return (
        _map_fits(maps.motor)
        and _map_fits(maps.sensory)
        and maps.sensory.units.shape[1] in (2, 3)
        and links.shape == (maps.motor.size, maps.sensory.size)
        and len(starts) == maps.motor.size + 1
        and (starts[0], starts[-1]) == (0, len(links.data))
        and bool(
            (np.diff(starts) >= 0).all()
            and (links.data > 0.0).all()
            and len(links.data)
        )
        and bool(
            (links.indices >= 0).all()
            and (links.indices < maps.sensory.size).all()
        )
        and 1e-3 <= maps.wiring.bandwidth <= 100.0
    )


def _map_fits(one: Map) -> bool:
    lattice = one.lattice
    joined = (
        not isinstance(lattice, Graph)
        or lattice.pairs.max(initial=0) < lattice.size
    )
    # steps and cells are counted in the distance of nodes
    spaced = not (one.scale.span < LIMITS.least).any() and one.spacing > 0.0
    return bool(lattice.size == len(one.units) and joined and spaced)


def _local_fits(models: LocalModels, maps: Association) -> bool:
    nodes, dof = maps.motor.units.shape
    width = maps.sensory.units.shape[1]
    return (
        models.degree <= LOCAL.most_degree
        and models.coefficients.shape
        == (nodes, len(exponents(dof, models.degree)), width)
        and len(models.radius) == nodes
        and not (models.radius < LIMITS.least).any()
    )


def _body_fits(body: Body, dof: int) -> bool:
    beliefs: list[Body | Second] = [body]
    if body.second is not None:
        beliefs.append(body.second)
    least = min(
        body.autocorrelation,
        body.repeat,
        body.rows,
        body.tau.min(),
        body.residual.min(),
    )
    return (
        body.structure.dof == dof
        and all(_belief_fits(belief, body.structure) for belief in beliefs)
        and 1.0 <= body.kappa < np.inf
        and body.nu >= 2.0
        and least >= 0.0
    )


def _belief_fits(belief: Body | Second, structure: Structure) -> bool:
    sizes = (len(belief.beta), len(belief.noise))
    return (
        sizes == (structure.size, structure.outputs)
        and bool((np.diff(belief.active) > 0).all())
        and bool(belief.root.any(axis=1).all())
        and not (belief.noise < LIMITS.least).any()
    )
