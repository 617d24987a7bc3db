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
from .hypotheses import FRAME, indices_of, is_sensors
from .settings import LEAST_OWN

_FAR = 0.05  # misfit, of the extents, from which another frame is looked for
_BETTER = 0.5  # misfit by which a mirror, another sense or a locked joint must be better
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
    new: bool = False  # whether only hypotheses with a free frame make sense
    mirrored: bool = False  # whether the sensor sees the plane from the other side than before
    turned: tuple[int, ...] = ()  # joints that turn the other way
    locked: tuple[int, ...] = ()  # joints that no longer move the tip
    scale: float = 1.0  # size of positions over what it was; 1 where they are in the old unit
    # (g,), parameters of the view whose old posterior does not count any more
    forgotten: Indices = field(default_factory=lambda: np.zeros(0, dtype=np.intp))

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
    old, rows = body.structure, thinned(len(q), _ROWS)
    places, extent, q, z = slice(old.blocks[0]), float(old.extents[0]), q[rows], z[rows]
    gap = np.linalg.norm((z - old.predict(q, body.beta))[:, places], axis=1)
    if float(np.median(gap)) < _FAR * extent:
        return Reference(body, body.beta)
    if is_camera(old.view):
        moved = _placed(old, q, z, [body.beta, _camera_anew(body, q, z)], FRAME)
        return Reference(body, moved, forgotten=indices_of(old, FRAME))
    tries = []
    for change, start, held in _variants(body):
        p = _replaced(old, change).predict(q, start)[:, places]
        for scaled in (False,) if held else (False, True):
            error, ratio, turn = _misfit(p, z[:, places], scaled)
            # each further freedom must halve what is left
            free = len(change) + len(held) + (scaled and not 0.5 < ratio < 2.0)
            error = max(error, _EXACT * extent) / _BETTER**free
            tries.append((error, change, start, held, ratio, turn))
    _, change, start, locked, ratio, turn = min(tries, key=lambda t: t[0])
    structure, other = _replaced(old, change), not _SCALES[0] < ratio < _SCALES[1]
    factor = ratio if other else 1.0
    if other:  # in the log's own unit
        own = {"extent": ratio * old.extent, "centre": tuple(z.mean(axis=0).tolist())}
        told = "sensor" if unit == old.unit else unit
        structure = _replaced(structure, {**own, "unit": told})
    about, shift = structure.groups["view.rotation"], structure.groups["view.shift"]
    starts = []
    for by in (np.eye(len(turn)), turn):
        beta, step = start.copy(), np.zeros(structure.size)
        beta[indices_of(structure, ("view.scale",))] += np.log(factor)
        step[about] = np.arctan2(by[1:2, 0], by[0, 0]) if len(about) == 1 else logarithm(by)
        beta = structure.retract(beta, step)
        residual = structure.residual(z, structure.predict(q, beta))
        beta[shift] += np.median(residual, axis=0)[: len(shift)]
        starts.append(beta)
    beta = _placed(structure, q, z, starts, (*FRAME, "view.scale") if other else FRAME)
    if len(about) == 1:  # the same angle, the short way round
        beta[about] -= 2 * np.pi * np.round((beta[about] - start[about]) / (2 * np.pi))
    new = bool(change) or bool(locked) or other
    signs = zip(change.get("signs", ()), getattr(old, "signs", ()), strict=False)
    turned = tuple(k for k, (now, was) in enumerate(signs) if now != was)
    view = [g for g in structure.groups if is_sensors(g)] if new else FRAME
    sizes = {name: factor * getattr(body, name) for name in ("noise", "tau", "residual")}
    body, forgotten = replace(body, structure=structure, **sizes), indices_of(structure, view)
    return Reference(body, beta, new, "mirror" in change, turned, locked, factor, forgotten)


def carried_offset(old: Body, new: Body, beta: Array, q: Array, offset: Array) -> Array:
    """What maps add to a body, (n, m), after a change: as the joints that cause it move the tip."""
    before = old.structure.slope(q, old.beta)
    after = new.structure.slope(q, beta)
    joints = np.einsum("ndm,nm->nd", np.linalg.pinv(before, rcond=1e-3), offset)
    return np.asarray(np.einsum("nmd,nd->nm", after, joints))


def _camera_anew(body: Body, q: Array, z: Array) -> Array:
    """Parameters of a camera that stands anywhere, its lens and the arm as they were."""
    from ..body.spatial_start import frame  # brings SciPy's linear algebra

    structure: Any = body.structure
    lens = tuple(body.beta[structure.groups["lens"]].tolist())
    known = replace(structure, lens=lens, lens_sd=(0.0, 0.0, 0.0, 0.0))
    beta, free = body.beta.copy(), indices_of(structure, FRAME)
    beta[free] = frame(known, q, z, body.beta)[free]
    return beta


def _variants(body: Body) -> Iterator[tuple[dict[str, Any], Array, tuple[int, ...]]]:
    """Other fields of the structure, parameters, locked joints: mirrored, turned round, locked."""
    structure, beta = body.structure, body.beta
    mirrors: list[dict[str, Any]] = [{}]
    if (mirror := getattr(structure, "mirror", None)) is not None:
        mirrors.append({"mirror": -mirror})
    yield from ((seen, beta, ()) for seen in mirrors)
    if not {"offset", "gain"} <= set(structure.groups):
        return
    signs = getattr(structure, "signs", ())
    for k in np.flatnonzero(structure.revolute).tolist():
        if signs:
            other = tuple(-s if j == k else s for j, s in enumerate(signs))
            yield from (({**seen, "signs": other}, beta, ()) for seen in mirrors)
        for angle in np.arange(-np.pi, np.pi, _LOCKED_STEP) if k else ():
            held = beta.copy()
            held[structure.groups["gain"][k]] = 0.0
            held[structure.groups["offset"][k]] += angle
            yield {}, held, (k,)


def _replaced(structure: Structure, change: dict[str, Any]) -> Structure:
    """The structure with other values of those fields that it has."""
    own = {name: value for name, value in change.items() if name in structure.__dict__}
    # a copy would compute again what a structure keeps of itself
    return replace(structure, **own) if own else structure  # type: ignore[type-var]


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
    structure: Structure, q: Array, z: Array, starts: list[Array], groups: tuple[str, ...]
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
