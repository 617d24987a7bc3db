"""The command `calib urdf`: write a copy of the URDF with what the model has learned."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

from calib.common.wording import for_people

from ..options import OF_FRAMES, takes
from ..output import NO, Notes, TextTable, fixed, note, number, show, show_json, tell
from ..units import units_of
from ..usage import flag, option

if TYPE_CHECKING:
    from calib.use.planar_geometry import Geometry
    from calib.use.spatial_geometry import SpatialGeometry


@takes(
    output=option("--output -o URDF", "The corrected description."),
    move_base=flag("--move-base", "Fit the place of the first joint as well."),
    move_tip=flag(
        "--move-tip",
        "Write the sensed point of a spatial arm as its tip; else it is a probe or a tag.",
    ),
    **OF_FRAMES,
)
def urdf(
    model: str,
    output: str,
    view: str = "auto",
    cause: str = "sensor",
    move_base: bool = False,
    move_tip: bool = False,
    as_json: bool = False,
) -> None:
    """Write a copy of the URDF with the joint offsets and link placements that fit the model best.

    Only the numbers that change are rewritten. Exit code 3 if offsets and placements do not
    describe the model; then nothing is written.
    """
    import calib
    from calib.common.atomic import atomic_write, check_writable
    from calib.use.correct import free_frame
    from calib.use.geometry import fit_geometry
    from calib.use.planar_geometry import Geometry
    from calib.use.urdf import MOST_UNEXPLAINED, check_output, corrected_urdf

    check_writable(output)
    loaded = calib.load(model)
    check_output(output, loaded.about.urdf)
    geometry = fit_geometry(loaded, view=view, cause=cause, move_base=move_base, move_tip=move_tip)
    explained = geometry.residual <= MOST_UNEXPLAINED * geometry.reach
    if explained:
        atomic_write(output, corrected_urdf(geometry).encode())
    if as_json:
        show_json(
            {
                "urdf": output if explained else None,
                **geometry.to_json(),
                "unit": geometry.unit,
                "units": {**units_of(loaded.about), "positions": geometry.unit},
            }
        )
    else:
        show(_table(geometry) if isinstance(geometry, Geometry) else _in_space(geometry))
    if geometry.free:
        Notes().say(free_frame(loaded, cause))
    left = 100.0 * geometry.residual / geometry.reach
    factor, unit = for_people(geometry.unit)
    rms = f"{number(factor * geometry.residual)} {unit} rms ({left:.3g} % of the reach)"
    if not explained:
        note(
            f"offsets and placements leave {rms} unexplained, more than {MOST_UNEXPLAINED:.0%}: "
            "nothing was written; check the joints, the tip and the unit of the log, and --view"
        )
        raise typer.Exit(NO)
    if not as_json:
        before = f"{number(factor * geometry.before)} {unit}"
        tell(f"{output}: residual {rms}, with the nominal URDF {before}")


def _table(geometry: Geometry) -> TextTable:
    rows, arm, offsets, ends = [], geometry.arm, geometry.offsets, geometry.ends
    for k, name in enumerate(arm.joint_names):
        factor, unit = for_people("rad" if arm.revolute[k] else "m")
        rows.append(_row(name, "offset", factor, unit, *(part[k] for part in offsets)))
        for axis, label in enumerate(("along x", "along y")):
            what = f"far end of its link, {label}"
            rows.append(_row("", what, 1e3, "mm", *(part[k + 1, axis] for part in ends)))
    if ends[1][0].any():
        for axis, label in enumerate(("along x", "along y")):
            name = "" if axis else "base"
            rows.append(_row(name, label, 1e3, "mm", *(part[0, axis] for part in ends)))
    return TextTable(
        ["joint", "change of", "unit", "value", "+-"], rows, "against the URDF", left=3
    )


def _in_space(geometry: SpatialGeometry) -> TextTable:
    structure, beta, half = geometry.structure, geometry.beta, 1.96 * geometry.sd
    groups, layout, revolute = structure.groups, structure.layout, geometry.arm.revolute
    found = []
    for k, name in enumerate(geometry.arm.joint_names):
        kind = "rad" if revolute[k] else "m"
        found.append((name, "offset", kind, groups["offset"][[k]]))
    for i, name in enumerate(geometry.places):
        found.append((name, "origin along {}", "m", layout.shifts[i]))
        found.append((name, "origin about {}", "rad", layout.turns[i]))
    written = "" if geometry.move_tip else ", not written"
    found.append((f"sensed point{written}", "along {}", "m", groups["tool"]))
    found.append((f"sensed point{written}", "about {}", "rad", groups["tool.rotation"]))
    rows, last = [], ""
    for name, what, kind, indices in found:
        if not half[indices].any():
            continue
        factor, unit = for_people(kind)
        for axis, index in zip("xyz", indices.tolist(), strict=False):
            shown = "" if name == last else name
            last = name
            rows.append(_row(shown, what.format(axis), factor, unit, beta[index], half[index]))
    return TextTable(
        ["joint", "change of", "unit", "value", "+-"], rows, "against the URDF", left=3
    )


def _row(name: str, what: str, factor: float, unit: str, value: float, width: float) -> list[str]:
    return [name, what, unit, fixed(factor * float(value), 4), number(factor * float(width))]
