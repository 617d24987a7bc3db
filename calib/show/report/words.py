"""Words of a report: how accurate, whether it still holds, what to do next."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...common.wording import clipped, one_line
from ..error_scale import number, rounding, unit_for
from ..settings import SETTINGS
from ..study import Study
from ..workspace import extent


def verdict(studies: Sequence[Study]) -> str:
    """What changed, how accurate the model is for each sensor, and the arm as delivered."""
    sentences = []
    for study in studies:
        sentences += _changes(study)
    sentences = list(
        dict.fromkeys(sentences)
    )  # an adaptation is of all sensors
    for study in studies:
        name = study.model.about.sensor
        start = f"By {clipped(name)}: the" if len(studies) > 1 else "The"
        sentences += _accuracy(study, start)
    sentences += _noise(studies[0])
    return " ".join(sentences)


def _changes(study: Study) -> list[str]:
    """What a log says of the arm, or what an adaptation has learned."""
    verdict = None if study.rows is None else study.rows.verdict
    if verdict is not None:
        causes = "; ".join(one_line(cause.words) for cause in verdict.causes)
        words = verdict.words[0].upper() + verdict.words[1:]
        return [f"{words}: {causes}." if causes else f"{words}."]
    history = study.model.history
    changes = history[-1].get("changed", []) if history else []
    if not changes:
        return []
    words = "; ".join(one_line(str(change["words"])) for change in changes)
    return [f"Since it was learned: {words}."]


def _accuracy(study: Study, start: str) -> list[str]:
    """How far predictions are off, and those of the arm as delivered."""
    model = study.model
    rows = study.rows
    if rows is None:
        errors = model.about.errors.get(model.default_readout)
        if not errors:
            return [
                "No rows are kept with this model: its errors are not known."
            ]
        distance = errors["forward"]["distance"]
        factor, unit = unit_for(float(distance["p99"]), model.about.unit)
        return [
            f"{start} tip was predicted to {number(factor * distance['mean'])} {unit} on "
            f"average, to {number(factor * distance['p99'])} {unit} in 99 of 100, when the "
            "model was made."
        ]
    delivered = 0.0
    if study.delivered is not None:
        delivered = float(np.linalg.norm(study.delivered, axis=1).mean())
    most = float(np.quantile(rows.distance, 0.95))
    factor, unit = unit_for(max(most, delivered), model.about.unit)
    least = rounding(model.about.unit, extent(model))
    if most < least:
        limit = ", below 1 nm," if model.about.unit == "m" else ""
        sentences = [
            f"{start} tip is predicted to rounding{limit} on {rows.source}."
        ]
    else:
        sentences = [
            f"{start} tip is predicted to {number(factor * rows.distance.mean())} {unit} on "
            f"average, to {number(factor * most)} {unit} in 95 of 100 {rows.source}."
        ]
    if delivered > least:
        sentences.append(
            f"As delivered it is off by {number(factor * delivered)} {unit}."
        )
    return sentences


def _noise(study: Study) -> list[str]:
    """How much smaller than the distance to noisy readings the model's own error is."""
    model = study.model
    bounds = model.model_bounds[model.visited]
    if (
        model.about.bound_of != "sensor reading"
        or not np.isfinite(bounds).any()
    ):
        return []
    bound = float(np.nanmedian(bounds))
    factor, unit = unit_for(bound, model.about.unit)
    return [
        f"That is the distance to noisy readings: the model's own error is below "
        f"{number(factor * bound)} {unit} (95 % bound, median over the range)."
    ]


def largest_cause(study: Study) -> str:
    """The largest cause in a sentence, or that there is none."""
    if study.certain:
        cause = study.certain[0]
        factor, unit = unit_for(cause.effect, study.model.about.unit)
        effect = f"{number(factor * cause.effect)} {unit}"
        return f"{cause.words}: it moves the tip by {effect}."
    if not study.model.about.urdf:
        return "No drawing came with this model: there is nothing to compare it with."
    return "Nothing differs from the drawing by more than these rows can show."


def still_true(study: Study) -> str:
    """Whether the model's bound holds for the rows, and how to find out later."""
    about = study.model.about
    verdict = None if study.rows is None else study.rows.verdict
    if verdict is not None:
        share = f"{100 * verdict.covered:.0f} % of {len(verdict.rows):,} rows of this log"
        holds = "it holds" if verdict.bound_holds else "it does not hold here"
        return f"The 95 % bound covers {share}: {holds}."
    if study.log is not None:
        return (
            f"This log has fewer than {SETTINGS.few_rows} rows that the model has not "
            "learned: it tells nothing, and what stands here is of the training."
        )
    if "covered" not in about.within:
        return "Not known: `calib check MODEL --data LOG` with ten rows tells."
    share = f"{100 * about.within['covered']:.0f} % of {about.tested:,} rows"
    if not about.bound_holds:
        return f"The 95 % bound covers {share}: it does not hold here."
    return (
        f"The 95 % bound covers {share}; ten new rows and `calib check MODEL --data LOG` "
        "tell if it still does."
    )


def next_step(study: Study) -> str:
    """The one thing that helps most."""
    model = study.model
    rows = study.rows
    if rows is not None and rows.verdict is not None and rows.verdict.changed:
        return "`calib adapt MODEL --data LOG` takes the change over."
    if model.about.simulation is not None:
        return "This arm is simulated: 30 measured rows of the real one (`calib plan`) tell more."
    if rows is not None and rows.learned is not None:
        learned = float(np.linalg.norm(rows.learned, axis=1).mean())
        unseen = float(rows.distance.mean())
        if unseen > SETTINGS.unseen * learned:
            return (
                f"Rows that it has not seen are missed {number(unseen / learned, 2)} times as "
                "far as its own: `calib plan MODEL` lists the poses that help most."
            )
    return "Use it (`calib correct`, `calib urdf`), and check it with ten rows now and then."


def uncertain(study: Study) -> str:
    """What rows do not tell apart, in a line."""
    names = [clipped(cause.name) for cause in study.causes if not cause.certain]
    if not names:
        return ""
    most = SETTINGS.names
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return f"Not told apart from nothing: {', '.join(names[:most])}{more}."


def sensors(studies: Sequence[Study]) -> dict[str, str]:
    """What each of several sensors is: its view, its noise and its rows."""
    lines = {}
    for study in studies:
        about = study.model.about
        body = study.model.body
        if not about.sensor or body is None or study.rows is None:
            continue
        factor, unit = unit_for(float(body.noise[0]), about.unit)
        noise = f"noise {number(factor * body.noise[0])} {unit}"
        rows = f"{len(study.rows.q):,} rows"
        lines[about.sensor] = f"{body.structure.view} view, {noise}, {rows}"
    return lines
