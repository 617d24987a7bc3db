"""The frame: an old belief brought into the frame of a new log; the tool, by orientations.

A camera that was hung elsewhere, mirrored or read in other units moves every position by far
more than anything else; so the frame comes first, and small changes after it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from ..arm.rotations import exponential, logarithm, matrix_of, similarity
from ..body.belief import Body, knows_orientation
from ..body.covariance import root_of
from ..body.fit import Fit
from ..body.parameters import Indices, Prior
from ..body.rows import Rows
from ..body.settings import FREE, STUDENT
from ..body.structure import Structure
from ..body.views import is_camera
from ..common.arrays import Array
from ..common.rows import spread_rows
from ..model.alignment import Alignment
from ..samples.diagnosis import unit_hint
from .causes import FRAME, Cause, indices_of, is_sensors
from .rows import LogRows
from .settings import FALSE_ALARM, LEAST_OWN


@dataclass(frozen=True)
class FrameSettings:
    """When a log is looked at in another frame."""

    # misfit, of the extents, from which another one is looked for
    far: float = 0.05
    # share of it that a mirror, another sense or another unit must leave at most
    better: float = 0.5
    # beyond these ratios of size positions are in another unit
    scales: tuple[float, float] = (0.5, 2.0)
    # that a frame is looked for with
    rows: int = 200
    # noise that is always allowed, of the extents
    least: float = 1e-4
    # misfit, of the extents, that is none
    exact: float = 1e-6
    # between the angles that are tried for a joint that is held [rad]
    angle: float = 0.1


PLACING = FrameSettings()


@dataclass(frozen=True)
class Reference:
    """The old belief, in the frame of a log."""

    # the old belief with the structure of the log: mirrored, or with a joint turned round
    body: Body
    beta: Array  # (d,), its parameters, the view's moved
    # a mirror, a joint that turns the other way, another unit: what is no matter of degree;
    # where there is one only hypotheses with a free frame make sense
    causes: tuple[Cause, ...] = ()
    # size of positions over what it was; 1 where they are in the old unit
    scale: float = 1.0
    # (g,), parameters of the view whose old posterior does not count any more
    forgotten: Indices = field(
        default_factory=lambda: np.zeros(0, dtype=np.intp)
    )

    @property
    def new(self) -> bool:
        """Whether the frame is one that no posterior tells of."""
        return bool(self.causes)

    @property
    def moved(self) -> bool:
        """Whether the frame was fitted to the log."""
        return len(self.forgotten) > 0

    @property
    def structure(self) -> Structure:
        """Structure of the log."""
        return self.body.structure

    @property
    def sizes(self) -> Array:
        """What residuals of each output are divided by, (m,) [unit]: the noise that is expected."""
        least = PLACING.least * np.asarray(self.structure.extents)
        return np.maximum(self.body.noise, least)

    @property
    def own_sd(self) -> Array:
        """Standard deviation (m,) [unit] of the residual that a log may have of its own."""
        least = LEAST_OWN * np.asarray(self.structure.extents)
        return np.maximum(self.body.tau, least)


def reference_of(body: Body, q: Array, z: Array, unit: str) -> Reference:
    """Bring the old belief into the frame of a log of rows (n, dof), (n, m)."""
    old = body.structure
    rows = spread_rows(len(q), PLACING.rows)
    q = q[rows]
    z = z[rows]
    places = slice(old.blocks[0])
    extent = float(old.extents[0])
    predicted = old.predict(q, body.beta)
    missed = np.linalg.norm((z - predicted)[:, places], axis=1)
    if float(np.median(missed)) < PLACING.far * extent:
        return Reference(body, body.beta)
    if is_camera(old.view):
        beta = _placed(old, q, z, _camera_anew(body, q, z), FRAME)
        return Reference(body, beta, forgotten=indices_of(old, FRAME))

    # the sense of axes and joints that comes nearest, in the log's own unit
    senses = [*_senses(old, body.beta), *_stuck(old, body.beta)]
    fits = [_Placement.of(sense, q, z[:, places]) for sense in senses]
    best = min(fits, key=lambda fit: fit.cost(extent))
    factor = best.ratio if best.rescaled else 1.0
    structure = best.sense.structure
    fitted: tuple[str, ...] = FRAME
    if best.rescaled:
        structure = _in_unit(structure, factor, z, unit)
        fitted = (*FRAME, "view.scale")

    # the frame fitted to the rows, from where that sense stands
    start = _turned(structure, best, factor)
    shift = structure.groups["view.shift"]
    residual = structure.residual(z, structure.predict(q, start))
    start[shift] += np.median(residual, axis=0)[: len(shift)]
    beta = _placed(structure, q, z, start, fitted)

    causes = list(best.sense.causes)
    if best.rescaled:
        causes.append(_other_unit(factor, old.unit))
    if causes and causes[0].cause == "mirror":
        frame = Alignment.between(predicted, structure.predict(q, beta))
        if frame.is_swapped:
            words = "x and y of the log are exchanged, compared with the model"
            causes[0] = replace(causes[0], words=words)
    forgotten: tuple[str, ...] = FRAME
    if causes:
        forgotten = tuple(filter(is_sensors, structure.groups))
    return Reference(
        body=_scaled(body, structure, factor),
        beta=beta,
        causes=tuple(causes),
        scale=factor,
        forgotten=indices_of(structure, forgotten),
    )


def _in_unit(
    structure: Structure, factor: float, z: Array, unit: str
) -> Structure:
    """The structure in the unit of positions (n, m), which are `factor` times the model's."""
    return _with_fields(
        structure,
        extent=factor * float(structure.extent),
        centre=tuple(z.mean(axis=0).tolist()),
        unit="sensor" if unit == structure.unit else unit,
    )


