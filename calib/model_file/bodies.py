"""A body as a JSON header and arrays for a model file, and back with every value checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arm.spatial_chain import SpatialChain
from ..body.belief import Body, Second
from ..body.covariance import pack, unpack
from ..body.planar import PlanarStructure
from ..body.structure import Structure
from ..body.views import VIEWS_OF_BODIES
from ..errors import ModelError
from .checked import (
    POSITIVE,
    Tensors,
    given,
    given_fields,
    given_key,
    plain_fields,
    refuse_impossible,
)

_PLAIN = ("kappa", "nu", "autocorrelation", "scales", "rows", "simulated", "member", "repeat")
"""Fields of a body that stand in the header as they are."""

_CHAIN = {
    "axes": "m3", "points": "m3", "tip": "3", "rotation": "33", "coupling": "md", "bias": "m",
    "masses": "w", "centres": "w3",
}  # fmt: skip
"""Shapes of a chain's arrays: m joints, d of them active, w masses."""

_MOST_JOINTS = 64


def body_header(body: Body) -> dict[str, Any]:
    """JSON-ready description of a body; `body_arrays` holds the rest."""
    told = plain_fields(body, _PLAIN)
    if not np.isfinite(body.nu):  # which JSON cannot say
        told["nu"] = None
    second = body.second is not None
    return {**told, "structure": structure_header(body.structure), "second": second}


def body_arrays(body: Body) -> dict[str, NDArray[Any]]:
    """Arrays of a body: parameters in double, covariances in single precision."""
    out: dict[str, NDArray[Any]] = {"tau": body.tau, "residual": body.residual}
    for prefix, belief in (("", body), ("second.", body.second)):
        if belief is not None:
            out[f"{prefix}beta"] = belief.beta
            out[f"{prefix}active"] = belief.active.astype(np.int32)
            out[f"{prefix}root"] = pack(belief.root)
            out[f"{prefix}noise"] = belief.noise
    structure: Any = body.structure
    if structure.kind == "spatial":
        out |= {f"structure.{name}": getattr(structure.chain, name) for name in _CHAIN}
    return out


def rebuild_body(header: Any, tensors: Tensors) -> Body:
    """The body of a header and its arrays.

    Raises ModelError if a value is missing, of the wrong kind or size, not finite, or impossible.
    """
    header = given(dict, header, "body")
    gaussian = header.get("nu", 0) is None
    told = given_fields(Body, {**header, "nu": 2.0} if gaussian else header, "body", _PLAIN)
    least = min(told["autocorrelation"], told["rows"], *told["scales"].values())
    refuse_impossible(
        {
            "kappa of at least 1": told["kappa"] < 1.0,
            "nu of at least 2": told["nu"] < 2.0,
            "an autocorrelation, rows and scales of 0 or more": least < 0.0,
        },
        "body",
    )
    if gaussian:
        told["nu"] = np.inf
    stated = given_key(dict, header, "structure", "body")
    structure = rebuild_structure(stated, tensors.under("structure."))
    second = None
    if given_key(bool, header, "second", "body"):
        second = Second(**_belief(structure, tensors.under("second.")))
    told["tau"], told["residual"] = (
        tensors.take(name, (structure.outputs,), least=0.0) for name in ("tau", "residual")
    )
    return Body(structure, **_belief(structure, tensors), **told, second=second)


