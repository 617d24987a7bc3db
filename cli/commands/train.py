"""The command `calib train`: learn a model from simulated babbling or from a measured log."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from calib.common.wording import for_people
from calib.model.facts import size_in_words

from ..options import takes
from ..output import Notes, progress_bar, show, show_json, tell
from ..photo import photo_of_log, with_photo
from ..samples import (
    Babbling,
    Logged,
    Selection,
    Training,
    babbled_samples,
    check_sources,
    measured_samples,
)
from ..summary import compact_table, summary
from ..usage import BadOption, argument, check_file, flag, option

if TYPE_CHECKING:
    from calib import Model, Samples


@takes(
    robot=argument(
        "ROBOT", "A URDF file, or a bundled robot (calib robots). Not needed with --data."
    ),
    output=option(
        "--output -o MODEL", "The model's file (default ROBOT.calib, without ROBOT LOG.calib)."
    ),
    force=flag("--force", "Replace a model of another robot or log by that name."),
    lens=option(
        "--lens lens.json",
        "The calibrated lens of a camera that sees an arm in space (default: fitted).",
    ),
    no_rows=flag("--no-rows", "Keep no rows of the log in the model (default up to 5000)."),
)
def train(
    *,
    robot: str | None = None,
    data: str | None = None,
    output: str | None = None,
    force: bool = False,
    selection: Selection,
    training: Training,
    babbling: Babbling,
    seed: int = 0,
    logged: Logged,
    lens: str | None = None,
    no_rows: bool = False,
    photo: str | None = None,
    no_photo: bool = False,
    as_json: bool = False,
) -> None:
    """Learn a model from simulated babbling or from a measured log."""
    import calib

    of_logs = {**vars(logged), "lens": lens, "photo": photo}
    check_sources([robot] if robot else [], data is not None, vars(babbling), of_logs)
    if photo is not None and no_photo:
        raise BadOption("--photo and --no-photo are given: expected one of them")
    if output is not None:
        check_file(output)
    notes = Notes()
    if data is None:
        log = babbled_samples(robot, selection, babbling, seed, notes)
    else:
        log = measured_samples(robot, selection, data, logged, seed, notes, lens)
    path = output or _file_name(str(robot or data))
    check_file(path)
    if output is None and not force:
        _check_same_origin(path, log)
    with progress_bar(log.unit) as progress:
        model = calib.train(log, **vars(training), seed=seed, progress=progress)
    notes.say([*model.about.notes, *_unexplained(model, log)])
    if no_rows:
        model = replace(model, rows=None)
    if photo is not None:
        model = with_photo(model, photo, log)
    elif data is not None and not no_photo:
        model = photo_of_log(model, log, data, notes)
    model.save(path)
    about = model.about
    if as_json:
        show_json(summary(model, path, about.errors, model.seconds))
        return
    what = "fresh exact samples" if about.source == "simulation" else "held out blocks of the log"
    show(compact_table(model, about.errors, f"errors on {what}"))
    tell(
        f"{path}: {about.options['map']}, {size_in_words(model)}, {about.samples} samples, "
        f"{model.seconds['total']:.2f} s, {Path(path).stat().st_size / 1e6:.2f} MB"
    )


def _unexplained(model: Model, log: Samples) -> list[str]:
    """Tell of rows that are predicted far worse than their log says that they were measured."""
    # only a log of pictures states how well its rows were measured
    stated, unit = log.source.get("noise"), model.about.unit
    left = next(iter(model.about.errors.values()))["forward"]["distance"]["mean"]
    if not isinstance(stated, float) or log.source.get("unit") != unit or left < 10.0 * stated:
        return []
    factor, name = for_people(unit)
    return [
        f"rows are predicted to {factor * left:.2g} {name} and were measured to "
        f"{factor * stated:.2g} {name}: too few rows, or something moved that no joint tells, such "
        "as a camera that refocuses, a loose tag or play"
    ]


def _check_same_origin(path: str, log: Samples) -> None:
    """Refuse a default name that is taken by a model of another robot or log."""
    import numpy as np

    import calib

    if not Path(path).exists():
        return
    try:
        old = calib.load(path)
    except calib.CalibError:
        what = "a file that is no model which this program reads"
    else:
        urdf = log.arm.urdf if log.arm else ""
        simulated = log.simulation is not None
        # the URDF's text and the joints tell robots apart, the first kept row tells logs apart
        same = (old.about.urdf, old.about.joint_names) == (urdf, log.joint_names)
        if not simulated and old.rows is not None and len(old.rows):
            pairs = ((old.rows.q, log.q), (old.rows.x, log.x))
            same &= all(bool(np.array_equal(a[0], b[0])) for a, b in pairs)
        if same and simulated == (old.about.source == "simulation"):
            return
        what = "a model of another robot or log"
    raise calib.OptionError(
        f"{path} is {what}",
        hint="name another file with -o, or replace it with `force=True`",
        parameter="force",
    )


def _file_name(source: str) -> str:
    """Return the default name of a model, without what would lead elsewhere or hide the file."""
    stem = "log" if source == "-" else Path(source).stem
    safe = re.sub(r"[^\w.+-]+", "_", stem).lstrip(".")
    return f"{safe or 'robot'}.calib"
