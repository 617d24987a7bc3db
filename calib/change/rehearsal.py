"""Rehearsal: imagine what the corrected arm would do, and learn from it as always."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from ..errors import LogError
from ..maps.association import Association
from ..maps.density import GAINS
from ..maps.model_selection import of_trends, select
from ..maps.predictor import Predictor
from ..model.about import About
from ..model.model import Model
from ..training.learn import Options, Progress, Stopwatch, both_maps, link

Array = NDArray[np.float64]

IMAGINED = 20_000
"""Samples that are imagined."""


@dataclass(frozen=True, eq=False)
class Learned:
    """What was learned of the imagined samples.

    Attributes
    ----------
    association : Association
        Both maps and their links.
    predictor : Predictor
        Smooth part and local models.
    visited : (motor nodes,) bool array
        Nodes that a sample has visited.
    """

    association: Association
    predictor: Predictor
    visited: NDArray[np.bool_]


def rehearse(
    model: Model,
    value: Callable[[Array], Array],
    rows: Array,
    rng: np.random.Generator,
    progress: Progress | None = None,
) -> Learned:
    """Learn maps, links and local models of a corrected map.

    Parameters
    ----------
    model : Model
        The old model: what it knew of is imagined again.
    value : callable
        (n, dof) -> (n, 2): the corrected map, on the joints' unit box.
    rows : (m, dof) array
        Joints of the log in the unit box: around them more may be known than before.
    rng : Generator
        Draws the joints.
    progress : callable, optional
        Told how far the learning is.
    """
    u, scale, options = imagine(model, rows, rng), model.motor.scale, options_of(model.about)
    x = value(u)
    motor, sensory = both_maps(scale, u, x, options, Stopwatch(), progress)
    selected = select(motor, u, of_trends(scale, model.about.revolute, u, x))
    visited = np.bincount(motor.nearest(u)[1][:, 0], minlength=motor.size) > 0
    return Learned(link(motor, sensory, u, x, options), selected.predictor, visited)


def imagine(model: Model, rows: Array, rng: np.random.Generator) -> Array:
    """Draw joints (n, dof) of the unit box that the old model or the log know of."""
    from ..maps.map import search_tree

    tree = search_tree(rows, model.motor.scale)
    found: list[Array] = []
    count = 0
    for _ in range(200):
        u = rng.random((IMAGINED, rows.shape[1]))
        known = np.isfinite(model.expected_error(model.motor.scale.from_unit(u)))
        if not known.all():
            known |= np.asarray(tree.query(u)[0]) <= model.motor.spacing
        found.append(u[known])
        count += int(np.count_nonzero(known))
        if count >= IMAGINED:
            return np.concatenate(found)[:IMAGINED]
    if not count:
        raise LogError("the log lies outside of all that the model knows, train a new one")
    return np.concatenate(found)


def options_of(about: About) -> Options:
    """How a model was trained, as far as its file says; taught, and coarse to fine."""
    known = {f.name for f in fields(Options)}
    given = {k: v for k, v in about.options.items() if k in known}
    for name in ("motor_size", "sensory_size"):
        given[name] = tuple(given[name])
    given |= {"rule": "batch", "epochs": None, "sigma": None, "taught": True}
    if given["map"] not in GAINS:
        given["map"] = "vdsom"  # a function that the file could not keep
    return Options(**given)
