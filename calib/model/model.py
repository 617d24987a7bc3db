"""The model: two maps, their links and local models, queried in both directions."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..inverse.solver import Solver
from ..maps.association import Association, check_readout
from ..maps.map import Map
from ..maps.node_bounds import blend_nodes
from ..maps.predictor import Predictor
from ..maps.support import Support
from . import answers
from .answers import Answer, checked_rows

if TYPE_CHECKING:
    import os

    from scipy.sparse import csr_array

    from ..change.baseline import Baseline
    from ..change.check import Drift
    from ..change.monitor import Monitor
    from ..samples.samples import Samples
    from ..training.evaluate import Evaluation
    from .about import About
    from .paths import Path

Array = NDArray[np.float64]


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

    @cached_property
    def support(self) -> Support:
        """Where samples were."""
        return Support(self.motor, self.visited)

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
        q, single = checked_rows(q, self.about.joint_names, "joint values")
        u = self.motor.scale.to_unit(q)
        inside = self.support.covers(u)
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
        if readout == "local":
            rows, single = checked_rows(x, ("x", "y"), "positions")
            q = answers.joints(self, rows, answers.anchor(self, near, len(rows)), nearest=nearest)
            return q[0] if single else q
        answer = self.solve(x, near, readout)
        q = answer.q if nearest else np.where(answer.reachable[:, None], answer.q, np.nan)
        return q[0] if np.ndim(x) == 1 else q

    def solve(self, x: ArrayLike, near: ArrayLike | None = None, readout: str = "local") -> Answer:
        """Answer inverse queries in full; see :meth:`inverse` for the parameters."""
        rows, _ = checked_rows(x, ("x", "y"), "positions")
        return answers.solve(self, rows, answers.anchor(self, near, len(rows)), readout)

    def solve_all(self, x: ArrayLike) -> list[Answer]:
        """All branches of each target, the one closest to the middle of the ranges first.

        A target out of reach has one answer, the nearest attainable point.
        """
        rows, _ = checked_rows(x, ("x", "y"), "positions")
        return answers.solve_all(self, rows)

    def inverse_all(self, x: ArrayLike) -> list[Array]:
        """Joint values of every branch that reaches each target, list of (k, dof) arrays.

        The solution closest to the middle of the joints' ranges comes first; a target out
        of reach has none.  A redundant arm reaches a target on curves or surfaces of
        joints: each connected one is represented by its point closest to the middle.
        """
        return [a.q[a.reachable] for a in self.solve_all(x)]

    def path(self, x: ArrayLike, start: ArrayLike | None = None, step: float | None = None) -> Path:
        """Joint values along straight lines through waypoints, on one branch if there is one.

        Parameters
        ----------
        x : (n, 2) array [unit]
            Waypoints, two or more.
        start : (dof,) array [rad or m], optional
            Joints that the path should start near; without it the branch that can follow
            the path furthest, of several the one that moves the joints least.
        step : float [unit], optional
            Longest way of the tip between two rows, 1 % of the workspace's extent where not
            given.  ``math.inf`` gives the waypoints alone.

        Returns
        -------
        Path
            Rows of joints without times, and where a jump cannot be avoided.
        """
        from .paths import follow_path

        return follow_path(self, x, start, step)

    def servo(
        self, x_measured: ArrayLike, target: ArrayLike, q: ArrayLike, gain: float = 0.5
    ) -> Array:
        """Joints a step closer to a target, from where the sensor sees the tip.

        A resolved-rate correction with the learned Jacobian: it closes the loop on the
        sensor, so that it converges even where the arm differs from the map.

        Parameters
        ----------
        x_measured, target : (n, 2) or (2,) array [unit]
            Where the tip is seen and where it should be.
        q : (n, dof) or (dof,) array [rad or m]
            Present joints; next time the joints that this returns.
        gain : float
            Share of the way that a step goes: smaller is calmer with a noisy sensor.

        Returns
        -------
        (n, dof) or (dof,) array [rad or m]
            Within the joints' range, at most a tenth of it away from `q`.
        """
        from ..use.servo import servo_step

        return servo_step(self, x_measured, target, q, gain)

    def expected_error(self, q: ArrayLike) -> Array:
        """95 % bound on the error of :meth:`forward` at joint values (n, dof), (n,) [unit].

        It bounds the distance to the true position for a simulated arm and to what the
        sensor would read for a log (``about.bound_of``).
        """
        q, single = checked_rows(q, self.about.joint_names, "joint values")
        u = self.motor.scale.to_unit(q)
        known = self.support.covers(u)
        bound = np.full(len(q), np.nan)
        bound[known] = blend_nodes(self.motor, self.bounds, u[known])
        return bound[0] if single else bound

    def evaluate(self, samples: Samples | None = None) -> Evaluation:
        """Errors of all readouts on fresh exact samples, or on measured ones."""
        from ..training.evaluate import evaluate

        return evaluate(self, samples)

    def check(self, log: Samples) -> Drift:
        """Whether new samples still fit the map, and what changed if they do not."""
        from ..change.check import check

        return check(self, log)

    def monitor(self) -> Monitor:
        """A monitor for a stream of samples: ``monitor.update(q, x)`` after each."""
        from ..change.monitor import Monitor

        return Monitor(self)

    def adapt(self, log: Samples, *, method: str = "few-shot") -> Model:
        """The model re-calibrated from new samples; this one is left as it is.

        Where nothing improved this one is returned.  :func:`calib.adapt` also tells by how
        much, and what was found.
        """
        from ..change.adapt import adapt

        return adapt(self, log, method=method).model

    def correct(self, q: ArrayLike) -> Array:
        """Joint values (n, dof) that lead to where a nominal controller wants to go with `q`."""
        from ..use.correct import correct

        return correct(self, q).q if np.ndim(q) > 1 else correct(self, q).q[0]

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the model into one file, whole or not at all."""
        from ..model_file.storage import save

        save(self, path)

    def outside(self, q: ArrayLike) -> str | None:
        """Why the joint values (dof,) are outside of what was learned, None if they are not."""
        rows, _ = checked_rows(q, self.about.joint_names, "joint values")
        u = self.motor.scale.to_unit(rows)
        if bool(self.support.covers(u)[0]):
            return None
        lower, upper = self.about.lower, self.about.upper
        for k, name in enumerate(self.about.joint_names):
            if not -self.motor.spacing <= u[0, k] <= 1.0 + self.motor.spacing:
                return (
                    f"{name} = {rows[0, k]:.6g} is outside of the learned range "
                    f"{lower[k]:.6g} to {upper[k]:.6g}"
                )
        return "no sample was measured near these joint values"
