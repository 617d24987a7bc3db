"""The text of an XML document with other attributes in some tags; all else stays as it was."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

_TAG = re.compile(rb"<(?:[^\"'>]|\"[^\"]*\"|'[^']*')*>")

Edit = tuple[int, int, str]
"""Where a part of the text begins and ends [bytes], and what stands there instead."""


@dataclass(frozen=True)
class Tag:
    """The start of an element in a text."""

    path: tuple[
        str, ...
    ]  # names of the elements around it, from the root on, and its own
    attributes: Mapping[str, str]
    begin: int  # [bytes]
    end: int
    is_empty: bool  # whether it closes itself

    def with_attributes(self, attributes: Mapping[str, str]) -> Edit:
        """Return the edit that gives the tag these attributes and no others."""
        return (
            self.begin,
            self.end,
            tag_text(self.path[-1], attributes, self.is_empty),
        )

    def followed_by(self, text: str) -> Edit:
        """Return the edit that puts a text behind the tag."""
        return self.end, self.end, text


def tag_text(
    name: str, attributes: Mapping[str, str], is_empty: bool = True
) -> str:
    """Return the text of a tag."""
    parts = [f"{key}={quoteattr(value)}" for key, value in attributes.items()]
    return f"<{' '.join([name, *parts])}{'/' if is_empty else ''}>"


def tags_of(text: str) -> list[Tag]:
    """Return the start tags of a document, in its order."""
    data = text.encode()
    path: list[str] = []
    tags: list[Tag] = []
    reader = expat.ParserCreate("utf-8")

    def start(name: str, attributes: dict[str, str]) -> None:
        path.append(name)
        begin = reader.CurrentByteIndex
        match = _TAG.match(data, begin)
        assert match is not None  # noqa: S101 - expat found a tag here
        is_empty = match[0].endswith(b"/>")
        tags.append(Tag(tuple(path), attributes, begin, match.end(), is_empty))

    reader.StartElementHandler = start
    reader.EndElementHandler = lambda _: path.pop()
    reader.Parse(data, True)
    return tags


def edited(text: str, edits: Iterable[Edit]) -> str:
    """Return the text with parts of it replaced."""
    data = text.encode()
    for begin, end, replacement in sorted(edits, reverse=True):
        data = data[:begin] + replacement.encode() + data[end:]
    return data.decode()


def numbers(values: Iterable[float]) -> str:
    """Return numbers of an attribute, in full."""
    return " ".join(repr(float(value) + 0.0) for value in values)
