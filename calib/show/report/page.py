"""Page: a report that answers how accurate, what is off, where, why so, in one file offline."""

import re
from collections.abc import Callable, Iterator, Sequence
from html import escape
from typing import NamedTuple

from matplotlib.figure import Figure

from ...common.atomic import FilePath
from ...common.wording import (
    fill_template,
    number,
)
from ...errors import require
from ...maps.association import Association
from ...maps.map import Map
from ...model.about import error_statistics, facts
from ...model.model import Model
from ...recording.rig import HandEye, rig_of_model
from ...samples.samples import Samples
from ...training.options import Progress
from ..study import Study, studies_of
from . import figures as arm
from . import map_figures as maps
from . import rig_figures as rigs
from . import words
from .drawing import settings
from .html import figure_of, write_page


class Entry(NamedTuple):
    """A figure of a page."""

    heading: str  # of its section
    # of a study or a rig, None where there is nothing to show
    draw: Callable[..., Figure | None]
    caption: str


ARM = (
    Entry("", arm.accuracy, "How far predictions are from measured positions."),
    Entry(
        "",
        arm.causes,
        "What differs from the drawing, by how much it moves the tip; lines are 95 % intervals.",
    ),
    Entry(
        "What is off",
        arm.setup,
        "What stands around the arm and what it carries, to scale.",
    ),
    Entry(
        "Where",
        arm.where,
        "The model's own 95 % bound on the true position; dots are rows, in the colour of their "
        "error; crosses are rows that were left out.",
    ),
    Entry(
        "Where",
        arm.coverage,
        "Which part of each joint's range the rows covered.",
    ),
    Entry(
        "Where",
        arm.arrows,
        "From the predicted position to the measured one, a dot.",
    ),
    Entry(
        "Where",
        maps.photo,
        "The sensory map and the rows as the camera sees them.",
    ),
    Entry(
        "Why so",
        arm.joints,
        "What rows say of each joint if it alone errs (dots), the learned curve and its band.",
    ),
    Entry(
        "Why so",
        arm.order,
        "Drift and steps show as slopes; the line is a running median.",
    ),
    Entry(
        "The maps",
        maps.lattices,
        "Nodes joined to their neighbours on the lattice.",
    ),
    Entry(
        "The maps",
        maps.u_matrices,
        "Ridges are folds and borders of the map.",
    ),
)
RIG = (
    Entry("", rigs.setup, "Base, flange, cameras and board, to scale."),
    Entry(
        "The pictures",
        rigs.misses,
        "Each picture is predicted by a fit that did not see it.",
    ),
)
HEADINGS = ("", "What is off", "The pictures", "Where", "Why so", "The maps")


