"""Page: the figures and tables of a report in one file that needs no network."""

from __future__ import annotations

import html
import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

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


class _Section(NamedTuple):
    title: str  # what the figure shows
    text: str  # how to read it
    draw: Callable[[Evidence], Any]  # draws it; None where there is nothing to draw


SECTIONS = {
    "photo": _Section(
        "The map over a photo",
        "The sensory map as the camera sees the arm, and where the tip was seen and is predicted.",
        maps.over_photo,
    ),
    "forward": _Section(
        "Forward error: where is the tip?",
        "Mean distance between predicted and true position of the test samples in each cell, "
        "over the positions; in a plane also over the joints that they belong to.",
        lambda e: maps.heat_maps(e, "forward"),
    ),
    "inverse": _Section(
        "Inverse error: how to get there?",
        "Distance from each target to where the answered joints lead.",
        lambda e: maps.heat_maps(e, "inverse"),
    ),
    "joints": _Section(
        "Error by joint",
        "Distance between predicted and measured position over the value of each joint: the mean "
        "and the 95 % quantile of each part of its range.",
        curves.by_joint,
    ),
    "curves": _Section(
        "Joint curves",
        "What a joint turns beyond its reading, with the 95 % interval, over the measured part of "
        "its range. Gears and encoders repeat such errors every turn.",
        curves.joint_curves,
    ),
    "histogram": _Section(
        "How large are the errors?",
        "An error left of the sensor's noise is smaller than what a single measurement shows.",
        curves.histogram,
    ),
    "lattices": _Section(
        "What was learned: both lattices",
        "Nodes of the motor map in the joint space and of the sensory map in the workspace, "
        "joined to their lattice neighbours and coloured by the expected error.",
        maps.lattices,
    ),
    "nodes": _Section(
        "U-matrix and hits",
        "The U-matrix shows how far apart neighbouring nodes are: ridges are folds and borders. "
        "Hits are the training samples that each node won.",
        maps.node_maps,
    ),
    "training": _Section(
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
    parts = [
        f"<h1>{html.escape(about.robot or 'An arm, learned from a log')}</h1>",
        _soft("What was learned, from which data, and how accurate it is."),
        f'<p class="lead">{_verdict(evidence)}</p>',
        _heading("What was learned from what"),
        _list({**facts(model), "links": f"{model.links.nnz:,}"}),
        *(_soft(f"Note: {note}") for note in about.notes),
        _heading("Errors"),
        _soft(f"On {evidence.source}."),
        _errors(evidence),
    ]
    if model.history:
        parts += [_heading("Before and after"), _states(model.history, about.unit)]
    if log is not None:
        parts += [_heading("Does the log still fit?"), _drift(model, log)]
    with settings():
        for name, (heading, text, draw) in SECTIONS.items():
            if (figure := draw(evidence)) is not None:
                svg = to_svg(figure, name, heading)
                caption = f"<figcaption>{html.escape(text)}</figcaption>"
                parts += [_heading(heading), f'<figure id="{name}">{svg}{caption}</figure>']
    title = f"{html.escape(about.robot or 'log')}: calibration report"
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
        Which: "photo", "forward", "inverse", "joints", "curves", "histogram", "lattices",
        "nodes", "training".

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
        drawn = {name: SECTIONS[name].draw(evidence) for name in names}
    return {name: figure for name, figure in drawn.items() if figure is not None}


def _heading(title: str) -> str:
    return f"<h2>{html.escape(title)}</h2>"


def _soft(text: str) -> str:
    return f'<p class="soft">{html.escape(text)}</p>'


def _list(items: Mapping[str, str]) -> str:
    rows = (
        f"<dt>{html.escape(k)}</dt><dd>{html.escape(v.replace('`', ''))}</dd>"
        for k, v in items.items()
    )
    return f"<dl>{''.join(rows)}</dl>"


def _table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return an HTML table; the first column holds words, the others numbers."""

    def line(tag: str, cells: Sequence[str]) -> str:
        kinds = ["", *[" class=number"] * (len(cells) - 1)]
        parts = zip(kinds, map(html.escape, cells), strict=True)
        return f"<tr>{''.join(f'<{tag}{kind}>{cell}</{tag}>' for kind, cell in parts)}</tr>"

    body = "".join(line("td", row) for row in rows)
    head = line("th", header)
    return f'<div class="wide"><table><thead>{head}</thead><tbody>{body}</tbody></table></div>'


def _verdict(evidence: Evidence) -> str:
    model, unit = evidence.model, evidence.unit
    errors, axes = evidence.errors.get(model.default_readout), len(model.axes)
    if not errors:
        return "No errors are known of this model."

    def strong(value: float) -> str:
        return f"<strong>{html.escape(length_in_words(value, unit))}</strong>"

    mean, most = (errors["forward"]["distance"][key] for key in ("mean", "p99"))
    text = f"The tip is predicted to {strong(mean)} on average"
    text += "" if mean == most else f", to {html.escape(length_in_words(most, unit))} in 99 of 100"
    if covered := model.about.within.get("covered"):
        text += f"; the 95 % bound covered {100 * covered:.0f} % of them when it was made"
    if evidence.noise:
        reading = html.escape(length_in_words(evidence.noise * _MEAN[axes], unit))
        text += f"; a single reading of its sensor is off by {reading} on average"
    if model.about.bound_of != "sensor reading" or model.body is None:
        return f"{text}."
    noise = float(np.sqrt(np.mean(model.body.noise[:axes] ** 2))) * _MEAN[axes]
    own = float(np.nanmedian(model.model_bounds[model.visited]))
    if not (math.isfinite(noise) and math.isfinite(own)):
        return f"{text}."
    return (
        f"{text}. That is the distance to noisy readings: a reading is off by about "
        f"{html.escape(length_in_words(noise, unit))} on average (estimated), and the model's own "
        f"error is below {strong(own)} (95 % bound, median over the learned range)."
    )


def _errors(evidence: Evidence) -> str:
    """Return mean and largest errors of each readout."""

    def cell(values: Mapping[str, float] | None) -> str:
        if values is None:  # of orientations only some have it
            return ""
        return "{} ({})".format(
            *(
                f"{v:.3g}" if v >= 1e-6 else "<1e-6" if math.isfinite(v) else "unknown"
                for v in (values["mean"], values["max"])
            )
        )

    readouts = [r for r in READOUTS if r in evidence.errors]
    if not readouts:
        return ""
    rows = [
        [f"{direction}, {name} [{unit}]", *(cell(found.get(readout)) for readout in readouts)]
        for direction, name, unit, found in shown_errors(evidence.model.about, evidence.errors)
    ]
    return _table(["mean (largest)", *readouts], rows)


def _states(history: Sequence[Mapping[str, Any]], unit: str) -> str:
    """Return mean distances before and after each adaptation, a line each."""
    told = []
    for state in history:
        errors = [state.get("before"), state.get("after")]
        if all(isinstance(each, Mapping) for each in errors):
            before, after = (length_in_words(float(each["mean"]), unit) for each in errors if each)
            rows = f"{state.get('samples', '')} rows ({state.get('method', '')})"
            told.append(_soft(f"Adapted with {rows}: {before} before, {after} after, on average."))
    return "".join(told)


def _drift(model: Model, log: Samples) -> str:
    """Return what a log says: drifted or not, the causes, each signal."""
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
