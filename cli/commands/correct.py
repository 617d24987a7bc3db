"""The command `calib correct`: correct joint values so that the real arm goes where they lead."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import typer

from calib.common.wording import for_people

from .. import parsing
from ..options import OF_FRAMES, takes
from ..output import NO, Notes, note, number, tell
from ..units import JointFormat, units_of
from ..usage import option

if TYPE_CHECKING:
    from calib.use.correct import Corrected


@takes(
    input_=option(
        "--input FILE",
        "Joint values that are right for the nominal arm: a CSV file (- standard input).",
    ),
    output=option("--output FILE", "File of the corrected joint values, as CSV."),
    limit=option(
        "--limit L",
        "Largest change of a joint that is accepted [rad or m]; three times what the "
        "model usually corrects if not given.",
        parsing.above_zero("rad or m"),
    ),
    **OF_FRAMES,
)
def correct(
    model: str,
    input_: str,
    output: str | None = None,
    limit: float | None = None,
    view: str = "auto",
    cause: str = "sensor",
    degrees: bool = False,
    as_json: bool = False,
) -> None:
    """Correct joint values so that the real arm reaches where the nominal arm would be.

    Exit code 3 if the real arm cannot reach one of these places, or if a joint would change by
    more than the limit; then nothing is written.
    """
    import numpy as np

    import calib
    from calib.samples.tables import read_batch
    from calib.use.correct import correct as correction

    from ..answers import numbered, say_rows, write_answers

    loaded = calib.load(model)
    joints = JointFormat(loaded.about, degrees)
    batch = read_batch(input_, joints.names)
    n = len(batch.values)
    valid = np.isfinite(batch.values).all(axis=1)
    factors = np.array(joints.typed)
    names = (*joints.names, *loaded.axes, "distance", "expected_error", "reachable")
    columns: dict[str, Any] = {name: np.full(n, np.nan) for name in names}
    columns["reachable"] = np.zeros(n, dtype=np.int64)
    found = None
    notes = Notes()
    if valid.any():
        found = correction(
            loaded,
            batch.values[valid] / factors,
            limit=None if limit is None else limit / factors,
            view=view,
            cause=cause,
        )
        notes.say(found.notes)
        parts = [*(found.q * factors).T, *found.target.T, found.distance, found.expected_error]
        for name, part in zip(names, parts, strict=False):
            columns[name][valid] = part
        columns["reachable"][valid] = found.reachable
        if found.angle is not None:
            columns["angle"] = np.full(n, np.nan)
            columns["angle"][valid] = found.angle
    rows = np.flatnonzero(valid) + 1
    beyond = [] if found is None else rows[found.exceeded].tolist()
    missed = (np.flatnonzero(valid & (columns["reachable"] == 0)) + 1).tolist()
    table = batch.answered(columns)
    changes = None if found is None else _changes(found, joints)
    write_answers(
        None if beyond else table,
        output,
        as_json,
        joints,
        rows=n,
        invalid=batch.invalid,
        out_of_reach=missed,
        beyond_limit=beyond,
        change=changes,
        unit=loaded.about.unit,
        units=units_of(loaded.about),
    )
    notes.say(batch.notes(names))
    say_rows(batch.invalid, n, "not all values are numbers, no answer")
    say_rows(missed, n, "out of reach for the real arm, no answer")
    if found is not None and changes and found.reachable.any():
        parts = []
        for k, (name, change) in enumerate(changes.items()):
            factor, unit = for_people(loaded.about.units_of_joints[k])
            mean, most = (number(factor * change[key]) for key in ("mean", "max"))
            parts.append(f"{name} {mean} (largest {most}) {unit}")
        say = note if as_json or output in (None, "-") else tell
        say(f"mean change: {', '.join(parts)}")
    if beyond and found is not None:
        # the row and the joint whose change is largest, measured by its limit
        share = np.nan_to_num(np.abs(found.change) / found.limit)
        row, worst = map(int, np.unravel_index(int(np.argmax(share)), share.shape))
        note(
            f"{numbered(beyond)} of {n}: a joint would change by more than the limit (row "
            f"{rows[row]}: {joints.change(worst, found.change[row, worst])}, limit "
            f"{joints.change(worst, found.limit[worst])}); "
            "nothing was written; if the change is right, give a larger --limit"
        )
    if batch.invalid and not beyond:
        raise typer.Exit(1)
    if missed or beyond:
        raise typer.Exit(NO)


def _changes(found: Corrected, joints: JointFormat) -> dict[str, Any]:
    """Mean, largest and accepted change of each joint, None where no row was answered."""
    import numpy as np

    size = np.abs(found.change[found.reachable])
    mean, most = (size.mean(axis=0), size.max(axis=0)) if len(size) else (np.nan, np.nan)
    rows = np.stack(np.broadcast_arrays(mean, most, found.limit), axis=-1).tolist()
    keys = ("mean", "max", "limit")
    return {n: dict(zip(keys, row, strict=True)) for n, row in zip(joints.names, rows, strict=True)}
