"""Assessment: how accurate a model is, whether its bound holds and what limits it, in sentences.

The command line and the report's page print the same sentences.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from ..common.choices import READOUTS
from ..common.wording import printable, with_unit

if TYPE_CHECKING:
    from ..body.belief import Body
    from ..model.about import About, Errors
    from ..model.model import Model
    from .evaluate import Evaluation

_EXACT = 1e-9  # share of the extent below which an error is rounding
_POINTS = 200  # of the learned range at which the bound is evaluated
_UNEVEN = 2.0  # a bound this many times wider in its worst tenth than in its best shows few rows
_NOISY = 0.7  # of the bound on readings: noise is the larger part where the model's own is smaller
_MOST = 3  # findings that are printed; `calib info` has all


def accuracy(model: Model, evaluation: Evaluation) -> str:
    """Return in one line how far predictions are from where the tip is or is measured."""
    unit = model.about.unit
    within = evaluation.within
    line = f"{with_unit(_mean_distance(evaluation.errors), unit)} on average"
    if "covered" in within:
        limit = with_unit(within["p95"], unit).removeprefix("below ")
        line += f", 95 % within {limit}"
        line += f"; the 95 % bound covers {100 * within['covered']:.0f} %"
        if "answered" in within:
            answered = 100 * within["answered"]
            line += f" of the {answered:.0f} % that have an answer"
    elif within:
        line += "; too few answers to say whether the 95 % bound holds"
    line += f", on {evaluation.rows} {evaluation.source}"
    if evaluation.left_out:
        line += f"; {evaluation.left_out} left out, wrong or outside of what was learned"
    return line


def accuracy_as_made(model: Model) -> str:
    """Return in one line how far a sensor's predictions were off when its model was made."""
    from .evaluate import as_made

    sensor = model.about.sensor
    line = accuracy(model, as_made(model))
    return f"{sensor}: {line}" if sensor else line


def _bound_fails(covered: float, rows: str) -> str:
    """The line that rows, in words, contradict the bound that covers this share of them."""
    return (
        f"THE BOUND DOES NOT HOLD: the model's own 95 % bound covers {100 * covered:.0f} % of "
        f"{rows}"
    )


def bound_warnings(about: About) -> list[str]:
    """State in one line that the rows that a model was tested on contradict its own bound."""
    if about.bound_holds:
        return []
    rows = "fresh samples" if about.source == "simulation" else "rows held out"
    answered = about.within.get("answered", 1.0)
    if answered < 0.5:
        return [
            f"TOO COARSE TO ANSWER: at {100 * (1 - answered):.0f} % of {rows} the model may be off "
            "by more than 10 % of the reach"
        ]
    line = _bound_fails(about.within["covered"], rows)
    return [f"{line}: do not rely on it"]


def bound_fails_for_log(about: About, covered: float) -> str:
    """State in one line that too few rows of a log are within a model's own bound."""
    line = _bound_fails(covered, "the rows of the log")
    if about.source == "simulation":
        line += "; it is that of the simulated arm"
    return line


def differences_from_drawing(model: Model) -> str:
    """Return in one line what differs from the drawing, or what a log determined without one."""
    from .geometry_fit import body_with_zeros

    about = model.about
    body = body_with_zeros(model)
    if body is None:
        return "found: no kinematic body under the maps"
    nothing = "an arm of these joints, without a drawing to compare it with"
    # parts of the lines of `Body.describe` that are left out: calib info has both
    untold = ["`expected_error`", "origin moved"]
    if about.urdf:
        nothing = "nothing that differs from the drawing by more than these rows can show"
        untold = untold[:1]
        body = _where_joints_differ(body)
    lines = [
        printable(" ".join(line.split()))
        for line in body.describe(about.lower, about.upper)
        if not any(words in line for words in untold)
    ]
    more = len(lines) - _MOST
    if more > 0:
        lines[_MOST:] = [f"{more} more in calib info"]
    return f"found: {'; '.join(lines) or nothing}"


def _where_joints_differ(body: Body) -> Body:
    """Return the body with joints as drawn where that is within their intervals."""
    from ..body.covariance import Z95

    structure = body.structure
    differs = abs(body.beta - structure.neutral()) > Z95 * body.sds_by_rows
    root = body.root.copy()
    for row, index in enumerate(body.active.tolist()):
        if structure.labels[index].joint is not None and not differs[index]:
            root[row] = 0.0
    return replace(body, root=root)


def limiting_factor(model: Model, errors: Errors) -> str:
    """Return in one line what limits the accuracy, and the one thing that would help most."""
    import numpy as np

    about = model.about
    unit = about.unit
    mean = _mean_distance(errors)
    simulated = about.source == "simulation"
    if model.body is None:
        more = "more samples (-n)" if simulated else "more rows"
        return f"limited by maps without a body; {more} and a larger `size` help most"
    if simulated:
        if mean < _EXACT * float(np.linalg.norm(model.sensory.scale.span)):
            return "limited by rounding alone: the model holds all that was simulated"
        return "limited by the simulated noise and changes; more samples (-n) help most"
    rng = np.random.default_rng(0)
    q = rng.uniform(about.lower, about.upper, (_POINTS, len(about.lower)))
    bounds = np.nan_to_num(model.expected_error(q), nan=np.inf)
    # a quantile between two infinite values is one of them
    shares = (0.1, 0.5, 0.9)
    low, middle, high = np.quantile(bounds, shares, method="lower").tolist()
    if not high <= _UNEVEN * low:
        return (
            "limited by few rows in parts of the range; calib plan MODEL lists where more rows "
            "help most"
        )
    of_model = float(np.nanmedian(model.model_error(q)))
    if of_model < _NOISY * middle:
        return (
            f"limited by noise of the readings: the model itself is within "
            f"{with_unit(of_model, unit)}; rows at rest help most"
        )
    return (
        f"limited by {with_unit(mean, unit)} that the model does not explain, noise of the "
        "readings or more; poses that are measured twice tell which, rows at rest help most"
    )


def _mean_distance(errors: Errors) -> float:
    """Return the mean error of the readout that answers queries [unit]."""
    best = next(errors[readout] for readout in READOUTS if readout in errors)
    return float(best["forward"]["distance"]["mean"])
