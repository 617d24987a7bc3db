"""Saving: the one method of a model that calls a room above, which knows the model's file."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

if TYPE_CHECKING:
    import os

    from .parts import Parts


class Saving:
    """What a model can do beside being asked."""

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the model into one file, whole or not at all."""
        from ..model_file.storage import save

        save(cast("Parts", self), path)
