"""Asking: what a query is of, as typed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Asking:
    """How a model is asked, one question or a table of them, as typed."""

    input_: str | None = None
    columns: Mapping[str, str] | None = None
    output: str | None = None
    unit: str | None = None
    degrees: bool = False
