"""Causes: which changes of arm or sensor explain the data."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..common.robust import solve
from ..common.scale import Scale
from .features import Chain, Frame, find_chain
from .outliers import harmonics, spread_points
from .systematic import Systematic, systematic

if TYPE_CHECKING:
    from ..model.model import Model

Array = NDArray[np.float64]

_UNMOVED = 5.0  # noises by which a joint must have moved the tip to be missed
_SHARE = 0.05  # of the predicted places that must be missed to be worth a word
_EASY = 0.02  # a cause is no better than another if it leaves so much of the change


@dataclass(frozen=True, eq=False)
class Evidence:
    """What the causes are judged by.

    Attributes
    ----------
    model : Model
        The map that may no longer fit.
    u, x, said : (n, dof), (n, 2), (n, 2) array
        Joints in the unit box, measured and predicted positions, without outliers.
    basis : (n, p) array
        Orthonormal smooth functions of the joints.
    floor : float [unit]
        Error that the model may have of itself.
    part : Systematic
        The systematic part of measured less predicted position.
    """

    model: Model
    u: Array
    x: Array
    said: Array
    basis: Array
    floor: float
    part: Systematic

    def explains(self, predicted: Array) -> bool:
        """Whether nothing systematic is left over from a prediction (n, 2)."""
        left = systematic(self.basis, self.x - predicted, self.floor)
        return not left.fired or left.value < _EASY * self.part.value

    def best_offset(self, joint: int) -> tuple[Array, float]:
        """Prediction with one joint's offset fitted, and the offset in the unit box."""
        predictor, offset = self.model.predictor, 0.0
        said = self.said
        for _ in range(8):
            moved = self.u.copy()
            moved[:, joint] += offset
            said, slope = predictor.value_and_slope(moved)
            along = slope[:, :, joint]
            power = float(np.sum(along**2))
            if power == 0.0:
                break
            step = float(np.sum(along * (self.x - said))) / power
            offset += float(np.clip(step, -0.1, 0.1))
            if abs(step) < 1e-12:
                break
        moved = self.u.copy()
        moved[:, joint] += offset
        return predictor.value(moved), offset


def find_causes(
    evidence: Evidence, drifted: bool, unvisited: bool, noisier: bool
) -> tuple[list[str], list[str]]:
    """Name every cause that explains the data, and say each in words.

    Parameters
    ----------
    evidence : Evidence
    drifted : bool
        Whether a signal has fired.
    unvisited : bool
        Whether nodes that the joints predict are no longer visited.
    noisier : bool
        Whether the scatter has grown.
    """
    found: list[tuple[str, str]] = []
    if drifted and evidence.part.fired:
        found += list(_geometric(evidence))
        if not found:
            found.append(
                ("unknown", "no change of the sensor's frame, a joint or a link explains it")
            )
    share = _lost_share(evidence) if drifted and unvisited else 0.0
    if share >= _SHARE:
        found.append(("workspace", f"{100 * share:.0f} % of the predicted places are not visited"))
    if noisier:
        factor, unit = _unit(evidence)
        found.append(
            ("noise", f"the scatter is {factor * evidence.part.noise:.3g} {unit} per axis")
        )
    names = [name for name, _ in found]
    words = [text for _, text in found]
    offsets = [n for n in names if n.startswith("offset:")]
    if "sensor" in names and offsets:
        words.append(
            "an offset of the first joint and a turn of the sensor about its axis are the same"
        )
    return names, words