def _other_unit(factor: float, unit: str) -> Cause:
    """Positions that are `factor` times the model's, in its unit."""
    hint = unit_hint(factor, unit)
    words = f"the log's positions are {factor:.4g} times the model's{hint}"
    return Cause("scale", "view.scale", words, factor, None, "1")


def _scaled(body: Body, structure: Structure, factor: float) -> Body:
    """The belief with the structure of a log, and its noises in the unit of that."""
    return replace(
        body,
        structure=structure,
        noise=factor * body.noise,
        tau=factor * body.tau,
        residual=factor * body.residual,
    )


def carried_offset(
    old: Body, new: Body, beta: Array, q: Array, offset: Array
) -> Array:
    """What maps add to a body, (n, m), after a change: as the joints that cause it move the tip."""
    before = old.structure.slope(q, old.beta)
    after = new.structure.slope(q, beta)
    joints = np.einsum("ndm,nm->nd", np.linalg.pinv(before, rcond=1e-3), offset)
    return np.asarray(np.einsum("nmd,nd->nm", after, joints))


class _Sense(NamedTuple):
    """A structure with another sense of axes or joints, or with a joint that is stuck."""

    structure: Structure
    beta: Array  # (d,)
    causes: tuple[Cause, ...] = ()  # one a freedom
    unit_is_open: bool = True  # whether positions may be in another unit


class _Placement(NamedTuple):
    """The turn and the ratio of sizes by which a sense comes nearest to a log."""

    sense: _Sense
    misfit: float
    turn: Array
    ratio: float

    @staticmethod
    def of(sense: _Sense, q: Array, z: Array) -> _Placement:
        """Turn predictions to positions (n, m); rows that contradict most are left out."""
        predicted = sense.structure.predict(q, sense.beta)
        p = predicted[:, : z.shape[1]]
        sound = np.ones(len(p), dtype=bool)
        for _ in range(3):
            turn, shift, ratio = similarity(p[sound], z[sound])
            if not sense.unit_is_open:
                ratio = 1.0
                away = z[sound] - p[sound] @ turn.T
                shift = away.mean(axis=0)
            placed = shift + ratio * p @ turn.T
            distance = np.linalg.norm(z - placed, axis=1)
            sound = distance <= max(3.0 * float(np.median(distance)), 1e-12)
        return _Placement(
            sense, float(np.median(distance)) / ratio, turn, ratio
        )

    @property
    def rescaled(self) -> bool:
        """Whether positions are in another unit."""
        low, high = PLACING.scales
        return not low < self.ratio < high

    def cost(self, extent: float) -> float:
        """The misfit beside that of others: each further freedom must halve what is left."""
        freedom = len(self.sense.causes) + int(self.rescaled)
        misfit = max(self.misfit, PLACING.exact * extent)
        return float(misfit / PLACING.better**freedom)


def _senses(structure: Structure, beta: Array) -> Iterator[_Sense]:
    """The axes as they are and mirrored, and each joint the other way, as far as that may be."""
    plain = [_Sense(structure, beta)]
    mirror = getattr(structure, "mirror", None)
    if mirror is not None:
        words = "the log's positions are mirrored, compared with the model"
        cause = Cause("mirror", "view.mirror", words)
        mirrored = _with_fields(structure, mirror=-mirror)
        plain.append(_Sense(mirrored, beta, (cause,)))
    yield from plain
    signs = getattr(structure, "signs", ())
    for k in np.flatnonzero(structure.revolute).tolist() if signs else ():
        name = structure.joint_names[k]
        words = f"{name} turns the other way than before"
        cause = Cause(f"sign:{name}", "sign", words)
        other = (*signs[:k], -signs[k], *signs[k + 1 :])
        for sense in plain:
            turned = sense.structure.with_fields(signs=other)
            yield _Sense(turned, beta, (*sense.causes, cause))


