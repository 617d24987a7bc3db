"""Words: what changed between a model and a log, as causes in numbers and sentences.

What a log cannot distinguish is reported with the named cause: a sensor that was turned about
the first joint's axis and that joint's offset; a sensor that shows all larger and longer links.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..body.covariance import Z95
from ..body.curves import HARMONICS
from ..body.parameters import Indices
from ..body.settings import NATS
from ..common.arrays import Array
from ..common.wording import for_people, quantity, two_digits
from .causes import FRAME, GROUPS, Cause, indices_of, kind_of
from .evidence import Evidence, frame_between
from .explanation import Explanation
from .noise import NOISIER, Play
from .significance import moves_of

SCATTER = (
    ": the sensor's noise, or an error of the arm that differs from row to row; "
    "the same poses, measured again after the last one, tell which"
)
REPEATING = ", and no noise: rows of like joints err alike"


@dataclass(frozen=True)
class WordSettings:
    """What is worth a word."""

    # standard deviations from which a parameter counts as changed
    clear: float = 2.6
    # share of the largest displacement from which a cause is named
    matters: float = 0.05
    # times the noise of a model: it learned from exact samples, of which there is no usual one
    exact: float = 1e3


WORDS = WordSettings()
_WHICH = "are the same to this log: give `cause='joints'` or `cause='sensor'` if you know which"


def causes_of(
    evidence: Evidence, play: Play | None
) -> tuple[tuple[Cause, ...], tuple[str, ...]]:
    """Return the causes of a log, the largest first, and notes on what it cannot distinguish.

    Where nothing changed, more noise, a play and a turned tool are the only causes there may be.
    """
    if evidence.step is not None:  # which both parts of the log tell
        return (), ()
    drifted = evidence.score > 1.0
    if drifted and not evidence.is_explained:
        return (Cause("unknown", "", evidence.why_not()),), ()
    causes: list[Cause] = []
    notes: list[str] = []
    if play is not None and play.score > 1.0:
        causes.append(_play(evidence, play))
    if drifted:
        changes = [*evidence.reference.causes, *_changes(evidence)]
        if evidence.cause is None:
            turns, notes = _turn_like_offset(evidence, changes)
            notes += _scale_like_lengths(evidence, changes)
            changes += turns
        if not changes:
            words = (
                "no single change of the sensor, a joint or a link explains it"
            )
            if evidence.is_one_place:
                words = (
                    "rows of one place do not tell what changed: move the arm"
                )
            changes.append(Cause("unknown", "", words))
        causes += changes
    causes += _noises(evidence, drifted=drifted)
    if evidence.tool.score > 1.0:
        causes.append(evidence.tool.cause)
    board = evidence.rows.model.about.options.get("board")
    if board is not None:
        what = "camera" if board["eye"] == "hand" else "board"
        causes = _mount_once(causes, what)
    return tuple(causes), tuple(notes)


def _joint(evidence: Evidence, joint: int) -> tuple[str, str]:
    """Name of a joint, and its unit."""
    about = evidence.rows.model.about
    unit = "rad" if about.revolute[joint] else "m"
    return about.joint_names[joint], unit


def _play(evidence: Evidence, play: Play) -> Cause:
    """A joint that has more play than the model knows, by all of it."""
    name, unit = _joint(evidence, play.joint)
    whole = 2.0 * float(play.half[play.joint])
    half = 2.0 * Z95 * play.deviation
    words = (
        f"{name} has {quantity(whole, unit, half)} of play that the model does not know: "
        "`calib train` learns it from a log that goes both ways"
    )
    cause = Cause(f"backlash:{name}", "backlash", words, whole, unit=unit)
    return cause.within(half)


def _noises(evidence: Evidence, *, drifted: bool) -> list[Cause]:
    """A joint whose encoder is noisy, and a scatter that is larger than usual."""
    tests = evidence.tests
    causes: list[Cause] = []
    if not (drifted or evidence.bound.may_be_noise):
        return causes
    if tests.noisy is not None and not drifted:
        name, unit = _joint(evidence, tests.noisy[0])
        sd = tests.noisy[1]
        factor, shown = for_people(unit)
        words = (
            f"{name} is noisy, by {two_digits(factor * sd)} {shown}: its encoder, or play; "
            "no calibration mends that"
        )
        causes.append(Cause(f"noise:{name}", "noise", words, sd, None, unit))
    noise = tests.noise
    if evidence.is_attributed:
        # a large change is not linear: what the best one leaves
        size = float(evidence.reference.sizes[0])
        noise = min(noise, evidence.best.noise * size)
    times = noise / tests.usual
    if tests.noisier and times > NOISIER:
        words = f"the scatter is {quantity(noise, evidence.unit)} per axis"
        if times < WORDS.exact:
            words += f", {times:.2g} times the usual"
        elif not drifted:  # a simulation has none
            words += SCATTER if not evidence.bound.repeats else REPEATING
        causes.append(
            Cause("noise", "noise", words, noise, None, evidence.unit)
        )
    return causes


def _mount_once(causes: list[Cause], what: str) -> list[Cause]:
    """Return the causes with at most one of the group "tool".

    That is a camera or a board that moved in its mount.
    """
    moved = [cause for cause in causes if cause.group.startswith("tool")]
    if not moved:
        return causes
    first = min(moved, key=lambda cause: cause.unit != "rad")
    low, high = first.interval or (0.0, 0.0)
    how = "moved in its mount, what it sees by"
    if first.unit == "rad":
        how = "turned in its mount by"
    size = quantity(abs(low + high) / 2, first.unit, (high - low) / 2)
    words = f"the {what} has {how} {size}"
    once = replace(first, cause="tool", words=words)
    return [once, *(cause for cause in causes if cause not in moved)]


class _Effect(NamedTuple):
    """A cause, and the displacement that it makes over the learned range."""

    size: float  # root mean square [unit]
    cause: Cause


def _changes(evidence: Evidence) -> list[Cause]:
    """Causes of the parameters that are clearly away from where they were, largest effect first.

    None where no explanation is clearly better than no change.
    """
    if not evidence.is_attributed:
        return []
    best = evidence.best
    if not len(best.indices):
        words = "the joints have waves that the model does not know: gears, or their sensors"
        return [Cause("curve", "curve", words)]
    effects = _effects(evidence, best)
    effects.sort(key=lambda effect: -effect.size)
    # beside a sensor that was put elsewhere all else is small
    is_elsewhere = best.reference.is_fitted
    sizes = [
        effect.size
        for effect in effects
        if not (is_elsewhere and effect.cause.cause == "sensor")
    ]
    least = WORDS.matters * max(sizes, default=0.0)
    causes = [e.cause for e in effects if e.size >= least]
    if FRAME[0] in best.groups and _frame_is_other(evidence):
        causes.insert(0, _move_of_sensor(evidence, best))
    return causes


def _frame_is_other(evidence: Evidence) -> bool:
    """Whether the sensor's frame has other axes or another unit: a move of it has no size then."""
    discrete = {cause.cause for cause in evidence.reference.causes}
    return not discrete.isdisjoint(("mirror", "scale"))