def _geometric(evidence: Evidence) -> Iterator[tuple[str, str]]:
    model = evidence.model
    names, turning = model.about.joint_names, model.about.revolute
    factor, unit = _unit(evidence)
    any_cause = False
    lost = [k for k in range(len(names)) if _is_lost(evidence, k)]
    for k in lost:
        any_cause = True
        yield f"lost:{names[k]}", f"{names[k]} no longer moves the tip"
    frame = Frame.of(evidence.said, 1).values(evidence.said)
    aligned = frame @ solve(frame, evidence.x)
    if not lost and evidence.explains(aligned):
        any_cause = True
        yield "sensor", f"the sensor's frame moved: {_frame_words(evidence, aligned)}"
    for k, name in enumerate(names):
        predicted, offset = evidence.best_offset(k)
        if not lost and evidence.explains(predicted):
            any_cause = True
            size = offset * float(model.motor.scale.span[k])
            shown = f"{math.degrees(size):.3g} deg" if turning[k] else f"{1e3 * size:.3g} mm"
            yield f"offset:{name}", f"{name} is off by {shown}"
    points, positions = spread_points(model.predictor.value, len(names))
    chain = find_chain(model.motor.scale, turning, points, positions)
    if chain is None or lost:
        if not any_cause:
            yield from _bent(evidence)
        return
    coefficients = solve(chain.values(points), positions)
    for k, name in enumerate(names):
        change = _length_change(evidence, chain, coefficients, k)
        if turning[k] and change is not None:
            any_cause = True
            length = math.sqrt(abs(np.linalg.det(coefficients[1 + 2 * k : 3 + 2 * k])))
            yield (
                f"length:{name}",
                f"the link of {name} is {100 * abs(change):.3g} % "
                f"({factor * abs(change) * length:.3g} {unit}) "
                f"{'longer' if change > 0 else 'shorter'}",
            )
    if not any_cause:
        features = chain.values(evidence.u)
        rest = evidence.x - evidence.said
        if evidence.explains(evidence.said + features @ solve(features, rest)):
            any_cause = True
            yield "geometry", f"links changed: {_links_words(evidence, chain, coefficients)}"
    if not any_cause:
        yield from _bent(evidence)


def _bent(evidence: Evidence) -> Iterator[tuple[str, str]]:
    if len(evidence.u) < 30:
        return
    frame = Frame.of(evidence.said, 3).values(evidence.said)
    if evidence.explains(frame @ solve(frame, evidence.x)):
        yield "bent", "the sensor's frame is bent, as by a lens"


def _length_change(
    evidence: Evidence, chain: Chain, coefficients: Array, joint: int
) -> float | None:
    """Relative change of one link that explains the data, None if none does."""
    columns = slice(1 + 2 * joint, 3 + 2 * joint)
    link = chain.values(evidence.u)[:, columns] @ coefficients[columns]
    rest = evidence.x - evidence.said
    power = float(np.sum(link**2))
    if power == 0.0:
        return None
    change = float(np.sum(link * rest)) / power
    return change if evidence.explains(evidence.said + change * link) else None


def _is_lost(evidence: Evidence, joint: int) -> bool:
    """Whether positions are a function of the other joints alone, and were not before."""
    model, u = evidence.model, evidence.u
    if u.shape[1] < 2 or len(u) < 20:
        return False
    rest = [k for k in range(u.shape[1]) if k != joint]
    scale = model.motor.scale
    small = Scale(scale.lower[rest], scale.span[rest], scale.periodic[rest])
    turning = tuple(model.about.revolute[k] for k in rest)
    features = harmonics(small, turning, u[:, rest], 3 if len(u) >= 40 else 1)
    before = evidence.said - features @ solve(features, evidence.said)
    if float(np.sqrt(np.mean(before**2))) < _UNMOVED * max(evidence.part.noise, evidence.floor):
        return False
    return evidence.explains(features @ solve(features, evidence.x))


def _lost_share(evidence: Evidence) -> float:
    from ..maps.map import search_tree

    sensory = evidence.model.sensory
    said, x = (sensory.scale.to_unit(p) for p in (evidence.said, evidence.x))
    gaps = np.asarray(search_tree(said, sensory.scale).query(said, k=2)[0])[:, 1]
    away = np.asarray(search_tree(x, sensory.scale).query(said)[0])
    return float(np.mean(away > 3.0 * np.median(gaps)))


def _frame_words(evidence: Evidence, aligned: Array) -> str:
    from .alignment import Alignment

    return Alignment.between(evidence.said, aligned).words(evidence.model.about.unit)


def _links_words(evidence: Evidence, chain: Chain, coefficients: Array) -> str:
    features = chain.values(evidence.u)
    new = coefficients + solve(features, evidence.x - evidence.said)
    parts = []
    for k, name in enumerate(evidence.model.about.joint_names):
        if not evidence.model.about.revolute[k]:
            continue
        old_link, new_link = coefficients[1 + 2 * k : 3 + 2 * k], new[1 + 2 * k : 3 + 2 * k]
        ratio = math.sqrt(abs(np.linalg.det(new_link) / np.linalg.det(old_link)))
        turned = old_link.T @ new_link
        angle = math.atan2(turned[0, 1] - turned[1, 0], turned[0, 0] + turned[1, 1])
        parts.append(f"{name} {100 * (ratio - 1):+.3g} %, {math.degrees(angle):+.3g} deg")
    return "; ".join(parts)


def _unit(evidence: Evidence) -> tuple[float, str]:
    unit = evidence.model.about.unit
    return (1e3, "mm") if unit == "m" else (1.0, unit)
