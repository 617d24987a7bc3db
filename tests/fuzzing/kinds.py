"""Kinds: what is fuzzed. Each makes an input from a seed and judges what calib did with it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from importlib import import_module
from pathlib import Path
from random import Random
from typing import Any


class Kind(ABC):
    """One kind of input; what all of its inputs share is kept in `folder`, which is empty."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @abstractmethod
    def make(self, rng: Random) -> Any:
        """Make an input; the same generator makes the same one."""

    @abstractmethod
    def judge(self, case: Any) -> str:
        """Give it to calib; what became of it, in a few words, AssertionError if it must not."""

    def close(self) -> None:  # noqa: B027 - most kinds share nothing
        """Let go of what is shared."""


KINDS = {
    "arm": ("urdfs", "Arms"),
    "urdf": ("urdfs", "Urdfs"),
    "log": ("logs", "Logs"),
    "model": ("models", "Models"),
    "cli": ("commands", "Commands"),
    "units": ("honest", "Units"),
    "columns": ("honest", "NamedColumns"),
    "names": ("honest", "HostileNames"),
    "streams": ("streams", "Streams"),
}


def make_kind(name: str, folder: Path) -> Kind:
    """Return the kind of that name; see `KINDS`."""
    module, cls = KINDS[name]
    found: Kind = getattr(import_module(f"{__package__}.{module}"), cls)(folder)
    return found
