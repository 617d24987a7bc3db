"""The command `calib info`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from calib.common.wording import printable

from .. import options as o
from ..output import number, show, show_facts, show_json
from ..summary import compact_table, size_in_words, summary
from ..translation import as_typed
from ..units import JointFormat, for_people

if TYPE_CHECKING:
    from calib import Model
    from calib.model.about import About


def info(
    model: o.ModelArgument, degrees: o.DegreesOption = False, as_json: o.JsonOption = False
) -> None:
    """Show what a model is and how it was made."""
    import calib

    loaded = calib.load(model)
    if as_json:
        show_json({**summary(loaded, model, loaded.about.errors, {}), **_provenance(loaded)})
        return
    show_facts(_facts(loaded, model, degrees))
    if loaded.body is not None:
        print("\nbody")
        for line in loaded.body.describe():
            print(f"  {printable(line)}")
    if loaded.about.errors:
        print()
        show(compact_table(loaded, loaded.about.errors, "errors when it was made"))


def _provenance(model: Model) -> dict[str, Any]:
    about = model.about
    return {
        "ranges": {
            name: [low, high]
            for name, low, high in zip(
                about.joint_names, about.lower.tolist(), about.upper.tolist(), strict=True
            )
        },
        "joint_units": dict(zip(about.joint_names, about.units_of_joints, strict=True)),
        "locked": about.locked,
        "source": about.source,
        "simulation": about.simulation,
        "taught": about.taught,
        "body": None if model.body is None else model.body.to_json(),
        "rows": 0 if model.rows is None else len(model.rows),
        "options": about.options,
        "notes": [as_typed(text) for text in about.notes],
        "schema": model.schema,
        "schemas": [s.name for s in model.schemas],
        "backlash": None if model.approach is None else (2.0 * model.approach.play).tolist(),
        "history": model.history,
    }


def _facts(model: Model, path: str, degrees: bool) -> dict[str, str]:
    about = model.about
    joints = JointFormat(about, degrees)
    facts = {
        "model": f"{path} ({Path(path).stat().st_size / 1e6:.2f} MB)",
        "robot": about.robot or "none, learned from a log alone",
    }
    for k, name in enumerate(about.joint_names):
        facts[f"joint {name}"] = joints.learned_range(k)
    if about.tip:
        facts["tip"] = about.tip
    if about.locked:
        facts["locked"] = ", ".join(f"{name}={value:.6g}" for name, value in about.locked.items())
    if about.plane:
        facts["plane"] = ", ".join(
            f"{name} ({', '.join(f'{value + 0.0:.4g}' for value in about.plane[name])})"
            for name in ("origin", "x", "y")
        )
    facts["positions in"] = about.unit
    facts["learned from"] = _source(about)
    facts["maps"] = f"{about.options['map']}, {about.options['rule']} rule, {size_in_words(model)}"
    facts["expected error"] = f"95 % bound on the distance to the {about.bound_of}"
    facts["model error"] = "95 % bound on the distance to the true position in the sensor's frame"
    for k, text in enumerate(about.notes, start=1):
        facts[f"note {k}"] = text
    if model.schemas:
        others = ", ".join(repr(s.name) for s in model.schemas)
        facts["schema"] = f"{model.schema!r}; kept beside it: {others}"
    if model.approach is not None:
        half = zip(about.joint_names, model.approach.play, about.revolute, strict=True)
        facts["backlash"] = ", ".join(
            f"{name} {2 * math.degrees(h):.3g} deg" if turns else f"{name} {2 * h:.3g} m"
            for name, h, turns in half
            if h > 0.0
        )
    if model.history:
        facts["earlier states"] = str(len(model.history))
    return facts


def _source(about: About) -> str:
    rows = f"{about.samples} {'simulated samples' if about.simulation else 'rows of a log'}"
    words = [rows, f"seed {about.seed}"]
    if about.simulation:
        noise = about.simulation["noise"]
        factor, unit = for_people(about.unit)
        words.append(f"noise {number(noise * factor)} {unit}" if noise else "no noise")
        words += [str(change) for change in about.simulation["changes"]]
    return ", ".join(words)