def report(
    model: Model | HandEye,
    path: FilePath,
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
    sections = dict.fromkeys(HEADINGS, "")

    # of a model of pictures first where camera and board are
    verdict = words.verdict(studies)
    rig = rig_of_model(model)
    if rig is not None:
        verdict = f"{verdict_of_rig(rig)} {verdict}"
        _add(sections, RIG[1:], rig)

    # the maps where answers are theirs, at least in part
    entries: Sequence[Entry] = ARM[:-2]
    linear = model.default_readout == "linear"
    if linear or model.predictor.models.degree >= 0:
        sections["The maps"] = _table(model)
        entries = ARM

    # what each sensor saw
    for k, study in enumerate(studies):
        if progress is not None:
            progress(k / len(studies), "figures", float("nan"))
        sensor = study.model.about.sensor
        label = f"{sensor}: " if len(studies) > 1 else ""
        _add(sections, entries, study, label)
    with_log = (study for study in studies if study.log is not None)
    judged = next(with_log, studies[0])
    others = [model_of_sensor.about for model_of_sensor in model.others]
    write_page(
        path,
        title=model.about.robot or "An arm, learned from a log",
        verdict=verdict,
        answers={
            "What is off": words.largest_cause(judged),
            "Still true?": words.still_true(judged),
            "Next": words.next_step(judged),
        },
        sections=sections,
        facts=facts(model.about, model.size_in_words, others),
        notes=model.notes,
    )
    return verdict


def figures(
    model: Model | HandEye | Map | Association,
    log: Samples | None = None,
) -> dict[str, Figure]:
    """Return the figures of a model, a map or an association, in colours for paper.

    Parameters
    ----------
    model : Model, HandEye, Map or Association
    log : Samples, optional
        A log to judge the model by, as in :func:`report`.

    Returns
    -------
    dict of matplotlib.figure.Figure
        By name; those of a second sensor are `where-2` and the like.

    Examples
    --------
    >>> import calib
    >>> model = calib.train(calib.babble(calib.load_arm("two_link"), 2000, seed=0), size=10)
    >>> list(calib.figures(model))[:3]
    ['accuracy', 'where', 'coverage']
    >>> list(calib.figures(model.association))
    ['lattices', 'u_matrices', 'links']
    """
    if isinstance(model, Map | Association):
        with settings():
            return maps.figures_of_maps(model)
    entries: Sequence[Entry] = RIG
    subjects: Sequence[Study | HandEye]
    if isinstance(model, HandEye):
        subjects = [model]
    else:
        require("model", model, Model)
        entries = ARM
        subjects = studies_of(model, log)
    return {
        name: figure
        for subject in subjects
        for _, name, figure in _filled_figures(entries, subject)
    }


def _filled_figures(
    entries: Sequence[Entry], subject: Study | HandEye
) -> Iterator[tuple[Entry, str, Figure]]:
    """Yield the figures that have something to show, with their names."""
    suffix = subject.suffix if isinstance(subject, Study) else ""
    with settings():
        for entry in entries:
            figure = entry.draw(subject)
            if figure is not None:
                yield entry, f"{entry.draw.__name__}{suffix}", figure


def _add(
    sections: dict[str, str],
    entries: Sequence[Entry],
    subject: Study | HandEye,
    label: str = "",
) -> None:
    """Add figures as HTML to the sections of a page."""
    for entry, name, figure in _filled_figures(entries, subject):
        content = figure_of(figure, name, f"{label}{entry.caption}")
        sections[entry.heading] += content


def _table(model: Model) -> str:
    """Forward errors of all readouts, aligned at the point."""
    if not model.about.errors:
        return ""
    statistics = error_statistics(model.about, model.about.errors)
    unit, distances = next(
        (unit, sizes)
        for direction, name, unit, sizes in statistics
        if (direction, name) == ("forward", "distance")
    )
    rows = []
    for readout, sizes in distances.items():
        cells = "</td><td>".join(f"{size:,.3f}" for size in sizes.values())
        rows.append(f"<tr><th>{readout}</th><td>{cells}</td></tr>")
    return fill_template(
        __package__, "table.html", unit=escape(unit), rows="\n".join(rows)
    )


def _report_rig(rig: HandEye, path: FilePath) -> str:
    """Write a report of a rig, and return its verdict in words."""
    sections = dict.fromkeys(HEADINGS, "")
    _add(sections, RIG, rig)
    verdict = verdict_of_rig(rig)
    square = rig.square
    interval = " to ".join(f"{1e3 * end:.2f}" for end in square["interval"])
    write_page(
        path,
        title=f"Hand-eye calibration: {rig.hand_item} in the hand",
        verdict=verdict,
        answers={
            "Limited by": rig.limited_by,
            "Held out": f"{number(rig.held_out['rms'])} px rms, of pictures that the fit did "
            "not see",
            "The arm": f"its poses scatter by {rig.repeats} (sd)",
            "A square": f"{interval} mm, {1e3 * square['said']:.2f} mm as stated",
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
    """The places of what is carried and of what is at rest, with intervals, in a sentence each."""
    sentences = []
    for line in rig.lines()[:2]:
        words = re.sub(r", quaternion \(.*\) ±", ", turned ±", line.strip())
        sentences.append(f"{words[0].upper()}{words[1:]}.")
    return " ".join(sentences)
