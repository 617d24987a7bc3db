"""Page: the figures and tables of a report in one file that needs no network."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

from ...common.atomic import atomic_write
from ...common.choices import READOUTS
from ...common.wording import filled, length_in_words, quoted, suggestion
from ...errors import OptionError
from ...model.facts import facts, shown_errors
from ...model.model import Model
from ...samples.samples import Samples
from ...training.evaluate import Evaluation, Residuals, evaluate, evaluate_residuals
from .figures import by_socket, heat_maps, lattices, over_photo, settings, to_svg, u_matrices

# name: what the figure shows, how to read it, and what draws it, or None where there is nothing
_Draw = Callable[[Model, Residuals | None, Samples | None], Any]
SECTIONS: dict[str, tuple[str, str, _Draw]] = {
    "photo": (
        "The map over a photo",
        "The sensory map as the camera sees the arm, and where the tip was seen and is predicted.",
        lambda model, residuals, _: over_photo(model, residuals),
    ),
    "sockets": (
        "Scatter by socket",
        "Each dot is a touch: its distance should be the play of the socket alone.",
        lambda model, _, log: by_socket(model, log),
    ),
    "forward": (
        "Forward error: where is the tip?",
        "Mean distance between predicted and true position of the test samples in each cell, "
        "over the positions; in a plane also over the joints that they belong to.",
        lambda model, residuals, _: heat_maps(model, residuals, "forward"),
    ),
    "inverse": (
        "Inverse error: how to get there?",
        "Distance from each target to where the answered joints lead.",
        lambda model, residuals, _: heat_maps(model, residuals, "inverse"),
    ),
    "lattices": (
        "What was learned: both lattices",
        "Nodes of the motor map in the joint space and of the sensory map in the workspace, "
        "joined to their lattice neighbours and coloured by the expected error.",
        lambda model, *_: lattices(model),
    ),
    "nodes": (
        "U-matrix",
        "How far apart neighbouring nodes are: ridges are folds and borders.",
        lambda model, *_: u_matrices(model),
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
    found, about = evaluate(model, log), model.about
    robot = escape(about.robot or "An arm, learned from a log")
    items = (
        f"<dt>{escape(k)}</dt><dd>{escape(v.replace('`', ''))}</dd>"
        for k, v in facts(model).items()
    )
    source = f"On {found.rows:,} {found.source}"
    source += f"; {found.left_out:,} are left out." if found.left_out else "."
    parts = [
        f"<h1>{robot}</h1>",
        f'<p class="lead">{_verdict(model, found)}</p>',
        "<h2>What was learned from what</h2>",
        f"<dl>{''.join(items)}</dl>",
        *(_soft(f"Note: {note}") for note in (*about.notes, *found.notes)),
        "<h2>Errors</h2>",
        _soft(source),
        _errors(model, found.errors),
    ]
    for name, figure in _drawn(model, found, log, SECTIONS, paper=False).items():
        heading, text, _ = SECTIONS[name]
        caption = f"<figcaption>{escape(text)}</figcaption>"
        with settings():
            svg = to_svg(figure, name, heading)
        parts.append(f'<h2>{heading}</h2><figure id="{name}">{svg}{caption}</figure>')
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
        Which: "photo", "sockets", "forward", "inverse", "lattices", "nodes".

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
    return _drawn(model, evaluate(model, log), log, names, paper=True)


def _drawn(
    model: Model, found: Evaluation, log: Samples | None, names: Iterable[str], *, paper: bool
) -> dict[str, Any]:
    residuals, rows = found.residuals, model.rows
    if residuals is None and rows is not None:  # the model learned from them: still they tell where
        residuals = evaluate_residuals(model, rows.q, rows.x, None)
    with settings(paper=paper):
        drawn = {name: SECTIONS[name][2](model, residuals, log) for name in names}
    return {name: figure for name, figure in drawn.items() if figure is not None}


def _soft(text: str) -> str:
    return f'<p class="soft">{escape(text)}</p>'


def _table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    def line(tag: str, cells: Sequence[str]) -> str:
        return f"<tr>{''.join(f'<{tag}>{escape(cell)}</{tag}>' for cell in cells)}</tr>"

    body = "".join(line("td", row) for row in rows)
    return f'<div class="wide"><table>{line("th", header)}{body}</table></div>'


def _verdict(model: Model, found: Evaluation) -> str:
    def words(value: float) -> str:
        return escape(length_in_words(value, model.about.unit))

    errors = found.errors.get(model.default_readout)
    if not errors:
        return "No errors are known of this model."
    mean, most = (errors["forward"]["distance"][key] for key in ("mean", "p99"))
    text = f"The tip is predicted to <strong>{words(mean)}</strong> on average"
    text += f", to {words(most)} in 99 of 100"
    if covered := model.about.within.get("covered"):
        text += f"; the 95 % bound covered {100 * covered:.0f} % of them when it was made"
    if model.about.bound_of == "sensor reading":
        own = float(np.nanmedian(model.model_bounds[model.visited]))
        text += (
            f". That is the distance to noisy readings: the model's own error is below "
            f"<strong>{words(own)}</strong> (95 % bound, median over the range)"
        )
    return f"{text}."


def _errors(model: Model, errors: Mapping[str, Any]) -> str:
    readouts = [readout for readout in READOUTS if readout in errors]
    if not readouts:
        return ""

    def cell(values: Mapping[str, float] | None) -> str:
        if values is None:  # of orientations only some have it
            return ""
        mean, most = ("<1e-6" if values[k] < 1e-6 else f"{values[k]:.3g}" for k in ("mean", "max"))
        return f"{mean} ({most})"

    rows = [
        [f"{direction}, {name} [{unit}]", *(cell(found.get(readout)) for readout in readouts)]
        for direction, name, unit, found in shown_errors(model.about, errors)
    ]
    return _table(["mean (largest)", *readouts], rows)
