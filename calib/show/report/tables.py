"""Tables: errors, facts and earlier states as HTML."""

from __future__ import annotations

import html
import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from ...common.choices import READOUTS
from ...paper.published import TABLE1
from ..error_scale import length_in_words
from .style import plain_text

if TYPE_CHECKING:
    from ...model.about import About
    from .evidence import Evidence

PAPER_ARM = "two_link"


def table(header: Sequence[str], rows: Iterable[Sequence[str]], words: int = 1) -> str:
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
    units = dict(zip(about.joint_names, about.units_of_joints, strict=True))
    quantities = [
        ("forward", name, about.unit)
        for name in (*"xyz"[: len(errors[readouts[0]]["forward"]) - 1], "distance")
    ]
    quantities += [("inverse", name, unit) for name, unit in units.items()]
    quantities.append(("inverse", "distance", about.unit))
    rows = []
    for direction, name, unit in quantities:
        factor, shown = page_unit(unit)
        row = [f"{direction}, {name} [{shown}]"]
        for readout in readouts:
            entry = errors[readout][direction][name]
            row.append(f"{_digits(entry['mean'], factor)} ({_digits(entry['max'], factor)})")
        if paper:
            printed = paper.get(name)
            row.append(f"{printed.mean:g} ({printed.max:g})" if printed else "")
        rows.append(row)
    return table(header, rows)


def page_unit(unit: str) -> tuple[float, str]:
    """Factor from a unit to the one that people read, and its name."""
    named = {"m": (1e3, "mm"), "rad": (math.degrees(1.0), "deg")}
    return named.get(unit, (1.0, unit))


def figure_unit(unit: str) -> tuple[float, str]:
    """Return the same for a figure, in which a name is no formula."""
    factor, name = page_unit(unit)
    return factor, plain_text(name)


def is_papers_arm(about: About) -> bool:
    """Whether a model is of the arm that the paper's tables are compared with."""
    simulation = about.simulation or {}
    return about.robot == PAPER_ARM and bool(simulation) and not simulation.get("changes")


def _digits(value: float | None, factor: float) -> str:
    """Three digits of an error; what is below a millionth is rounding."""
    if value is None or not math.isfinite(value):
        return "unknown"
    return f"{value * factor:.3g}" if value * factor >= 1e-6 else "<1e-6"


def facts(evidence: Evidence) -> list[tuple[str, str]]:
    """Return what was learned from what."""
    model = evidence.model
    about = model.about
    options = about.options
    found = [("robot", about.robot or "none, learned from a log alone")]
    for k, name in enumerate(about.joint_names):
        low, high = float(about.lower[k]), float(about.upper[k])
        if about.revolute[k]:
            text = f"{math.degrees(low):.5g}° to {math.degrees(high):.5g}°"
        else:
            text = f"{1e3 * low:.5g} mm to {1e3 * high:.5g} mm"
        found.append((f"joint {name}", text))
    if about.tip:
        found.append(("tip", about.tip))
    if about.locked:
        held = ", ".join(f"{name} = {value:.5g}" for name, value in about.locked.items())
        found.append(("locked", held))
    if about.plane:
        axes = "; ".join(
            f"{key} ({', '.join(f'{v + 0.0:.4g}' for v in about.plane[key])})"
            for key in ("origin", "x", "y")
        )
        found.append(("plane", axes))
    found.append(("learned from", _source(evidence)))
    shapes = [("x".join(map(str, part.lattice.shape))) for part in (model.motor, model.sensory)]
    found.append(("maps", f"{options['map']}, motor {shapes[0]}, sensory {shapes[1]} nodes"))
    found.append(("training", f"{options['rule']} rule, seed {about.seed}"))
    found.append(("links", f"{model.links.nnz:,}"))
    found.append(("expected error", f"95 % bound on the distance to the {about.bound_of}"))
    return found


def fact_list(pairs: Iterable[tuple[str, str]]) -> str:
    """Return names and values as an HTML list."""
    items = "".join(
        f"<dt>{html.escape(name)}</dt><dd>{html.escape(value)}</dd>" for name, value in pairs
    )
    return f"<dl>{items}</dl>"


def _source(evidence: Evidence) -> str:
    about = evidence.model.about
    if about.simulation is None:
        return f"{about.samples:,} rows of a log"
    noise = about.simulation.get("noise") or 0.0
    parts = [f"{about.samples:,} simulated samples"]
    parts.append(f"sensor noise {length_in_words(noise, about.unit)}" if noise else "no noise")
    return ", ".join([*parts, *map(str, about.simulation.get("changes", ()))])
