"""The body: what an arm and its sensor must obey, as one Gaussian belief over its parameters.

`fit_body` finds it from rows, `Body` answers: positions, slopes, bounds, parameters in words.
"""

from __future__ import annotations

from .belief import Body, Parameter, Second
from .fitting import fit_body
from .nominal import Nominal, nominal_of
from .planar import PlanarStructure
from .posterior import BodyFit, fit_structure
from .structure import Hyper, Label, Prior, Structure
from .telling import warnings_of

__all__ = [
    "Body",
    "BodyFit",
    "Hyper",
    "Label",
    "Nominal",
    "Parameter",
    "PlanarStructure",
    "Prior",
    "Second",
    "Structure",
    "fit_body",
    "fit_structure",
    "nominal_of",
    "warnings_of",
]
