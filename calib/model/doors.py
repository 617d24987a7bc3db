"""Doors: methods of a model that only call what other rooms do with a model.

They are here because users expect them; each is one line, and what it calls is documented
there.  These are the only imports of the package that run up, and they run when called.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import ArrayLike

from ..common.arrays import Array

if TYPE_CHECKING:
    import os

    from ..change.check import Drift
    from ..change.monitor import Monitor
    from ..samples.samples import Samples
    from ..training.evaluate import Evaluation
    from .model import Model
    from .paths import Path


class Doors:
    """What is done with a model elsewhere, as methods of the model."""

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

        return follow_path(_model(self), x, start, step)

    def inverse_pose(
        self,
        position: ArrayLike,
        quaternion: ArrayLike | None = None,
        near: ArrayLike | None = None,
        *,
        frame: str = "sensor",
    ) -> Array:
        """Joint values (n, dof) for positions and orientations of an arm in space.

        NaN out of reach; :func:`calib.model.poses.solve_poses` tells more, and all branches.

        Parameters
        ----------
        position : (n, 3) or (3,) array [m, or the sensor's unit in its frame]
        quaternion : (n, 4) or (4,) array, optional
            qx, qy, qz, qw; free where not given.
        near : (n, dof) or (dof,) array, optional [rad or m]
            Of several solutions the nearest to these joints answers.
        frame : {"sensor", "base"}
        """
        from .poses import solve_poses

        found = solve_poses(_model(self), position, quaternion, near, frame=frame)
        q = np.where(found.reachable[:, None], found.q, np.nan)
        return q[0] if np.ndim(position) == 1 else q

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
        from .answers import servo_step

        return servo_step(_model(self), x_measured, target, q, gain)

    def evaluate(self, samples: Samples | None = None) -> Evaluation:
        """Errors of all readouts on fresh exact samples, or on measured ones."""
        from ..training.evaluate import evaluate

        return evaluate(_model(self), samples)

    def check(self, log: Samples) -> Drift:
        """Whether new samples still fit the map, and what changed if they do not."""
        from ..change.check import check

        return check(_model(self), log)

    def monitor(self) -> Monitor:
        """A monitor for a stream of samples: ``monitor.update(q, x)`` after each."""
        from ..change.monitor import Monitor

        return Monitor(_model(self))

    def adapt(self, log: Samples, *, method: str = "few-shot") -> Model:
        """The model re-calibrated from new samples; this one is left as it is.

        Where nothing improved this one is returned.  :func:`calib.adapt` also tells by how
        much, and what was found.
        """
        from ..change.adapt import adapt

        return adapt(_model(self), log, method=method).model

    def correct(self, q: ArrayLike) -> Array:
        """Joint values (n, dof) that lead to where a nominal controller wants to go with `q`.

        NaN out of reach, and where a joint would change by far more than this model usually
        corrects; :func:`calib.correct` tells which and takes another limit.
        """
        from ..use.correct import correct

        found = correct(_model(self), q)
        answer = np.where(found.exceeded[:, None], np.nan, found.q)
        return answer[0] if found.single else answer

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the model into one file, whole or not at all."""
        from ..model_file.storage import save

        save(_model(self), path)


def _model(self: Doors) -> Model:
    return cast("Model", self)
