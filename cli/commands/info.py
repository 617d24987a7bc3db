"""The command `calib info`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from calib.common.wording import printable
from calib.model.facts import facts

from .. import options as opt
from ..output import Outcome, as_typed, fields, sized
from ..summary import accuracy, advice, error_table, summary

if TYPE_CHECKING:
    pass


def info(
    model: opt.ModelFile,
    *,
    degrees: opt.Degrees = False,
    as_json: opt.Json = False,
    verbose: opt.Verbose = False,
    quiet: opt.Quiet = False,
) -> Outcome:
    """Show what a model is and how it was made."""
    import calib

    loaded = calib.load(model)
    about = loaded.about
    # a model knows no seconds: its bytes must not depend on the machine's pace
    limits = zip(about.lower.tolist(), about.upper.tolist(), strict=True)
    document = summary(loaded, model, about.errors, {}) | {
        "ranges": dict(zip(about.joint_names, limits, strict=True)),
        "joint_units": dict(zip(about.joint_names, about.units_of_joints, strict=True)),
        **fields(about, "locked source simulation options"),
        "history": loaded.history,
        "body": None if loaded.body is None else loaded.body.to_json(),
        "rows": 0 if loaded.rows is None else len(loaded.rows),
        "notes": [as_typed(text) for text in about.notes],
        "backlash": None
        if loaded.approach is None
        else (2.0 * loaded.approach.play).tolist(),
    }
    about_it = {
        "model": f"{model} ({Path(model).stat().st_size / 1e6:.2f} MB)",
        **facts(loaded, degrees=degrees),
        **{f"note {k}": text for k, text in enumerate(about.notes, start=1)},
    }
    if loaded.approach is not None:  # play is stored as the distance from the middle
        parts = zip(
            about.joint_names,
            2.0 * loaded.approach.play,
            about.units_of_joints,
            strict=True,
        )
        about_it["backlash"] = ", ".join(
            f"{n} {sized(play, unit)}" for n, play, unit in parts
        )
    if loaded.history:
        about_it["earlier states"] = str(len(loaded.history))
    width = max(map(len, about_it))
    lines = [f"{name:<{width}}  {as_typed(text)}" for name, text in about_it.items()]
    if loaded.body is not None:
        body_lines = loaded.body.describe(about.lower, about.upper)
        lines += ["", "body", *(f"  {printable(line)}" for line in body_lines)]
    if not about.errors:
        return Outcome(document, lines)
    accuracy_line = accuracy(
        loaded, about.errors, about.within, f"{about.tested} rows", about.left_out
    )
    lines += ["", f"accuracy: {accuracy_line}", *advice(loaded, about.errors)]
    table = error_table(loaded, about.errors, "errors when it was made")
    return Outcome(document, lines, [table])
