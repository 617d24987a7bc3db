"""Summary: what a model is, how well it does, and what limits it, as JSON, lines and a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import calib
from calib.common.choices import READOUTS
from calib.common.wording import printable

from .output import NO, TextTable, number, with_unit
from .units import units_of

if TYPE_CHECKING:
    from calib.model.about import About, Errors

_EXACT = 1e-9  # share of the extent below which an error is rounding
_POINTS = 200  # of the learned range at which the bound is asked
_UNEVEN = 2.0  # so many times wider in its worst tenth than in its best, a bound tells of few rows
_NOISY = 0.7  # of the bound on readings: noise is the larger part where the model's own is smaller
_MOST = 3  # findings that are printed; `calib info` has all
_TERMS = (
    "local: body and local models; body: the body alone; linear, activity, winner: the maps and "
    "their Hebbian links alone"
)


def summary(
    model: calib.Model, path: str, errors: Errors, seconds: Mapping[str, float]
) -> dict[str, object]:
    """Return what `train`, `evaluate` and `info` print as JSON; `seconds` have a "total"."""
    about = model.about
    facts = {
        "model": path,
        "robot": about.robot or None,
        "joints": about.joint_names,
        "tip": about.tip or None,
        "plane": about.plane,
        "view": _view_of(model),
        "map": about.options["map"],
        "rule": about.options["rule"],
        "size": {
            "motor": model.motor.lattice.shape,
            "sensory": model.sensory.lattice.shape,
        },
        "samples": about.samples,
        "left_out": about.left_out,
        "seed": about.seed,
        "seconds": seconds,
        "unit": about.unit,
        "units": units_of(about),
        "bound_of": about.bound_of,
        "bound_holds": about.bound_holds,
        "sensors": [_sensor(model.by(name)) for name in model.sensors],
        "errors": errors,
    }
    if len(model.axes) == 3:
        del facts["plane"]
    return facts


def _sensor(model: calib.Model) -> dict[str, object]:
    """Return what a sensor is as JSON: its name, kind, unit, view, noise and rows."""
    about = model.about
    body = model.body
    view = None if body is None else body.structure.view
    kind = "space" if len(model.axes) == 3 else "plane"
    if about.unit == "px":
        kind = "pixels"
    elif view is not None and "pose" in view:
        kind = "pose"
    return {
        "name": about.sensor,
        "kind": kind,
        "unit": about.unit,
        "view": view,
        "noise": None if body is None else float(body.noise[0]),
        "rows": about.samples,
    }


def _view_of(model: calib.Model) -> dict[str, object]:
    """Return what the sensor measures as JSON: the kind of view and its fitted parameters."""
    body = model.body
    if body is None:
        return {"kind": None}
    from calib.body.belief import knows_orientation
    from calib.body.sensor_pose import SensorPose
    from calib.body.views import is_camera

    kind = "pose" if knows_orientation(body) else body.structure.view
    view: dict[str, object] = {"kind": kind}
    mirror = getattr(body.structure, "mirror", None)
    if mirror is not None:
        view["mirror"] = mirror < 0
    for parameter in body.parameters():
        # the arm's own parameters stand in `calib info`; here only what the sensor is
        if parameter.group.startswith(("view.", "lens")):
            key = parameter.name.partition(".")[2].replace(" ", "_")
            if mirror is not None:  # of a planar arm
                key = {"scale": "log_scale"}.get(key, key).replace(".", "_")
            view[key] = {
                "value": parameter.value,
                "interval": [parameter.low, parameter.high],
                "unit": parameter.unit,
            }
    sensor = SensorPose.of(body)
    if sensor is not None:
        view["camera" if is_camera(kind) else "sensor"] = sensor.to_json()
    if is_camera(kind):
        # one focal length serves both axes: the camera of a body has square pixels
        f, u, v, k1 = body.beta[body.structure.groups["lens"]].tolist()
        size = model.about.picture
        view["lens"] = {"focal": f, "centre": [u, v], "k1": k1, "size": size}
    return view


def _mean_distance(errors: Errors) -> float:
    """Return the mean error of the readout that answers queries [unit]."""
    best = next(errors[readout] for readout in READOUTS if readout in errors)
    return float(best["forward"]["distance"]["mean"])


def accuracy(
    model: calib.Model,
    errors: Errors,
    within: Mapping[str, float],
    rows: str,
    left_out: int,
) -> str:
    """Return in one line how far predictions are from where the tip is or is measured."""
    unit = model.about.unit
    line = f"{with_unit(_mean_distance(errors), unit)} on average"
    if within:
        limit = with_unit(within["p95"], unit).removeprefix("below ")
        line += f", 95 % within {limit}"
        answered = within.get("answered", 1.0)
        if answered > 0.0:
            line += f"; the 95 % bound covers {100 * within['covered']:.0f} %"
        if 0.0 < answered < 1.0:
            line += f" of the {100 * answered:.0f} % that have an answer"
    line += f", on {rows}"
    if left_out:
        line += f"; {left_out} left out, wrong or outside of what was learned"
    return line


def accuracy_of_sensor(model: calib.Model) -> str:
    """Return in one line how far predictions of a sensor were off when its model was made."""
    about = model.about
    tested = f"{about.tested} {tested_rows(about)}"
    line = accuracy(model, about.errors, about.within, tested, about.left_out)
    return f"{about.sensor}: {line}" if about.sensor else line


def tested_rows(about: About) -> str:
    """Return what a model was tested on when it was made."""
    if about.source == "simulation":
        return "fresh exact samples"
    return "rows held out in blocks of the log"


def error_table(model: calib.Model, errors: Errors, title: str) -> TextTable:
    """Return all errors, a line for each readout, direction and quantity."""
    from calib.model.about import STATISTICS, error_statistics

    rows = []
    for readout in READOUTS:
        if readout not in errors:
            continue
        alone = {readout: errors[readout]}
        for direction, name, unit, sizes in error_statistics(
            model.about, alone
        ):
            values = map(number, sizes[readout].values())
            rows.append([readout, direction, name, unit, *values])
    header = ["readout", "direction", "error of", "unit", *STATISTICS]
    return TextTable(header, rows, title, left=4, foot=_TERMS)


def findings_of_body(model: calib.Model) -> list[str]:
    """Return in one line what differs from the drawing, or what was found without one."""
    from calib.use.geometry_fit import body_with_zeros

    about = model.about
    if about.source != "log":
        return []
    body = body_with_zeros(model)
    if body is None:
        return ["found: no kinematic body under the maps"]
    nothing = "an arm of these joints, without a drawing to compare it with"
    untold = ["`expected_error`", "origin moved"]  # calib info tells of both
    if about.urdf:
        nothing = "nothing that differs from the drawing by more than these rows can show"
        untold = untold[:1]
    lines = [
        printable(" ".join(line.split()))
        for line in body.describe(about.lower, about.upper)
        if not any(words in line for words in untold)
    ]
    more = len(lines) - _MOST
    if more > 0:
        lines[_MOST:] = [f"{more} more in calib info"]
    return [f"found: {'; '.join(lines) or nothing}"]


def bound_warnings(about: About) -> list[str]:
    """Say in one line that the rows that a model was tested on contradict its own bound."""
    if about.bound_holds:
        return []
    rows = "fresh samples" if about.source == "simulation" else "rows held out"
    answered = about.within.get("answered", 1.0)
    if answered < 0.5:
        return [
            f"TOO COARSE TO ANSWER: at {100 * (1 - answered):.0f} % of {rows} the model may be off "
            "by more than 10 % of the reach"
        ]
    return [
        f"THE BOUND DOES NOT HOLD: the model's own 95 % bound covers "
        f"{100 * about.within['covered']:.0f} % of {rows}: do not rely on it"
    ]


def code_of(warnings: list[str]) -> int:
    """Return the exit code of a command that shows figures of a model, and warns of them."""
    return NO if warnings else 0


def advice(
    model: calib.Model, errors: Errors, warnings: Sequence[str]
) -> list[str]:
    """Say in one line what limits the accuracy, and the one thing that would help most.

    Nothing limits a model that does not hold: its `warnings` say what to do.
    """
    return [] if warnings else [_limit(model, errors)]


def _limit(model: calib.Model, errors: Errors) -> str:
    about = model.about
    unit = about.unit
    mean = _mean_distance(errors)
    simulated = about.source == "simulation"
    if model.body is None:
        more = "more samples (-n)" if simulated else "more rows"
        return f"limited by maps that stand alone; {more} and a larger --size help most"
    if simulated:
        if mean < _EXACT * float((model.sensory.scale.span**2).sum() ** 0.5):
            return "limited by rounding alone: the model holds all that was simulated"
        return "limited by the simulated noise and changes; more samples (-n) help most"
    import numpy as np

    rng = np.random.default_rng(0)
    q = rng.uniform(about.lower, about.upper, (_POINTS, len(about.lower)))
    limits = np.nan_to_num(model.expected_error(q), nan=np.inf)
    # a quantile between two infinite values is one of them
    shares = (0.1, 0.5, 0.9)
    low, middle, high = np.quantile(limits, shares, method="lower").tolist()
    if not high <= _UNEVEN * low:
        return (
            "limited by few rows in parts of the range; calib plan MODEL lists where more rows "
            "help most"
        )
    of_model = float(np.nanmedian(model.model_error(q)))
    if of_model < _NOISY * middle:
        return (
            f"limited by noise of the readings: the model itself is within "
            f"{with_unit(of_model, unit)}; rows at rest help most"
        )
    return (
        f"limited by {with_unit(mean, unit)} that the model does not explain, noise of the "
        "readings or more; poses that are measured twice tell which, rows at rest help most"
    )
