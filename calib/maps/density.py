"""Varying density: what eq. 7 and 8 can mean, each as a factor g on a sample's update.

g is 1 at the start, so that the map orders itself.  The batch rule goes to the fixed points of
eq. 2 with it, where each node is the mean of all samples weighted by g h.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..common.arrays import Array, Index
from ..common.choices import MAPS, check_choice
from ..common.rows import group_sums
from ..errors import OptionError
from .lattice import Graph, Lattice
from .settings import DENSITY


@dataclass(frozen=True, repr=False)
class Visit:
    """Samples that visit a map in training, as a gain sees them.

    Attributes
    ----------
    progress : float
        t / T, from 0 at the start of the training to 1 at its end.
    winners : (n,) int array
        Best matching node of each sample (eq. 1).
    distances : (n,) array
        Distance of each sample to its winner, in the unit box.
    weights : (nodes, d) array
        Weights of the nodes, in the unit box.
    lattice : Lattice or Graph
        How the nodes are joined.
    residual : (n,) array, optional
        Held-out error of a smooth model at each sample, where one was fitted [unit].
    sigma : float [nodes]
        Neighbourhood radius now; NaN where a network has none.
    per_node : float
        Training samples per node.

    Examples
    --------
    Eq. 7 for the winner of each sample, O the nodes joined to it: `numpy.exp(-sums)[winners]`.
    """

    progress: float
    winners: Index
    distances: Array
    weights: Array
    lattice: Lattice | Graph
    residual: Array | None = None
    sigma: float = np.nan
    per_node: float = np.inf

    @property
    def sums(self) -> Array:
        """Sum over the neighbours i of |w_j - w_i|^2, for each node j, (nodes,): that of eq. 7."""
        ends = self.lattice.edges().T
        a, b = ends
        gaps = self.weights[a] - self.weights[b]
        square = np.sum(gaps**2, axis=1)
        of_ends = np.tile(square, 2)
        return group_sums(ends.ravel(), of_ends, len(self.weights))


Gain = Callable[[Visit], Array]


def border(visit: Visit, share: float = 1.0) -> Array:
    """Gain of nodes "with a small number of neighbors", corners and edges: what the paper means.

    g = exp(p min(1, 3/2 t/T) (1 - neighbours / most neighbours)), p a `share` of 3 log2(side / 4),
    1.5 to 9, by the nodes along a side: of a small lattice a large share is border, and drawn there
    its nodes would be missed inside.  With fewer than 4 samples per node p is less, down to half:
    at full strength the readout ``winner`` lost 7 % on 30x30 nodes of 2,000 samples.  The gain has
    no feedback and cannot tear the map; the last third of the training, at the full gain, brings
    the map to rest.
    """
    dim = getattr(visit.lattice, "dim", 2)
    side = visit.lattice.size ** (1 / dim)
    of_size = np.clip(3.0 * np.log2(side / 4.0), 1.5, 9.0)
    of_samples = np.clip(visit.per_node / 4, 0.5, 1.0)
    strength = of_size * of_samples
    ramp = share * min(1.0, visit.progress / DENSITY.full)
    lonely = 1.0 - visit.lattice.neighbour_share()
    gain = np.exp(strength * ramp * lonely)
    return np.asarray(gain[visit.winners])


def as_printed(_visit: Visit) -> Array:
    """Equations 7 and 8 as printed, which no factor on a sample is: see `vdsom.py`.

    h = (t / (rho T))^4 exp(-t / (sigma^2 T)) does not depend on the node: all follow each sample.
    """
    raise OptionError(
        "eq. 8 as printed is a rule for one sample at a time: give rule='online'",
        parameter="rule",
    )


def error(visit: Visit) -> Array:
    """Gain of samples that the map represents badly: (d^2 / mean d^2)^(t/T), d to the winner."""
    square = visit.distances**2
    mean = float(square.mean())
    if mean == 0.0:
        return np.ones(len(square))
    return (square / mean + 1e-6) ** visit.progress


def rho(visit: Visit) -> Array:
    """Equations 7 and 8 as a factor of eq. 3, with O the whole lattice: their stable reading.

    g = 1 + (t mean(rho) / (rho T))^4, rho = exp(-sum |w_bmu - w_i|^2 / its mean).  It differs
    from what is printed: exp(-t / (sigma^2 T)) stays the Gaussian of eq. 3, so that a pull falls
    with the distance, and the gain starts at 1 instead of 0, as eq. 2 needs to begin at all.
    With the sum over "each node in the lattice" rho is smallest at the border.
    """
    # sum over i of |w_j - w_i|^2, up to the factor n: |w_j - mean|^2 + variance
    gaps = visit.weights - visit.weights.mean(axis=0)
    total = np.sum(gaps**2, axis=1)
    total = total + total.mean()
    mean = max(float(total.mean()), 1e-300)
    rho_of_nodes = np.exp(-total / mean)  # eq. 7
    relative = visit.progress * rho_of_nodes.mean() / rho_of_nodes
    gain: Array = 1.0 + relative**4  # eq. 8
    return gain[visit.winners]


def residual(visit: Visit) -> Array:
    """Gain of samples where a smooth model is wrong, times that of the border: the default.

    g = border (r / mean r)^(min(1, 3/2 t/T)), r of `model_selection.misfit`: "concentration of
    nodes in regions with large transformation errors".  The border's gain has two thirds of its
    strength; without residuals it is all there is.
    """
    gain = border(visit, 2 / 3)
    if visit.residual is None:
        return gain
    mean = max(float(visit.residual.mean()), 1e-300)
    share = np.clip(
        visit.residual / mean,
        DENSITY.least_residual,
        DENSITY.most_residual,
    )
    ramp = min(1.0, visit.progress / DENSITY.full)
    return gain * share**ramp


def guard_gain(gain: Gain) -> Gain:
    """Return a user's gain that refuses an answer which is no factor for each sample."""

    def guard(visit: Visit) -> Array:
        answer = gain(visit)
        shape = visit.winners.shape
        try:
            factors = np.asarray(answer, dtype=float)
        except (TypeError, ValueError):
            factors = np.zeros(0)
        if (
            factors.shape != shape
            or not (factors >= 0).all()
            or not 0 < factors.sum() < np.inf
        ):
            raise OptionError(
                f"the gain returned {answer!r:.200}: expected an array of shape {shape}, "
                "a factor for each sample, finite, 0 or more and not all 0"
            )
        return factors

    return guard


GAINS: dict[str, Gain] = {
    "residual": residual,
    "border": border,
    "rho": rho,
    "printed": as_printed,
    "error": error,
}
"""What a varying density can mean, by the name that follows the colon in ``--map``."""


def gain_of(name: str) -> Gain | None:
    """Gain of a network by its name in ``--map``, None where there is none."""
    check_choice("map", name, MAPS)
    if name == "vdsom":
        return border
    _, _, reading = name.partition(":")
    return GAINS.get(reading)


def kind_of(network: str | Gain) -> str:
    """Kind of a network, "som", "dsom" or "gng", by its name or gain function."""
    if not isinstance(network, str):
        return "som"
    gain_of(network)
    return network.removeprefix("vd").partition(":")[0]
