"""A spatial structure from the header and arrays of a model file, every value checked."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arm.spatial_chain import SpatialChain
from ..errors import ModelError
from .given import Given
from .spatial import SpatialStructure
from .storing import finite_array
from .views import SPATIAL

_MOST_JOINTS = 32


def rebuild_spatial(
    header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]
) -> SpatialStructure:
    """A spatial structure from its header and its arrays.

    Raises ModelError if a value is missing, of the wrong kind or size, not finite, or impossible.
    """
    given = Given(header, "body.structure")
    names, chain_names = given.texts("joint_names"), given.texts("chain_names")
    dof, m = len(names), len(chain_names)
    if not 1 <= dof <= m <= _MOST_JOINTS or len(set(names)) != dof or len(set(chain_names)) != m:
        raise ModelError(
            f"body: {dof} joint names and {m} of the chain, expected 1 to {_MOST_JOINTS} "
            "different ones"
        )
    view = given.text("view")
    if view not in SPATIAL:
        raise ModelError(f"body: unknown view {view!r}")
    masses = arrays.get("masses")
    weights = m if masses is not None and len(masses) else 0
    chain = SpatialChain(
        axes=finite_array(arrays, "axes", (m, 3)),
        points=finite_array(arrays, "points", (m, 3)),
        tip=finite_array(arrays, "tip", (3,)),
        rotation=finite_array(arrays, "rotation", (3, 3)),
        revolute=given.truths("chain_revolute", m),
        coupling=finite_array(arrays, "coupling", (m, dof)),
        bias=finite_array(arrays, "bias", (m,)),
        masses=finite_array(arrays, "masses", (weights,)),
        centres=finite_array(arrays, "centres", (weights, 3)),
    )
    for name, axis in zip(chain_names, chain.axes, strict=True):
        if abs(float(np.linalg.norm(axis)) - 1) > 1e-6:
            raise ModelError(f"body: the axis of {name!r} is no unit vector")
    if np.abs(chain.rotation @ chain.rotation.T - np.eye(3)).max() > 1e-6:
        raise ModelError("body: the orientation of the tip is no rotation")
    lens, lens_sd = given.numbers("lens", 4), given.numbers("lens_sd", 4)
    gravity = given.numbers("gravity", 3)
    return SpatialStructure(
        chain=chain,
        joint_names=names,
        chain_names=chain_names,
        revolute=given.truths("turning", dof),
        view=view,
        unit=given.text("unit"),
        metre=given.number("metre", least=1e-12),
        extent=given.number("extent", least=1e-300),
        lens=(lens[0], lens[1], lens[2], lens[3]),
        lens_sd=(lens_sd[0], lens_sd[1], lens_sd[2], lens_sd[3]),
        informed=given.truth("informed"),
        gravity=(gravity[0], gravity[1], gravity[2]),
        simulated=given.truth("simulated"),
    )
