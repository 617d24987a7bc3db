"""Libraries that train a self-organizing map, ours among them, behind one call each.

Every peer takes the same array of samples in the unit box and returns its nodes.  Its
options are those that suit it best among the ones that it documents; where a decay can only
be set through a private name, that is done and said.
"""

import contextlib
import io
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from importlib import metadata

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Setting:
    """How much a peer trains."""

    rows: int  # samples that it is given
    rounds: int = 0  # passes over them (batch), or steps (online); 0 for its defaults
    start: float = 0.0  # neighbourhood radius [nodes], 0 where it has no such option
    end: float = 0.0

    def words(self, online: bool) -> str:
        """One line for a table."""
        radius = f", radius {self.start:g} to {self.end:g}" if self.start else ""
        if online:
            return f"{self.rounds:,} steps{radius}"
        passes = f"{self.rounds} x " if self.rounds else ""
        return f"{passes}{self.rows:,} samples{radius}"


@dataclass(frozen=True)
class Peer:
    """One library."""

    name: str
    package: str
    online: bool  # whether it shows one sample at a time
    # samples (n, 2), nodes along a side, a setting and a seed -> nodes (side**2, 2)
    train: Callable[[Array, int, Setting, int], Array]

    def version(self) -> str | None:
        """Installed version, None where it is not there."""
        try:
            return metadata.version(self.package)
        except metadata.PackageNotFoundError:
            return None


def _exponential(start: float, end: float, total: int) -> Callable[[float, int, int], float]:
    """A decay from `start` to `end` as most libraries call it: (value, t, total)."""
    return lambda _value, t, _total: start * (end / start) ** (t / total)


def _calib(u: Array, side: int, s: Setting, seed: int) -> Array:
    import calib

    radii = (s.start, s.end) if s.start else None
    som = calib.SOM((side, side), map="som", epochs=s.rounds or None, sigma=radii, seed=seed)
    return som.fit(u[: s.rows]).weights


def _minisom(u: Array, side: int, s: Setting, seed: int) -> Array:
    from minisom import MiniSom

    som = MiniSom(side, side, u.shape[1], sigma=s.start, learning_rate=0.5, random_seed=seed)
    som._sigma_decay_function = _exponential(s.start, s.end, s.rounds)
    som._learning_rate_decay_function = _exponential(0.5, 0.05, s.rounds)
    som.random_weights_init(u)
    som.train(u, s.rounds, random_order=True)
    return som.get_weights().reshape(-1, u.shape[1])


def _numbasom(u: Array, side: int, s: Setting, _seed: int) -> Array:
    import numbasom

    with contextlib.redirect_stdout(io.StringIO()):
        lattice = numbasom.SOM((side, side)).train(u, s.rounds)
    return lattice.reshape(-1, u.shape[1])


def _sparse_online(u: Array, side: int, s: Setting, _seed: int) -> Array:
    from scipy.sparse import csr_matrix
    from sparse_som import Som, cooling, topology

    som = Som(side, side, u.shape[1], topology.RECT, 0)
    som.train(csr_matrix(u, dtype=np.float32), s.rounds, r0=s.start, rN=s.end,
              rcool=cooling.EXPONENTIAL)  # fmt: skip
    # a view of memory that goes with the map
    return np.array(som.codebook, dtype=float).reshape(-1, u.shape[1])


def _sparse_batch(u: Array, side: int, s: Setting, _seed: int) -> Array:
    from scipy.sparse import csr_matrix
    from sparse_som import BSom, cooling, topology

    som = BSom(side, side, u.shape[1], topology.RECT, 0)
    rows = csr_matrix(u[: s.rows], dtype=np.float32)
    som.train(rows, s.rounds, r0=s.start, rN=s.end, cool=cooling.EXPONENTIAL)
    # a view of memory that goes with the map
    return np.array(som.codebook, dtype=float).reshape(-1, u.shape[1])


OURS = Peer("calib", "calib-arm", False, _calib)
PEERS = (
    OURS,
    Peer("sparse-som", "sparse-som", True, _sparse_online),
    Peer("numbasom", "numbasom", True, _numbasom),
    Peer("sparse-som batch", "sparse-som", False, _sparse_batch),
    Peer("MiniSom", "minisom", True, _minisom),
)
"""Ours first, then peers from the fastest to the slowest."""


def by_name(name: str) -> Peer:
    """The peer of this name."""
    return next(p for p in PEERS if p.name == name)


def train(peer: Peer, u: Array, side: int, setting: Setting, seed: int) -> Array:
    """Nodes of a trained map; raises ValueError where they are not finite."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        weights = peer.train(u, side, setting, seed)
    if weights.shape != (side * side, u.shape[1]) or not np.isfinite(weights).all():
        raise ValueError(f"{peer.name} returned nodes of shape {weights.shape} or not finite")
    return weights
