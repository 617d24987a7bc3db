"""Measurements: a log that is read for a model that there is already."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from .output import Notes

if TYPE_CHECKING:
    from calib.model.model import Model
    from calib.samples.samples import Samples

_METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254}


def log_for(
    model: Model,
    path: str,
    columns: Mapping[str, str] | None,
    degrees: bool | None,
    unit: str | None,
    notes: Notes,
) -> Samples:
    """Read a log of a model's joints, in the model's unit where that is known.

    What is None is as in the log that the model was made from.
    """
    from dataclasses import replace

    import calib
    from calib.errors import LogError
    from calib.samples.columns import open_source
    from calib.samples.joint_values import check_joint_values
    from calib.samples.tables import about_source

    about = model.about
    source = open_source(path)  # once: it may be a pipe
    said = about_source(source).get("unit")
    unit = unit or (said if isinstance(said, str) else None)
    if unit is not None and (unit == "px") != (about.unit == "px"):
        raise LogError(
            f"{path} is in {unit}, the model in {about.unit}",
            hint="record it with the same reference as the model's log, or train a model of it",
        )
    degrees = about.degrees if degrees is None else degrees
    log = calib.read_log(
        source,
        joints=list(about.joint_names),
        columns=columns,
        usual=about.columns,
        outputs=len(model.axes),
        degrees=degrees,
        unit=unit or about.unit,
        prismatic=[n for n, t in zip(about.joint_names, about.revolute, strict=True) if not t],
    )
    notes.say(log.notes)
    ranges = (about.joint_names, about.lower, about.upper, about.revolute)
    check_joint_values(log.q, *ranges, degrees=degrees, label=path)
    if unit is not None and unit != about.unit and {unit, about.unit} <= set(_METRES):
        factor = _METRES[unit] / _METRES[about.unit]
        notes.say([f"positions converted from {unit} to {about.unit}"])
        shared = {"noise_of_reference": log.shared * factor}
        log = replace(log, x=log.x * factor, unit=about.unit, source={**log.source, **shared})
    return log
