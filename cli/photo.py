"""The photo that a map is drawn over: where it comes from, and whether the model keeps it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from . import options as opt
from .output import say
from .samples import Compared, log_of

if TYPE_CHECKING:
    from calib.model.model import Model
    from calib.samples.samples import Samples


def photo_of_log(model: Model, log: Samples, data: str) -> Model:
    """Return a model with the picture that its log names, if it lies beside or below the log."""
    from calib.errors import CalibError

    named = log.source.get("photo")
    if not isinstance(named, str) or data == "-":
        return model
    folder = Path(data).resolve().parent
    # a log may come from a stranger: it must not bring files from elsewhere into a model
    try:
        path = (folder / named).resolve()
        if not (path.is_relative_to(folder) and path.is_file()):
            return model
        made = with_photo(model, str(path), log)
    except (OSError, ValueError):  # no name of a file
        return model
    except CalibError as error:
        say([f"no photo is kept in the model: {error}"])
        return model
    say([f"{path.name} is kept in the model as its photo; --no-photo leaves it out"])
    return made


@dataclass(frozen=True, kw_only=True)
class Drawn(Compared):
    """What a model is drawn with, as typed."""

    data: opt.Data = None
    photo: opt.PhotoFile = None
    no_photo: opt.NoPhoto = False

    def load(self, path: str) -> tuple[Model, Samples | None]:
        """Load a model as it is to be drawn, and a log of its own arm where one is given."""
        import calib

        model = calib.load(path)
        log = log_of(model, self.data, self)
        if self.photo is None:
            return (replace(model, photo=None) if self.no_photo else model), log
        model = with_photo(model, self.photo, log)
        if not self.no_photo:
            model.save(path)
            say([f"{self.photo} is kept in {path}; --no-photo leaves it out"])
        return model, log


def with_photo(model: Model, path: str, log: Samples | None) -> Model:
    """Return a model with a photo; for metres `log` says where its camera was."""
    from calib.recording.photo import take_photo

    about, unit = None if log is None else log.source, model.about.unit
    return replace(model, photo=take_photo(path, model.sensory.weights, unit, about))
