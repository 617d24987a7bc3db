"""Words of a report: how accurate, whether it still holds, what to do next."""

from __future__ import annotations

import numpy as np

from ...common.wording import ROUNDED_AWAY, clipped, one_line
from ..error_scale import number, unit_for
from ..settings import AMOUNTS, LIMITS
from ..workspace import extent
from .figures import Study, cause_words


def verdict(study: Study) -> str:
    """How accurate the model is, what changed, and how far off the arm is as delivered."""
    unit = study.model.about.unit
    if study.rows is None:
        return _without_rows(study)
    delivered = study.rows.delivered
    before = (
        0.0 if delivered is None else float(np.linalg.norm(delivered, axis=1).mean())
    )
    most = float(np.quantile(study.rows.distance, 0.95))
    factor, name = unit_for(max(most, before), unit)
    rounding = ROUNDED_AWAY if unit == "m" else ROUNDED_AWAY * extent(study.model)
    if most < rounding:
        few = "rounding, below 1 nm," if unit == "m" else "rounding"
        sentences = [f"The tip is predicted to {few} on {study.rows.source}."]
    else:
        mean = number(factor * float(study.rows.distance.mean()))
        sentences = [
            f"The tip is predicted to {mean} {name} on average, to {number(factor * most)} {name} "
            f"in 95 of 100 {study.rows.source}."
        ]
    changes = study.model.history[-1].get("changed", []) if study.model.history else []
    if changes:
        words = "; ".join(one_line(str(change["words"])) for change in changes)
        sentences.insert(0, f"Since it was learned: {words}.")
    if before > rounding:
        sentences.append(f"As delivered it is off by {number(factor * before)} {name}.")
    sentences += _of_noise(study)
    return " ".join(sentences)


def _without_rows(study: Study) -> str:
    """How accurate a model was when it was made, of which no rows are kept."""
    model = study.model
    errors = model.about.errors.get(model.default_readout)
    if not errors:
        return "No rows are kept with this model: its errors are not known."
    distance = errors["forward"]["distance"]
    factor, name = unit_for(float(distance["p99"]), model.about.unit)
    words = (
        f"The tip was predicted to {number(factor * distance['mean'])} {name} on average, to "
        f"{number(factor * distance['p99'])} {name} in 99 of 100, when the model was made."
    )
    return " ".join([words, *_of_noise(study)])


def _of_noise(study: Study) -> list[str]:
    """Say how much smaller than the distance to noisy readings the model's own error is."""
    model = study.model
    bounds = model.model_bounds[model.visited]
    if model.about.bound_of != "sensor reading" or not np.isfinite(bounds).any():
        return []
    own = float(np.nanmedian(bounds))
    factor, name = unit_for(own, model.about.unit)
    return [
        f"That is the distance to noisy readings: the model's own error is below "
        f"{number(factor * own)} {name} (95 % bound, median over the range)."
    ]


def largest_cause(study: Study) -> str:
    """The largest cause in a sentence, or that there is none."""
    if study.certain:
        cause = study.certain[0]
        factor, unit = unit_for(cause.effect, study.model.about.unit)
        return f"{cause_words(cause)}: it moves the tip by {number(factor * cause.effect)} {unit}."
    if not study.model.about.urdf:
        return "No drawing came with this model: there is nothing to compare it with."
    return "Nothing differs from the drawing by more than these rows can show."


def still_true(study: Study) -> str:
    """Whether the model's bound holds for the rows, and how to find out later."""
    if study.rows is None:
        return "Not known: `calib check MODEL --data LOG` with ten rows tells."
    inside = _inside(study)
    words = f"The 95 % bound covers {100 * inside.mean():.0f} % of {len(inside):,} rows"
    if _holds(study):
        if study.rows.fresh:
            return f"{words} of this log: it holds."
        return f"{words}; ten new rows and `calib check MODEL --data LOG` tell if it still does."
    return f"{words}: it does not hold here."


def next_step(study: Study) -> str:
    """The one thing that helps most."""
    model = study.model
    rows = study.rows
    if rows is not None and rows.fresh and not _holds(study):
        return "`calib check` says what changed, `calib adapt` takes it over."
    if model.about.simulation is not None:
        return "This arm is simulated: 30 measured rows of the real one (`calib plan`) tell more."
    if rows is not None and not rows.fresh and model.rows is not None:
        learned = float(np.linalg.norm(rows.learned, axis=1).mean())
        unseen = float(rows.distance.mean())
        if unseen > LIMITS.few_rows * learned:
            ratio = number(float(f"{unseen / learned:.2g}"))
            return (
                f"Rows that it has not seen are missed {ratio} times as far as its own: "
                "`calib plan MODEL` lists the poses that help most."
            )
    return "Use it (`calib correct`, `calib urdf`), and check it with ten rows now and then."


def uncertain(study: Study) -> str:
    """What rows do not tell apart, in a line."""
    names = [clipped(cause.name) for cause in study.causes if not cause.certain]
    if not names:
        return ""
    more = (
        f" and {len(names) - AMOUNTS.names} more" if len(names) > AMOUNTS.names else ""
    )
    return f"Not told apart from nothing: {', '.join(names[: AMOUNTS.names])}{more}."


def _inside(study: Study) -> np.ndarray:
    """Which rows (n,) are within the model's 95 % bound."""
    assert study.rows is not None  # noqa: S101 - the caller has looked
    return np.asarray(
        study.rows.distance <= study.model.expected_error(study.rows.q) + 1e-12
    )


def _holds(study: Study) -> bool:
    """Whether a 95 % bound covers as many rows as it should, but for chance."""
    beyond = int(np.count_nonzero(~_inside(study)))
    return beyond <= LIMITS.missed * len(_inside(study)) + LIMITS.chance
