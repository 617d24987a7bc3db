"""Export: a model as one C99 header, for controllers and microcontrollers without Python."""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass, replace

from ..common.parallel import one_blas_thread
from ..common.wording import one_line
from ..errors import OptionError
from ..model.header import Header
from ..model.model import Model
from ..model_file.storage import to_bytes
from .correct import usual_limit

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,40}")


@dataclass(frozen=True)
class CHeader:
    """A C header and what it takes."""

    text: str
    tables: int  # bytes of its constant tables


def c_header(model: Model, *, prefix: str = "calib_", single: bool = False) -> CHeader:
    """One C99 header (also valid C++) that answers as the model does.

    model : with a body, planar or spatial
    prefix : starts every name
    single : ``float`` instead of ``double``, for microcontrollers
    Raises OptionError if the model has no body, or the prefix is no C name.
    """
    if not _NAME.fullmatch(prefix):
        raise OptionError(f"prefix {prefix!r}: expected a C name such as 'calib_'")
    with one_blas_thread():  # the same bytes on any number of cores
        header = Header.of(model)
        if header.nominal is not None:
            header = replace(header, limit=usual_limit(model))
    about = model.about
    joints = zip(about.joint_names, about.lower, about.upper, strict=True)
    lines = [f" *   {_comment(name)}: {low:.6g} to {high:.6g}" for name, low, high in joints]
    text, tables = header.text(
        prefix,
        single,
        {
            "title": _comment(f"{about.robot or 'An arm'}, calibrated"),
            "checksum": hashlib.sha256(to_bytes(model)).hexdigest(),
            "facts": " * Joints, base to tip:\n" + "\n".join(lines) + "\n",
            "unit": _comment(about.unit),
            "bound_of": _comment(about.bound_of),
        },
    )
    return CHeader(text, _bytes(tables))


def _bytes(tables: str) -> int:
    """Size of constant tables, from their numbers: double ones have a point and no suffix."""
    found = re.findall(r"(?<=[\s{])-?\d[\d.e+-]*f?(?=[,}])", tables)
    return sum(4 if text.endswith("f") or not re.search("[.e]", text) else 8 for text in found)


def _comment(text: str) -> str:
    """Text of a stranger's file that cannot end a C comment or start a trigraph."""
    return one_line(text).replace("*", "x").replace("/", "-").replace("?", "-").replace("\\", "-")
