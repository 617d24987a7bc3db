"""Words of a report: how accurate, whether it still holds, what to do next."""

import re
from collections.abc import Sequence

import numpy as np

from ...common.rows import row_lengths
from ...common.wording import clipped, one_line, quantity
from ...training.settings import TESTING
from ...use import assessment
from ..study import Study


def verdict(studies: Sequence[Study]) -> str:
    """What changed, how accurate the model is for each sensor, and the arm as delivered."""
    # an adaptation covers all sensors
    changes = dict.fromkeys(_changes(study) for study in studies)
    sentences = list(filter(None, changes))
    for study in studies:
        name = clipped(study.model.about.sensor)
        start = f"By {name}: the" if len(studies) > 1 else "The"
        sentences += _accuracy(study, start)
    return " ".join([*sentences, *_noise(studies[0])])


def _changes(study: Study) -> str:
    """What a log shows of the arm, or what an adaptation has learned."""
    verdict = study.evaluation.verdict
    history = study.model.history
    if verdict is not None:
        start = f"{verdict.words.capitalize()}: "
        words = list(verdict.explanations)
    elif history:
        event = history[-1]
        sensor = clipped(event.get("sensor", ""))
        start = "Since it was learned: "
        if sensor:
            start = f"Since it was learned, by {sensor}: "
        words = [str(change["words"]) for change in event["changed"]]
        # the model's own intervals follow below: those of the log are wider
        words = [re.sub(r" ± [\d.]+", "", text) for text in words]
    else:
        return ""
    if not words:
        return "" if verdict is None else f"{start[:-2]}."
    return f"{start}{'; '.join(map(one_line, words))}."


def _accuracy(study: Study, start: str) -> list[str]:
    """How far predictions are off, and those of the arm as delivered."""
    evaluation = study.evaluation
    if not evaluation.errors:
        return ["No rows are kept with this model: its errors are not known."]
    accuracy = assessment.accuracy(study.model, evaluation)
    sentences = [f"{start} tip is predicted to {accuracy}."]
    if study.delivered is not None:
        delivered = float(row_lengths(study.delivered).mean())
        if delivered > evaluation.within["p95"]:
            unit = study.model.about.unit
            sentences.append(
                f"As delivered it is off by {quantity(delivered, unit)}."
            )
    return sentences


def _noise(study: Study) -> list[str]:
    """How much smaller than the distance to noisy readings the model's own error is."""
    model = study.model
    bounds = model.model_bounds[model.visited & np.isfinite(model.model_bounds)]
    if model.about.bound_of != "sensor reading" or not len(bounds):
        return []
    bound = float(np.median(bounds))
    evaluation = study.evaluation
    # else the rows do not distinguish noise and errors of the model
    is_smaller = bound < evaluation.within.get("p95", 0.0)
    if not (is_smaller and evaluation.bound_holds):
        return []
    return [
        "That is the distance to noisy readings: the model's own error is below "
        f"{quantity(bound, model.about.unit)} (95 % bound, median over the range)."
    ]


def largest_cause(study: Study) -> str:
    """The largest cause in a sentence, or that there is none."""
    verdict = study.evaluation.verdict
    if verdict is not None and verdict.changed:
        words = verdict.main_cause
        return f"{one_line(words[0].upper() + words[1:])}."
    if study.model.body is None:
        return "Not known: maps without a body have no parameters to compare with a drawing."
    if study.certain:
        deviation = study.certain[0]
        effect = quantity(deviation.effect, study.model.about.unit)
        return f"{deviation.words}: it moves the tip by {effect}."
    if not study.model.about.urdf:
        return "No drawing came with this model: there is nothing to compare it with."
    return "Nothing differs from the drawing by more than these rows can show."


def still_true(study: Study) -> str:
    """Whether the model's bound holds for the rows, and how to find out later."""
    evaluation = study.evaluation
    if study.log is not None and evaluation.verdict is None:
        return (
            f"This log has fewer than {TESTING.fewest} rows that the model has not learned: it "
            "tells nothing, and what stands here is of the training."
        )
    within = evaluation.within
    if "covered" not in within:
        return (
            "Not known: `calib check MODEL --data LOG` with ten rows shows it."
        )
    answered = within.get("answered", 1.0)
    rows = f"{evaluation.rows:,} rows"
    if study.log is not None:
        rows += " of this log"
    if answered < 1.0:
        rows += f", of the {100 * answered:.0f} % that have an answer"
    answer = "it holds" if evaluation.bound_holds else "it does not hold here"
    return f"The 95 % bound covers {100 * within['covered']:.0f} % of {rows}: {answer}."


def next_step(study: Study) -> str:
    """The one thing that helps most."""
    verdict = study.evaluation.verdict
    if verdict is not None and verdict.changed:
        hint = verdict.hint
        if hint:
            return f"{hint[0].upper()}{hint[1:]}."
        return "`calib adapt MODEL --data LOG` takes the change over."
    if study.model.about.simulation is not None:
        return "This arm is simulated: 30 measured rows of the real one (`calib plan`) tell more."
    return "Use it (`calib correct`, `calib urdf`), and check it with ten rows now and then."