def _effects(evidence: Evidence, best: Explanation) -> list[_Effect]:
    """Effects of the parameters that are clearly away from where they were."""
    structure = best.reference.structure
    change = np.abs(best.beta - evidence.prior.beta)
    clear = change > WORDS.clear * best.deviation
    clear &= best.deviation > 0.0
    moves = moves_of(structure, best.beta, evidence.rows.probes)
    sizes = moves * change
    is_scaled = any(c.cause == "scale" for c in evidence.reference.causes)

    effects: list[_Effect] = []
    for group in best.groups:
        if group in FRAME or (group == "view.scale" and is_scaled):
            continue
        if kind_of(group) == "curve":
            effects.append(_wave(evidence, best, group, moves))
            continue
        indices = indices_of(structure, (group,))
        is_one_cause = GROUPS[group].whole
        for part in [indices] if is_one_cause else indices[:, None]:
            telling = part[clear[part]]
            if len(telling):
                largest = int(telling[np.argmax(sizes[telling])])
                cause = _of_parameter(evidence, best, largest, part)
                size = float(np.linalg.norm(sizes[part]))
                effects.append(_Effect(size, cause))
    frame = indices_of(structure, FRAME)
    is_moved = FRAME[0] in best.groups and clear[frame].any()
    if is_moved and not _frame_is_other(evidence):
        size = float(np.linalg.norm(sizes[frame]))
        moved = _move_of_sensor(evidence, best)
        effects.append(_Effect(size, moved))
    return effects


def _wave(
    evidence: Evidence, best: Explanation, group: str, moves: Array
) -> _Effect:
    """The largest change of a wave of a joint's curve, that of its group.

    moves : (d,), displacement by one of each parameter [unit]
    """
    structure = best.reference.structure
    curve = structure.groups[group].reshape(2, HARMONICS)
    change = best.beta - evidence.prior.beta
    amplitudes = np.linalg.norm(change[curve], axis=0)
    amplitudes[~np.isin(curve[0], best.indices)] = 0.0
    order = int(np.argmax(amplitudes))
    wave = curve[:, order]
    amplitude = float(amplitudes[order])
    half = Z95 * float(np.linalg.norm(best.deviation[wave])) / math.sqrt(2.0)
    joint = structure.labels[wave[0]].joint
    words = GROUPS["curve"].changed.format(
        joint=joint,
        size=quantity(amplitude, "rad", half),
        order=order + 1,
    )
    cause = Cause(f"curve:{joint}", "curve", words, amplitude, unit="rad")
    size = float(np.linalg.norm(moves[wave])) * amplitude / math.sqrt(2.0)
    return _Effect(size, cause.within(half))


