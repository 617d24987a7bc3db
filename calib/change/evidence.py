"""Evidence: the workings of a verdict: what tests, the bound, orientations and causes say."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..arm.rotations import exponential, logarithm, matrix_of
from ..body.belief import Body, knows_orientation
from ..body.covariance import autocorrelation_time, root_of
from ..body.fit import Fit
from ..body.parameters import Indices, Prior
from ..body.rows import Rows
from ..body.settings import FREE, STUDENT
from ..common.arrays import Array, Mask
from ..samples.diagnosis import rows_behind
from .causes import Cause
from .explain import Explanation, is_changed
from .frame import Reference
from .rows import LogRows
from .settings import (
    BEYOND,
    FALSE_ALARM,
    FEW_WRONG,
    UNEXPLAINED,
)
from .significance import SIGNIFICANCE, GroupTest, Tested
from .system import Log


@dataclass(frozen=True)
class BoundTest:
    """The rows that are beyond the model's own 95 % bound."""

    beyond: float  # share of them
    usual: float  # median of the bounds [unit]
    test: GroupTest  # the chance of so many by noise

    @property
    def holds(self) -> bool:
        """Whether they are about as many as usual."""
        return self.beyond <= BEYOND and self.test.score <= 1.0

    def words(self, *, noisier: bool) -> str:
        """The share in words; `noisier` if noise may be all there is to it."""
        cause = "a noisier sensor or encoder, " if noisier else ""
        return (
            f"{100 * self.beyond:.0f} % of the rows are further from the prediction than its "
            f"bound, where 5 % should be: {cause}the bound does not hold"
        )


def bound_test(
    rows: LogRows,
    sound: Mask,
    limit: Array,
    shared: Array | float,
    tests: Tested,
) -> BoundTest:
    """Count the rows beyond the 95 % bound, beside what a noisier sensor or encoder would do.

    sound : (n,), rows that do not contradict all others; k of them
    limit : (n,), the bound of each row [unit]
    shared : (k,), variance of what all rows share [unit^2]
    """
    from scipy.special import bdtrc, chdtri

    index = np.flatnonzero(sound)
    away = (rows.x - rows.predicted)[index]
    bound = limit[index]
    usual = float(np.median(bound))
    square = (away**2).sum(axis=1)
    outputs = away.shape[1]
    # squared, of 95 % of a Gaussian, in deviations
    radius = float(chdtri(outputs, 0.05))
    # half of the rows of a noisier sensor are nearer than its median
    median = float(np.median(square)) / float(chdtri(outputs, 0.5))
    noise = max(tests.noise**2, median) - tests.usual**2
    if noise > 0.0 and alike(index, rows.u[index], away) * radius > usual**2:
        noise = 0.0
    variance = np.full(len(away), max(noise, 0.0))
    if tests.noisy is not None:
        joint, sd = tests.noisy
        slope = rows.body.structure.slope(rows.q[sound], rows.body.beta)
        variance += sd**2 * (slope[..., joint] ** 2).sum(axis=1)
    over = square > bound**2 + radius * (shared + variance)
    # rows that err together count once
    time = 1.0
    if over.any():
        time = autocorrelation_time(over[:, None].astype(float))
    count = int(over.sum() / time)
    independent = math.ceil(len(over) / time)
    chance = float(bdtrc(count - 1, independent, BEYOND)) if count else 1.0
    beyond = float(np.mean(square > bound**2 + radius * shared))
    return BoundTest(beyond, usual, GroupTest("bound", chance))


def alike(rows: Indices, u: Array, residual: Array) -> float:
    """Variance of an axis by which rows of like joints err alike, 0 where that may be chance."""
    from scipy.spatial import cKDTree
    from scipy.special import ndtri

    # of so many rows at least one is no neighbour in time: noise may last over some rows
    lasting = SIGNIFICANCE.lasting
    near = cKDTree(u).query(u, min(2 * lasting + 2, len(u)))[1]
    near = np.asarray(near)
    later = np.abs(rows[near] - rows[:, None]) > lasting
    row = np.flatnonzero(later.any(axis=1))
    if not len(row):
        return 0.0
    pairs = np.stack([row, near[row, later[row].argmax(axis=1)]], axis=1)
    first, second = np.unique(np.sort(pairs, axis=1), axis=0).T
    product = (residual[first] * residual[second]).sum(axis=1)
    # whatever its size, noise makes either sign as likely
    sure = product.sum() > -ndtri(FALSE_ALARM) * np.linalg.norm(product)
    return float(product.mean()) / residual.shape[1] if sure else 0.0


@dataclass(frozen=True)
class TurnedTool:
    """How the tool of a log is turned, beside what a belief says."""

    # statistic over its threshold; 0 where nothing can be compared
    score: float = 0.0
    turn: Array = field(
        default_factory=lambda: np.zeros(3)
    )  # [rad], in the tool's own axes
    covariance: Array = field(default_factory=lambda: np.zeros((3, 3)))

    @property
    def cause(self) -> Cause:
        """A tool that is turned about its own tip."""
        angle = float(np.linalg.norm(self.turn))
        half = (
            1.96
            * float(np.sqrt(self.turn @ self.covariance @ self.turn))
            / angle
        )
        size = f"{np.degrees(angle):.3g} deg"
        words = f"the tool is turned by {size} (its orientation, not its place)"
        return Cause.measured(
            "tool", "tool.rotation", words, angle, half, "rad"
        )

    def of(self, body: Body) -> Body:
        """A belief with the tool turned."""
        tool = body.structure.groups["tool.rotation"]
        delta = np.zeros(body.structure.size)
        delta[tool] = self.turn
        place = np.searchsorted(body.active, tool)
        covariance = body.covariance.copy()
        covariance[place] = 0.0
        covariance[:, place] = 0.0
        covariance[np.ix_(place, place)] = self.covariance / body.kappa**2
        beta = body.structure.retract(body.beta, delta)
        return replace(body, beta=beta, root=root_of(covariance))


