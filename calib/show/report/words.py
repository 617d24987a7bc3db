"""Words of a report: how accurate, whether it still holds, what to do next."""

import re
from collections.abc import Sequence

import numpy as np

from ...common.wording import clipped, one_line, quantity
from ..settings import SETTINGS
from ..study import Study


def verdict(studies: Sequence[Study]) -> str:
    """What changed, how accurate the model is for each sensor, and the arm as delivered."""
    # an adaptation is of all sensors
    changes = dict.fromkeys(_changes(study) for study in studies)
    sentences = list(filter(None, changes))
    for study in studies:
        name = clipped(study.model.about.sensor)
        start = f"By {name}: the" if len(studies) > 1 else "The"
        sentences += _accuracy(study, start)
    return " ".join([*sentences, *_noise(studies[0])])


def _changes(study: Study) -> str:
    """What a log says of the arm, or what an adaptation has learned."""
    verdict = None if study.rows is None else study.rows.verdict
    history = study.model.history
    if verdict is not None:
        start = f"{verdict.words.capitalize()}: "
        words = list(verdict.explanations)
    elif history:
        start = "Since it was learned: "
        words = [str(change["words"]) for change in history[-1]["changed"]]
        # the model's own intervals stand below: those of the log are wider
        words = [re.sub(r" ± [\d.]+", "", text) for text in words]
    else:
        return ""
    if not words:
        return "" if verdict is None else f"{start[:-2]}."
    return f"{start}{'; '.join(map(one_line, words))}."


def _accuracy(study: Study, start: str) -> list[str]:
    """How far predictions are off, and those of the arm as delivered."""
    model = study.model
    unit = model.about.unit
    rows = study.rows
    if rows is None:
        errors = model.about.errors.get(model.default_readout)
        if not errors:
            return [
                "No rows are kept with this model: its errors are not known."
            ]
        mean = quantity(errors["forward"]["distance"]["mean"], unit)
        return [
            f"{start} tip was predicted to {mean} on average when the model was made."
        ]
    most = float(np.quantile(rows.distance, 0.95))
    sentences = [
        f"{start} tip is predicted to {quantity(rows.distance.mean(), unit)} on average, "
        f"to {quantity(most, unit)} in 95 of 100 {rows.source}{_of_answered(rows.answered)}."
    ]
    if study.delivered is not None:
        delivered = float(np.linalg.norm(study.delivered, axis=1).mean())
        if delivered > most:
            sentences.append(
                f"As delivered it is off by {quantity(delivered, unit)}."
            )
    return sentences


def _of_answered(share: float) -> str:
    """Which share of the rows is spoken of, where the model has no answer for the others."""
    if share == 1.0:
        return ""
    return f", of the {100 * share:.0f} % that have an answer"


def _noise(study: Study) -> list[str]:
    """How much smaller than the distance to noisy readings the model's own error is."""
    model = study.model
    bounds = model.model_bounds[model.visited & np.isfinite(model.model_bounds)]
    if model.about.bound_of != "sensor reading" or not len(bounds):
        return []
    bound = float(np.median(bounds))
    rows = study.rows
    if rows is None or (rows.verdict and not rows.verdict.bound_holds):
        return []
    if bound >= np.quantile(rows.distance, 0.95):
        return []  # the rows do not tell noise and errors of the model apart
    return [
        "That is the distance to noisy readings: the model's own error is below "
        f"{quantity(bound, model.about.unit)} (95 % bound, median over the range)."
    ]


def largest_cause(study: Study) -> str:
    """The largest cause in a sentence, or that there is none."""
    verdict = None if study.rows is None else study.rows.verdict
    if verdict is not None and verdict.changed:
        words = verdict.main_cause
        return f"{one_line(words[0].upper() + words[1:])}."
    if study.model.body is None:
        return "Not told: maps without a body have no parameters to compare with a drawing."
    if study.certain:
        cause = study.certain[0]
        effect = quantity(cause.effect, study.model.about.unit)
        return f"{cause.words}: it moves the tip by {effect}."
    if not study.model.about.urdf:
        return "No drawing came with this model: there is nothing to compare it with."
    return "Nothing differs from the drawing by more than these rows can show."


def still_true(study: Study) -> str:
    """Whether the model's bound holds for the rows, and how to find out later."""
    about = study.model.about
    verdict = None if study.rows is None else study.rows.verdict
    if verdict is not None:
        covered = verdict.covered
        rows = f"{len(verdict.rows):,} rows of this log"
        holds = verdict.bound_holds
    elif study.log is not None:
        return (
            f"This log has fewer than {SETTINGS.few_rows} rows that the model has not "
            "learned: it tells nothing, and what stands here is of the training."
        )
    elif "covered" not in about.within:
        return "Not known: `calib check MODEL --data LOG` with ten rows tells."
    else:
        covered = about.within["covered"]
        rows = f"{about.tested:,} rows"
        holds = about.bound_holds
        rows += _of_answered(about.within.get("answered", 1.0))
    answer = "it holds" if holds else "it does not hold here"
    return f"The 95 % bound covers {100 * covered:.0f} % of {rows}: {answer}."


def next_step(study: Study) -> str:
    """The one thing that helps most."""
    verdict = None if study.rows is None else study.rows.verdict
    if verdict is not None and verdict.changed:
        return "`calib adapt MODEL --data LOG` takes the change over."
    if study.model.about.simulation is not None:
        return "This arm is simulated: 30 measured rows of the real one (`calib plan`) tell more."
    return "Use it (`calib correct`, `calib urdf`), and check it with ten rows now and then."
