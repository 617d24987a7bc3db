"""The commands that tell: `calib robots`, `calib info` and `calib evaluate`."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from calib.common.wording import printable, unit_of_joint
from calib.model.facts import facts

from .. import options as opt
from ..measurements import Reading, log_of
from ..output import Outcome, TextTable, as_typed, fact_lines, fields, say
from ..samples import Sockets
from ..summary import accuracy, advice, answers_back, does_not_hold, error_table, summary

if TYPE_CHECKING:
    from calib import Evaluation, Model


def robots() -> Outcome:
    """List the bundled robots."""
    import calib

    entries = calib.list_robots()
    rows = [[entry.name, str(entry.dof), entry.description] for entry in entries]
    table = TextTable(["robot", "joints", "description"], rows, left=3)
    names = fact_lines({entry.name: ", ".join(entry.joints) for entry in entries})
    document = [fields(entry, "name joints dof description") for entry in entries]
    return Outcome(document, [table], ["", "joints, base to tip", *names], result=[table])


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


def evaluate(
    model: opt.ModelFile,
    *,
    data: opt.Data = None,
    reading: Reading,
    sockets: Sockets,
    frame: Annotated[
        Literal["kept", "free"],
        opt.flag("--frame", "free: of the log, the sensor's frame is found anew."),
    ] = "kept",
) -> Outcome:
    """Print the errors of a model, on fresh samples or on a log."""
    import calib

    loaded = calib.load(model)
    log = log_of(loaded, data, reading)
    if log is not None:
        log = sockets.of(log)
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
        rows = [
            [each["setup"], each["point"], str(each["rows"]), f"{1e3 * each['scatter']:.3f}"]
            for each in result.touch["points"]
        ]
        table = TextTable(["setup", "point", "rows", "scatter [mm]"], rows, "by socket", 2)
        return Outcome(document, [_scatter(model, result), *limit], [table])
    tested = f"{result.rows} {result.source}"
    lines = [
        f"{model}: {accuracy(loaded, result.errors, result.within, tested, result.left_out)}",
        answers_back(loaded, result.errors),
        *limit,
    ]
    title = f"errors on {tested}"
    return Outcome(document, lines, [error_table(loaded, result.errors, title)])


def _scatter(model: str, result: Evaluation) -> str:
    size = {name: 1e3 * value for name, value in result.touch["scatter"].items()}
    line = (
        f"{model}: tips scatter about their sockets by {size['mean']:.3g} mm (95 % within "
        f"{size['p95']:.3g}, largest {size['max']:.3g}) in {result.rows} touches"
    )
    if result.left_out:
        line += f", {result.left_out} left out (in no socket of theirs, or out of range)"
    off = [abs(each["predicted"] - each["stated"]) for each in result.touch["distances"]]
    return line + (f"; distances are off by {1e3 * sum(off) / len(off):.2g} mm" if off else "")
