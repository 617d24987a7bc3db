"""Rows of sensors: what each saw of one chain, how much a row counts, and how rows add up."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..arm.spatial_chain import Motion
from ..common.arrays import Array
from .parameters import Block, Indices
from .structure import Structure
from .views import Measurement, Placed, Sight

_AT_ONCE = 3000  # rows whose derivatives are held together

_Structure = TypeVar("_Structure", bound=Structure)


@dataclass(frozen=True, eq=False)
class Rows:
    """What one sensor measured: n rows of m outputs."""

    q: Array  # (n, dof + g), joint values [rad or m], and what else a row tells the sensor
    z: Array  # (n, m), what it saw
    sensor: Measurement | None = None  # how it measures; None: as the structure says
    floor: Array | float = 0.0  # (m,), least noise [unit]
    noise: Array | float | None = None  # (m,), noise to start from

    def __len__(self) -> int:
        """Number of rows."""
        return len(self.z)

    def take(self, rows: Indices | slice) -> Rows:
        """Some of the rows."""
        return replace(self, q=self.q[rows], z=self.z[rows])


@dataclass(frozen=True, eq=False)
class Beside(Measurement):
    """One of several measurements of a chain, with the parameters of all."""

    every: tuple[Measurement, ...]  # the chain's own last
    at: int = 0  # which these rows are of

    def __post_init__(self) -> None:
        told = {
            "outputs": self.one.outputs,
            "noise": self.one.noise,
            "within": self.every[0].within,
            "floating": self.every[0].floating,
            "curves": all(each.curves for each in self.every),
            "tool": next((each.tool for each in self.every if each.tool), None),
            "free": tuple(name for each in self.every[:-1] for name in each.free),
        }
        for name, value in told.items():
            object.__setattr__(self, name, value)

    @property
    def one(self) -> Measurement:
        """The measurement that these rows are of."""
        return self.every[self.at]

    def parameters(self) -> tuple[Block, ...]:
        """The parameters of the chain's own sensor, then of the others."""
        return tuple(block for each in self.every[::-1] for block in each.parameters())

    def placed(self, own: Mapping[str, Array]) -> Placed:
        """The chain's own sensor."""
        return self.every[-1].placed(own)

    def look(self, own: Mapping[str, Any], motion: Motion, also: Array) -> Sight:
        """See the chain."""
        return self.one.look(own, motion, also)


def together(structure: _Structure, rows: Sequence[Rows]) -> _Structure:
    """Return the structure with the parameters of all sensors; it sees as the first one does."""
    others = tuple(each.sensor for each in rows if each.sensor is not None)
    if not others or isinstance(structure.measurement, Beside):
        return structure
    return _seen_by(
        replace(structure, reading=Beside((*others, structure.measurement))),  # type: ignore[type-var]
        rows[0].sensor,
    )


def _seen_by(structure: _Structure, sensor: Measurement | None) -> _Structure:
    """Return the structure as a sensor sees it, with the parameters of all."""
    if not isinstance(both := structure.measurement, Beside):
        return structure
    at = both.every.index(sensor) if sensor else len(both.every) - 1
    return replace(structure, reading=replace(both, at=at))  # type: ignore[type-var]


class Part:
    """Rows of one sensor within a fit: residuals, noise, and weights under Student noise.

    nu : degrees of freedom of the noise; infinite for Gaussian
    blocks : contiguous blocks of rows that are kept apart
    """

    residual: Array  # (n, m), at the fit's parameters
    weight: Array  # (n, m)
    noise: Array  # (m,)

    def __init__(
        self, structure: Structure, rows: Rows, beta: Array, nu: float, blocks: int
    ) -> None:
        self.structure, self.q, self.z = _seen_by(structure, rows.sensor), rows.q, rows.z
        self.nu = nu
        self.outputs = [slice(*pair) for pair in pairwise(np.cumsum((0, *self.structure.blocks)))]
        self.edges = np.linspace(0, len(rows), blocks + 1).round().astype(int)
        self.stated = (own := self.structure.measurement.noise) is not None
        floor, noise = (own, own) if self.stated else (rows.floor, rows.noise)
        self.floor = np.broadcast_to(np.asarray(floor, dtype=float), self.z.shape[1:])
        self.residual = self.residual_at(beta)
        if noise is None:
            self.learn_noise()
        else:
            self.noise = np.broadcast_to(noise, self.floor.shape)

    def residual_at(self, beta: Array) -> Array:
        """Residuals (n, m) at parameters (d,)."""
        with np.errstate(all="ignore"):
            return self.structure.residual(self.z, self.structure.predict(self.q, beta))

    def by_blocks(self, beta: Array, active: Indices) -> Iterator[tuple[slice, Array]]:
        """Each block's rows, and the derivatives (n, m, k) of their predictions."""

        def of(q: Array) -> Array:
            return self.structure.linearise(q, beta, active)[1]

        whole = of(self.q) if len(self.q) <= _AT_ONCE else None
        for rows in (slice(*pair) for pair in pairwise(self.edges)):
            yield rows, of(self.q[rows]) if whole is None else whole[rows]

    def learn_noise(self, share: float = 0.0) -> None:
        """Find the most probable noise (m,); a `share` of the numbers was fitted."""
        if self.stated:
            return
        n, m = self.residual.shape
        noise = np.empty(m)
        for part, p, e2 in self._squares(self.residual):
            lowest = max(float(self.floor[part.start]) ** 2, 1e-300)
            free = max((1 - share) * p * n, p * n / 4 + 1)
            s2 = max(float(np.median(e2)) / p, lowest)
            for _ in range(12 if np.isfinite(self.nu) else 1):
                weight = (self.nu + p) / (self.nu + e2 / s2) if np.isfinite(self.nu) else 1.0
                s2 = max(float((weight * e2).sum()) / free, lowest)
            noise[part] = np.sqrt(s2)
        self.noise = noise

    def weigh(self) -> Array:
        """Set the weights, one for each row and block of outputs; their roots over the noise."""
        self.weight = np.ones_like(self.residual)
        if np.isfinite(self.nu):
            for part, p, e2 in self._squares(self.residual):
                away = e2 / self.noise[part.start] ** 2
                self.weight[:, part] = ((self.nu + p) / (self.nu + away))[:, None]
        return np.asarray(np.sqrt(self.weight) / self.noise)

    def energy(self, residual: Array) -> float:
        """Negative log likelihood of residuals (n, m), up to a constant."""
        total = 0.0
        for part, p, e2 in self._squares(residual):
            s = float(self.noise[part.start])
            total += len(e2) * p * np.log(s)
            if np.isfinite(self.nu):
                total += 0.5 * (self.nu + p) * float(np.log1p(e2 / s**2 / self.nu).sum())
            else:
                total += 0.5 * float(e2.sum()) / s**2
        return total

    def _squares(self, r: Array) -> list[tuple[slice, int, NDArray[np.float64]]]:
        """Columns, number and squared lengths (n,) of the residuals of each block of outputs."""
        return [(s, s.stop - s.start, (r[:, s] ** 2).sum(axis=1)) for s in self.outputs]
