"""Page: the figures and tables of a report in one file that needs no network."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

from ...change.check import check
from ...common.atomic import atomic_write
from ...common.choices import READOUTS
from ...common.templates import filled
from ...common.wording import length_in_words, quoted, suggestion
from ...errors import OptionError
from ...model.facts import facts, shown_errors
from ...model.model import Model
from ...samples.samples import Samples
from . import curves, maps
from .drawing import settings, to_svg
from .evidence import Evidence, gather

_MEAN = {2: 1.2533, 3: 1.5958}  # mean distance over the standard deviation along an axis

# name: what the figure shows, how to read it, and what draws it, or None where there is nothing
SECTIONS: dict[str, tuple[str, str, Callable[[Evidence], Any]]] = {
    "photo": (
        "The map over a photo",
        "The sensory map as the camera sees the arm, and where the tip was seen and is predicted.",
        maps.over_photo,
    ),
    "sockets": (
        "Scatter by socket",
        "Each dot is a touch: its distance from the mean of all tips in that socket, which should "
        "be the play of the socket alone.",
        curves.by_socket,
    ),
    "forward": (
        "Forward error: where is the tip?",
        "Mean distance between predicted and true position of the test samples in each cell, "
        "over the positions; in a plane also over the joints that they belong to.",
        lambda e: maps.heat_maps(e, "forward"),
    ),
    "inverse": (
        "Inverse error: how to get there?",
        "Distance from each target to where the answered joints lead.",
        lambda e: maps.heat_maps(e, "inverse"),
    ),
    "curves": (
        "Joint curves",
        "What a joint turns beyond its reading, with the 95 % interval, over the measured part of "
        "its range. Gears and encoders repeat such errors every turn.",
        curves.joint_curves,
    ),
    "lattices": (
        "What was learned: both lattices",
        "Nodes of the motor map in the joint space and of the sensory map in the workspace, "
        "joined to their lattice neighbours and coloured by the expected error.",
        maps.lattices,
    ),
    "nodes": (
        "U-matrix and hits",
        "The U-matrix shows how far apart neighbouring nodes are: ridges are folds and borders. "
        "Hits are the training samples that each node won.",
        maps.node_maps,
    ),
    "training": (
        "Training",
        "Error and neighbourhood by epoch; dotted lines are where a finer lattice takes over.",
        curves.training,
    ),
}


def report(model: Model, path: str | os.PathLike[str], log: Samples | None = None) -> None:
    """Write a report of a model, figures and tables, as one HTML file that needs no network.

    Parameters
    ----------
    model : Model
    path : path-like
        The file, written whole or not at all.
    log : Samples, optional
        A log to judge the model by.  Without it a simulated model is judged by fresh exact
        samples, and a model of a log by its own table of held-out rows.

    Examples
    --------
    >>> import calib, os, tempfile
    >>> model = calib.train(calib.babble(calib.load_arm("two_link"), 2000, seed=0), size=10)
    >>> path = os.path.join(tempfile.mkdtemp(), "report.html")
    >>> calib.report(model, path)
    >>> os.path.getsize(path) > 100_000
    True
    """
    evidence, about = gather(model, log), model.about
    robot = escape(about.robot or "An arm, learned from a log")
    listed = {**facts(model), "links": f"{model.links.nnz:,}"}
    items = (
        f"<dt>{escape(k)}</dt><dd>{escape(v.replace('`', ''))}</dd>" for k, v in listed.items()
    )
    parts = [
        f"<h1>{robot}</h1>",
        f'<p class="lead">{_verdict(evidence)}</p>',
        _heading("What was learned from what"),
        f"<dl>{''.join(items)}</dl>",
        *(_soft(f"Note: {note}") for note in about.notes),
        _heading("Errors"),
        _soft(f"On {evidence.source}."),
        _errors(evidence),
    ]
    if log is not None:
        parts += [_heading("Does the log still fit?"), _drift(model, log)]
    with settings():
        for name, (heading, text, draw) in SECTIONS.items():
            if (figure := draw(evidence)) is not None:
                svg = to_svg(figure, name, heading)
                caption = f"<figcaption>{escape(text)}</figcaption>"
                parts += [_heading(heading), f'<figure id="{name}">{svg}{caption}</figure>']
    title = f"{robot}: calibration report"
    page = filled(__package__, "page.html", title=title, body="\n".join(parts))
    atomic_write(path, page.encode("utf-8"))


def figures(
    model: Model, log: Samples | None = None, names: Sequence[str] = tuple(SECTIONS)
) -> dict[str, Any]:
    """Return the figures of a report as Matplotlib figures, in the ink of paper.

    Parameters
    ----------
    model : Model
    log : Samples, optional
        A log to judge the model by, as in :func:`report`.
    names : sequence of str
        Which: "photo", "sockets", "forward", "inverse", "curves", "lattices", "nodes", "training".

    Returns
    -------
    dict of matplotlib.figure.Figure
        By name; without those that have nothing to show, such as a photo that is not there.

    Examples
    --------
    >>> import calib
    >>> model = calib.train(calib.babble(calib.load_arm("two_link"), 2000, seed=0), size=10)
    >>> list(calib.figures(model, names=["forward", "photo"]))
    ['forward']
    """
    for name in names:
        if name not in SECTIONS:
            raise OptionError(
                f"`names`: {quoted(name)} is no figure",
                hint=suggestion(name, SECTIONS),
                parameter="names",
                value=name,
            )
    evidence = gather(model, log)
    with settings(paper=True):
        drawn = {name: SECTIONS[name][2](evidence) for name in names}
    return {name: figure for name, figure in drawn.items() if figure is not None}


def _heading(title: str) -> str:
    return f"<h2>{escape(title)}</h2>"


def _soft(text: str) -> str:
    return f'<p class="soft">{escape(text)}</p>'


def _table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return an HTML table; the first column holds words, the others numbers."""

    def line(tag: str, cells: Sequence[str]) -> str:
        first, *others = map(escape, cells)
        numbers = "".join(f"<{tag} class=number>{cell}</{tag}>" for cell in others)
        return f"<tr><{tag}>{first}</{tag}>{numbers}</tr>"

    body, head = "".join(line("td", row) for row in rows), line("th", header)
    return f'<div class="wide"><table><thead>{head}</thead><tbody>{body}</tbody></table></div>'


