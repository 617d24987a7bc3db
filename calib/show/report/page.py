"""Page: a report that answers how accurate, what is off, where, why so, in one file offline."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, TypeVar

from ...common.wording import (
    filled,
    number,
    quoted,
    sized,
    suggestion,
    unit_for,
)
from ...errors import OptionError, require
from ...maps.association import Association
from ...maps.map import Map
from ...model.facts import facts
from ...model.model import Model
from ...recording.rig import HandEye
from ...recording.rig_file import rig_of_model
from ...samples.samples import Samples
from ...training.learn import Progress
from ..study import Study, studies_of
from . import figures as arm
from . import map_figures as maps
from . import rig_figures as rigs
from . import words
from .drawing import settings
from .html import figure_of, paragraph, write_page

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_Subject = TypeVar("_Subject")
Captions = Mapping[Callable[[_Subject], "Figure | None"], str]
"""What draws a figure of a subject, None where there is nothing to show, and what it shows."""

ARM: dict[str, Captions[Study]] = {
    "": {
        arm.accuracy: "How far predictions are from measured positions.",
        arm.causes: "What differs from the drawing, by how much it moves the tip; lines are "
        "95 % intervals.",
    },
    "What is off": {
        arm.setup: "What stands around the arm and what it carries, to scale.",
    },
    "Where": {
        arm.where: "The model's own 95 % bound on the true position; dots are rows, in the "
        "colour of their error; crosses are rows that were left out.",
        arm.coverage: "Which part of each joint's range the rows covered.",
        arm.arrows: "From the predicted position to the measured one, a dot.",
        maps.photo: "The sensory map and the rows as the camera sees them.",
    },
    "Why so": {
        arm.joints: "What rows say of each joint's own error (dots), the learned error curve "
        "and its band.",
        arm.order: "Drift and steps show as slopes; the line is a running median.",
        arm.trust: "A bound that holds follows the diagonal or lies above it; grey is what "
        "chance does.",
    },
    "The maps": {
        maps.lattices: "Nodes joined to their neighbours on the lattice.",
        maps.u_matrices: "Ridges are folds and borders of the map.",
    },
}
"""Figures of an arm, by section."""

RIG: dict[str, Captions[HandEye]] = {
    "": {
        rigs.setup: "Base, flange, cameras and board, to scale.",
    },
    "The pictures": {
        rigs.misses: "Each picture is predicted by a fit that did not see it.",
        rigs.corners: "Corners over a picture that the fit did not see.",
    },
}


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
        return _report_rig(model, path)
    require("model", model, Model)
    studies = studies_of(model, log)
    study = next((one for one in studies if one.log is not None), studies[0])
    verdict = words.verdict(studies)
    sections = {"": "", "What is off": paragraph(words.uncertain(study))}
    rig = rig_of_model(model)
    with settings():
        if rig is not None:
            verdict = f"{verdict_of_rig(rig)} {verdict}"
            sections["The pictures"] = _html(RIG["The pictures"], rig)
        for done, (heading, captions) in enumerate(ARM.items()):
            if progress is not None:
                progress(done / len(ARM), heading, float("nan"))
            for one in studies:
                sensor = one.model.about.sensor
                label = f"{sensor}: " if len(studies) > 1 else ""
                content = _html(captions, one, one.suffix, label)
                sections[heading] = sections.get(heading, "") + content
    if model.default_readout == "linear" or model.predictor.models.degree >= 0:
        sections["The maps"] += _table(model)
    else:
        del sections["The maps"]
    write_page(
        path,
        title=model.about.robot or "An arm, learned from a log",
        verdict=verdict,
        answers={
            "What is off": words.largest_cause(study),
            "Still true?": words.still_true(study),
            "Next": words.next_step(study),
        },
        sections=sections,
        facts=facts(model),
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
    with settings():
        if isinstance(model, Map | Association):
            drawn = maps.figures_of_maps(model)
            chosen = _checked(names, drawn)
            return {name: drawn[name] for name in chosen}
        if isinstance(model, HandEye):
            chosen = _checked(names, _names(RIG))
            return _figures(RIG, model, chosen)
        require("model", model, Model)
        chosen = _checked(names, _names(ARM))
        drawn = {}
        for study in studies_of(model, log):
            drawn |= _figures(ARM, study, chosen, study.suffix)
        return drawn


def _names(sections: Mapping[str, Captions[_Subject]]) -> list[str]:
    return [
        draw.__name__ for captions in sections.values() for draw in captions
    ]


def _checked(
    names: Sequence[str] | None, there: Iterable[str]
) -> Sequence[str]:
    """Names of figures, all that there are by default."""
    known = list(there)
    for name in names or ():
        if name not in known:
            raise OptionError(
                f"`names`: {quoted(name)} is no figure",
                hint=suggestion(name, known),
                parameter="names",
                value=name,
            )
    return known if names is None else names


def _figures(
    sections: Mapping[str, Captions[_Subject]],
    subject: _Subject,
    names: Sequence[str],
    suffix: str = "",
) -> dict[str, Figure]:
    """Figures by name, of those that have something to show."""
    drawn = {}
    for captions in sections.values():
        for draw in captions:
            figure = draw(subject) if draw.__name__ in names else None
            if figure is not None:
                drawn[draw.__name__ + suffix] = figure
    return drawn


def _html(
    captions: Captions[_Subject],
    subject: _Subject,
    suffix: str = "",
    label: str = "",
) -> str:
    """Figures as HTML; "" for those that have nothing to show."""
    parts = []
    for draw, caption in captions.items():
        name = draw.__name__ + suffix
        parts.append(figure_of(draw(subject), name, f"{label}{caption}"))
    return "".join(parts)


def _table(model: Model) -> str:
    """Distances of all readouts, aligned at the point."""
    distances = {
        readout: directions["forward"]["distance"]
        for readout, directions in model.about.errors.items()
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
        cells = "</td><td>".join(values)
        rows.append(f"<tr><th>{readout}</th><td>{cells}</td></tr>")
    return filled(
        __package__, "table.html", unit=escape(unit), rows="\n".join(rows)
    )


def _report_rig(rig: HandEye, path: str | os.PathLike[str]) -> str:
    """Write a report of a rig, and return its verdict in words."""
    with settings():
        sections = {
            heading: _html(captions, rig) for heading, captions in RIG.items()
        }
    verdict = verdict_of_rig(rig)
    spread = rig.repeatability
    square = rig.square
    interval = " to ".join(number(1e3 * end, 4) for end in square["interval"])
    write_page(
        path,
        title=f"Hand-eye calibration: {rig.carried} in the hand",
        verdict=verdict,
        answers={
            "Limited by": rig.limited_by,
            "Held out": f"{number(rig.held_out['rms'])} px rms, of pictures that the fit did "
            "not see",
            "The arm": f"its poses scatter by {sized(spread['position'], 'm')} and "
            f"{sized(spread['rotation'], 'rad')} (sd)",
            "A square": f"{interval} mm, {number(1e3 * square['said'], 4)} mm as stated",
        },
        sections=sections,
        facts={
            "pictures": f"{rig.used} of {rig.pictures}",
            "left out": ", ".join(rig.left_out) or "none",
            "board": str(rig.board["text"]),
        },
        notes=rig.notes,
    )
    return verdict


def verdict_of_rig(rig: HandEye) -> str:
    """Where what is carried and what stands still are, with intervals, in a sentence each."""
    sentences = []
    for line in rig.lines()[:2]:
        words = re.sub(r", quaternion \(.*\) ±", ", turned ±", line.strip())
        sentences.append(f"{words[0].upper()}{words[1:]}.")
    return " ".join(sentences)
