"""The model: two maps, their links and local models, queried in both directions."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import QueryError
from .maps.map import Map
from .readouts.bounds import blend_nodes
from .readouts.inverse import Solver
from .readouts.linked import Association, check_readout
from .readouts.predictor import Predictor

if TYPE_CHECKING:
    import os

    from scipy.sparse import csr_array

    from .about import About
    from .data.samples import Samples
    from .drift.baseline import Baseline
    from .evaluation import Evaluation

Array = NDArray[np.float64]

_SUPPORT = 3.0  # a query may be so many node spacings from the nearest visited node
_REACHED = 1e-4  # share of the workspace's extent that counts as reached
_SAME = 1e-3  # solutions closer than this share of the joints' range are one


class Answer(NamedTuple):
    """Inverse answers, one row each.

    Attributes
    ----------
    q : (n, dof) array [rad or m]
        Joint values.
    position : (n, 2) array [unit]
        Where the map says that they lead.
    distance : (n,) array [unit]
        From the target to that position.
    expected_error : (n,) array [unit]
        95 % bound on the distance from that position to the true one.
    reachable : (n,) bool array
        Whether the target was reached within that bound.
    """

    q: Array
    position: Array
    distance: Array
    expected_error: Array
    reachable: NDArray[np.bool_]

    def take(self, rows: list[int]) -> Answer:
        """Some of the rows."""
        return Answer(
            self.q[rows],
            self.position[rows],
            self.distance[rows],
            self.expected_error[rows],
            self.reachable[rows],
        )


@dataclass(frozen=True, eq=False)
class Model:
    """A calibrated arm.

    Attributes
    ----------
    about : About
        What it is a model of and where it came from.
    association : Association
        Motor map, sensory map and the links between them.
    predictor : Predictor
        Trend and local models of the motor nodes.
    bounds : (motor nodes,) array [unit]
        95 % bound on the error around each node.
    visited : (motor nodes,) bool array
        Nodes that training samples have visited.
    history : tuple of dict
        Earlier states of this model: trained, adapted, with their errors.
    baseline : Baseline or None
        What an undisturbed arm's distortions look like, for `check` and `monitor`.
    seconds : dict
        How long the steps of its training took; not stored in a file.
    """

    about: About
    association: Association
    predictor: Predictor
    bounds: Array
    visited: NDArray[np.bool_]
    history: tuple[dict[str, Any], ...] = field(default=())
    baseline: Baseline | None = field(default=None)
    seconds: dict[str, float] = field(default_factory=dict)

    @property
    def motor(self) -> Map:
        """Motor map; its weights are joint values."""
        return self.association.motor

    @property
    def sensory(self) -> Map:
        """Sensory map; its weights are positions."""
        return self.association.sensory

    @property
    def links(self) -> csr_array:
        """Oja-Hebbian links, (motor nodes, sensory nodes)."""
        return self.association.links

    @cached_property
    def solver(self) -> Solver:
        """Solver of the inverse direction."""
        return Solver(self.association, self.predictor)

    def forward(self, q: ArrayLike, readout: str = "local") -> Array:
        """Position of the tip for joint values.

        Parameters
        ----------
        q : (n, dof) or (dof,) array [rad or m]
        readout : {"local", "activity", "winner"}

        Returns
        -------
        (n, 2) or (2,) array [unit]
            NaN more than one node spacing outside of the learned range, or far from every
            sample.

        Raises
        ------
        QueryError
            If the shape is wrong or a value is not finite.

        Examples
        --------
        >>> import calib
        >>> arm = calib.load_arm("two_link")
        >>> model = calib.train(calib.babble(arm, 2000, seed=0), size=20)
        >>> model.forward([0.5, 1.0]).round(3)
        array([0.281, 0.393])
        """
        check_readout(readout)
        q, single = _rows(q, self.about.joint_names, "joint values")
        u = self.motor.scale.to_unit(q)
        inside = self._known(u)
        x = np.full((len(q), 2), np.nan)
        if inside.any():
            u = u[inside]
            if readout == "local":
                x[inside] = self.predictor.value(u)
            else:
                x[inside] = self.sensory.scale.from_unit(self.association.forward(u, readout))
        return x[0] if single else x

    def inverse(
        self,
        x: ArrayLike,
        near: ArrayLike | None = None,
        readout: str = "local",
        *,
        nearest: bool = False,
    ) -> Array:
        """Joint values that bring the tip to a position.

        Parameters
        ----------
        x : (n, 2) or (2,) array [unit]
        near : (n, dof) or (dof,) array [rad or m], optional
            Of several solutions the one closest to these joints answers, distances in
            units of the joints' ranges; the middle of the ranges where not given.
        readout : {"local", "activity", "winner"}
        nearest : bool
            Where a target is out of reach, answer with the nearest reachable point
            instead of NaN.

        Returns
        -------
        (n, dof) or (dof,) array [rad or m]
        """
        answer = self.solve(x, near, readout)
        q = answer.q if nearest else np.where(answer.reachable[:, None], answer.q, np.nan)
        return q[0] if np.ndim(x) == 1 else q

    def solve(self, x: ArrayLike, near: ArrayLike | None = None, readout: str = "local") -> Answer:
        """Answer inverse queries in full; see :meth:`inverse` for the parameters."""
        check_readout(readout)
        x, _ = _rows(x, ("x", "y"), "positions")
        anchor = self._anchor(near, len(x))
        if readout != "local":
            v = self.sensory.scale.to_unit(x)
            u = self.solver.clip(self.association.inverse(v, anchor, readout))
            position = self.sensory.scale.from_unit(self.association.forward(u, readout))
            return self._answer(u, x, position)
        target, u, _ = self.solver.starts(x)
        away = np.linalg.norm(self.motor.scale.difference(u, anchor[target]), axis=1)
        # the two likeliest starts of each target
        order = np.lexsort((away, target))
        owner = target[order]
        order = order[np.arange(len(order)) - np.searchsorted(owner, owner) < 2]
        target = target[order]
        u, left = self.solver.settle(u[order], x[target], anchor[target])
        away = np.linalg.norm(self.motor.scale.difference(u, anchor[target]), axis=1)
        met = left <= _REACHED * self.solver.extent
        # a met target before a missed one, then the closer joints or the smaller miss
        order = np.lexsort((np.where(met, away, left), ~met, target))
        best = order[np.searchsorted(target[order], np.arange(len(x)))]
        return self._answer(u[best], x, None)

    def solve_all(self, x: ArrayLike) -> list[Answer]:
        """All branches of each target, the one closest to the middle of the ranges first."""
        x, _ = _rows(x, ("x", "y"), "positions")
        target, u, _ = self.solver.starts(x)
        u, left = self.solver.settle(u, x[target], u)
        answer = self._answer(u, x[target], None)
        away = np.linalg.norm(self.motor.scale.difference(u, 0.5 * np.ones_like(u)), axis=1)
        result = []
        for i in range(len(x)):
            rows = (
                np.flatnonzero(target == i)
                if len(x) < 50
                else np.arange(*np.searchsorted(target, [i, i + 1]))
            )
            reached = rows[answer.reachable[rows]]
            if len(reached):
                order = reached[np.argsort(away[reached], kind="stable")]
            else:
                order = rows[np.argsort(left[rows], kind="stable")][:1]
            kept: list[int] = []
            for row in order.tolist():
                gaps = self.motor.scale.difference(u[kept], u[row])
                if not kept or np.abs(gaps).max(axis=1).min() > _SAME:
                    kept.append(row)
            result.append(answer.take(kept))
        return result

    def inverse_all(self, x: ArrayLike) -> list[Array]:
        """Joint values of every branch that reaches each target, list of (k, dof) arrays.

        The solution closest to the middle of the joints' ranges comes first; a target out
        of reach has none.
        """
        return [a.q[a.reachable] for a in self.solve_all(x)]

    def expected_error(self, q: ArrayLike) -> Array:
        """95 % bound on the error of :meth:`forward` at joint values (n, dof), (n,) [unit].

        It bounds the distance to the true position for a simulated arm and to what the
        sensor would read for a log (``about.bound_of``).
        """
        q, single = _rows(q, self.about.joint_names, "joint values")
        u = self.motor.scale.to_unit(q)
        known = self._known(u)
        bound = np.full(len(q), np.nan)
        bound[known] = blend_nodes(self.motor, self.bounds, u[known])
        return bound[0] if single else bound

    def evaluate(self, samples: Samples | None = None) -> Evaluation:
        """Errors of all readouts on fresh exact samples, or on measured ones."""
        from .evaluation import evaluate

        return evaluate(self, samples)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the model into one file, whole or not at all."""
        from .storage import save

        save(self, path)

    def outside(self, q: ArrayLike) -> str | None:
        """Why the joint values (dof,) are outside of what was learned, None if they are not."""
        rows, _ = _rows(q, self.about.joint_names, "joint values")
        u = self.motor.scale.to_unit(rows)
        if bool(self._known(u)[0]):
            return None
        lower, upper = self.about.lower, self.about.upper
        for k, name in enumerate(self.about.joint_names):
            if not -self.motor.spacing <= u[0, k] <= 1.0 + self.motor.spacing:
                return (
                    f"{name} = {rows[0, k]:.6g} is outside of the learned range "
                    f"{lower[k]:.6g} to {upper[k]:.6g}"
                )
        return "no sample was measured near these joint values"

    def _known(self, u: Array) -> NDArray[np.bool_]:
        """Whether points of the unit box are within what was learned, (n,)."""
        margin = self.motor.spacing
        inside = (u >= -margin) & (u <= 1.0 + margin) | self.motor.scale.periodic
        known: NDArray[np.bool_] = np.asarray(inside.all(axis=1))
        if not self.visited.all() and known.any():
            tree = self._visited_tree
            near = np.asarray(tree.query(u[known])[0]) <= _SUPPORT * self.motor.spacing
            known[known] = near
        return known

    @cached_property
    def _visited_tree(self) -> Any:
        from .maps.map import search_tree

        return search_tree(self.motor.units[self.visited], self.motor.scale)

    def _anchor(self, near: ArrayLike | None, n: int) -> Array:
        """Joints of the unit box that answers should be close to, (n, dof)."""
        dof = len(self.about.joint_names)
        if near is None:
            return np.full((n, dof), 0.5)
        rows, _ = _rows(near, self.about.joint_names, "near")
        if len(rows) not in (1, n):
            raise QueryError(f"near has {len(rows)} rows for {n} targets: give one or {n}")
        lower, upper = self.about.lower, self.about.upper
        slack = 1e-9 * (upper - lower)
        out = ((rows < lower - slack) | (rows > upper + slack)) & ~self.motor.scale.periodic
        if out.any():
            row, k = np.argwhere(out)[0]
            raise QueryError(
                f"near has {self.about.joint_names[k]} = {rows[row, k]:.6g}: expected a value "
                f"in its range {lower[k]:.6g} to {upper[k]:.6g}"
            )
        return np.broadcast_to(self.motor.scale.to_unit(rows), (n, dof))

    def _answer(self, u: Array, x: Array, position: Array | None) -> Answer:
        if position is None:
            position = self.predictor.value(u)
        distance = np.linalg.norm(position - x, axis=1)
        bound = blend_nodes(self.motor, self.bounds, u)
        within = distance <= np.maximum(bound, _REACHED * self.solver.extent)
        return Answer(self.motor.scale.from_unit(u), position, distance, bound, within)


def _rows(values: ArrayLike, names: tuple[str, ...], what: str) -> tuple[Array, bool]:
    """Check an argument; rows (n, len(names)) and whether it was a single vector."""
    try:
        rows = np.array(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise QueryError(f"{what}: expected numbers, got {values!r:.60}") from error
    single = rows.ndim == 1
    rows = np.atleast_2d(rows)
    if rows.ndim != 2 or rows.shape[1] != len(names):
        raise QueryError(
            f"{what} of shape {np.shape(values)}: expected ({len(names)},) or (n, {len(names)}), "
            f"one column each for {', '.join(names)}"
        )
    if not np.isfinite(rows).all():
        row = int(np.argmin(np.isfinite(rows).all(axis=1)))
        where = "" if single else f" in row {row}"
        raise QueryError(f"{what}{where}: {rows[row].tolist()} is not finite, expected numbers")
    return rows, single
