"""Measurements: a log that is read for a model that there is already."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

from . import options as opt
from .output import say
from .parsing import BadOption

if TYPE_CHECKING:
    from collections.abc import Mapping

    from calib.model.model import Model
    from calib.samples.samples import Samples


_FAR_BOUND = 3.0  # times the expected error from which a log is doubted
_FAR_SHARE = 0.02  # and of the positions' spread: the bound of an ideal arm is rounding


@dataclass(frozen=True, kw_only=True)
class Reading:
    """How a log is read, as typed; what is None is as in the log that a model was made from."""

    columns: opt.Columns = None
    unit: opt.Unit = None
    time_offset: opt.TimeOffset = None
    degrees: opt.LogDegrees = None


def refuse(typed: Mapping[str, object], why: str) -> None:
    """Refuse the first of some options that was given; None is not given."""
    for name, value in typed.items():
        if value is not None:
            raise BadOption(f"--{name.replace('_', '-')} {why}")


def log_for(model: Model, path: str, reading: Reading) -> Samples:
    """Read a log of a model's joints, in the model's unit where that is known."""
    import calib
    from calib.common.scale import METRES
    from calib.errors import LogError
    from calib.samples.joint_values import check_joint_values
    from calib.samples.tables import open_source

    about = model.about
    source = open_source(path)  # once: it may be a pipe
    unit = reading.unit or source.unit
    # pixels and metres have no factor between them, and the plane of a camera model is another
    if unit is not None and (unit == "px") != (about.unit == "px"):
        raise LogError(
            f"{path} is in {unit}, the model in {about.unit}",
            hint="record it with the same reference as the model's log, or train a model of it",
        )
    degrees = about.degrees if reading.degrees is None else reading.degrees
    log = calib.read_log(
        source,
        joints=list(about.joint_names),
        columns=reading.columns,
        time_offset=reading.time_offset,
        usual=about.columns,
        outputs=len(model.axes),
        degrees=degrees,
        unit=unit or about.unit,
        prismatic=[n for n, t in zip(about.joint_names, about.revolute, strict=True) if not t],
    )
    say(log.notes)
    ranges = (about.joint_names, about.lower, about.upper, about.revolute)
    check_joint_values(log.q, *ranges, degrees=degrees, label=path)
    if unit is not None and unit != about.unit and {unit, about.unit} <= set(METRES):
        factor = METRES[about.unit] / METRES[unit]
        say([f"positions converted from {unit} to {about.unit}"])
        # that noise is a length too, in the unit of the log that states it
        shared = {"noise_of_reference": log.shared * factor}
        log = replace(log, x=log.x * factor, unit=about.unit, source={**log.source, **shared})
    return log


def log_of(model: Model, path: str | None, reading: Reading) -> Samples | None:
    """Read a log to look at, with a note where it does not fit the model; None for none."""
    if path is None:
        typed = {field.name: getattr(reading, field.name) for field in fields(Reading)}
        refuse(typed, "applies to a log: expected --data LOG too")
        return None
    log = log_for(model, path, reading)
    if log.touch is not None:
        return log
    import numpy as np

    from calib.samples.diagnosis import unit_hint

    predicted = model.forward(log.q)
    known = np.isfinite(predicted[:, 0])
    if not known.any():
        return log
    predicted, x = predicted[known], log.x[known]
    # spreads about the median: single wrong rows do not decide the ratio
    gap, size, seen = (
        float(np.median(np.linalg.norm(away, axis=1)))
        for away in (predicted - x, predicted - np.median(predicted, 0), x - np.median(x, 0))
    )
    bound = float(np.nanmedian(model.expected_error(log.q)))
    if gap > max(_FAR_BOUND * bound, _FAR_SHARE * size):
        hint = unit_hint(seen / max(size, 1e-300))
        far = f"{gap / size:.2g} times their spread{hint}; calib check names the cause"
        say([f"the log does not fit the model: measured positions are off by {far}"])
    return log
