"""The command `calib urdf`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from typer import Option

from calib.common.wording import for_people

from .. import options as opt
from ..output import NO, Outcome, TextTable, fixed, note, number, say, sized
from ..parsing import check_file
from ..units import units_of

if TYPE_CHECKING:
    from calib.use.geometry import Geometry


def urdf(
    model: opt.ModelFile,
    output: Annotated[
        str, Option("--output", "-o", metavar="URDF", help="The corrected description.")
    ],
    view: opt.LogView = "auto",
    move_base: Annotated[
        bool, Option("--move-base", help="Fit the first joint's place.")
    ] = False,
    move_tip: Annotated[
        bool, Option("--move-tip", help="The tip is sensed, no probe.")
    ] = False,
    free: opt.Free = "all",
    as_json: opt.Json = False,
    verbose: opt.Verbose = False,
    quiet: opt.Quiet = False,
) -> Outcome:
    """Write a copy of the URDF with the joint offsets and link placements that fit the model best.

    Only the numbers that change are rewritten. Exit code 3 if offsets and placements do not
    describe the model; then nothing is written.
    """
    import calib
    from calib.common.atomic import atomic_write
    from calib.use.frames import FRAME_IS_FITTED
    from calib.use.geometry_fit import fit_geometry
    from calib.use.urdf import (
        MOST_UNEXPLAINED,
        check_output,
        corrected_urdf,
        what_no_urdf_holds,
    )

    check_file(output, (".urdf", ".xml"))
    loaded = calib.load(model)
    check_output(output, loaded.about.urdf)
    geometry = fit_geometry(
        loaded,
        view=view,
        move_base=move_base,
        move_tip=move_tip,
        drawn=free == "offsets",
    )
    explained = geometry.residual <= MOST_UNEXPLAINED * geometry.reach
    if explained:
        atomic_write(output, corrected_urdf(geometry).encode())
    document = {
        "urdf": output if explained else None,
        **geometry.to_json(),
        "unit": geometry.unit,
        "units": {**units_of(loaded.about), "positions": geometry.unit},
    }
    if geometry.free:
        say([FRAME_IS_FITTED])
    say(what_no_urdf_holds(loaded))
    share = 100.0 * geometry.residual / geometry.reach
    rms = f"{sized(geometry.residual, geometry.unit)} rms ({share:.3g} % of the reach)"
    if not explained:
        note(
            f"offsets and placements leave {rms} unexplained, more than {MOST_UNEXPLAINED:.0%}: "
            "nothing was written; check the joints, the tip and the unit of the log, and --view"
        )
        return Outcome(document, [_table(geometry)], code=NO)
    before = sized(geometry.before, geometry.unit)
    line = f"{output}: residual {rms}, with the nominal URDF {before}"
    return Outcome(document, [line, _table(geometry)])


def _table(geometry: Geometry) -> TextTable:
    import numpy as np

    parameters = geometry.to_json()
    arm = geometry.arm
    changes = [
        (name, "offset", kind, parameters["offsets"][name])
        for name, kind in zip(arm.joint_names, arm.units_of_joints, strict=True)
    ]
    ways = parameters.get("moved", {})
    changes += [
        (name, "far end of its link, along {}", "m", change)
        for name, change in ways.items()
    ]
    places = dict(parameters.get("places", {}))
    if "tip" in parameters:
        written = "" if parameters["tip"]["written"] else ", not written"
        places[f"sensed point{written}"] = parameters["tip"]
    for name, change in places.items():
        changes += [(name, "origin along {}", "m", change["shift"])]
        changes += [(name, "origin about {}", "rad", change["turn"])]
    if "base" in parameters:
        changes.append(("base", "along {}", "m", parameters["base"]))
    rows = []
    for name, what, kind, change in changes:
        factor, unit = for_people(kind)
        values = np.ravel(change["value"])
        widths = np.ravel(change["interval"])
        for axis, value, width in zip(
            "xyz", values.tolist(), widths.tolist(), strict=False
        ):
            if width:  # what was fitted
                shown = fixed(factor * value, 4), number(factor * width)
                rows.append([name, what.format(axis), unit, *shown])
    return TextTable(
        ["joint", "change of", "unit", "value", "+-"], rows, "against the URDF", 3
    )
