"""Write a copy of the URDF with the joint offsets and link placements that fit the model best.

Only the numbers that change are rewritten. Exit code 3 if offsets and placements do not
describe the model; then nothing is written.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import calib
from calib.common.wording import error_size, for_people, with_unit
from calib.use import assessment

from .. import options as opt
from ..output import EXIT_ACT, Outcome, TextTable, note, say, with_decimals
from ..parsing import check_file
from ..units import units_of

if TYPE_CHECKING:
    from calib.use.geometry import Geometry

_SAME = 1e-6  # m, between two readers of one file


def urdf(
    model: opt.ModelFile,
    output: Annotated[
        str, opt.value("--output -o URDF", "The corrected description.")
    ],
    free: opt.Free = "all",
) -> Outcome:
    from calib.common.atomic import atomic_write
    from calib.model.nominal import assumption
    from calib.use.geometry import MOST_UNEXPLAINED
    from calib.use.geometry_fit import fit_geometry, seen_in_lengths
    from calib.use.urdf import (
        check_output,
        corrected_urdf,
        gap_to_yourdfpy,
    )

    check_file(output, (".urdf", ".xml"))
    loaded = seen_in_lengths(calib.load(model))
    say(assessment.bound_warnings(loaded.about))
    check_output(output, loaded.about.urdf)
    geometry = fit_geometry(loaded, geometry_is_drawn=free == "offsets")
    if geometry.is_explained:
        corrected = corrected_urdf(geometry)
        atomic_write(output, corrected.encode())
        gap = gap_to_yourdfpy(corrected, geometry.arm.tip)
        if gap > _SAME:
            note(f"yourdfpy reads the tip of {output} {1e3 * gap:.3g} mm off")
    unit = geometry.unit
    document = {
        "urdf": output if geometry.is_explained else None,
        **geometry.document(),
        "unit": unit,
        "units": units_of(loaded.about, unit),
    }
    if loaded.about.sensor:
        say([f"fitted to the rows of sensor {loaded.about.sensor!r} alone"])
    if geometry.frame_is_free:
        say([assumption(loaded)])
    share = 100.0 * geometry.residual / geometry.reach
    rms = (
        f"{with_unit(geometry.residual, unit)} rms ({share:.3g} % of the reach)"
    )
    if not geometry.is_explained:
        note(
            f"offsets and placements leave {rms} unexplained, more than {MOST_UNEXPLAINED:.0%}: "
            "nothing was written; check joints and their senses, the tip and the unit of the log"
        )
        return Outcome(document, [_table(geometry)], code=EXIT_ACT)
    before = with_unit(geometry.nominal_residual, unit)
    line = f"{output}: residual {rms}, with the nominal URDF {before}"
    return Outcome(document, [line, _table(geometry)])


def _table(geometry: Geometry) -> TextTable:
    import numpy as np

    parameters = geometry.document()
    arm = geometry.arm
    changes = [
        (name, "offset", unit, parameters["offsets"][name])
        for name, unit in zip(arm.joint_names, arm.units_of_joints, strict=True)
    ]
    for name, change in parameters.get("moved", {}).items():
        changes.append((name, "far end of its link, along {}", "m", change))
    places = dict(parameters.get("places", {}))
    if "tip" in parameters:
        places["sensed point, not written"] = parameters["tip"]
    for name, change in places.items():
        changes.append((name, "origin along {}", "m", change["shift"]))
        changes.append((name, "origin about {}", "rad", change["turn"]))
    rows = []
    for name, what, kind, change in changes:
        factor, unit = for_people(kind)
        values = factor * np.ravel(change.value)
        intervals = factor * np.ravel(change.interval)
        for axis, value, interval in zip(
            "xyz", values, intervals, strict=False
        ):
            if interval:  # what was fitted
                shown = (
                    with_decimals(float(value), 4),
                    error_size(float(interval)),
                )
                rows.append([name, what.format(axis), unit, *shown])
    header = ["joint", "change of", "unit", "value", "+-"]
    return TextTable(header, rows, "against the URDF", left=3)
