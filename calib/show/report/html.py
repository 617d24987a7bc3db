"""HTML: the pieces that pages of reports are filled from."""

import re
from collections.abc import Mapping
from html import escape

from matplotlib.figure import Figure

from ...common.atomic import FilePath, atomic_write
from ...common.wording import fill_template, number
from .drawing import to_svg


def write_page(
    path: FilePath,
    *,
    title: str,
    verdict: str,
    answers: Mapping[str, str],
    sections: Mapping[str, str],
    facts: Mapping[str, str],
    notes: tuple[str, ...],
) -> None:
    """Write a report: its answers, sections of figures, the first without a title, facts, notes."""
    divisions = []
    for heading, content in sections.items():
        title_of_section = f"<h2>{escape(heading)}</h2>\n" if heading else ""
        kind = "figures" if heading else "figures first"
        if content:
            divisions.append(
                f'{title_of_section}<div class="{kind}">{content}</div>\n'
            )
    page = fill_template(
        __package__,
        "page.html",
        title=escape(title),
        verdict=text_of(verdict),
        answers=_list(answers),
        sections="".join(divisions),
        facts=_list(facts),
        notes="".join(
            f'<p class="soft">{text_of(f"Note: {note}")}</p>\n'
            for note in notes
        ),
    )
    atomic_write(path, page.encode("utf-8"))


def figure_of(figure: Figure, name: str, caption: str) -> str:
    """A figure with its caption."""
    words = escape(caption)
    svg = to_svg(figure, name, words)
    return (
        f'<figure id="{name}">{svg}<figcaption>{words}</figcaption></figure>\n'
    )


def text_of(text: str) -> str:
    """A text for the page; code is in backticks, no number has an exponent."""
    text = re.sub(
        r"\d[\d.]*e[-+]\d+", lambda match: number(float(match[0]), 2), text
    )
    return re.sub(r"`([^`]*)`", r"<code>\1</code>", escape(text))


def _list(entries: Mapping[str, str]) -> str:
    """Names and what they are."""
    return "".join(
        f"<dt>{escape(name)}</dt><dd>{text_of(value)}</dd>\n"
        for name, value in entries.items()
    )
