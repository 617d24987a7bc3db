"""Kinds: what is fuzzed. Each makes an input from a seed and judges what calib did with it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path
from random import Random
from typing import Any


class Kind(ABC):
    """One kind of input; it may keep what all of its inputs share in `folder`.

    Parameters
    ----------
    folder : Path
        An empty folder that files are written to.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @abstractmethod
    def make(self, rng: Random) -> Any:
        """Make an input; the same generator makes the same one."""

    @abstractmethod
    def judge(self, case: Any) -> str:
        """Give it to calib and return what became of it in a few words.

        Raises
        ------
        AssertionError
            If calib did what it must not.
        """

    def close(self) -> None:  # noqa: B027 - most kinds share nothing
        """Let go of what is shared."""


def make_kind(name: str, folder: Path) -> Kind:
    """Return the kind of that name; see `KINDS`."""
    from importlib import import_module

    module, cls = KINDS[name]
    found = getattr(import_module(f"{__package__}.{module}"), cls)(folder)
    assert isinstance(found, Kind)
    return found


KINDS = {
    "arm": ("urdfs", "Arms"),
    "urdf": ("urdfs", "Urdfs"),
    "log": ("logs", "Logs"),
    "model": ("models", "Models"),
    "cli": ("commands", "Commands"),
    "process": ("commands", "Processes"),
    "units": ("honest", "Units"),
    "columns": ("honest", "NamedColumns"),
    "names": ("honest", "HostileNames"),
    "streams": ("streams", "Streams"),
}
