"""The body: what an arm and its sensor must obey, as one Gaussian belief over its parameters.

`fit_body` finds it from rows, `Body` answers: positions, slopes, bounds, parameters in words.
Names are loaded when they are first used: a query needs none of the fit.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .belief import Body as Body
    from .belief import Parameter as Parameter
    from .belief import Second as Second
    from .fitting import fit_body as fit_body
    from .nominal import Nominal as Nominal
    from .nominal import nominal_of as nominal_of
    from .planar import PlanarStructure as PlanarStructure
    from .posterior import BodyFit as BodyFit
    from .posterior import fit_structure as fit_structure
    from .structure import Hyper as Hyper
    from .structure import Label as Label
    from .structure import Prior as Prior
    from .structure import Structure as Structure
    from .telling import warnings_of as warnings_of

_HOME = {
    "Body": "belief",
    "BodyFit": "posterior",
    "Hyper": "structure",
    "Label": "structure",
    "Nominal": "nominal",
    "Parameter": "belief",
    "PlanarStructure": "planar",
    "Prior": "structure",
    "Second": "belief",
    "Structure": "structure",
    "fit_body": "fitting",
    "fit_structure": "posterior",
    "nominal_of": "nominal",
    "warnings_of": "telling",
}

__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_HOME[name]}", __name__), name)
