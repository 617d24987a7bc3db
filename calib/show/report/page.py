"""Page: a report that answers how accurate, what is off, where, why so, in one file offline."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from html import escape
from typing import TYPE_CHECKING

from ...common.choices import READOUTS
from ...common.wording import quoted, suggestion
from ...errors import OptionError, require
from ...maps.association import Association
from ...maps.map import Map
from ...model.facts import facts
from ...model.model import Model
from ...recording.rig import HandEye
from ...recording.rig_file import rig_of_model
from ...samples.samples import Samples
from ...training.learn import Progress
from ..error_scale import unit_for
from ..study import Study, studies_of
from . import figures as arm
from . import map_figures as maps
from . import words
from .drawing import settings
from .html import figure_of, filled, paragraph, write_page
from .rig_page import (
    figures_of_rig,
    pictures_of_rig,
    report_rig,
    verdict_of_rig,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Draw = Callable[[Study], "Figure | None"]
"""What draws a figure, None where there is nothing to show."""

CAPTIONS: dict[Draw, str] = {
    arm.accuracy: "How far predictions are from measured positions.",
    arm.causes: "What differs from the drawing, by how much it moves the tip; lines are 95 % "
    "intervals.",
    arm.setup: "What stands around the arm and what it carries, to scale.",
    arm.where: "The model's own 95 % bound on the true position; dots are rows, in the colour "
    "of their error; crosses are rows that were left out.",
    arm.coverage: "Which part of each joint's range the rows covered.",
    arm.arrows: "From the predicted position to the measured one.",
    maps.photo: "The sensory map and the arm as the camera sees them.",
    arm.joints: "What rows say of each joint's own error (dots), the learned error curve and "
    "its band.",
    arm.order: "Drift and steps show as slopes; the line is a running median.",
    arm.trust: "A bound that holds follows the diagonal or lies above it; grey is what chance "
    "does.",
    arm.sockets: "Each dot is a touch: held out, only the play should be left.",
    maps.lattices: "Nodes joined to their neighbours on the lattice.",
    maps.u_matrices: "Ridges are folds and borders of the map.",
}
FIGURES = {draw.__name__: draw for draw in CAPTIONS}
_WHERE = (arm.where, arm.coverage, arm.arrows, maps.photo)
_WHY = (arm.joints, arm.order, arm.trust, arm.sockets)
_FIRST_ALONE = (arm.coverage, arm.joints, arm.arrows)  # of several sensors
_MAPS = (maps.lattices, maps.u_matrices)


def report(
    model: Model | HandEye,
    path: str | os.PathLike[str],
    log: Samples | None = None,
    *,
    progress: Progress | None = None,
) -> str:
    """Write a report of a model into one HTML file, and return its verdict in words.

    Parameters
    ----------
    model : Model or HandEye
    path : path-like
        The file; it needs no network to be read.
    log : Samples, optional
        Measured samples to judge the model by.  Without them fresh samples of a simulated arm
        are used, and of a model of a log the rows that it keeps.
    progress : callable, optional
        Called with the share that is done, a step and NaN.

    Examples
    --------
    >>> import calib, os, tempfile
    >>> model = calib.train(calib.babble(calib.load_arm("two_link"), 2000, seed=0), size=10)
    >>> path = os.path.join(tempfile.mkdtemp(), "report.html")
    >>> calib.report(model, path)
    'The tip is predicted to ...'
    """
    if isinstance(model, HandEye):
        return report_rig(model, path)
    require("model", model, Model)
    studies = studies_of(model, log)
    rig = rig_of_model(model)
    study = next((one for one in studies if one.log is not None), studies[0])
    with settings():
        bars = _of_sensors(studies, [arm.accuracy])
        first = "".join(bars.values()) + _figures(study, [arm.causes])
        off = paragraph(words.uncertain(study)) + _figures(
            studies[0], [arm.setup]
        )
        sections = {"What is off": off}
        if rig is not None:
            pictures = pictures_of_rig(rig)
            del pictures["setup"]
            sections["The pictures"] = "".join(pictures.values())
        for heading, draws in (("Where", _WHERE), ("Why so", _WHY)):
            if progress is not None:
                progress(len(sections) / 4, heading, float("nan"))
            for sensor, content in _of_sensors(studies, draws).items():
                sections[f"{heading}: {sensor}" if sensor else heading] = (
                    content
                )
        if (
            model.default_readout == "linear"
            or model.predictor.models.degree >= 0
        ):
            sections["The maps"] = _table(model) + _figures(studies[0], _MAPS)
    verdict = words.verdict(studies)
    if rig is not None:
        verdict = f"{verdict_of_rig(rig)} {verdict}"
    write_page(
        path,
        title=model.about.robot or "An arm, learned from a log",
        verdict=verdict,
        answers={
            "What is off": words.largest_cause(study),
            "Still true?": words.still_true(study),
            "Next": words.next_step(study),
        },
        first=first,
        sections=sections,
        facts=facts(model) | words.sensors(studies),
        notes=model.about.notes,
    )
    return verdict


def figures(
    model: Model | HandEye | Map | Association,
    log: Samples | None = None,
    names: Sequence[str] | None = None,
) -> dict[str, Figure]:
    """Return the figures of a model, a map or an association, in the ink of paper.

    Parameters
    ----------
    model : Model, HandEye, Map or Association
    log : Samples, optional
        A log to judge the model by, as in :func:`report`.
    names : sequence of str, optional
        Which; by default all that have something to show.

    Returns
    -------
    dict of matplotlib.figure.Figure
        By name; those of a second sensor are `where-2` and the like.

    Examples
    --------
    >>> import calib
    >>> model = calib.train(calib.babble(calib.load_arm("two_link"), 2000, seed=0), size=10)
    >>> list(calib.figures(model, names=["where", "photo"]))
    ['where']
    >>> list(calib.figures(model.association))
    ['lattices', 'u_matrices', 'links']
    """
    with settings(paper=True):
        if isinstance(model, HandEye | Map | Association):
            if isinstance(model, HandEye):
                drawn = figures_of_rig(model)
            else:
                drawn = maps.figures_of_maps(model)
            return {name: drawn[name] for name in _checked(names, drawn)}
        if not isinstance(model, Model):
            raise OptionError(
                f"figures of {type(model).__name__}: expected a model, a map or an association",
                hint="`calib.load(path)` reads a model",
                parameter="model",
            )
        chosen = _checked(names, FIGURES)
        drawn = {}
        for study in studies_of(model, log):
            for name in chosen:
                figure = FIGURES[name](study)
                if figure is not None:
                    drawn[name + study.suffix] = figure
    return drawn


def _checked(
    names: Sequence[str] | None, drawn: Iterable[str]
) -> Sequence[str]:
    """Names of figures, all that there are by default."""
    there = list(drawn)
    for name in names or ():
        if name not in there:
            raise OptionError(
                f"`names`: {quoted(name)} is no figure",
                hint=suggestion(name, there),
                parameter="names",
                value=name,
            )
    return there if names is None else names


def _of_sensors(
    studies: Sequence[Study], draws: Sequence[Draw]
) -> dict[str, str]:
    """Figures as HTML, by the name of the sensor."""
    return {
        study.model.about.sensor: _figures(study, draws) for study in studies
    }


def _figures(study: Study, draws: Sequence[Draw]) -> str:
    """Figures as HTML; "" for those that have nothing to show."""
    parts = []
    for draw in draws:
        if study.suffix and draw in _FIRST_ALONE:
            continue
        caption = CAPTIONS[draw]
        if draw is arm.accuracy and study.model.about.sensor:
            caption = f"{study.model.about.sensor}: {caption}"
        name = draw.__name__ + study.suffix
        parts.append(figure_of(draw(study), name, caption))
    return "".join(parts)


def _table(model: Model) -> str:
    """Distances of all readouts, aligned at the point."""
    errors = model.about.errors
    distances = {
        readout: errors[readout]["forward"]["distance"]
        for readout in READOUTS
        if readout in errors
    }
    if not distances:
        return ""
    least = min(distance["mean"] for distance in distances.values())
    factor, unit = unit_for(least, model.about.unit)
    rows = []
    for readout, distance in distances.items():
        values = [
            f"{factor * distance[key]:,.3f}" for key in ("mean", "p99", "max")
        ]
        rows.append(
            f"<tr><th>{readout}</th><td>{'</td><td>'.join(values)}</td></tr>"
        )
    return filled("table.html", unit=escape(unit), rows="\n".join(rows))
