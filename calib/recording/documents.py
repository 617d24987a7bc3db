"""Documents: JSON and YAML as programs write them."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

from .pictures import package

Json = Any
"""A mapping, a list, a number or a text."""

# OpenCV's first line and tag of matrices, which no version of YAML has
_OF_OPENCV = r"\A%YAML.*|!!opencv-matrix"


def parse_document(text: str) -> Json:
    """The mapping or list of a JSON or YAML text.  Raises ValueError if it is neither."""
    with suppress(ValueError, RecursionError):
        return json.loads(text)
    yaml = package("yaml")
    # 1e-5 is a word in YAML
    text = re.sub(r"(?<![\w.])(\d+)(e[-+]\d+)\b", r"\1.0\2", text)
    text = re.sub(_OF_OPENCV, "", text)
    try:
        # they may repeat without end
        if any(
            isinstance(event, yaml.AliasEvent) for event in yaml.parse(text)
        ):
            raise ValueError("no YAML without aliases")
        documents = [*yaml.safe_load_all(text)]
    except (yaml.YAMLError, RecursionError) as error:
        raise ValueError(f"no YAML: {error}") from None
    # several are messages that ROS echoed
    document = documents[0] if len(documents) == 1 else documents
    if not isinstance(document, (dict, list)):
        raise ValueError("a text alone")
    return document


def values_of(document: Json, key: str) -> Iterator[Json]:
    """Values of a key, however deep it is in a document."""
    if isinstance(document, dict):
        if key in document:
            yield document[key]
        document = [*document.values()]
    if isinstance(document, list):
        for item in document:
            yield from values_of(item, key)
