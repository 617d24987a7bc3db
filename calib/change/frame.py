"""The frame: an old belief brought into the frame of a new log.

A camera that was hung elsewhere, mirrored or read in other units moves every position by far
more than anything else; so the frame comes first, and small changes after it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..arm.rotations import logarithm, similarity
from ..body.belief import Body
from ..body.fit import Fit
from ..body.parameters import Indices, Prior
from ..body.rows import Rows
from ..body.settings import SIMULATED_FLOOR, STUDENT
from ..body.structure import Structure
from ..body.views import is_camera
from ..common.arrays import Array
from ..common.rows import thinned
from ..model.alignment import Alignment
from ..samples.diagnosis import unit_hint
from .causes import FRAME, Cause, indices_of, is_sensors
from .settings import LEAST_OWN

_FAR = 0.05  # misfit, of the extents, from which another frame is looked for
# misfit by which a mirror, another sense or a locked joint must be better
_BETTER = 0.5
_SCALES = (0.5, 2.0)  # beyond these the positions are in another unit
_ROWS = 200
_LEAST = 1e-4  # noise that is always allowed, of the extents
_EXACT = 1e-6  # misfit, of the extents, that is none
_LOCKED_STEP = 0.1  # between the angles that are tried for a joint that is held [rad]


@dataclass(frozen=True)
class Reference:
    """The old belief, in the frame of a log."""

    # the old belief with the structure of the log: mirrored, or with a joint turned round
    body: Body
    beta: Array  # (d,), its parameters, the view's moved
    # a mirror, joints that turn the other way or no more, another unit: what is no matter of
    # degree; where there is one only hypotheses with a free frame make sense
    causes: tuple[Cause, ...] = ()
    # size of positions over what it was; 1 where they are in the old unit
    scale: float = 1.0
    # (g,), parameters of the view whose old posterior does not count any more
    forgotten: Indices = field(default_factory=lambda: np.zeros(0, dtype=np.intp))

    @property
    def new(self) -> bool:
        """Whether the frame is one that no posterior tells of."""
        return bool(self.causes)

    @property
    def structure(self) -> Structure:
        """Structure of the log."""
        return self.body.structure

    @property
    def sizes(self) -> Array:
        """What residuals of each output are divided by, (m,) [unit]: the noise that is expected."""
        return np.maximum(self.body.noise, _LEAST * np.asarray(self.structure.extents))

    @property
    def own_sd(self) -> Array:
        """Standard deviation (m,) [unit] of the residual that a log may have of its own."""
        return np.maximum(self.body.tau, LEAST_OWN * np.asarray(self.structure.extents))


def reference_of(body: Body, q: Array, z: Array, unit: str) -> Reference:
    """Bring the old belief into the frame of a log of rows (n, dof), (n, m)."""
    old = body.structure
    rows = thinned(len(q), _ROWS)
    places = slice(old.blocks[0])
    extent = float(old.extents[0])
    q = q[rows]
    z = z[rows]
    seen = old.predict(q, body.beta)
    if float(np.median(np.linalg.norm((z - seen)[:, places], axis=1))) < _FAR * extent:
        return Reference(body, body.beta)
    if is_camera(old.view):
        moved = _placed(old, q, z, [body.beta, _camera_anew(body, q, z)], FRAME)
        return Reference(body, moved, forgotten=indices_of(old, FRAME))
    tries = []
    for change, start, told in _variants(body):
        p = _replaced(old, change).predict(q, start)[:, places]
        held = start is not body.beta
        for scaled in (False,) if held else (False, True):
            error, ratio, turn = _misfit(p, z[:, places], scaled)
            # each further freedom must halve what is left
            free = len(told) + (scaled and not 0.5 < ratio < 2.0)
            error = max(error, _EXACT * extent) / _BETTER**free
            tries.append((error, change, start, told, ratio, turn))
    _, change, start, told, ratio, turn = min(tries, key=lambda t: t[0])
    structure = _replaced(old, change)
    other = not _SCALES[0] < ratio < _SCALES[1]
    factor = ratio if other else 1.0
    if other:  # in the log's own unit
        own = {"extent": ratio * old.extent, "centre": tuple(z.mean(axis=0).tolist())}
        structure = _replaced(
            structure, {**own, "unit": "sensor" if unit == old.unit else unit}
        )
    about = structure.groups["view.rotation"]
    shift = structure.groups["view.shift"]
    starts = []
    for by in (np.eye(len(turn)), turn):
        beta = start.copy()
        step = np.zeros(structure.size)
        beta[indices_of(structure, ("view.scale",))] += np.log(factor)
        step[about] = (
            np.arctan2(by[1:2, 0], by[0, 0]) if len(about) == 1 else logarithm(by)
        )
        beta = structure.retract(beta, step)
        residual = structure.residual(z, structure.predict(q, beta))
        beta[shift] += np.median(residual, axis=0)[: len(shift)]
        starts.append(beta)
    beta = _placed(structure, q, z, starts, (*FRAME, "view.scale") if other else FRAME)
    if len(about) == 1:  # the same angle, the short way round
        beta[about] -= 2 * np.pi * np.round((beta[about] - start[about]) / (2 * np.pi))
    causes = list(told)
    if (
        "mirror" in change
        and Alignment.between(seen, structure.predict(q, beta)).swapped
    ):
        words = "x and y of the log are exchanged, compared with the model"
        causes[0] = replace(causes[0], words=words)
    if other:
        words = (
            f"the log's positions are {ratio:.4g} times the model's{unit_hint(ratio)}"
        )
        causes.append(Cause("scale", "view.scale", words, ratio, None, "1"))
    view = [g for g in structure.groups if is_sensors(g)] if causes else FRAME
    sizes = {
        name: factor * getattr(body, name) for name in ("noise", "tau", "residual")
    }
    body = replace(body, structure=structure, **sizes)
    return Reference(body, beta, tuple(causes), factor, indices_of(structure, view))


def carried_offset(old: Body, new: Body, beta: Array, q: Array, offset: Array) -> Array:
    """What maps add to a body, (n, m), after a change: as the joints that cause it move the tip."""
    before = old.structure.slope(q, old.beta)
    after = new.structure.slope(q, beta)
    joints = np.einsum("ndm,nm->nd", np.linalg.pinv(before, rcond=1e-3), offset)
    return np.asarray(np.einsum("nmd,nd->nm", after, joints))


def _camera_anew(body: Body, q: Array, z: Array) -> Array:
    """Parameters of a camera that stands anywhere, its lens and the arm as they were."""
    from ..body.starts import frame  # brings SciPy's linear algebra

    structure: Any = body.structure
    lens = tuple(body.beta[structure.groups["lens"]].tolist())
    known = structure.with_sensor(lens=lens, lens_sd=(0.0, 0.0, 0.0, 0.0))
    beta = body.beta.copy()
    free = indices_of(structure, FRAME)
    beta[free] = frame(known, q, z, body.beta)[free]
    return beta


def _variants(body: Body) -> Iterator[tuple[dict[str, Any], Array, tuple[Cause, ...]]]:
    """Other fields of the structure and parameters, and what they mean, one cause a freedom."""
    structure = body.structure
    beta = body.beta
    seen: list[tuple[dict[str, Any], tuple[Cause, ...]]] = [({}, ())]
    if (mirror := getattr(structure, "mirror", None)) is not None:
        words = "the log's positions are mirrored, compared with the model"
        seen.append(({"mirror": -mirror}, (Cause("mirror", "view.mirror", words),)))
    yield from ((change, beta, told) for change, told in seen)
    if not {"offset", "gain"} <= set(structure.groups):
        return
    signs = getattr(structure, "signs", ())
    for k in np.flatnonzero(structure.revolute).tolist():
        name = structure.joint_names[k]
        if signs:
            other = tuple(-s if j == k else s for j, s in enumerate(signs))
            turned = Cause(
                f"sign:{name}", "sign", f"{name} turns the other way than before"
            )
            yield from (
                ({**change, "signs": other}, beta, (*told, turned))
                for change, told in seen
            )
        lost = Cause(
            f"lost:{name}", "gain", f"{name} no longer moves the tip", 0.0, None, "1"
        )
        for angle in np.arange(-np.pi, np.pi, _LOCKED_STEP) if k else ():
            held = beta.copy()
            held[structure.groups["gain"][k]] = 0.0
            held[structure.groups["offset"][k]] += angle
            yield {}, held, (lost,)


def _replaced(structure: Structure, change: dict[str, Any]) -> Structure:
    """The structure with other values of those fields that it has."""
    fields = vars(structure.viewpoint)
    sensor = {name: value for name, value in change.items() if name in fields}
    if sensor:  # a copy would compute again what a structure keeps of itself
        structure = structure.with_sensor(**sensor)
    signs = change.get("signs")
    return structure if signs is None else structure.changed(signs=signs)


def _misfit(p: Array, z: Array, scaled: bool) -> tuple[float, float, Array]:
    """Typical distance after the best motion, its scale and its rotation.

    Rows that contradict most others are left out of a second fit.
    """
    kept = np.ones(len(p), dtype=bool)
    for _ in range(3):
        turn, _, ratio = similarity(p[kept], z[kept])
        size = ratio if scaled else 1.0
        away = z - z[kept].mean(axis=0) - size * (p - p[kept].mean(axis=0)) @ turn.T
        error = np.linalg.norm(away, axis=1)
        kept = error <= max(3.0 * float(np.median(error)), 1e-12)
    # a scale that is near one is not what is asked for
    return float(np.median(error)) / size, ratio, turn


def _placed(
    structure: Structure,
    q: Array,
    z: Array,
    starts: list[Array],
    groups: tuple[str, ...],
) -> Array:
    """The frame alone fitted to the rows, from the best of some starts."""
    sd = np.zeros(structure.size)
    sd[indices_of(structure, groups)] = 1e3 * max(1.0, float(structure.extents[0]))
    found = []
    for start in starts:
        rows = [Rows(q, z, floor=SIMULATED_FLOOR * structure.extents)]
        fit = Fit(structure, rows, start, Prior(start, sd), nu=STUDENT)
        beta, cost, _ = fit.settle(30)
        found.append((cost, beta))
    return min(found, key=lambda each: each[0])[1]
