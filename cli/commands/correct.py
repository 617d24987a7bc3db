"""The command `calib correct`: correct joint values so that the real arm goes where they lead."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import typer

from calib.common.wording import for_people

from .. import parsing
from ..options import OF_FRAMES, takes
from ..output import NO, Notes, fields, note, number, tell
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
    more than the limit; the other rows are written.
    """
    import numpy as np

    import calib
    from calib.samples.tables import read_batch
    from calib.use.correct import correct as correction

    from ..answers import numbered, over_all_rows, say_rows, write_answers

    loaded = calib.load(model)
    joints = JointFormat(loaded.about, degrees)
    batch = read_batch(input_, joints.names)
    n, factors = len(batch.values), np.array(joints.typed)
    valid: Any = np.isfinite(batch.values).all(axis=1)
    rows = np.flatnonzero(valid) + 1
    found = correction(
        loaded,
        batch.values[valid] / factors,
        limit=None if limit is None else limit / factors,
        view=view,
        cause=cause,
    )
    notes = Notes()
    notes.say(found.notes)
    commanded = np.where(found.exceeded[:, None], np.nan, found.q)
    columns = dict(zip(joints.names, (commanded * factors).T, strict=True))
    columns |= dict(zip(loaded.axes, found.target.T, strict=True))
    columns |= fields(found, "distance expected_error reachable")
    columns |= {} if found.angle is None else {"angle": found.angle}
    placed = found.placement_error
    columns |= {} if placed is None else {"placement_error": placed}
    beyond, missed = rows[found.exceeded].tolist(), rows[~found.reachable].tolist()
    answered = bool((found.reachable & ~found.exceeded).any())
    changes = _changes(found, joints)
    write_answers(
        batch.answered(over_all_rows(valid, columns)) if answered or not beyond else None,
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
    notes.say(batch.notes(list(columns)))
    say_rows(batch.invalid, n, "not all values are numbers, no answer")
    say_rows(missed, n, "out of reach for the real arm, no answer")
    if changes is not None:
        parts = []
        for (name, change), kind in zip(changes.items(), loaded.about.units_of_joints, strict=True):
            factor, unit = for_people(kind)
            mean, most = (number(factor * change[key]) for key in ("mean", "max"))
            parts.append(f"{name} {mean} (largest {most}) {unit}")
        say = note if as_json or output in (None, "-") else tell
        say(f"mean change: {', '.join(parts)}")
    if beyond:
        # the row and the joint whose change is largest, measured by its limit
        share = np.nan_to_num(np.abs(found.change) / found.limit)
        row, worst = map(int, np.unravel_index(int(np.argmax(share)), share.shape))
        note(
            f"{numbered(beyond)} of {n}: a joint would change by more than the limit (row "
            f"{rows[row]}: {joints.change(worst, found.change[row, worst])}, limit "
            f"{joints.change(worst, found.limit[worst])}); "
            "no answer; if the change is right, give a larger --limit"
        )
    if batch.invalid and not beyond:
        raise typer.Exit(1)
    if missed or beyond:
        raise typer.Exit(NO)


def _changes(found: Corrected, joints: JointFormat) -> dict[str, Any] | None:
    """Mean, largest and accepted change of each joint, None where no row was answered."""
    import numpy as np

    size = np.abs(found.change[found.reachable])
    if not len(size):
        return None
    told = zip(size.mean(axis=0), size.max(axis=0), found.limit, strict=True)
    return {
        name: dict(zip(("mean", "max", "limit"), row, strict=True))
        for name, row in zip(joints.names, told, strict=True)
    }
