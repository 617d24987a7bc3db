"""Compare a model with new samples: is it still calibrated? Exit code 3 if not.

A log with a column `episode` is judged series by series, too. The data of a model of pictures
may be pictures or a LeRobotDataset.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Annotated

from calib.common.wording import for_people

from .. import options as opt
from .. import parsing
from ..logs import Reading, log_for
from ..output import NO, Outcome, TextTable, number, say, sized
from ..pictures import log_of_pictures
from ..units import units_of

if TYPE_CHECKING:
    from calib import Model, Samples, Verdict

SIGNALS = {
    "motor": "motor map, zeta",
    "sensory": "sensory map, zeta",
    "reverse": "reverse distortion",
    "links": "distance to the prediction",
}
_MOST = 8  # tests that are printed


def check(
    model: opt.ModelFile,
    data: opt.NewLog,
    cause: opt.WhatChanged = None,
    tolerance: Annotated[
        float | None,
        opt.value("--tolerance", "S", "Exit 3 if unseen [m].", parsing.number),
    ] = None,
    columns: opt.Columns = None,
    unit: opt.Unit = None,
    time_offset: opt.TimeOffset = None,
    degrees: opt.LogDegrees = None,
    joints_file: opt.JointsFile = None,
    camera: opt.DatasetCamera = None,
) -> Outcome:
    import calib

    loaded = calib.load(model)
    reading = Reading(columns, unit, time_offset, degrees)
    with log_of_pictures(loaded, data, joints_file, camera, degrees) as path:
        log = log_for(loaded, path, reading)
    episodes = _episodes(loaded, log, cause)
    drift = calib.check(loaded, log, cause=cause, tolerance=tolerance)
    say(drift.notes)
    bumped = [episode for episode in episodes if episode.drifted]
    document = {
        "model": model,
        **drift.to_json(),
        "drifted": True if bumped else drift.drifted,
        "episodes": [asdict(episode) for episode in episodes],
        "unit": drift.unit,
        "units": units_of(loaded.about, drift.unit),
    }
    lines = _verdict(drift, f"calib adapt {model} --data {data}")
    if bumped and not drift.drifted:
        lines = [
            f"DRIFTED in {len(bumped)} of {len(episodes)} episodes",
            lines[-1],
        ]
    for episode in bumped:
        first = [*episode.explanations, "its cause is unknown"][0]
        lines.append(f"episode {episode.episode}: DRIFTED: {first}")
    code = NO if bumped or _needs_action(drift) else 0
    return Outcome(document, lines, _details(drift), code=code)


def _needs_action(drift: Verdict) -> bool:
    """Return whether a script should stop: a change, no answer, or a bound that fails.

    A bound that noisier readings alone exceed is said, and is no change of the arm.
    """
    if drift.drifted is not False:
        return True
    noisier = any(cause.group == "noise" for cause in drift.causes)
    return not drift.bound_holds and not noisier


def _verdict(drift: Verdict, adapt: str) -> list[str]:
    """Say what the rows tell, what to do, and what limits the answer."""
    smallest = sized(drift.smallest, drift.unit)
    limit = (
        f"limited by noise: these {drift.samples} rows show changes from {smallest} on; "
        "more rows show smaller ones"
    )
    if drift.drifted:
        first, *others = drift.explanations or ("its cause is unknown",)
        return [
            f"DRIFTED: {first}",
            *others,
            f"what to do: {_remedy(drift, adapt)}",
            limit,
        ]
    if drift.changed is None:
        return [
            "TOO FEW ROWS TO SAY: they could not show a change of ten times the noise",
            "what to do: measure more poses, spread over the joints' ranges",
        ]
    if drift.drifted is None:
        return [
            "TOO COARSE: these rows could not have shown a change of the tolerated size",
            "what to do: give more rows, or rows of less noise",
            limit,
        ]
    verdict = "still calibrated"
    if not drift.bound_holds:
        share = f"{100 * drift.covered:.0f} %"
        verdict = f"THE BOUND DOES NOT HOLD: {share} of the rows are within it, 95 % should be"
    return [verdict, *drift.explanations, limit]


def _remedy(drift: Verdict, adapt: str) -> str:
    if not drift.adapts:
        return (
            "calib adapt finds nothing that mends it: check the log and the arm"
        )
    if any(
        cause.cause == "scale" and cause.interval is None
        for cause in drift.causes
    ):
        return "check the log's unit before calib adapt, which learns the new scale"
    return f"{adapt} re-calibrates it"


@dataclass(frozen=True)
class Episode:
    """The verdict on one series of a log; `--json` prints these fields."""

    episode: int
    samples: int
    drifted: bool | None = None  # None where it has too few rows
    score: float | None = None
    explanations: tuple[str, ...] = ()


def _episodes(model: Model, log: Samples, cause: str | None) -> list[Episode]:
    """Return the verdict on each series of a log."""
    import calib
    from calib.errors import LogError

    if log.episode is None:
        return []
    series = log.episode.astype(int)
    episodes = []
    for number_ in sorted(set(series.tolist())):
        rows = (series == number_).nonzero()[0]
        episode = Episode(number_, len(rows))
        try:
            drift = calib.check(model, log.take(rows), cause=cause)
        except LogError as error:
            episodes.append(replace(episode, explanations=(str(error),)))
            continue
        episode = replace(episode, drifted=drift.drifted, score=drift.score)
        episodes.append(replace(episode, explanations=drift.explanations))
    return episodes


def _details(drift: Verdict) -> list[TextTable]:
    factor, unit = for_people(drift.unit)
    tests = []
    for group in sorted(drift.groups, key=lambda group: -group.score)[:_MOST]:
        sizes = number(group.p_value), number(factor * group.smallest)
        tests.append([group.name, *sizes, "fired" if group.score > 1.0 else ""])
    signals = []
    for key, signal in drift.distortion.items():
        # zeta is a squared share of the unit box: millionths are readable
        size, shown = (factor, unit) if key == "links" else (1e6, "1e-6")
        values = number(size * signal.value), number(size * signal.threshold)
        signals.append([SIGNALS[key], shown, *values])
    chance = (
        "chance: of such rows where nothing changed; below 0.001 the test fired; "
        "smallest: the smallest change that these rows could have shown"
    )
    zeta = "zeta: mean squared distance of rows to winning nodes, in the unit box (eq. 9)"
    header = ["what may have changed", "chance", f"smallest [{unit}]", ""]
    signal_header = ["on the maps", "unit", "found", "usual"]
    return [
        TextTable(header, tests, foot=chance),
        TextTable(signal_header, signals, left=2, foot=zeta),
    ]
