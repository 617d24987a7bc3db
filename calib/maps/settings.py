"""Settings of the maps: every number that was tuned, with its unit and its reason."""

from dataclasses import dataclass
from typing import NamedTuple


@dataclass(frozen=True)
class OnlineSettings:
    """The paper's rule, one sample at a time (`vdsom.py`)."""

    # learning rate of the maps at the start, alpha_init of eq. 4
    alpha: float = 0.5
    # learning rate of the links, eta_init of eq. 12: eta beta stays below 1
    eta: float = 0.13
    # samples between two looks at the nodes' spacings (eq. 6) and at a gain
    chunk: int = 250
    # exponent of eq. 6 beyond which a node is silent: below 1e-3
    silent: float = 7.0
    most_links: int = 100_000_000  # that are held densely: 400 MB


@dataclass(frozen=True)
class BatchSettings:
    """Kohonen's batch map, from coarse lattices to fine ones (`batch.py`)."""

    last_radius: float = 0.4  # of the full lattice [nodes]
    # where the density varies [nodes]: a smooth map is better
    last_radius_varying: float = 1.5
    coarsest: int = 64  # nodes of the lattice that is ordered first
    growth: float = 10.0  # the next lattice has at most so many times the nodes
    samples_per_node: int = 10  # that a coarse lattice is shown in an epoch
    step: float = 1.5  # see `Stage.step`
    # of the full lattice, of a density that grows [nodes]
    first_radius_growing: float = 3.0
    epochs_growing: int = 5  # of the full lattice, of a density that grows
    grown: float = 0.5  # t / T after the coarse lattices
    # parts of the unit box by which samples are sorted
    sorting_cells: int = 65_535


@dataclass(frozen=True)
class DensitySettings:
    """Gains of a varying density (`density.py`)."""

    # share of the training after which the gain at the border is full
    full: float = 2 / 3
    least_residual: float = 0.05  # of the residual's share in the gain
    most_residual: float = 50.0


@dataclass(frozen=True)
class LinkSettings:
    """Hebbian links and the activity of nodes (`links.py`)."""

    bandwidth: float = 0.7  # of a node's activity (eq. 6) [node spacings]
    # nodes that are active at a time: further ones are below 1e-3
    nearest: int = 12
    # links below this share of the strongest of their nodes are let go
    weak: float = 0.02
    nothing: float = 1e-6  # and those below this share of the strongest of all


@dataclass(frozen=True)
class ReadoutSettings:
    """Readouts of the links and branches of the inverse (`clusters.py`, `linear_models.py`)."""

    # nodes closer than so many spacings belong to one cluster
    joined: float = 1.9
    core: float = 6.0  # reach of a cluster around its strongest node [spacings]
    most_clusters: int = 6  # of each sensory node
    active: float = 1e-9  # activity below which a node was never active
    # [spacings], the largest number in half precision is a little more
    furthest: float = 6e4
    # of the regressions, share of the mean variance of the nodes' places
    ridge: float = 1e-2


@dataclass(frozen=True)
class DynamicSettings:
    """DSOM with the values of its source (`dsom.py`)."""

    # how far a sample's pull reaches: 1 to 3 in the source
    elasticity: float = 3.0
    rate: float = 0.1  # learning rate epsilon of the source


@dataclass(frozen=True)
class GrowingSettings:
    """Growing neural gas with the letters and values of its source (`gng.py`)."""

    epsilon_b: float = 0.1  # step of the winner towards a sample
    epsilon_n: float = 0.006  # step of its neighbours
    a_max: int = 50  # age beyond which an edge is removed
    alpha: float = 0.5  # share of the error that the parents of a new node keep
    growing: float = 0.6  # share of the samples during which nodes are inserted
    block: int = 512  # samples that are shown at once
    samples_per_node: int = 15  # in a pass; more teach a gas little


@dataclass(frozen=True)
class LocalSettings:
    """Local models of the motor nodes (`local_models.py`)."""

    # share of the weight up to which nodes with models count nothing
    silent: float = 0.3
    full: float = 0.5  # share from which on they count in full
    ring: int = 16  # places around a node where its polynomial has to be firm
    firm: float = 10.0  # variance of an answer there, over that of one sample


class ModelShape(NamedTuple):
    """What all local models of a map have in common."""

    degree: int  # largest total degree of the polynomials
    samples: int  # that each is fitted to


@dataclass(frozen=True)
class SelectionSettings:
    """Which nodes carry local models (`model_selection.py`)."""

    folds: int = 5
    # of local models, of which one is chosen
    shapes: tuple[ModelShape, ...] = (
        ModelShape(degree=0, samples=30),
        ModelShape(degree=1, samples=50),
        ModelShape(degree=3, samples=40),
        ModelShape(degree=5, samples=60),
    )
    rounding: float = 1e-9  # share of the extent that is no residual
    rows_around: int = 9  # whose median residual shows whether a row is calm
    # times the noise's mean square, below which that median is calm
    calm: float = 2.0
    # weight of a calm row: what mends a defect must not spoil what is right
    harm: float = 30.0
    # of a node's weight: with more on wrong rows it may carry a model
    wrong_share: float = 0.5
    # of a log: a gain has to come from several, near-repeats are no evidence
    parts: int = 20
    node_gain: float = 1.0  # standard errors beyond zero of a node's gain
    total_gain: float = 3.0  # standard errors beyond zero of the sum
    # share of the residuals along the motion that is no chance
    along: float = 0.1
    sure: float = 5.0  # standard errors of that share
    rows_averaged: int = 30  # whose residuals are averaged for a map's density
    # standard errors by which a mean square must exceed the common one
    chance: float = 4.0
    # standard deviations of the calm mean squares by which it must exceed the common one
    spreads: float = 6.0


@dataclass(frozen=True)
class BoundSettings:
    """The 95 % bound on errors (`node_bounds.py`)."""

    coverage: float = 0.95
    around: int = 50  # held-out errors that set the scale around a node
    # a pass shrinks a group by no more, so that errors of zero leave a bound
    least: float = 1e-3
    passes: int = 4  # over the two groups of nodes
    enough: int = 40  # fewest rows for a group's factor
    border: float = 1.5  # nodes within so many spacings of a limit form a group


ONLINE = OnlineSettings()
BATCH = BatchSettings()
DENSITY = DensitySettings()
LINK = LinkSettings()
READOUT = ReadoutSettings()
DYNAMIC = DynamicSettings()
GROWING = GrowingSettings()
LOCAL = LocalSettings()
SELECTION = SelectionSettings()
BOUND = BoundSettings()