def _verdict(evidence: Evidence) -> str:
    model, errors = evidence.model, evidence.errors.get(evidence.model.default_readout)
    if not errors:
        return "No errors are known of this model."
    axes = len(model.axes)

    def words(value: float) -> str:
        return escape(length_in_words(value, evidence.unit))

    mean, most = (errors["forward"]["distance"][key] for key in ("mean", "p99"))
    text = f"The tip is predicted to <strong>{words(mean)}</strong> on average"
    text += "" if mean == most else f", to {words(most)} in 99 of 100"
    if covered := model.about.within.get("covered"):
        text += f"; the 95 % bound covered {100 * covered:.0f} % of them when it was made"
    if evidence.noise:
        reading = words(evidence.noise * _MEAN[axes])
        text += f"; a single reading of its sensor is off by {reading} on average"
    elif model.about.bound_of == "sensor reading" and model.body is not None:
        noise = float(np.sqrt(np.mean(model.body.noise[:axes] ** 2))) * _MEAN[axes]
        own = float(np.nanmedian(model.model_bounds[model.visited]))
        text += (
            f". That is the distance to noisy readings, each off by about {words(noise)} "
            f"on average (estimated): the model's own error is below <strong>{words(own)}</strong> "
            "(95 % bound, median over the range)"
        )
    return f"{text}."


def _errors(evidence: Evidence) -> str:
    readouts = [r for r in READOUTS if r in evidence.errors]
    if not readouts:
        return ""

    def cell(values: Mapping[str, float] | None) -> str:
        if values is None:  # of orientations only some have it
            return ""
        mean, most = ("<1e-6" if values[k] < 1e-6 else f"{values[k]:.3g}" for k in ("mean", "max"))
        return f"{mean} ({most})"

    rows = [
        [f"{direction}, {name} [{unit}]", *(cell(found.get(readout)) for readout in readouts)]
        for direction, name, unit, found in shown_errors(evidence.model.about, evidence.errors)
    ]
    return _table(["mean (largest)", *readouts], rows)


def _drift(model: Model, log: Samples) -> str:
    found = check(model, log)
    verdict = "It has drifted." if found.drifted else "No drift was found."
    rows = [
        [name, f"{signal.value:.3g}", f"{signal.threshold:.3g}", f"{signal.score:.2f}"]
        for name, signal in found.distortion.items()
    ]
    header = ["distortion", "value", "threshold", "value over threshold"]
    told = "".join(map(_soft, found.explanations))
    counted = f"{found.samples:,} rows were compared, {found.outliers:,} outliers were left out."
    return f"<p>{verdict} {counted}</p>{told}{_table(header, rows)}"
