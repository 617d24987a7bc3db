"""Show what a model is and how it was made; exit code 3 if its own rows contradict its bound."""

from pathlib import Path

import calib
from calib.common.wording import by_name, printable, with_unit
from calib.use import assessment

from .. import options as opt
from ..output import Outcome, as_typed
from ..summary import error_table, summary


def info(model: opt.ModelFile, degrees: opt.Degrees = False) -> Outcome:
    from calib.model.about import facts
    from calib.use.geometry_fit import body_with_zeros

    loaded = calib.load(model)
    about = loaded.about
    body = body_with_zeros(loaded)
    names = about.joint_names
    units = about.units_of_joints
    # play is stored as the distance from the middle
    play = None
    if loaded.approach is not None:
        play = (2.0 * loaded.approach.play).tolist()
    limits = zip(about.lower, about.upper, strict=True)
    # a model knows no seconds: its bytes must not depend on the machine's pace
    document = summary(loaded, model, about.errors, {}) | {
        "ranges": by_name(names, limits),
        "joint_units": by_name(names, units),
        "locked": about.locked,
        "source": about.source,
        "simulation": about.simulation,
        "options": about.options,
        "history": loaded.history,
        "body": None if body is None else body.to_json(),
        "rows": 0 if loaded.rows is None else len(loaded.rows),
        "notes": [as_typed(text) for text in loaded.notes],
        "backlash": play,
    }
    others = [model_of_sensor.about for model_of_sensor in loaded.others]
    words = {
        "model": f"{model} ({Path(model).stat().st_size / 1e6:.2f} MB)",
        **facts(about, loaded.size_in_words, others, degrees=degrees),
        **{f"note {k}": text for k, text in enumerate(loaded.notes, start=1)},
    }
    sensors = [loaded.by(name) for name in loaded.sensors]
    if len(sensors) > 1:
        rows = [
            f"{by.about.sensor} ({by.about.samples} rows)" for by in sensors
        ]
        words["sensors"] = ", ".join(rows)
    if play is not None:
        sizes = map(with_unit, play, units)
        words["backlash"] = ", ".join(map("{} {}".format, names, sizes))
    if loaded.history:
        words["earlier states"] = str(len(loaded.history))
    width = max(map(len, words))
    warnings = assessment.bound_warnings(about)
    lines = [
        f"{name:<{width}}  {as_typed(text)}" for name, text in words.items()
    ]
    if body is not None:
        body_lines = body.describe(about.lower, about.upper)
        lines += ["", "body", *(f"  {printable(line)}" for line in body_lines)]
    if not about.errors:
        return Outcome(document, lines, warnings=warnings)
    lines += ["", "accuracy"]
    lines += map(assessment.accuracy_as_made, sensors)
    if not warnings:
        lines.append(assessment.limiting_factor(loaded, about.errors))
    table = error_table(loaded, about.errors, "errors when it was made")
    return Outcome(document, lines, [table], warnings=warnings)
