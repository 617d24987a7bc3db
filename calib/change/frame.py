"""The frame: an old belief brought into the frame of a new log.

A camera that was hung elsewhere, mirrored or read in other units moves every position by far
more than anything else; so the frame comes first, in closed form, and small changes after it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arm.rotations import logarithm
from ..body.belief import Body
from ..body.parameters import Indices
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
    new: bool  # whether the view is so different that only hypotheses with a free frame make sense
    mirrored: bool  # whether the sensor sees the plane from the other side than before
    turned: tuple[int, ...]  # joints that turn the other way
    locked: tuple[int, ...]  # joints that no longer move the tip
    scale: float  # size of positions over what it was; 1 where they are in the old unit
    # (g,), parameters of the view whose old posterior does not count any more
    forgotten: NDArray[np.intp]

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


def kept_reference(body: Body) -> Reference:
    """A belief where it is."""
    return Reference(body, body.beta, False, False, (), (), 1.0, np.zeros(0, dtype=np.intp))


def reference_of(body: Body, q: Array, z: Array, unit: str | None = None) -> Reference:
    """Bring a belief into the frame of a log.

    body : the old belief
    q, z : (n, dof), (n, m), the log
    unit : unit of its positions, where it is another
    """
    kept = kept_reference(body)
    places = body.structure.blocks[0]
    rows = thinned(len(q), _ROWS)
    q, z = q[rows], z[rows]
    seen = body.structure.predict(q, body.beta)
    extent = float(np.asarray(body.structure.extents)[0])
    gap = float(np.median(np.linalg.norm((z - seen)[:, :places], axis=1)))
    if gap < _FAR * extent:
        return kept
    if is_camera(body.structure.view):
        return replace(kept, beta=_camera_moved(body, q, z), forgotten=_moving(body.structure))
    tries: list[tuple[float, dict[str, Any], Array, tuple[int, ...], float]] = []
    for change, start, held in _variants(body):
        structure = _replaced(body.structure, change)
        p = structure.predict(q, start)[:, :places]
        for scaled in (False,) if held else (False, True):
            error, ratio, _ = rigid_misfit(p, z[:, :places], scaled)
            # each further freedom must halve what is left
            free = len(change) + len(held) + (scaled and not 0.5 < ratio < 2.0)
            tries.append((max(error, _EXACT * extent) / _BETTER**free, change, start, held, ratio))
    _, change, start, locked, ratio = min(tries, key=lambda t: t[0])
    other = not _SCALES[0] < ratio < _SCALES[1]
    factor = ratio if other else 1.0
    structure = _replaced(body.structure, change)
    if other:  # in the log's own unit
        known = unit not in (None, getattr(structure, "unit", None))
        told: dict[str, Any] = {
            "extent": ratio * getattr(structure, "extent", 1.0),
            "centre": tuple(z.mean(axis=0).tolist()),
            "unit": unit if known else "sensor",
        }
        structure = _replaced(structure, told)
    beta = _framed(structure, start, q, z, ratio if other else None)
    new = bool(change) or bool(locked) or other
    signs, old = change.get("signs", ()), getattr(body.structure, "signs", ())
    turned = tuple(k for k, (now, was) in enumerate(zip(signs, old, strict=False)) if now != was)
    view = indices_of(structure, [g for g in structure.groups if is_sensors(g)])
    moved = replace(
        body, structure=structure, noise=body.noise * factor, tau=body.tau * factor,
        residual=body.residual * factor,
    )  # fmt: skip
    forgotten = view if new else _moving(structure)
    return Reference(moved, beta, new, "mirror" in change, turned, locked, factor, forgotten)


def _moving(structure: Structure) -> Indices:
    """Parameters of a sensor that was moved."""
    return indices_of(structure, FRAME)


def _camera_moved(body: Body, q: Array, z: Array) -> Array:
    """Parameters of a camera elsewhere, its lens and the arm as they were."""
    from ..body.spatial_start import frame  # brings SciPy's linear algebra

    structure: Any = body.structure
    groups = structure.groups
    lens = tuple(body.beta[groups["lens"]].tolist())
    known = replace(structure, lens=lens, lens_sd=(0.0, 0.0, 0.0, 0.0))
    beta = body.beta.copy()
    free = _moving(structure)
    beta[free] = frame(known, q, z, body.beta)[free]
    careful = np.isin(free, groups["view.rotation"])
    tries = [_aligned(structure, each, q, z, free, careful) for each in (body.beta, beta)]
    return min(tries, key=lambda t: t[0])[1]


def _variants(body: Body) -> Iterator[tuple[dict[str, Any], Array, tuple[int, ...]]]:
    """The belief itself, seen from behind, with one joint turned round, with one joint locked.

    Yields fields of the structure that differ, parameters, and the joints that are locked.
    """
    structure, beta = body.structure, body.beta
    yield {}, beta, ()
    names = _fields(structure)
    mirrors: list[dict[str, Any]] = [{}]
    if "mirror" in names:
        mirrors.append({"mirror": -structure.mirror})  # type: ignore[attr-defined]
        yield mirrors[1], beta, ()
    chain = {"offset", "gain"} <= set(structure.groups)
    for k, turns in enumerate(structure.revolute):
        if "signs" in names and chain and turns:
            signs = structure.signs  # type: ignore[attr-defined]
            other = tuple(-s if j == k else s for j, s in enumerate(signs))
            for mirror in mirrors:
                yield {**mirror, "signs": other}, beta, ()
        if chain and turns and k:
            held, offset = beta.copy(), structure.groups["offset"][k]
            held[structure.groups["gain"][k]] = 0.0
            for angle in np.arange(-np.pi, np.pi, _LOCKED_STEP):
                held = held.copy()
                held[offset] = beta[offset] + angle
                yield {}, held, (k,)


def _fields(structure: Structure) -> set[str]:
    """Names of the fields of a structure."""
    return {f.name for f in fields(structure)} if is_dataclass(structure) else set()


def _replaced(structure: Structure, change: dict[str, Any]) -> Structure:
    """The structure with other values of those fields that it has."""
    own = {name: value for name, value in change.items() if name in _fields(structure)}
    # a copy would compute again what a structure keeps of itself
    return replace(structure, **own) if own else structure  # type: ignore[type-var]


def rigid_misfit(p: Array, z: Array, scaled: bool) -> tuple[float, float, Array]:
    """Typical distance after the best motion, its scale and its rotation (Umeyama 1991).

    The rotation is a proper one: mirrors are variants of the structure.  Rows that contradict
    most others are left out of a second fit.
    """
    kept = np.ones(len(p), dtype=bool)
    for _ in range(3):
        a, b = p[kept] - p[kept].mean(axis=0), z[kept] - z[kept].mean(axis=0)
        u, s, vt = np.linalg.svd(b.T @ a)
        sign = np.ones(len(s))
        sign[-1] = np.sign(np.linalg.det(u @ vt)) or 1.0
        turn = (u * sign) @ vt
        ratio = float((s * sign).sum() / max(float((a**2).sum()), 1e-300))
        size = ratio if scaled else 1.0
        residual = z - z[kept].mean(axis=0) - size * (p - p[kept].mean(axis=0)) @ turn.T
        error = np.linalg.norm(residual, axis=1)
        kept = error <= max(3.0 * float(np.median(error)), 1e-12)
    # a scale that is near one is not what is asked for
    typical = float(np.median(error)) / (size if scaled and size > 0 else 1.0)
    return typical, max(ratio, 1e-12), turn


def _framed(structure: Structure, beta: Array, q: Array, z: Array, ratio: float | None) -> Array:
    """Parameters with the frame that fits a log best, from where it is and from a rigid motion."""
    groups = structure.groups
    turn, shift = np.asarray(groups["view.rotation"]), np.asarray(groups["view.shift"])
    scale = np.asarray(groups["view.scale"]) if ratio is not None else np.zeros(0, dtype=int)
    free = np.concatenate([turn, shift, scale]).astype(np.intp)
    beta = beta.copy()
    if ratio is not None:
        beta[scale] += np.log(ratio)
    places = structure.blocks[0]
    seen = structure.predict(q, beta)[:, :places]
    _, _, matrix = rigid_misfit(seen, z[:, :places], ratio is not None)
    angle = np.arctan2(matrix[1:2, 0], matrix[0, 0]) if len(turn) == 1 else logarithm(matrix)
    tries: list[tuple[float, Array]] = []
    for start in (np.zeros(len(turn)), angle):
        full = np.zeros(len(beta))
        full[turn] = start
        found = structure.retract(beta, full)
        residual = structure.residual(z, structure.predict(q, found))
        found[shift] += np.median(residual, axis=0)[: len(shift)]
        tries.append(_aligned(structure, found, q, z, free, ~np.isin(free, shift)))
    best = min(tries, key=lambda t: t[0])[1]
    if len(turn) == 1:  # the same angle, the short way round
        best[turn] -= 2 * np.pi * np.round((best[turn] - beta[turn]) / (2 * np.pi))
    return best


def _aligned(
    structure: Structure, beta: Array, q: Array, z: Array, free: Indices, careful: NDArray[np.bool_]
) -> tuple[float, Array]:
    """Gauss-Newton of the frame alone on absolute residuals, and the median error.

    Steps of the parameters `careful` (bool, of `free`), a rotation and a scale, stay below 0.5.
    """
    for _ in range(30):
        predicted, x = structure.linearise(q, beta, free)
        r = structure.residual(z, predicted)
        error = np.linalg.norm(r, axis=1)
        root = 1.0 / np.sqrt(np.maximum(error, 0.3 * np.median(error) + 1e-12))
        j = (x * root[:, None, None]).reshape(-1, len(free))
        size = np.sqrt((j**2).sum(axis=0)) + 1e-300
        step = np.linalg.lstsq(j / size, (r * root[:, None]).ravel(), rcond=1e-12)[0] / size
        step *= min(1.0, 0.5 / max(float(np.abs(step[careful]).max()), 1e-12))
        full = np.zeros(len(beta))
        full[free] = step
        beta = structure.retract(beta, full)
        if float(np.abs(step * size).max()) < 1e-9 * float(size.max()):
            break
    residual = structure.residual(z, structure.predict(q, beta))
    return float(np.median(np.linalg.norm(residual, axis=1))), beta


def carried_offset(old: Body, new: Body, beta: Array, q: Array, offset: Array) -> Array:
    """What maps add to a body, after the arm or the sensor has changed.

    A displacement of the tip is taken as that of the joints that causes it (least squares), and
    these joints' displacement in the new prediction: a moved sensor turns it exactly.

    beta : (d,), parameters of the new prediction
    q, offset : (n, dof), (n, m)
    Returns (n, m).
    """
    before = old.structure.slope(q, old.beta)
    after = new.structure.slope(q, beta)
    joints = np.einsum("ndm,nm->nd", np.linalg.pinv(before, rcond=1e-3), offset)
    return np.asarray(np.einsum("nmd,nd->nm", after, joints))
