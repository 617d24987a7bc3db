"""Poses: a fit to positions and orientations as one of positions."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from .belief import Body
    from .posterior import BodyFit


def positions_of(fit: BodyFit) -> BodyFit:
    """A fit to poses as one of positions, with the orientations' errors beside it.

    The parameters that the orientations told are kept, the tool's rotation among them.
    """
    body = fit.body
    three = {name: getattr(body, name)[:3] for name in ("noise", "tau", "residual")}
    second = body.second and replace(body.second, noise=body.second.noise[:3])
    view = "base" if body.structure.view.startswith("base") else "rigid"
    structure = replace(body.structure, view=view)  # type: ignore[type-var]
    turned = np.linalg.norm(fit.held_out[:, 3:], axis=1)
    positions = replace(body, structure=structure, second=second, **three)
    return replace(fit, body=positions, held_out=fit.held_out[:, :3], turned=turned)


def knows_orientation(body: Body | None) -> bool:
    """Whether a body was learned from orientations too."""
    if body is None or body.structure.kind != "spatial":
        return False
    return bool(np.isin(body.structure.groups["tool.rotation"], body.active).all())
