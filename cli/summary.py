"""Summary: what a model is and how well it does, as JSON and as tables."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from calib.common.choices import READOUTS

from .output import Table, number
from .units import for_people, units_of

if TYPE_CHECKING:
    from calib import Model

Errors = Mapping[str, Mapping[str, Mapping[str, Mapping[str, float]]]]

STATISTICS = ("mean", "p99", "max")
_NONE = dict.fromkeys(STATISTICS)  # of what a readout does not answer


def summary(
    model: Model, path: str, errors: Errors, seconds: Mapping[str, float]
) -> dict[str, Any]:
    """Return what `train`, `evaluate` and `info` print as JSON.

    Parameters
    ----------
    model : Model
        The model.
    path : str
        Its file, as typed.
    errors : mapping
        Errors per readout.
    seconds : mapping of str to float
        How long it took, "total" among them.
    """
    about = model.about
    return {
        "model": path,
        "robot": about.robot or None,
        "joints": list(about.joint_names),
        "tip": about.tip or None,
        **({"plane": about.plane} if len(model.axes) == 2 else {}),
        "view": view_of(model),
        "map": about.options["map"],
        "rule": about.options["rule"],
        "size": {
            "motor": list(model.motor.lattice.shape),
            "sensory": list(model.sensory.lattice.shape),
        },
        "samples": about.samples,
        "seed": about.seed,
        "seconds": dict(seconds),
        "unit": about.unit,
        "units": units_of(about),
        "bound_of": about.bound_of,
        "errors": errors,
    }


def view_of(model: Model) -> dict[str, Any]:
    """Return what the sensor measures as JSON: the kind of view and its fitted parameters.

    The kind is null where no body stands under the maps.
    """
    body = model.body
    if body is None:
        return {"kind": None}
    from calib.body.poses import knows_orientation
    from calib.body.sensor import SensorPose
    from calib.body.views import is_camera

    kind = "pose" if knows_orientation(body) else body.structure.view
    view: dict[str, Any] = {"kind": kind}
    if (mirror := body.structure.header().get("mirror")) is not None:
        view["mirror"] = mirror < 0
    for parameter in body.parameters():
        if parameter.group.startswith(("view.", "lens")):
            view[parameter.name.partition(".")[2].replace(" ", "_")] = {
                "value": parameter.value,
                "interval": [parameter.low, parameter.high],
                "unit": parameter.unit,
            }
    if (sensor := SensorPose.of(body)) is not None:
        view["camera" if is_camera(view["kind"]) else "sensor"] = sensor.to_json()
    if is_camera(view["kind"]):
        f, u, v, k1 = body.beta[body.structure.groups["lens"]].tolist()
        view["lens"] = {"focal": f, "centre": [u, v], "k1": k1, "size": model.about.picture}
    return view


def error_table(model: Model, errors: Errors, title: str) -> Table:
    """Return all errors, a line for each readout, direction and quantity."""
    about = model.about
    units = dict(zip(about.joint_names, about.units_of_joints, strict=True))
    quantities = {"forward": list(model.axes), "inverse": list(about.joint_names)}
    rows = []
    for readout in _ordered(errors):
        label = readout
        for direction, names in quantities.items():
            heading = direction
            turned = ["orientation"] if "orientation" in errors[readout][direction] else []
            for name in [*names, "distance", *turned]:
                is_joint = direction == "inverse" and name != "distance"
                si = units[name] if is_joint else "rad" if name in turned else about.unit
                factor, unit = for_people(si)
                error = errors[readout][direction][name]
                values = [_scaled(error, key, factor) for key in STATISTICS]
                rows.append([label, heading, name, unit, *values])
                label = heading = ""
    return Table(["readout", "direction", "error of", "unit", *STATISTICS], rows, title, left=4)


def compact_table(model: Model, errors: Errors, title: str) -> Table:
    """Return mean errors, a line for each quantity; of the best readout the greatest too."""
    about = model.about
    units = dict(zip(about.joint_names, about.units_of_joints, strict=True))
    quantities = [("forward", "distance", about.unit)]
    quantities += [("inverse", name, unit) for name, unit in units.items()]
    quantities += [("inverse", "distance", about.unit)]
    readouts = _ordered(errors)
    if "orientation" in errors[readouts[0]]["forward"]:
        quantities.insert(1, ("forward", "orientation", "rad"))
    rows = []
    for direction, name, si in quantities:
        factor, unit = for_people(si)
        row = [f"{direction} {name} [{unit}]"]
        found = [errors[readout][direction].get(name, _NONE) for readout in readouts]
        row += [_scaled(each, "mean", factor) for each in found]
        row.insert(2, _scaled(errors[readouts[0]][direction][name], "max", factor))
        rows.append(row)
    return Table(["mean, and max", readouts[0], "max", *readouts[1:]], rows, title)


def size_in_words(model: Model) -> str:
    """Return the lattices as `motor 70x70, sensory 70x70`."""
    motor, sensory = (
        "x".join(map(str, part.lattice.shape)) for part in (model.motor, model.sensory)
    )
    return f"motor {motor}, sensory {sensory}"


def _ordered(errors: Errors) -> list[str]:
    """Return the readouts that there are, the best one first."""
    return [readout for readout in READOUTS if readout in errors]


def _scaled(error: Mapping[str, float | None], key: str, factor: float) -> str:
    value = error[key]
    return number(None if value is None else value * factor)
