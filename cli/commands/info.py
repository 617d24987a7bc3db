"""The command `calib info`: show what a model is and how it was made."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from calib.common.wording import printable, unit_of_joint
from calib.model.facts import facts

from .. import options as opt
from ..output import Outcome, as_typed, fact_lines, fields
from ..summary import accuracy, advice, error_table, summary

if TYPE_CHECKING:
    from calib import Model


def info(model: opt.ModelFile, *, degrees: opt.Degrees = False) -> Outcome:
    """Show what a model is and how it was made."""
    import calib

    loaded = calib.load(model)
    about = loaded.about
    # a model knows no seconds: its bytes must not depend on the machine's pace
    limits = zip(about.lower.tolist(), about.upper.tolist(), strict=True)
    document = summary(loaded, model, about.errors, {}) | {
        "ranges": dict(zip(about.joint_names, limits, strict=True)),
        "joint_units": dict(zip(about.joint_names, about.units_of_joints, strict=True)),
        **fields(about, "locked source simulation taught options"),
        "history": loaded.history,
        "body": None if loaded.body is None else loaded.body.to_json(),
        "rows": 0 if loaded.rows is None else len(loaded.rows),
        "notes": [as_typed(text) for text in about.notes],
        "backlash": None if loaded.approach is None else (2.0 * loaded.approach.play).tolist(),
    }
    lines = fact_lines(_facts(loaded, model, degrees))
    told = [] if loaded.body is None else loaded.body.describe()
    lines += ["", "body", *(f"  {printable(line)}" for line in told)] if told else []
    if not about.errors:
        return Outcome(document, lines)
    held = accuracy(loaded, about.errors, about.within, f"{about.tested} rows", about.left_out)
    lines += ["", f"accuracy: {held}", *advice(loaded, about.errors)]
    table = error_table(loaded, about.errors, "errors when it was made")
    return Outcome(document, lines, [table])


def _facts(model: Model, path: str, degrees: bool) -> dict[str, str]:
    about = model.about
    found = {
        "model": f"{path} ({Path(path).stat().st_size / 1e6:.2f} MB)",
        **facts(model, degrees=degrees),
        **{f"note {k}": text for k, text in enumerate(about.notes, start=1)},
    }
    if model.approach is not None:
        units = [unit_of_joint(turns, degrees=True) for turns in about.revolute]
        parts = zip(about.joint_names, model.approach.play, units, strict=True)
        # play is stored as the distance from the middle, and told from side to side
        told = (f"{name} {2 * half * by:.3g} {unit}" for name, half, (by, unit) in parts if half)
        found["backlash"] = ", ".join(told)
    if model.history:
        found["earlier states"] = str(len(model.history))
    return found
