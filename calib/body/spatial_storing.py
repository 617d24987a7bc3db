"""A spatial structure from the header and arrays of a model file, every value checked."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arm.spatial_chain import SpatialChain
from .given import given, given_fields, refuse
from .spatial import SpatialStructure
from .storing import finite_array, impossible_names
from .views import SPATIAL

_MOST_JOINTS = 32


def rebuild_spatial(
    header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]
) -> SpatialStructure:
    """A spatial structure from its header and its arrays.

    Raises ModelError if a value is missing, of the wrong kind or size, not finite, or impossible.
    """
    # the chain is in the arrays; `few` is found out by the fit
    told = given_fields(
        SpatialStructure,
        {**header, "revolute": header.get("turning")},
        "body.structure",
        leave=("chain", "few"),
    )
    names, chain_names = told["joint_names"], told["chain_names"]
    dof, m = len(names), len(chain_names)
    turning = given(tuple[bool, ...], header.get("chain_revolute"), "body.structure")
    refuse(
        {
            **impossible_names(names, min(m, _MOST_JOINTS)),
            **impossible_names(chain_names, _MOST_JOINTS),
            f"one of the views {', '.join(SPATIAL)}": told["view"] not in SPATIAL,
            "sizes above zero": told["metre"] < 1e-12 or told["extent"] < 1e-300,
            f"kinds of {dof} and {m} joints": (len(told["revolute"]), len(turning)) != (dof, m),
        },
        "body.structure",
    )
    masses = arrays.get("masses")
    weights = m if masses is not None and len(masses) else 0
    chain = SpatialChain(
        axes=finite_array(arrays, "axes", (m, 3)),
        points=finite_array(arrays, "points", (m, 3)),
        tip=finite_array(arrays, "tip", (3,)),
        rotation=finite_array(arrays, "rotation", (3, 3)),
        revolute=turning,
        coupling=finite_array(arrays, "coupling", (m, dof)),
        bias=finite_array(arrays, "bias", (m,)),
        masses=finite_array(arrays, "masses", (weights,)),
        centres=finite_array(arrays, "centres", (weights, 3)),
    )
    lengths = np.linalg.norm(chain.axes, axis=1)
    turned = chain.rotation @ chain.rotation.T - np.eye(3)
    refuse(
        {
            "axes of length 1": bool(np.abs(lengths - 1).max() > 1e-6),
            "the orientation of the tip to be a rotation": bool(np.abs(turned).max() > 1e-6),
        },
        "body.structure",
    )
    return SpatialStructure(chain=chain, **told)