def _stuck(structure: Structure, beta: Array) -> Iterator[_Sense]:
    """Each joint but the first stuck, at angles around the turn."""
    gains = structure.groups.get("gain", np.zeros(0, np.intp))
    for k in range(1, len(gains)):
        if not structure.revolute[k]:
            continue
        name = structure.joint_names[k]
        words = f"{name} no longer moves the tip"
        lost = Cause(f"lost:{name}", "gain", words, 0.0, None, "1")
        for angle in np.arange(-np.pi, np.pi, PLACING.angle):
            stuck = beta.copy()
            stuck[gains[k]] = 0.0
            stuck[structure.groups["offset"][k]] += angle
            yield _Sense(structure, stuck, (lost,), unit_is_open=False)


def _camera_anew(body: Body, q: Array, z: Array) -> Array:
    """Parameters of a camera that stands anywhere, its lens and the arm as they were."""
    from ..body.frame_starts import frame  # brings SciPy's linear algebra

    structure: Any = body.structure
    lens = tuple(body.beta[structure.groups["lens"]].tolist())
    fixed = structure.with_sensor(lens=lens, lens_sd=(0.0, 0.0, 0.0, 0.0))
    beta = body.beta.copy()
    free = indices_of(structure, FRAME)
    beta[free] = frame(fixed, q, z, body.beta)[free]
    return beta


def _with_fields(structure: Structure, **change: Any) -> Structure:
    """The structure with other values of those fields that its sensor has."""
    fields = vars(structure.viewpoint)
    sensor = {name: value for name, value in change.items() if name in fields}
    return structure.with_sensor(**sensor)


def _turned(structure: Structure, best: _Placement, factor: float) -> Array:
    """Parameters (d,) with the frame turned and scaled as it fits best."""
    about = structure.groups["view.rotation"]
    turn = best.turn
    step = np.zeros(structure.size)
    step[indices_of(structure, ("view.scale",))] = np.log(factor)
    if len(about) > 1:
        step[about] = logarithm(turn)
    else:
        step[about] = np.arctan2(turn[1, 0], turn[0, 0])
    return structure.retract(best.sense.beta, step)


def _placed(
    structure: Structure,
    q: Array,
    z: Array,
    start: Array,
    groups: tuple[str, ...],
) -> Array:
    """The frame alone fitted to the rows, from a start (d,)."""
    from ..body.start import Start

    sd = np.zeros(structure.size)
    anywhere = 1e3 * max(1.0, float(structure.extents[0]))
    sd[indices_of(structure, groups)] = anywhere
    prior = Prior(start, sd)
    return Start(structure, start).run(q, z, prior, 30).beta


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
        deviation = np.sqrt(self.turn @ self.covariance @ self.turn) / angle
        size = f"{np.degrees(angle):.3g} deg"
        words = f"the tool is turned by {size} (its orientation, not its place)"
        cause = Cause("tool", "tool.rotation", words, angle, unit="rad")
        return cause.within(1.96 * float(deviation))

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
    if rows.log.orientation is None or not knows_orientation(old):
        return TurnedTool()
    tool = structure.groups["tool.rotation"]
    sd = np.zeros(len(beta))
    if deviation is not None:
        sd = deviation.copy()
        sd[structure.groups["view.rotation"]] = FREE
    sd[tool] = FREE
    fit = _fit_to_poses(rows, rows.log.orientation, structure, Prior(beta, sd))
    before, after = exponential(np.stack([beta[tool], fit.beta[tool]]))
    turn = logarithm(before.T @ after)
    in_fit = np.searchsorted(fit.active, tool)
    covariance = fit.covariance[np.ix_(in_fit, in_fit)]
    # the model knows its own tool as well as it does
    in_old = np.searchsorted(old.active, tool)
    known = old.kappa**2 * old.covariance[np.ix_(in_old, in_old)]
    square = float(turn @ np.linalg.solve(covariance + known, turn))
    # what the chain leaves over differs between regions of the workspace by about its scatter
    scatter = np.sqrt(3) * fit.noise[-1]
    score = min(
        square / float(chdtri(3, FALSE_ALARM)),
        float(np.linalg.norm(turn) / scatter),
    )
    return TurnedTool(score, turn, covariance)


def _fit_to_poses(
    rows: LogRows, orientation: Array, structure: Any, prior: Prior
) -> Fit:
    """The parameters by the rows' orientations; of their positions nothing is asked."""
    turns = logarithm(matrix_of(orientation))
    poses = np.hstack([rows.x, turns])
    floor = np.repeat([FREE**2 * structure.extent, 1e-9], 3)
    measured = [Rows(rows.q, poses, floor=floor)]
    poser = structure.with_sensor(view="pose")
    return Fit(poser, measured, prior.mean, prior, nu=STUDENT).maximise()
