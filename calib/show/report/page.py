"""Page: a report that answers how accurate, what is off, where, why so, in one file offline."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping, Sequence
from html import escape
from importlib.resources import files
from string import Template
from typing import TYPE_CHECKING, Any, NamedTuple

from ...common.atomic import atomic_write
from ...common.choices import READOUTS
from ...common.wording import quoted, suggestion
from ...errors import OptionError
from ...maps.association import Association
from ...maps.map import Map
from ...model.facts import facts
from ...model.model import Model
from ...samples.samples import Samples
from ...training.evaluate import evaluate
from ...training.learn import Progress
from ..error_scale import unit_for
from . import figures as draw
from . import maps as draw_maps
from . import words
from .drawing import settings, to_svg
from .figures import Study

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_CODE = re.compile(r"`([^`]*)`")


class Panel(NamedTuple):
    """A figure of the report: what draws it, None where there is nothing, and how to read it."""

    draw: Callable[[Study], Figure | None]
    caption: str


PANELS = {
    "accuracy": Panel(
        draw.accuracy, "How far predictions are from measured positions."
    ),
    "causes": Panel(
        draw.causes,
        "What differs from the drawing, by how much it moves the tip; lines are 95 % intervals.",
    ),
    "setup": Panel(
        draw.setup, "What stands around the arm and what it carries, to scale."
    ),
    "where": Panel(
        draw.where,
        "The model's own 95 % bound on the true position; dots are rows, in the colour of their "
        "error; crosses are rows that were left out.",
    ),
    "coverage": Panel(
        draw.coverage, "Which part of each joint's range the rows covered."
    ),
    "photo": Panel(draw_maps.photo, "The sensory map as the camera sees the arm."),
    "joints": Panel(
        draw.joints,
        "What rows say of each joint's own error (dots), the learned error curve and its band.",
    ),
    "order": Panel(
        draw.order, "Drift and steps show as slopes; the line is a running median."
    ),
    "arrows": Panel(draw.arrows, "From the predicted position to the measured one."),
    "trust": Panel(
        draw.trust,
        "A bound that holds follows the diagonal or lies above it; grey is what chance does.",
    ),
    "sockets": Panel(
        draw.sockets, "Each dot is a touch: held out, only the play should be left."
    ),
    "lattices": Panel(
        draw_maps.lattices, "Nodes joined to their neighbours on the lattice."
    ),
    "u_matrices": Panel(
        draw_maps.u_matrices, "Ridges are folds and borders of the map."
    ),
}
_FIRST = ("accuracy", "causes")
_SECTIONS = {
    "What is off": ("setup",),
    "Where": ("where", "coverage", "arrows", "photo"),
    "Why so": ("joints", "order", "trust", "sockets"),
    "The maps": ("lattices", "u_matrices"),
}


def report(
    model: Model,
    path: str | os.PathLike[str],
    log: Samples | None = None,
    *,
    progress: Progress | None = None,
) -> str:
    """Write a report of a model, figures and words, as one HTML file that needs no network.

    Parameters
    ----------
    model : Model
    path : path-like
        The file, written whole or not at all.
    log : Samples, optional
        A log to judge the model by.  Without it a simulated model is judged by fresh exact
        samples, and a model of a log by its own rows, each predicted from the others.
    progress : callable, optional
        Called with the share of the work done, the section and NaN.

    Returns
    -------
    str
        How accurate the model is, the page's first sentences.

    Examples
    --------
    >>> import calib, os, tempfile
    >>> model = calib.train(calib.babble(calib.load_arm("two_link"), 2000, seed=0), size=10)
    >>> path = os.path.join(tempfile.mkdtemp(), "report.html")
    >>> calib.report(model, path)
    'The tip is predicted to ...'
    """
    study = Study(model, log)
    texts = {
        "What is off": words.uncertain(study),
        "Where": "Errors are where the arm is asked to go; outside of the field it cannot.",
        "Why so": "What is left over, by joint, by time and by place.",
        "The maps": "Where maps answer, or where there is no body under them.",
    }
    verdict = words.verdict(study)
    sections = []
    for k, (heading, names) in enumerate(_SECTIONS.items()):
        if progress is not None:
            progress((k + 1) / (len(_SECTIONS) + 1), heading, float("nan"))
        maps = heading == "The maps"
        if maps and not _maps_answer(model):
            continue
        content = _figures(study, names)
        if maps:
            content = _table(model, log) + content
        if content or (heading == "What is off" and texts[heading]):
            text = _html(texts[heading])
            sections.append(
                _filled("section.html", heading=heading, text=text, content=content)
            )
    page = _filled(
        "page.html",
        title=escape(model.about.robot or "An arm, learned from a log"),
        style=_file("page.css"),
        verdict=_html(verdict),
        cause=_html(words.largest_cause(study)),
        still=_html(words.still_true(study)),
        next=_html(words.next_step(study)),
        first=_figures(study, _FIRST),
        sections="".join(sections),
        facts="".join(
            _filled("fact.html", name=escape(name), value=_html(value))
            for name, value in facts(model).items()
        ),
        notes="".join(
            _filled("note.html", note=_html(note)) for note in model.about.notes
        ),
    )
    atomic_write(path, page.encode("utf-8"))
    return verdict


def figures(
    model: Model | Map | Association,
    log: Samples | None = None,
    names: Sequence[str] | None = None,
) -> dict[str, Any]:
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
        By name; without those that have nothing to show, such as a photo that is not there.

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
        if not isinstance(model, Model | Map | Association):
            raise OptionError(
                f"figures of {type(model).__name__}: expected a model, a map or an association",
                hint="`calib.load(path)` reads a model",
                parameter="model",
            )
        if not isinstance(model, Model):
            drawn: Mapping[str, Any] = draw_maps.figures_of_maps(model)
            _check_names(names, drawn)
        else:
            _check_names(names, PANELS)
            study = Study(model, log)
            drawn = {name: PANELS[name].draw(study) for name in names or PANELS}
    return {
        name: figure
        for name, figure in drawn.items()
        if figure is not None and (names is None or name in names)
    }


def _check_names(names: Sequence[str] | None, drawn: Mapping[str, Any]) -> None:
    for name in names or ():
        if name not in drawn:
            raise OptionError(
                f"`names`: {quoted(name)} is no figure",
                hint=suggestion(name, drawn),
                parameter="names",
                value=name,
            )


def _figures(study: Study, names: Sequence[str]) -> str:
    """Figures as HTML; "" for those that have nothing to show."""
    parts = []
    with settings():
        for name in names:
            panel = PANELS[name]
            figure = panel.draw(study)
            if figure is not None:
                svg = to_svg(figure, name, panel.caption)
                parts.append(
                    _filled("figure.html", name=name, svg=svg, caption=panel.caption)
                )
    return "".join(parts)


def _maps_answer(model: Model) -> bool:
    """Whether maps have a part in the answers."""
    return model.default_readout == "linear" or model.predictor.models.degree >= 0


def _table(model: Model, log: Samples | None) -> str:
    """Distances of all readouts, aligned at the point."""
    errors = model.about.errors if log is None else evaluate(model, log).errors
    readouts = [readout for readout in READOUTS if readout in errors]
    if not readouts:
        return ""
    table = {readout: errors[readout]["forward"]["distance"] for readout in readouts}
    factor, unit = unit_for(
        min(row["mean"] for row in table.values()), model.about.unit
    )
    rows = []
    for readout, row in table.items():
        cells = {key: f"{factor * row[key]:,.3f}" for key in ("mean", "p99", "max")}
        rows.append(_filled("row.html", name=readout, **cells))
    return _filled(
        "table.html", corner=escape(f"distance [{unit}]"), rows="".join(rows)
    )


def _html(text: str) -> str:
    """A text for the page; what stands in backticks is typed."""
    return _CODE.sub(r"<code>\1</code>", escape(text))


def _filled(file: str, /, **parts: str) -> str:
    """A template of this folder with its places filled."""
    return Template(_file(file)).substitute(parts)


def _file(name: str) -> str:
    return files(__package__).joinpath(name).read_text(encoding="utf-8")
