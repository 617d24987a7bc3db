"""Rows of sensors: readings of one chain, the weights of rows, and the sums over them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..common.arrays import Array
from ..common.rows import spread_rows
from .parameters import Indices
from .settings import FIT
from .structure import Structure, StructureT
from .views import Measurement


@dataclass(frozen=True, eq=False)
class Rows:
    """What one sensor measured: n rows of m outputs."""

    q: Array  # (n, dof + a), joint values [rad or m], and further facts of a row for the sensor
    z: Array  # (n, m), readings
    # the measurement, or the sensor's name where the structure has several; None: its only one
    sensor: Measurement | str | None = None
    floor: Array | float = 0.0  # (m,), least noise [unit]
    noise: Array | float | None = None  # (m,), noise to start from

    def __len__(self) -> int:
        """Number of rows."""
        return len(self.z)

    def take(self, rows: Indices | slice) -> Rows:
        """Some of the rows."""
        q = self.q[rows]
        z = self.z[rows]
        return replace(self, q=q, z=z)

    def spread(self, count: int) -> Rows:
        """At most `count` of the rows, spread over all."""
        return self.take(spread_rows(len(self), count))


def with_measurements(
    structure: StructureT, rows: Sequence[Rows]
) -> StructureT:
    """The structure with the measurements of all rows, which predicts the first of them."""
    others = tuple(
        rows_of_sensor.sensor
        for rows_of_sensor in rows
        if isinstance(rows_of_sensor.sensor, Measurement)
    )
    if not others or structure.others:
        return structure
    return structure.with_fields(others=others).as_seen_by(rows[0].sensor)


def edges_of(count: int, blocks: int) -> Indices:
    """Limits (b + 1,) of contiguous blocks of rows."""
    edges = np.linspace(0, count, blocks + 1)
    return edges.round().astype(int)


class RowBlock(NamedTuple):
    """Neighbouring rows, linearised."""

    rows: slice
    residual: Array  # (n, m)
    slope: Array  # (n, m, k), derivative of the predictions by the parameters

    def information(self, root_weights: Array) -> tuple[Array, Array]:
        """Information (k, k) and moments (k,), by roots (all, m) of all rows' weights."""
        root = root_weights[self.rows]
        misfit = (root * self.residual).T
        # rows last, as derivatives lie in memory
        weighted = self.slope.T * root.T
        flat = weighted.reshape(len(weighted), -1)
        return flat @ flat.T, flat @ misfit.ravel()


class FitReadings:
    """Rows of one sensor within a fit: residuals, noise, and weights under Student noise.

    nu : degrees of freedom of the noise; infinite for Gaussian
    blocks : number of contiguous blocks of rows
    """

    residual: Array  # (n, m), at the fit's parameters
    noise: Array  # (m,)

    def __init__(
        self,
        structure: Structure,
        rows: Rows,
        beta: Array,
        nu: float,
        blocks: int,
    ) -> None:
        self.structure = structure.as_seen_by(rows.sensor)
        self.q = rows.q
        self.z = rows.z
        self.nu = nu
        sizes = self.structure.output_sizes
        self.outputs = [slice(3 * k, 3 * k + p) for k, p in enumerate(sizes)]
        self.edges = edges_of(len(rows), blocks)
        stated = self.structure.measurement.noise
        self.stated = stated is not None
        floor = rows.floor
        noise = rows.noise
        if stated is not None:
            floor = stated
            noise = stated
        self.floor = np.broadcast_to(
            np.asarray(floor, dtype=float), self.z.shape[1:]
        )
        self.residual = self.residual_at(beta)
        if noise is None:
            self.learn_noise(0.0)
        else:
            self.noise = np.broadcast_to(noise, self.floor.shape)

    def residual_at(self, beta: Array) -> Array:
        """Residuals (n, m) at parameters (d,)."""
        structure = self.structure
        with np.errstate(all="ignore"):
            predicted = structure.predict(self.q, beta)
            return structure.residual(self.z, predicted)

    def by_blocks(self, beta: Array, active: Indices) -> Iterator[RowBlock]:
        """Each block of rows, linearised at `beta` (d,) by the parameters `active` (k,)."""
        for part in self.in_parts(beta, active):
            if len(self.q) > FIT.rows_at_once:
                yield part
            else:
                for rows in self._blocks:
                    residual = part.residual[rows]
                    yield RowBlock(rows, residual, part.slope[rows])

    def in_parts(self, beta: Array, active: Indices) -> Iterator[RowBlock]:
        """All rows at once where they are few, else each block, linearised as in `by_blocks`."""
        parts = self._blocks
        if len(self.q) <= FIT.rows_at_once:
            parts = [slice(None)]
        for rows in parts:
            yield self._linearised(rows, beta, active)

    @property
    def _blocks(self) -> list[slice]:
        """Rows of each block."""
        limits = pairwise(self.edges.tolist())
        return [slice(first, last) for first, last in limits]

    def _linearised(
        self, rows: slice, beta: Array, active: Indices
    ) -> RowBlock:
        """Some rows, linearised."""
        structure = self.structure
        predicted, slope = structure.linearise(self.q[rows], beta, active)
        with np.errstate(all="ignore"):
            residual = structure.residual(self.z[rows], predicted)
        return RowBlock(rows, residual, slope)

    def learn_noise(self, share: float) -> None:
        """Find the most probable noise (m,).

        share : share of the numbers that the parameters absorb; the others determine the noise
        """
        if self.stated:
            return
        noise = np.empty(len(self.floor))
        for columns, p, squares in self._squares(self.residual):
            numbers = p * len(squares)
            freedom = max((1 - share) * numbers, 1.0)
            floor = float(self.floor[columns.start])
            lowest = max(floor**2, 1e-300)
            typical = float(np.median(squares)) / p
            variance = max(typical, lowest)
            for _ in range(FIT.noise_steps):
                weights = self._weights(squares / variance, p)
                total = float(weights @ squares)
                variance = max(total / freedom, lowest)
            noise[columns] = np.sqrt(variance)
        self.noise = noise

    @property
    def weight(self) -> Array:
        """Weights (n, m), equal for outputs that share a noise."""
        weight = np.empty_like(self.residual)
        for columns, p, squares in self._squares(self.residual):
            ratios = squares / self.noise[columns.start] ** 2
            weights = self._weights(ratios, p)
            weight[:, columns] = weights[:, None]
        return weight

    def root_weights(self) -> Array:
        """Roots (n, m) of the weights, over the noise."""
        roots: Array = np.sqrt(self.weight)
        return roots / self.noise

    def _weights(self, ratios: Array, p: int) -> Array:
        """Weights (n,) of p residuals each, whose squared lengths over the noise's are `ratios`."""
        if np.isinf(self.nu):
            return np.ones_like(ratios)
        return (self.nu + p) / (self.nu + ratios)

    def energy(self, residual: Array) -> float:
        """Negative log likelihood of residuals (n, m), up to a constant."""
        total = 0.0
        for columns, p, squares in self._squares(residual):
            noise = float(self.noise[columns.start])
            total += len(squares) * p * np.log(noise)
            ratios = squares / noise**2
            if np.isfinite(self.nu):
                ratios = (self.nu + p) * np.log1p(ratios / self.nu)
            total += 0.5 * float(ratios.sum())
        return total

    def _squares(self, residual: Array) -> Iterator[tuple[slice, int, Array]]:
        """Columns, number and squared lengths (n,) of the residuals of each block of outputs."""
        for columns in self.outputs:
            squares = (residual[:, columns] ** 2).sum(axis=1)
            yield columns, columns.stop - columns.start, squares
