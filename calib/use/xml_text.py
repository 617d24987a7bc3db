"""The text of an XML document with other attributes in some tags; all else stays as it was."""

import re
from collections.abc import Iterable, Mapping
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

_TAG = re.compile(rb"<([^\s/>]+)(?:[^\"'>]|\"[^\"]*\"|'[^']*')*>")

Attributes = Mapping[str, str]


def edited(text: str, tags: Mapping[int, tuple[Attributes, str]]) -> str:
    """Return the text where some start tags have these attributes, and a text behind them.

    tags : by the number of the element, in the order of the text
    """
    data = text.encode()
    begins: list[int] = []
    reader = expat.ParserCreate("utf-8")
    reader.StartElementHandler = lambda *_: begins.append(
        reader.CurrentByteIndex
    )
    reader.Parse(data, True)
    for number in sorted(tags, reverse=True):
        attributes, behind = tags[number]
        old = _TAG.match(data, begins[number])
        assert old is not None  # noqa: S101 - expat found a tag here
        end = "/>" if old[0].endswith(b"/>") else ">"
        new = start_of_tag(old[1].decode(), attributes) + end + behind
        data = data[: old.start()] + new.encode() + data[old.end() :]
    return data.decode()


def start_of_tag(name: str, attributes: Attributes) -> str:
    """Return the text of a tag but for its end."""
    parts = [f"{key}={quoteattr(value)}" for key, value in attributes.items()]
    return " ".join([f"<{name}", *parts])


def numbers(values: Iterable[float]) -> str:
    """Return numbers of an attribute, in full."""
    return " ".join(repr(float(value) + 0.0) for value in values)
