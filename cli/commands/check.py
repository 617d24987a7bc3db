"""The command `calib check`: compare a model with new samples, and say whether it drifted."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

from calib.common.wording import for_people

from ..measurements import Reading, log_for
from ..options import NEW_LOG, takes
from ..output import NO, Notes, TextTable, explained, number, show, show_json, tell
from ..parsing import number_where
from ..translation import as_typed
from ..units import units_of
from ..usage import option

if TYPE_CHECKING:
    from calib import Drift

_MOST = 8
"""Groups that are printed."""

SIGNALS = {
    "motor": "motor map, zeta",
    "sensory": "sensory map, zeta",
    "reverse": "reverse distortion",
    "links": "distance to the prediction",
}


@takes(
    tolerance=option(
        "--tolerance S",
        "Also exit 3 if the rows could not have shown a change of this size [m].",
        number_where("a number [m]"),
    ),
    **NEW_LOG,
)
def check(
    *,
    model: str,
    data: str,
    cause: str | None = None,
    tolerance: float | None = None,
    reading: Reading,
    as_json: bool = False,
) -> None:
    """Compare a model with new samples: is it still calibrated? Exit code 3 if not."""
    import calib

    loaded = calib.load(model)
    notes = Notes()
    log = log_for(loaded, data, reading, notes)
    drift = calib.check(loaded, log, cause=cause, tolerance=tolerance)
    notes.say(drift.notes)
    rescaled = any(cause.cause == "scale" and cause.interval is None for cause in drift.causes)
    unit_seen = "sensor" if rescaled else loaded.about.unit
    if as_json:
        show_json(
            {
                "model": model,
                **drift.to_json(),
                "unit": unit_seen,
                "units": {**units_of(loaded.about), "positions": unit_seen},
            }
        )
    else:
        factor, name = for_people(unit_seen)
        remedy = "calib adapt re-calibrates it"
        if rescaled:
            remedy = "check the log's unit before calib adapt, which learns the new scale"
        if any(cause.cause == "unknown" and not cause.group for cause in drift.causes[:1]):
            remedy = "check the log and the arm before calib adapt"
        title = f"{model}: {drift.samples} samples of {data}"
        _show(drift, title, factor, name, remedy)
    if drift.drifted is not False:
        raise typer.Exit(NO)


def _show(drift: Drift, title: str, factor: float, name: str, remedy: str) -> None:
    """Print the most telling groups, how the rows lie on the maps, and the verdict."""
    groups = sorted(drift.groups, key=lambda g: -g.score)[:_MOST]
    rows = [
        [
            group.name,
            number(group.statistic),
            number(group.threshold),
            number(factor * group.smallest),
            "fired" if group.score > 1.0 else "",
        ]
        for group in groups
    ]
    header = ["what may have changed", "found", "threshold", f"smallest [{name}]", ""]
    show(explained(TextTable(header, rows, title)))
    rows = [
        [SIGNALS[key], factor_unit, number(size * found.value), number(size * found.threshold)]
        for key, found in drift.distortion.items()
        # zeta is a squared share of the unit box: millionths are readable
        for size, factor_unit in [(factor, name) if key == "links" else (1e6, "1e-6")]
    ]
    show(explained(TextTable(["on the maps", "unit", "found", "usual"], rows, left=2)))
    for text in drift.explanations:
        tell(as_typed(text))
    verdict = "still calibrated"
    if drift.drifted:
        verdict = f"DRIFTED: {remedy}"
    elif drift.drifted is None:
        verdict = "TOO COARSE: these rows could not have shown a change of the tolerated size"
    smallest = f"smallest change they show: {number(factor * drift.smallest)} {name}"
    tell(f"{verdict} (score {number(drift.score)}, threshold 1; {smallest})")