def _belief(structure: Structure, tensors: Tensors) -> dict[str, Any]:
    """Parameters, which of them are active, the root of their covariance, the noise."""
    active = tensors.take("active", (-1,), "int32").astype(np.intp)
    k, last = len(active), structure.size - 1
    rising = k == 0 or (active[0] >= 0 and active[-1] <= last and (np.diff(active) > 0).all())
    refuse_impossible(
        {f"rising numbers of parameters up to {last}": not rising}, f"{tensors.prefix}active"
    )
    root = unpack(tensors.take("root", (k * (k + 1) // 2,), "float32"), k)
    refuse_impossible({"the root of a covariance": not root.any(axis=1).all()}, "body.root")
    return {
        "beta": tensors.take("beta", (structure.size,)),
        "active": active,
        "root": root,
        "noise": tensors.take("noise", (structure.outputs,), least=POSITIVE),
    }


def structure_header(structure: Structure) -> dict[str, Any]:
    """JSON-ready description from which `rebuild_structure` makes the structure again."""
    told: dict[str, Any] = {"kind": structure.kind, **asdict(structure)}  # type: ignore[call-overload]
    if structure.kind == "spatial":  # the chain is in the arrays; `few` is found out by the fit
        told["chain_revolute"] = told.pop("chain")["revolute"]
        told["turning"] = told.pop("revolute")
        del told["few"]
    return told


def rebuild_structure(header: Any, tensors: Tensors) -> Structure:
    """The structure of a header and its arrays; its kind says which class."""
    kind = given(dict, header, "body.structure").get("kind")
    if kind not in VIEWS_OF_BODIES:
        raise ModelError(f"body of kind {kind!r}, expected planar or spatial")
    found = _planar(header) if kind == "planar" else _spatial(header, tensors)
    refuse_impossible(
        {
            **_impossible_names(found.joint_names),
            f"one of the views {', '.join(VIEWS_OF_BODIES[kind])}": found.view
            not in VIEWS_OF_BODIES[kind],
            "sizes above zero": found.metre < 1e-12 or found.extent < 1e-300,
        },
        "body.structure",
    )
    return found


def _planar(header: Mapping[str, Any]) -> PlanarStructure:
    found: PlanarStructure = given(PlanarStructure, header, "body.structure")
    n, own = len(found.joint_names), found.nominal
    told = [found.revolute, found.signs, *((own.lengths, own.offsets, own.signs) if own else ())]
    signs = {*found.signs, found.mirror, *((own.mirror, *own.signs) if own else ())}
    refuse_impossible(
        {
            f"{n} values of each kind": any(len(values) != n for values in told),
            "signs that are 1 or -1": not signs <= {1, -1},
        },
        "body.structure",
    )
    return found


def _spatial(header: Mapping[str, Any], tensors: Tensors) -> Any:
    from ..body.spatial import SpatialStructure  # modules of arms in space

    turning = given(tuple[bool, ...], header.get("chain_revolute"), "body.structure")
    header = {**header, "revolute": header.get("turning")}
    kept = [name for name in SpatialStructure.__dataclass_fields__ if name not in ("chain", "few")]
    told = given_fields(SpatialStructure, header, "body.structure", kept)
    dof, m = len(told["joint_names"]), len(told["chain_names"])
    refuse_impossible(
        {
            **_impossible_names(told["chain_names"]),
            f"kinds of {dof} and {m} joints": (len(told["revolute"]), len(turning)) != (dof, m)
            or dof > m,
        },
        "body.structure",
    )
    weighed = m if len(tensors.take("masses", (-1,))) else 0
    sizes = {"m": m, "d": dof, "w": weighed, "3": 3}  # all masses are known, or none
    arrays = {n: tensors.take(n, tuple(sizes[s] for s in shape)) for n, shape in _CHAIN.items()}
    chain = SpatialChain(revolute=turning, **arrays)
    turned = chain.rotation @ chain.rotation.T - np.eye(3)
    lengths = np.linalg.norm(chain.axes, axis=1)
    refuse_impossible(
        {
            "axes of length 1": bool(np.abs(lengths - 1).max() > 1e-6),
            "the orientation of the tip to be a rotation": bool(np.abs(turned).max() > 1e-6),
        },
        "body.structure",
    )
    return SpatialStructure(chain=chain, **told)


def _impossible_names(names: tuple[str, ...]) -> dict[str, bool]:
    """Whether joints' names are too few or many, or the same, by what is expected."""
    wrong = not 1 <= len(names) <= _MOST_JOINTS or len(set(names)) < len(names)
    return {f"1 to {_MOST_JOINTS} different joint names": wrong}
