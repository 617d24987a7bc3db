"""The commands that tell: `calib robots`, `calib info` and `calib evaluate`."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from calib.common.wording import printable
from calib.model.facts import facts

from .. import options as opt
from ..output import Outcome, TextTable, as_typed, fields, say, sized
from ..samples import Compared, Sockets, log_of
from ..summary import accuracy, advice, answers_back, does_not_hold, error_table, summary

if TYPE_CHECKING:
    from calib import Evaluation


Kept = Literal["kept", "free"]


def robots() -> Outcome:
    """List the bundled robots."""
    import calib

    entries = calib.list_robots()
    rows = [[entry.name, str(entry.dof), entry.description] for entry in entries]
    table = TextTable(["robot", "joints", "description"], rows, left=3)
    document = [fields(entry, "name joints dof description") for entry in entries]
    return Outcome(document, [table])


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
        **fields(about, "locked source simulation options"),
        "history": loaded.history,
        "body": None if loaded.body is None else loaded.body.to_json(),
        "rows": 0 if loaded.rows is None else len(loaded.rows),
        "notes": [as_typed(text) for text in about.notes],
        "backlash": None if loaded.approach is None else (2.0 * loaded.approach.play).tolist(),
    }
    about_it = {
        "model": f"{model} ({Path(model).stat().st_size / 1e6:.2f} MB)",
        **facts(loaded, degrees=degrees),
        **{f"note {k}": text for k, text in enumerate(about.notes, start=1)},
    }
    if loaded.approach is not None:  # play is stored as the distance from the middle
        parts = zip(
            about.joint_names, 2.0 * loaded.approach.play, about.units_of_joints, strict=True
        )
        about_it["backlash"] = ", ".join(f"{n} {sized(play, unit)}" for n, play, unit in parts)
    if loaded.history:
        about_it["earlier states"] = str(len(loaded.history))
    width = max(map(len, about_it))
    lines = [f"{name:<{width}}  {as_typed(text)}" for name, text in about_it.items()]
    told = [] if loaded.body is None else loaded.body.describe()
    lines += ["", "body", *(f"  {printable(line)}" for line in told)] if told else []
    if not about.errors:
        return Outcome(document, lines)
    held = accuracy(loaded, about.errors, about.within, f"{about.tested} rows", about.left_out)
    lines += ["", f"accuracy: {held}", *advice(loaded, about.errors)]
    table = error_table(loaded, about.errors, "errors when it was made")
    return Outcome(document, lines, [table])


def evaluate(
    model: opt.ModelFile,
    *,
    data: opt.Data = None,
    reading: Compared,
    sockets: Sockets,
    frame: Annotated[Kept, opt.flag("--frame", "free: the sensor's frame is found anew.")] = "kept",
) -> Outcome:
    """Print the errors of a model, on fresh samples or on a log."""
    import calib

    loaded = calib.load(model)
    log = log_of(loaded, data, reading)
    log = None if log is None else sockets.of(log)
    started = time.perf_counter()
    result = calib.evaluate(loaded, log, frame=frame)
    say(result.notes)
    seconds = {"total": time.perf_counter() - started}
    document = summary(loaded, model, result.errors, seconds)
    document["evaluated"] = fields(result, "source rows left_out")
    document["left_out"] = result.left_out
    missed = [] if log is None else does_not_hold(result.within, result.rows)
    limit = missed or advice(loaded, result.errors)
    if result.touch:
        document["touch"] = result.touch
        return Outcome(document, [f"{model}: {_scatter(result)}", *limit])
    tested = f"{result.rows} {result.source}"
    lines = [
        f"{model}: {accuracy(loaded, result.errors, result.within, tested, result.left_out)}",
        answers_back(loaded, result.errors),
        *limit,
    ]
    return Outcome(document, lines, [error_table(loaded, result.errors, f"errors on {tested}")])


def _scatter(result: Evaluation) -> str:
    size = {name: sized(value, "m") for name, value in result.touch["scatter"].items()}
    line = f"tips scatter about their sockets by {size['mean']}, 95 % within {size['p95']}"
    line += f", in {result.rows} touches, {result.left_out} left out"
    off = [abs(each["predicted"] - each["stated"]) for each in result.touch["distances"]]
    return line + (f"; distances are off by {sized(sum(off) / len(off), 'm')}" if off else "")