def _half_width(evidence: Evidence, best: Explanation, k: int) -> float:
    """Half of the 95 % interval of a parameter's change.

    It holds the other explanations that the evidence hardly distinguishes from the best: rows
    that show a sum of two changes do not show each.
    """
    half = Z95 * float(best.deviation[k])
    least = best.evidence - NATS
    for other in evidence.explanations:
        if other.evidence > least:
            distance = abs(float(other.beta[k] - best.beta[k]))
            half = max(half, distance + Z95 * float(other.deviation[k]))
    return half


def _of_parameter(
    evidence: Evidence, best: Explanation, k: int, part: Indices
) -> Cause:
    """A cause of one parameter.

    part : all parameters that it covers
    """
    label = best.reference.structure.labels[k]
    old = float(evidence.prior.beta[k])
    changes = best.beta - evidence.prior.beta
    change = float(changes[k])
    half = _half_width(evidence, best, k)
    value = math.expm1(change) if label.group == "view.scale" else change
    share = abs(change / old) if old else math.nan
    words = GROUPS[label.group].changed.format(
        joint=label.joint,
        name=label.name,
        most=two_digits(math.degrees(np.abs(changes[part]).max())),
        size=quantity(value, label.unit, half, "+"),
        length=quantity(abs(change), label.unit, half),
        share=f"{100 * share:.2g} %",
        longer="longer" if change > 0 else "shorter",
    )
    kind = label.group.removeprefix("view.")
    name = f"{kind}:{label.joint}" if label.joint else kind
    cause = Cause(name, label.group, words, change, unit=label.unit)
    return cause.within(half)


def _move_of_sensor(evidence: Evidence, best: Explanation) -> Cause:
    """The sensor's frame as one cause, its rotation as the number."""
    structure = best.reference.structure
    turn = structure.groups["view.rotation"]
    moved = frame_between(evidence, best.beta)
    half = Z95 * float(np.linalg.norm(best.deviation[turn]))
    squares = np.zeros(len(moved.shift))
    for k in indices_of(structure, FRAME).tolist():
        nearby = best.beta.copy()
        nearby[k] += best.deviation[k]
        squares += (frame_between(evidence, nearby).shift - moved.shift) ** 2
    value = moved.angle
    if len(turn) == 1:  # with its sign, also of a mirrored one
        change = best.beta - evidence.prior.beta
        angle = float(change[turn[0]])
        value = math.remainder(angle, 2 * math.pi)
    size = moved.words(evidence.unit, half, Z95 * np.sqrt(squares))
    words = f"the sensor's frame moved: {size}"
    cause = Cause("sensor", "view.rotation", words, value, unit="rad")
    return cause.within(half)


def _turn_like_offset(
    evidence: Evidence, causes: Sequence[Cause]
) -> tuple[list[Cause], list[str]]:
    """The turn of the sensor that would look like an offset of the first joint, and a note."""
    about = evidence.rows.model.about
    first = about.joint_names[0]
    by_name = {cause.cause: cause for cause in causes}
    offset = by_name.get(f"offset:{first}")
    if offset is None or not about.revolute[0] or "mirror" in by_name:
        return [], []
    turned = (
        "an offset of the first joint and a turn of the sensor about its axis"
    )
    notes = [f"{turned} {_WHICH}"]
    if "sensor" in by_name:
        return [], notes
    low, high = offset.interval or (0.0, 0.0)
    turn = quantity((low + high) / 2, "rad", (high - low) / 2, "+")
    words = f"the sensor turned by {turn} about {first} would look the same"
    twin = replace(offset, cause="sensor", group="view.rotation", words=words)
    return [twin], notes


def _scale_like_lengths(
    evidence: Evidence, causes: Sequence[Cause]
) -> list[str]:
    """A note where a scale of the sensor and links that are all longer are the same."""
    about = evidence.rows.model.about
    names = {cause.cause for cause in causes}
    lengths = {f"length:{name}" for name in about.joint_names}
    has_links = len(evidence.rows.body.structure.groups.get("length", ())) > 0
    is_scaled = any(
        cause.cause == "scale" and cause.interval is not None
        for cause in causes
    )
    is_same = (is_scaled and has_links) or lengths <= names
    if not (all(about.revolute) and is_same):
        return []
    return [
        f"a sensor that shows all larger and links that are all longer {_WHICH}"
    ]
