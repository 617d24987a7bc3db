"""Group tests: whether freeing a group of parameters explains more of a log than chance does.

Generalised least squares of each group against all that the belief does not know: its posterior,
a residual of this log alone, and noise.  The statistic is a chi-square variable where nothing
changed.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ..body.belief import Body
from ..body.parameters import Indices
from ..common.arrays import Array
from .members import FRAME, TESTED, drift
from .reference import Reference
from .rows import TESTED_ROWS, Log, spectrum
from .seen import design_effect

FALSE_ALARM = 1e-3
"""Share of undisturbed logs for which any group fires."""

_POWER = 0.9  # of the smallest change that is told


@dataclass(frozen=True)
class GroupTest:
    """One group of parameters, freed alone."""

    name: str  # ``"sensor"``, ``"sensor scale"``, ``"length:elbow"``, ``"geometry"``,
    indices: Indices  # (p,), its parameters; the first is the one that the group is about
    # chi-square statistic, and what chance stays below in 999 of 1,000 logs
    statistic: float
    threshold: float
    freedom: int  # directions that the rows tell apart
    # (p,), change of each parameter and its standard deviation
    estimate: Array
    deviation: Array
    # [unit], root mean square displacement, over the learned range, of the smallest change of the
    # first parameter that these rows would show nine times in ten
    smallest: float

    @property
    def score(self) -> float:
        """Statistic over threshold."""
        return self.statistic / self.threshold


@dataclass(frozen=True)
class Tested:
    """All groups of one log."""

    groups: tuple[GroupTest, ...]
    noise: float  # [unit], standard deviation per axis of what no group explains
    usual: float  # [unit], what the belief expected

    @property
    def score(self) -> float:
        """Largest statistic over its threshold."""
        return max(g.score for g in self.groups)

    @property
    def smallest(self) -> float:
        """Displacement [unit] that any single cause would have shown."""
        return max(g.smallest for g in self.groups if g.smallest > 0.0)


def fired(groups: Iterable[GroupTest]) -> tuple[GroupTest, ...]:
    """Groups above their threshold, the most telling first."""
    above = (g for g in groups if g.score > 1.0)
    # a larger group explains more by chance alone
    return tuple(sorted(above, key=lambda g: 3.0 * g.freedom - g.statistic))


def groups_of(body: Body) -> dict[str, Indices]:
    """Groups that are tested: the sensor's view, and each joint's own parameters."""
    structure = body.structure
    known = structure.groups

    def joined(*names: str) -> Indices:
        return np.concatenate([known[n] for n in names if n in known]).astype(np.intp)

    frame = joined(*FRAME)
    found = {"sensor": frame}
    if "view.scale" in known:
        found["sensor scale"] = np.concatenate([known["view.scale"], frame])
    if "view.tilt" in known:
        found["sensor tilt"] = joined("view.tilt", "view.shear", "view.scale", *FRAME)
    if "lens" in known and len(known["lens"]):
        found["lens"] = np.concatenate([known["lens"][:1], frame])
    own: dict[str, list[int]] = {}
    for group in TESTED:
        for index in known.get(group, ()):
            joint = structure.label(int(index)).joint
            own.setdefault(f"{group}:{joint}" if joint else group, []).append(int(index))
    if len(known.get("elastic", ())):  # a payload bends all joints at once
        own["elastic"] = known["elastic"].tolist()
    for name, indices in own.items():
        found[name] = np.array(indices, dtype=np.intp)
        found[f"{name} and sensor"] = np.concatenate([found[name], frame])
    found["geometry"] = joined("offset", "length", "gain", "elastic", *FRAME)
    return {k: np.asarray(ix, dtype=np.intp) for k, ix in found.items() if len(ix)}


def group_tests(reference: Reference, log: Log, probes: Array) -> Tested:
    """Test every group.

    reference : the belief as the model knows it, in the frame of the log where that is new
    log : rows; `z` less what maps add to the body
    probes : (p, dof), joints all over the learned range
    """
    from scipy.special import chdtri, chndtrinc, fdtri

    log = log.some(TESTED_ROWS)
    body, structure = reference.body, reference.structure
    groups = groups_of(body)
    every = np.unique(np.concatenate(list(groups.values())))
    predicted, x = structure.linearise(log.q, reference.beta, every)
    usual = max(body.kappa, 1.0)
    space = spectrum(reference, log, drift(body), usual)
    y = space.turn(structure.residual(log.z, predicted))
    derivative = space.turn_columns(x)
    columns = derivative / (np.linalg.norm(derivative, axis=0) + 1e-300)
    residual, noise = y.copy(), usual
    for _ in range(3):
        precision = 1.0 / (space.values + noise**2)
        root = np.sqrt(precision)
        basis = np.linalg.qr(columns * root[:, None])[0]
        residual = (root * y - basis @ (basis.T @ (root * y))) / root
        free = np.sqrt(len(y) / max(len(y) - basis.shape[1], 1))
        noise = max(free * space.noise(residual), usual)
    known = noise <= 1.05 * usual
    precision = 1.0 / (space.values + noise**2 * np.sqrt(max(body.autocorrelation, 1.0)))
    _, moves = structure.linearise(probes, reference.beta, every)
    places = structure.blocks[0]
    moves = np.sqrt((moves[:, :places] ** 2).sum(axis=1).mean(axis=0))
    # maps' errors are alike near each other: a statistic is so many times that of noise
    unit, level = float(reference.sizes[0]), FALSE_ALARM / len(groups)
    unsure = design_effect(structure, log.q, noise * unit)
    found = []
    for name, indices in groups.items():
        if name.startswith("elastic"):  # of a joint about a vertical axis no load is felt
            indices = indices[np.argsort(-moves[np.searchsorted(every, indices)], kind="stable")]
        place = np.searchsorted(every, indices)
        if not x[..., place[0]].any():  # what the sensor cannot see: a tracker has no lens
            continue
        b = derivative[:, place] * np.sqrt(precision)[:, None]
        size = np.linalg.norm(b, axis=0)
        size = np.where(size > 0.0, size, 1.0)  # a parameter that moves nothing stays as it was
        u, s, vt = np.linalg.svd(b / size, full_matrices=False)
        kept = s > 1e-5 * s[0]
        score = u[:, kept].T @ (y * np.sqrt(precision))
        p = int(kept.sum())
        statistic = float((score**2).sum())
        if known:
            threshold = float(chdtri(p, level))
        else:
            threshold = p * float(fdtri(p, max(len(y) - len(every), 1), 1.0 - level))
        threshold *= unsure
        estimate = (vt[kept].T / s[kept]) @ score / size
        deviation = np.sqrt(((vt[kept].T / s[kept]) ** 2).sum(axis=1)) / size
        # the noncentrality with which the statistic exceeds its threshold nine times in ten
        needed = float(chndtrinc(threshold, p, 1.0 - _POWER))
        smallest = np.sqrt(needed) / size[0] * moves[place[0]]
        found.append(
            GroupTest(name, indices, statistic, threshold, p, estimate, deviation, float(smallest))
        )
    # what the weights of a Student distribution leave out
    scale = float(
        np.median(np.linalg.norm(space.rest(residual, noise) / space.root[:, None], axis=1))
    )
    spread = scale / np.sqrt(2.0 * np.log(2.0)) if places == 2 else scale / 1.54
    return Tested(tuple(found), spread * unit, float(body.noise[0]))
