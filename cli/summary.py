"""Summary: what a model is, how well it does, as JSON and a table."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import calib
from calib.common.choices import READOUTS
from calib.common.wording import error_size

from .output import TextTable
from .units import units_of

if TYPE_CHECKING:
    from calib.model.about import Errors

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
        # the arm's own parameters are in `calib info`; here only what the sensor is
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
            values = map(error_size, sizes[readout].values())
            rows.append([readout, direction, name, unit, *values])
    header = ["readout", "direction", "error of", "unit", *STATISTICS]
    return TextTable(header, rows, title, left=4, foot=_TERMS)
