"""Gaussian beliefs over parameters, kept as the root of a covariance."""

from __future__ import annotations

from functools import cached_property

from ..common.arrays import Array
from ..common.frozen import ReadOnly, frozen
from .parameters import Indices
from .structure import Structure


class Gaussian(ReadOnly):
    """A Gaussian belief over some parameters."""

    beta: Array  # (d,)
    active: Indices  # (k,), those that it is over
    root: Array  # (k, r), of their covariance

    @cached_property
    def covariance(self) -> Array:
        """Covariance (k, k) of the active parameters."""
        return frozen(self.root @ self.root.T)


class OfStructure(Gaussian):
    """The same with the structure that they are of."""

    structure: Structure