def turned_tool(
    rows: LogRows, structure: Any, beta: Array, deviation: Array | None = None
) -> TurnedTool:
    """Compare orientations with those that parameters (d,) predict.

    deviation : (d,), standard deviations of the parameters, which may turn the tool, too; the
        sensor may be turned then: positions tell that less well
    """
    from scipy.special import chdtri

    old = rows.body
    if rows.orientation is None or not knows_orientation(old):
        return TurnedTool()
    tool = structure.groups["tool.rotation"]
    sd = np.zeros(len(beta))
    if deviation is not None:
        sd = deviation.copy()
        sd[structure.groups["view.rotation"]] = FREE
    sd[tool] = FREE
    poses = np.hstack([rows.x, logarithm(matrix_of(rows.orientation))])
    # of positions nothing is asked
    floor = np.repeat([FREE**2 * structure.extent, 1e-9], 3)
    fit = Fit(
        structure.with_view("pose"),
        [Rows(rows.q, poses, floor=floor)],
        beta,
        Prior(beta, sd),
        nu=STUDENT,
    ).maximise()
    before, after = exponential(np.stack([beta[tool], fit.beta[tool]]))
    turn = logarithm(before.T @ after)
    place = np.searchsorted(fit.active, tool)
    covariance = fit.covariance[np.ix_(place, place)]
    place = np.searchsorted(old.active, tool)
    # the model knows its own tool as well as it does
    both = covariance + old.kappa**2 * old.covariance[np.ix_(place, place)]
    square = float(turn @ np.linalg.solve(both, turn))
    # what the chain leaves over differs between regions of the workspace by about its scatter
    scatter = np.sqrt(3) * fit.noise[-1]
    score = min(
        square / float(chdtri(3, FALSE_ALARM)),
        float(np.linalg.norm(turn) / scatter),
    )
    return TurnedTool(score, turn, covariance)


@dataclass(frozen=True, eq=False)
class Evidence:
    """What a log says of a belief."""

    rows: LogRows
    # {"sensor", "joints", "offsets"} or None, what is known about the change
    cause: str | None
    prior: Body  # the belief that a changed arm starts from
    reference: Reference  # the same in the frame of the log
    sound: Mask  # (n,), rows that do not contradict all others
    data: Log  # these
    tests: Tested
    bound: BoundTest
    explanations: tuple[Explanation, ...]  # the best first

    @property
    def unit(self) -> str:
        """Unit of the positions; "sensor" where their scale shows that it is not the model's."""
        unit = self.rows.unit
        same = self.reference.scale == 1.0 or unit != self.rows.model.about.unit
        return unit if same else "sensor"

    @cached_property
    def distance(self) -> float:
        """Typical distance of the rows from the best explanation [unit]."""
        residual = self.explanations[0].residual
        return float(np.median(np.linalg.norm(residual, axis=1)))

    @cached_property
    def misfit(self) -> float:
        """The same as a share of the typical distance of the positions from their middle."""
        away = self.rows.x - np.median(self.rows.x, axis=0)
        spread = float(np.median(np.linalg.norm(away, axis=1)))
        return self.distance / max(spread, 1e-300)

    @cached_property
    def explained(self) -> bool:
        """Whether any explanation comes near the rows: to a part of their spread, or as bounded."""
        if self.misfit < UNEXPLAINED:
            return True
        # rows that lag or whose joints are exchanged come near too, but for those at each jump
        wrong = self.rows.wrong + int(np.count_nonzero(~self.sound))
        few = wrong <= FEW_WRONG * len(self.rows)
        return few and self.distance < self.bound.usual < np.inf

    @cached_property
    def better(self) -> bool:
        """Whether a change explains the rows, and clearly better than none."""
        changed = self.reference.new or is_changed(self.explanations)
        return self.explained and changed

    @cached_property
    def score(self) -> float:
        """Above 1 the arm or its sensor changed."""
        fails = self.bound.beyond > BEYOND
        scores = [self.tests.score, self.bound.test.score]
        if self.reference.new:
            scores.append(2.0)
        if not self.explained and (fails or max(scores) > 1.0):
            scores.append(1.0 + self.misfit)
        if self.better and fails and self.tests.noisy is None:
            scores.append(1.0 + self.bound.beyond)
        return max(scores)

    @property
    def attributed(self) -> bool:
        """Whether something changed, and a change is clearly better than none."""
        return self.better and self.score > 1.0

    @cached_property
    def tool(self) -> TurnedTool:
        """How the tool is turned beside the best explanation of the positions, as far as sure."""
        if not self.attributed:
            return self.tool_beside(self.rows.body.beta)
        best = self.explanations[0]
        structure = self.reference.structure
        return turned_tool(self.rows, structure, best.beta, best.deviation)

    def tool_beside(self, beta: Array) -> TurnedTool:
        """How the tool is turned beside what parameters (d,) predict."""
        return turned_tool(self.rows, self.reference.structure, beta)

    def why_not(self) -> str:
        """One line on a log that nothing explains."""
        reference = self.reference
        z = self.rows.x.copy()
        z[self.sound] = self.data.z
        lag = rows_behind(
            lambda q: reference.structure.predict(q, reference.beta),
            self.rows.q,
            z,
        )
        check = "check that joints and positions of a row belong together and are of this arm"
        if lag:
            check = f"positions follow the joints by {lag} rows: align the clocks of both"
        return (
            f"nothing explains the log: its positions are {100 * self.misfit:.0f} % of their "
            f"spread away from any change of the arm or the sensor; {check}"
        )
