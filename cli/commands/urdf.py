"""The command `calib urdf`."""

from __future__ import annotations

import math
from typing import Annotated

import typer

from .. import options as o
from ..output import Table, fixed, number, show, show_json, tell


def urdf(
    model: o.ModelArgument,
    output: Annotated[
        str, typer.Option("--output", "-o", metavar="URDF", help="The corrected description.")
    ],
    as_json: o.JsonOption = False,
) -> None:
    """Write a URDF whose joint offsets and link placements fit the model best."""
    import calib
    from calib.common.atomic import atomic_write
    from calib.use.geometry import fit_geometry
    from calib.use.urdf import corrected_urdf

    loaded = calib.load(model)
    geometry = fit_geometry(loaded)
    atomic_write(output, corrected_urdf(geometry).encode())
    if as_json:
        show_json({"urdf": output, **geometry.to_json(), "unit": loaded.about.unit})
        return
    rows = []
    arm = geometry.arm
    for k, name in enumerate(arm.joint_names):
        turns = arm.revolute[k]
        factor, unit = (math.degrees(1.0), "deg") if turns else (1e3, "mm")
        rows.append(
            [
                name,
                "offset",
                unit,
                fixed(factor * float(geometry.offsets[k]), 4),
                number(factor * float(geometry.interval_offsets[k])),
            ]
        )
        for axis, label in enumerate(("along x", "along y")):
            rows.append(
                [
                    "",
                    f"its link, {label}",
                    "mm",
                    fixed(1e3 * float(geometry.moved[k, axis]), 4),
                    number(1e3 * float(geometry.interval_moved[k, axis])),
                ]
            )
    for axis, label in enumerate(("along x", "along y")):
        rows.append(
            [
                "base" if axis == 0 else "",
                label,
                "mm",
                fixed(1e3 * float(geometry.base[axis]), 4),
                number(1e3 * float(geometry.interval_base[axis])),
            ]
        )
    show(Table(["joint", "change of", "unit", "value", "+-"], rows, "against the URDF", left=3))
    tell(
        f"{output}: {number(1e3 * geometry.residual)} mm rms are no geometry of this arm "
        f"(before {number(1e3 * geometry.before)} mm)"
    )
