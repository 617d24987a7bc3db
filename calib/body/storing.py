"""A body as a JSON header and arrays for a model file, and back with every value checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..common.arrays import Array
from ..errors import ModelError
from .belief import Body, Second
from .covariance import Packed, packed_of, unpack
from .given import given, refuse
from .planar import PlanarStructure
from .structure import Indices, Structure
from .views import PLANAR

Stored = Mapping[str, NDArray[Any]]

MOST_JOINTS = 64


def body_header(body: Body) -> dict[str, Any]:
    """JSON-ready description of a body; `body_arrays` holds the rest."""
    return {
        "structure": body.structure.header(),
        "kappa": body.kappa,
        "nu": body.nu if np.isfinite(body.nu) else None,
        "autocorrelation": body.autocorrelation,
        "scales": dict(body.scales),
        "rows": body.rows,
        "simulated": body.simulated,
        "member": body.member,
        "second": body.second is not None,
    }


def body_arrays(body: Body) -> dict[str, NDArray[Any]]:
    """Arrays of a body: parameters in double, covariances in single precision."""
    out: dict[str, NDArray[Any]] = {"tau": body.tau, "residual": body.residual}
    for prefix, belief in (("", body), ("second.", body.second)):
        if belief is not None:
            out[f"{prefix}beta"] = belief.beta
            out[f"{prefix}active"] = belief.active.astype(np.int32)
            out[f"{prefix}root"] = packed_of(belief.covariance, belief.packed)
            out[f"{prefix}noise"] = belief.noise
    return out | {f"structure.{k}": v for k, v in body.structure.arrays().items()}


def rebuild_body(header: Mapping[str, Any], arrays: Stored) -> Body:
    """The body of a header and its arrays.

    Raises ModelError if a value is missing, of the wrong kind or size, not finite, or impossible.
    """
    told = given(_Told, header, "body")
    refuse(
        {
            "kappa of at least 1": told.kappa < 1.0,
            "nu of at least 2": told.nu is not None and told.nu < 2.0,
            "an autocorrelation, rows and scales of 0 or more": (
                min(told.autocorrelation, told.rows, *told.scales.values()) < 0.0
            ),
        },
        "body",
    )
    structure = rebuild_structure(
        told.structure, {k[10:]: v for k, v in arrays.items() if k.startswith("structure.")}
    )
    second = Second(*_belief(structure, arrays, "second.")) if told.second else None
    first = _belief(structure, arrays, "")
    return Body(
        structure,
        *first[:4],
        told.kappa,
        _positive(arrays, "tau", structure.outputs, zero=True),
        _positive(arrays, "residual", structure.outputs, zero=True),
        np.inf if told.nu is None else told.nu,
        told.autocorrelation,
        told.scales,
        told.rows,
        told.simulated,
        told.member,
        second,
        first[4],
    )


@dataclass(frozen=True)
class _Told:
    """What a header says of a body, see `Body`."""

    structure: dict[str, Any]
    kappa: float
    nu: float | None  # None where it is infinite, which JSON cannot say
    autocorrelation: float
    scales: dict[str, float]
    rows: int
    simulated: bool
    member: str
    second: bool


def rebuild_structure(header: Mapping[str, Any], arrays: Stored) -> Structure:
    """The structure of a header and its arrays; its kind says which class."""
    kind = header.get("kind")
    if kind == "planar":
        return rebuild_planar(header)
    if kind == "spatial":
        from .spatial_storing import rebuild_spatial

        return rebuild_spatial(header, arrays)
    raise ModelError(f"body of kind {kind!r}, expected planar or spatial")


def rebuild_planar(header: Mapping[str, Any]) -> PlanarStructure:
    """A planar structure from its header."""
    found: PlanarStructure = given(PlanarStructure, header, "body.structure")
    n, own = len(found.joint_names), found.nominal
    told = [found.revolute, found.signs, *((own.lengths, own.offsets, own.signs) if own else ())]
    signs = {*found.signs, found.mirror, *((own.mirror, *own.signs) if own else ())}
    refuse(
        {
            **impossible_names(found.joint_names, MOST_JOINTS),
            f"{n} values of each kind": any(len(values) != n for values in told),
            "signs that are 1 or -1": not signs <= {1, -1},
            f"one of the views {', '.join(PLANAR)}": found.view not in PLANAR,
            "sizes above zero": found.metre < 1e-12 or found.extent < 1e-300,
        },
        "body.structure",
    )
    return found


def impossible_names(names: tuple[str, ...], most: int) -> dict[str, bool]:
    """Whether joints' names are too few or many, or the same, by what is expected."""
    return {
        f"1 to {most} different joint names": not 1 <= len(names) <= most
        or len(set(names)) < len(names)
    }


def _belief(
    structure: Structure, arrays: Stored, prefix: str
) -> tuple[Array, Indices, Array, Array, Packed]:
    """Parameters, which of them are active, their covariance, the noise, the covariance's root."""
    name = prefix + "active"
    active = arrays.get(name)
    if active is None or active.ndim != 1 or active.dtype.kind not in "iu":
        raise ModelError(f"body: array {name!r} is missing or no list of whole numbers")
    k = len(active)
    index = active.astype(np.intp)
    if k > structure.size or (k and (index.min() < 0 or index.max() >= structure.size)):
        raise ModelError(f"body: array {name!r} names parameters beyond {structure.size}")
    if (np.diff(index) <= 0).any():
        raise ModelError(f"body: array {name!r} does not rise")
    name = prefix + "root"
    packed = np.asarray(finite_array(arrays, name, (k * (k + 1) // 2,)), dtype=np.float32)
    covariance = unpack(packed, k)
    if not (np.isfinite(covariance).all() and (np.diag(covariance) > 0).all()):
        raise ModelError(f"body: array {name!r} is the root of no covariance")
    beta = finite_array(arrays, prefix + "beta", (structure.size,))
    return beta, index, covariance, _positive(arrays, prefix + "noise", structure.outputs), packed


def finite_array(arrays: Stored, name: str, shape: tuple[int, ...]) -> Array:
    """A finite array of this shape, or an error that names it."""
    value = arrays.get(name)
    if value is None:
        raise ModelError(f"body: array {name!r} is missing")
    if value.shape != shape or value.dtype.kind != "f":
        raise ModelError(
            f"body: array {name!r} is {value.dtype} {value.shape}, expected numbers {shape}"
        )
    if not np.isfinite(value).all():
        raise ModelError(f"body: array {name!r} is not finite")
    return np.asarray(value, dtype=float)


def _positive(arrays: Stored, name: str, size: int, zero: bool = False) -> Array:
    value = finite_array(arrays, name, (size,))
    if (value < 0).any() or (not zero and (value == 0).any()):
        raise ModelError(f"body: array {name!r} must be positive")
    return value
