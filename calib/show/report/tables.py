"""Tables: errors, facts and earlier states as HTML."""

from __future__ import annotations

import html
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from ...change.check import Drift
from ...common.choices import READOUTS
from ...common.wording import for_people
from ...model.about import About
from ...paper.published import TABLE1
from ..error_scale import length_in_words
from ..facts import shown_errors
from .evidence import Evidence
from .style import plain_text

_PAPER_ARM = "two_link"


def _table(header: Sequence[str], rows: Iterable[Sequence[str]], words: int = 1) -> str:
    """Return an HTML table; the first `words` columns hold words, the others numbers."""

    def line(tag: str, cells: Sequence[str]) -> str:
        parts = [
            f"<{tag}{'' if k < words else ' class=number'}>{html.escape(cell)}</{tag}>"
            for k, cell in enumerate(cells)
        ]
        return f"<tr>{''.join(parts)}</tr>"

    body = "".join(line("td", row) for row in rows)
    return (
        f'<div class="wide"><table><thead>{line("th", header)}</thead>'
        f"<tbody>{body}</tbody></table></div>"
    )


def errors_in_html(evidence: Evidence) -> str:
    """Return mean and largest errors of each readout, with the paper's where they compare."""
    about, errors = evidence.model.about, evidence.errors
    readouts = [r for r in READOUTS if r in errors]
    paper = TABLE1["vdsom"] if is_papers_arm(about) else {}
    header = ["mean (largest)", *readouts, *(["paper"] if paper else [])]
    rows = []
    for direction, name, unit, found in shown_errors(about, errors):
        row = [f"{direction}, {name} [{unit}]"]
        for readout in readouts:  # of orientations only some have it
            values = found.get(readout)
            row.append(f"{_digits(values['mean'])} ({_digits(values['max'])})" if values else "")
        if paper:
            printed = paper.get(name)
            row.append(f"{printed.mean:g} ({printed.max:g})" if printed else "")
        rows.append(row)
    return _table(header, rows)


def figure_unit(unit: str) -> tuple[float, str]:
    """Return `for_people` for a figure, in which a name is no formula."""
    factor, name = for_people(unit)
    return factor, plain_text(name)


def is_papers_arm(about: About) -> bool:
    """Whether a model is of the arm that the paper's tables are compared with."""
    simulation = about.simulation or {}
    return about.robot == _PAPER_ARM and bool(simulation) and not simulation.get("changes")


def _digits(value: float) -> str:
    """Three digits of an error; what is below a millionth is rounding."""
    if not math.isfinite(value):
        return "unknown"
    return f"{value:.3g}" if value >= 1e-6 else "<1e-6"


def fact_list(facts: Mapping[str, str]) -> str:
    """Return names and values as an HTML list."""
    items = "".join(
        f"<dt>{html.escape(name)}</dt><dd>{html.escape(value)}</dd>"
        for name, value in facts.items()
    )
    return f"<dl>{items}</dl>"


def adaptation_table(history: Sequence[Mapping[str, Any]], unit: str) -> str:
    """Return mean (largest) distances before and after each adaptation, "" where none tells."""
    rows = []
    for state in history:
        before, after = state.get("before"), state.get("after")
        if not isinstance(before, Mapping) or not isinstance(after, Mapping):
            continue
        cells = [str(state.get("method", "")), f"{state.get('samples', '')}"]
        for errors in (before, after):
            mean, most = (
                length_in_words(float(errors.get(key) or 0.0), unit) for key in ("mean", "max")
            )
            cells.append(f"{mean} ({most})")
        rows.append(cells)
    if not rows:
        return ""
    return _table(["adapted by", "rows", "before: mean (largest)", "after: mean (largest)"], rows)


def drift_text(drift: Drift) -> str:
    """Return what the log that was given says: drifted or not, each signal, the causes."""
    verdict = "It has drifted." if drift.drifted else "No drift was found."
    told = "".join(f'<p class="soft">{html.escape(text)}</p>' for text in drift.explanations)
    rows = [
        [name, f"{signal.value:.3g}", f"{signal.threshold:.3g}", f"{signal.score:.2f}"]
        for name, signal in drift.distortion.items()
    ]
    header = ["distortion", "value", "threshold", "value over threshold"]
    return (
        f"<p>{verdict} {drift.samples:,} rows were compared, {drift.outliers:,} outliers "
        f"were left out.</p>{told}{_table(header, rows)}"
    )
