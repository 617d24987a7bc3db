"""Page: a report that answers how accurate, what is off, where, why so, in one file offline."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Sequence
from html import escape
from importlib.resources import files
from string import Template
from typing import TYPE_CHECKING

from ...common.atomic import atomic_write
from ...common.choices import READOUTS
from ...common.wording import quoted, suggestion
from ...errors import OptionError
from ...maps.association import Association
from ...maps.map import Map
from ...model.facts import facts
from ...model.model import Model
from ...samples.samples import Samples
from ...training.learn import Progress
from ..error_scale import unit_for
from ..study import Study, studies_of
from . import figures as arm
from . import map_figures as maps
from . import words
from .drawing import settings, to_svg

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
_MAPS = (maps.lattices, maps.u_matrices)


def report(
    model: Model,
    path: str | os.PathLike[str],
    log: Samples | None = None,
    *,
    progress: Progress | None = None,
) -> str:
    """Write a report of a model into one HTML file, and return its verdict in words.

    Parameters
    ----------
    model : Model
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
    studies = studies_of(model, log)
    study = next((one for one in studies if one.log is not None), studies[0])
    with settings():
        bars = _of_sensors(studies, [arm.accuracy])
        first = "".join(bars.values()) + _figures(study, [arm.causes])
        off = _paragraph(words.uncertain(study)) + _figures(studies[0], [arm.setup])
        sections = {"What is off": off}
        for heading, draws in (("Where", _WHERE), ("Why so", _WHY)):
            if progress is not None:
                progress(len(sections) / 4, heading, float("nan"))
            for sensor, content in _of_sensors(studies, draws).items():
                sections[f"{heading}: {sensor}" if sensor else heading] = content
        if model.default_readout == "linear" or model.predictor.models.degree >= 0:
            sections["The maps"] = _table(model) + _figures(studies[0], _MAPS)
    verdict = words.verdict(studies)
    page = _filled(
        "page.html",
        title=escape(model.about.robot or "An arm, learned from a log"),
        style=_file("page.css"),
        verdict=_html(verdict),
        answers=_list(
            {
                "What is off": words.largest_cause(study),
                "Still true?": words.still_true(study),
                "Next": words.next_step(study),
            }
        ),
        first=first,
        sections="".join(
            f'<h2>{escape(heading)}</h2>\n<div class="figures">{content}</div>\n'
            for heading, content in sections.items()
            if content
        ),
        facts=_list(facts(model)),
        notes="".join(_paragraph(f"Note: {note}") for note in model.about.notes),
    )
    atomic_write(path, page.encode("utf-8"))
    return verdict


def figures(
    model: Model | Map | Association,
    log: Samples | None = None,
    names: Sequence[str] | None = None,
) -> dict[str, Figure]:
    """Return the figures of a model, a map or an association, in the ink of paper.

    Parameters
    ----------
    model : Model, Map or Association
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
        if isinstance(model, Map | Association):
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


def _checked(names: Sequence[str] | None, drawn: Iterable[str]) -> Sequence[str]:
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


def _of_sensors(studies: Sequence[Study], draws: Sequence[Draw]) -> dict[str, str]:
    """Figures as HTML, by the name of the sensor."""
    return {study.model.about.sensor: _figures(study, draws) for study in studies}


def _figures(study: Study, draws: Sequence[Draw]) -> str:
    """Figures as HTML; "" for those that have nothing to show."""
    parts = []
    for draw in draws:
        figure = draw(study)
        if figure is None:
            continue
        caption = CAPTIONS[draw]
        name = draw.__name__ + study.suffix
        svg = to_svg(figure, name, caption)
        if draw is arm.accuracy and study.model.about.sensor:
            caption = f"{escape(study.model.about.sensor)}: {caption}"
        caption = f"<figcaption>{caption}</figcaption>"
        parts.append(f'<figure id="{name}">{svg}{caption}</figure>\n')
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
        values = [f"{factor * distance[key]:,.3f}" for key in ("mean", "p99", "max")]
        rows.append(f"<tr><th>{readout}</th><td>{'</td><td>'.join(values)}</td></tr>")
    return _filled("table.html", unit=escape(unit), rows="\n".join(rows))


def _list(entries: dict[str, str]) -> str:
    """Names and what they are."""
    return "".join(
        f"<dt>{escape(name)}</dt><dd>{_html(value)}</dd>\n"
        for name, value in entries.items()
    )


def _paragraph(text: str) -> str:
    """A text in soft ink, "" for none."""
    return f'<p class="soft">{_html(text)}</p>\n' if text else ""


def _html(text: str) -> str:
    """A text for the page; what stands in backticks is typed."""
    return re.sub(r"`([^`]*)`", r"<code>\1</code>", escape(text))


def _filled(file: str, /, **parts: str) -> str:
    """A template of this folder with its places filled."""
    return Template(_file(file)).substitute(parts)


def _file(name: str) -> str:
    return files(__package__).joinpath(name).read_text(encoding="utf-8")
