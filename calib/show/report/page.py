"""Page: the figures and tables of a report in one file that needs no network."""

from __future__ import annotations

import html
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ...change.check import check
from ...common.templates import filled
from ...model.model import Model
from ...samples.samples import Samples
from ..error_scale import length_in_words
from ..facts import facts
from . import curves, maps, space
from .evidence import Evidence, gather
from .maps import over_photo
from .style import settings, to_png, to_svg
from .tables import adaptation_table, drift_text, errors_in_html, fact_list, is_papers_arm

_MEAN = {2: 1.2533, 3: 1.5958}  # mean distance over the standard deviation along an axis


class Section(NamedTuple):
    """A figure of the report."""

    name: str  # for its file and its place in the page
    title: str  # what it shows
    text: str  # how to read it
    draw: Callable[[Evidence], Any]  # draws it; None where there is nothing to draw


SECTIONS = (
    Section(
        "photo",
        "The map over a photo",
        "The sensory map as the camera sees the arm, and where the tip was seen and is predicted.",
        over_photo,
    ),
    Section(
        "forward",
        "Forward error: where is the tip?",
        "Mean distance between predicted and true position of the test samples in each cell, "
        "over the positions; in a plane also over the joints that they belong to.",
        lambda e: maps.heat_maps(e, "forward"),
    ),
    Section(
        "inverse",
        "Inverse error: how to get there?",
        "Distance from each target to where the answered joints lead.",
        lambda e: maps.heat_maps(e, "inverse"),
    ),
    Section(
        "vectors",
        "Residual vectors",
        "Measured minus predicted positions, enlarged. Arrows that "
        "point alike in one region are an error that is not noise.",
        space.residual_vectors,
    ),
    Section(
        "joints",
        "Error by joint",
        "Distance between predicted and measured position over the value of each joint: the mean "
        "and the 95 % quantile of each part of its range.",
        space.by_joint,
    ),
    Section(
        "curves",
        "Joint curves",
        "What a joint turns beyond its reading, with the 95 % interval, over the measured part of "
        "its range. Gears and encoders repeat such errors every turn.",
        space.joint_curves,
    ),
    Section(
        "histogram",
        "How large are the errors?",
        "An error left of the sensor's noise is smaller than what a single measurement shows.",
        curves.histogram,
    ),
    Section(
        "calibration",
        "How well does the expected error hold?",
        "Share of the test samples whose error is within a part of its 95 % bound. Where the lines "
        "cross the bound is exact; a curve above it has bounds that are larger than needed.",
        curves.calibration,
    ),
    Section(
        "lattices",
        "What was learned: both lattices",
        "Nodes of the motor map in the joint space and of the sensory map in the workspace, "
        "joined to their lattice neighbours and coloured by the expected error.",
        maps.lattices,
    ),
    Section(
        "nodes",
        "U-matrix and hits",
        "The U-matrix shows how far apart neighbouring nodes are: ridges are folds and borders. "
        "Hits are the training samples that each node won.",
        maps.node_maps,
    ),
    Section(
        "training",
        "Training",
        "Error and neighbourhood, epoch by epoch; dotted lines are where a finer lattice takes "
        "over.",
        curves.training,
    ),
)


def report(model: Model, samples: Samples | None = None) -> str:
    """Return a report of a model as a page.

    samples : a log to judge the model by; without it a simulated model is judged by fresh exact
        samples and a model of a log by its own table alone
    """
    evidence = gather(model, samples)
    about = model.about
    parts = [
        f"<h1>{html.escape(about.robot or 'An arm, learned from a log')}</h1>",
        _soft("What was learned, from which data, and how accurate it is."),
        f'<p class="lead">{_verdict(evidence)}</p>',
        _heading("What was learned from what"),
        fact_list({**facts(model), "links": f"{model.links.nnz:,}"}),
        *(_soft(f"Note: {note}") for note in about.notes),
        _heading("Errors"),
        _error_text(evidence),
        errors_in_html(evidence),
    ]
    if model.history:
        parts += [
            _heading("Before and after"),
            _soft("Earlier states of this model and what made it change."),
            adaptation_table(model.history, about.unit),
        ]
    if samples is not None:
        parts += [_heading("Does the log still fit?"), drift_text(check(model, samples))]
    with settings():
        for name, heading, text, draw in SECTIONS:
            if (figure := draw(evidence)) is not None:
                svg = to_svg(figure, name, heading)
                caption = f"<figcaption>{html.escape(text)}</figcaption>"
                parts += [_heading(heading), f'<figure id="{name}">{svg}{caption}</figure>']
    title = f"{html.escape(about.robot or 'log')}: calibration report"
    return filled(__package__, "page.html", title=title, body="\n".join(parts))


def pictures(model: Model, samples: Samples | None = None) -> dict[str, bytes]:
    """Return the figures of a report as PNG, by name."""
    evidence = gather(model, samples)
    with settings(paper=True):
        drawn = {section.name: section.draw(evidence) for section in SECTIONS}
        return {name: to_png(figure) for name, figure in drawn.items() if figure is not None}


def _heading(title: str) -> str:
    return f"<h2>{html.escape(title)}</h2>"


def _soft(text: str) -> str:
    return f'<p class="soft">{html.escape(text)}</p>'


def _verdict(evidence: Evidence) -> str:
    errors, unit = evidence.errors.get(evidence.model.default_readout), evidence.unit
    if not errors:
        return "No errors are known of this model."
    mean, most = (
        html.escape(length_in_words(errors["forward"]["distance"][key], unit))
        for key in ("mean", "p99")
    )
    text = f"The tip is predicted to <strong>{mean}</strong> on average"
    text += "" if mean == most else f", to {most} in 99 of 100 cases"
    if evidence.noise:
        reading = length_in_words(evidence.noise * _MEAN[len(evidence.model.axes)], unit)
        text += f"; a single reading of its sensor is off by {html.escape(reading)} on average"
    return f"{text}.{_own_error(evidence)}"


def _own_error(evidence: Evidence) -> str:
    """Of a log, what is the readings' noise and what the model's own error."""
    model, unit = evidence.model, evidence.unit
    if model.about.bound_of != "sensor reading" or model.body is None:
        return ""
    axes = len(model.axes)
    noise = float(np.sqrt(np.mean(model.body.noise[:axes] ** 2))) * _MEAN[axes]
    own = float(np.nanmedian(model.model_bounds[model.visited]))
    if not (np.isfinite(noise) and np.isfinite(own)):
        return ""
    return (
        " That is the distance to noisy readings: a reading is off by about "
        f"{html.escape(length_in_words(noise, unit))} on average (estimated), and the model's own "
        f"error is below <strong>{html.escape(length_in_words(own, unit))}</strong> (95 % bound, "
        "median over the learned range)."
    )


def _error_text(evidence: Evidence) -> str:
    text = f"On {evidence.source}."
    if evidence.left_out:
        text += f" {evidence.left_out:,} rows outside of what was learned are left out."
    if is_papers_arm(evidence.model.about):
        text += (
            " The paper's column is its Table 1 for a VDSOM of 70x70 nodes. Its link lengths and "
            "ranges are not known, so the columns are not of the same arm; its readout is the one "
            "that is called activity here."
        )
    if evidence.noise == 0.0:
        text += (
            " Without noise the body of an ideal arm is found exactly: judge by noisy or measured "
            "data."
        )
    return _soft(text)
