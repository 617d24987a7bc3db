"""Measurements: a log that is read for a model that there is already."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from .output import Notes
from .usage import refuse

if TYPE_CHECKING:
    from calib.model.model import Model
    from calib.samples.samples import Samples

_FAR_BOUND = 3.0  # times the expected error from which a log is doubted
_FAR_SHARE = 0.02  # and of the positions' spread: the bound of an ideal arm is rounding
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


def log_of(
    model: Model,
    path: str | None,
    columns: Mapping[str, str] | None,
    degrees: bool | None,
    unit: str | None,
    notes: Notes,
) -> Samples | None:
    """Read a log to look at, with a note where it does not fit the model; None for none."""
    if path is None:
        of_logs = {"--columns": columns, "--degrees": degrees, "--unit": unit}
        refuse(of_logs, "applies to a log: expected --data LOG too")
        return None
    log = log_for(model, path, columns, degrees, unit, notes)
    notes.say(doubt(model, log))
    return log


def doubt(model: Model, log: Samples) -> list[str]:
    """Return one line where a log is far from what a model predicts, none where it is near."""
    import numpy as np

    from calib.samples.plausibility import unit_hint

    gap = np.linalg.norm(model.forward(log.q) - log.x, axis=1)
    bound = model.expected_error(log.q)
    known = np.isfinite(gap) & np.isfinite(bound)
    if not known.any():
        return []
    predicted = model.forward(log.q[known])
    size, seen = (
        float(np.median(np.linalg.norm(p - np.median(p, axis=0), axis=1)))
        for p in (predicted, log.x[known])
    )
    typical = float(np.median(gap[known]))
    if typical <= max(_FAR_BOUND * float(np.median(bound[known])), _FAR_SHARE * size):
        return []
    ratio = seen / max(size, 1e-300)
    hint = unit_hint(ratio)
    times = f"; its positions extend over {ratio:.4g} times the model's{hint}" if hint else ""
    return [
        "the log does not fit the model: the median distance from predicted to measured position "
        f"is {typical / size:.2g} times their spread{times}; calib check names the cause"
    ]
