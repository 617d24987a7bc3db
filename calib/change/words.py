"""Words: what changed between a model and a log, as causes in numbers and sentences.

A cause is reported together with those that the log cannot distinguish from it: a turn of the
sensor about the first joint's axis and that joint's offset; a larger scale and longer links.
"""

from __future__ import annotations

import math
from collections.abc import Sequence, Set
from dataclasses import dataclass, replace
from operator import itemgetter

import numpy as np

from ..body.covariance import Z95
from ..body.curves import HARMONICS
from ..body.parameters import Indices
from ..body.settings import NATS
from ..common.wording import by_name, for_people, quantity, two_digits
from .causes import FRAME, GROUPS, Cause, cause_kind, indices_of
from .evidence import Evidence, frame_between
from .explain import MARGIN
from .noise import NOISE_RATIO, Play
from .significance import moves_of

SCATTER = (
    ": the sensor's noise, or an error of the arm that differs from row to row; "
    "the same poses, measured again after the last one, tell which"
)
REPEATING = ", and no noise: rows of like joints err alike"
WAVES = "the joints have waves that the model does not know: gears, or their sensors"
UNEXPLAINED = "no single change of the sensor, a joint or a link stands out"
ONE_PLACE = "rows of one place do not tell what changed: move the arm"


@dataclass(frozen=True)
class WordSettings:
    """Which changes are named."""

    # standard deviations from which a parameter counts as changed
    clear: float = 2.6
    # least displacement of a named cause, over the largest
    matters: float = 0.05
    # noise over that of the model from which the model has learned exact samples, whose noise is
    # not the usual one
    exact: float = 1e3


WORDS = WordSettings()
_WHICH = "are the same to this log: give `cause='joints'` or `cause='sensor'` if you know which"


def causes_of(evidence: Evidence) -> tuple[tuple[Cause, ...], tuple[str, ...]]:
    """Return the causes of a log, the largest first, and notes on what it cannot distinguish.

    Where nothing changed, the only causes are a larger noise, a play, and a turned tool.
    """
    if evidence.step is not None:  # `judge` describes both parts of the log
        return (), ()
    drifted = evidence.score > 1.0
    if drifted and not evidence.is_explained:
        return (Cause("unknown", "", evidence.why_not()),), ()
    causes: list[Cause] = []
    notes: list[str] = []
    play = evidence.play
    if play is not None:
        causes.append(_play(evidence, play))
    if drifted:
        changes = [*evidence.reference.causes, *_changes(evidence)]
        if not changes:
            changes.append(Cause("unknown", "", _doubt_of(evidence)))
        causes += changes
        if evidence.cause is None:
            twins, notes = _twins(evidence, changes)
            causes += twins
        if evidence.is_attributed:
            notes += _rivals(evidence, {cause.cause for cause in causes})
    causes += _noises(evidence, drifted=drifted)
    if evidence.tool.score > 1.0:
        causes.append(evidence.tool.cause)
    board = evidence.rows.model.about.board
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
    """The whole play that a joint has beyond what the model knows, as a cause."""
    name, unit = _joint(evidence, play.joint)
    whole = 2.0 * play.half
    half = 2.0 * Z95 * play.deviation
    words = (
        f"{name} has {quantity(whole, unit, half)} of play that the model does not know: "
        "`calib train` learns it from a log that goes both ways"
    )
    cause = Cause(f"backlash:{name}", "backlash", words, whole, unit=unit)
    return cause.within(half)


def _noises(evidence: Evidence, *, drifted: bool) -> list[Cause]:
    """The causes of a larger noise: one joint's encoder, or the scatter of all rows."""
    tests = evidence.tests
    causes: list[Cause] = []
    if not (drifted or evidence.bound.may_be_noise):
        return causes
    if tests.noisy_joint is not None and not drifted:
        joint, sd = tests.noisy_joint
        name, unit = _joint(evidence, joint)
        factor, shown_unit = for_people(unit)
        words = (
            f"{name} is noisy, by {two_digits(factor * sd)} {shown_unit}: its encoder, or play; "
            "no calibration mends that"
        )
        causes.append(Cause(f"noise:{name}", "noise", words, sd, unit=unit))
    noise = tests.noise
    if evidence.is_attributed:
        # the tests are linear; a large change is not, and its explanation leaves less
        unit_noise = float(evidence.reference.expected_noise[0])
        noise = min(noise, evidence.best.noise * unit_noise)
    times = noise / tests.usual
    if tests.is_noisier and times > NOISE_RATIO:
        unit = evidence.unit
        words = f"the scatter is {quantity(noise, unit)} per axis"
        if times < WORDS.exact:
            words += f", {times:.2g} times the usual"
        elif not drifted:
            words += REPEATING if evidence.bound.repeats else SCATTER
        causes.append(Cause("noise", "noise", words, noise, unit=unit))
    return causes


def _mount_once(causes: list[Cause], what: str) -> list[Cause]:
    """Return the causes with at most one of the tool: `what` (camera, board) moved in its mount."""
    of_tool = [cause for cause in causes if cause.group.startswith("tool")]
    if not of_tool:
        return causes
    first = min(of_tool, key=lambda cause: cause.unit != "rad")
    low, high = first.interval or (0.0, 0.0)
    how = "moved in its mount, what it sees by"
    if first.unit == "rad":
        how = "turned in its mount by"
    size = quantity(abs(low + high) / 2, first.unit, (high - low) / 2)
    words = f"the {what} has {how} {size}"
    once = replace(first, cause="tool", words=words)
    return [once, *(cause for cause in causes if cause not in of_tool)]


def _changes(evidence: Evidence) -> list[Cause]:
    """Causes of the parameters that clearly changed, the largest effect first.

    There are none where no explanation is clearly better than no change.
    """
    if not evidence.is_attributed:
        return []
    best = evidence.best
    if not len(best.indices):
        return [Cause("curve", "curve", WAVES)]
    effects = _effects(evidence)
    effects.sort(key=itemgetter(0), reverse=True)
    # the move of a sensor that was put elsewhere would hide all other causes
    is_elsewhere = best.reference.is_fitted
    sizes = [
        size
        for size, cause in effects
        if not (is_elsewhere and cause.cause == "sensor")
    ]
    least = WORDS.matters * max(sizes, default=0.0)
    return [cause for size, cause in effects if size >= least]


def _doubt_of(evidence: Evidence) -> str:
    """What may have changed, in words, where no cause is clear."""
    if evidence.is_one_place:
        return ONE_PLACE
    effects = _effects(evidence)
    if (
        not effects
        or evidence.best.log_evidence < evidence.unnamed_log_evidence
    ):
        return UNEXPLAINED
    _, likeliest = max(effects, key=itemgetter(0))
    return f"not clear what changed; likeliest: {likeliest.words}"


def _effects(evidence: Evidence) -> list[tuple[float, Cause]]:
    """Causes of the parameters that clearly changed, each after the size of its effect.

    That is the root mean square displacement over the learned range [unit].
    """
    best = evidence.best
    structure = best.reference.structure
    change = np.abs(evidence.change)
    is_clear = change > WORDS.clear * best.deviation
    is_clear &= best.deviation > 0.0
    sizes = change * moves_of(structure, best.beta, evidence.rows.probes)
    frame = indices_of(structure, FRAME)
    is_scaled = evidence.reference.scale != 1.0

    effects: list[tuple[float, Cause]] = []
    for group in best.groups:
        if group in FRAME or (group == "view.scale" and is_scaled):
            continue
        if cause_kind(group) == "curve":
            wave, cause = _wave(evidence, group)
            effects.append((float(np.linalg.norm(sizes[wave])), cause))
            continue
        indices = indices_of(structure, (group,))
        parts = [indices] if GROUPS[group].whole else indices[:, None]
        for part in parts:
            changed = part[is_clear[part]]
            if len(changed):
                largest = int(changed[np.argmax(sizes[changed])])
                cause = _of_parameter(evidence, largest, part)
                effects.append((float(np.linalg.norm(sizes[part])), cause))
    # with mirrored axes or another unit the frame has moved, whatever its parameters say
    discrete = {cause.cause for cause in evidence.reference.causes}
    is_other = not discrete.isdisjoint(("mirror", "scale"))
    if FRAME[0] in best.groups and (is_other or is_clear[frame].any()):
        size = float(np.linalg.norm(sizes[frame]))
        effects.append((size, _move_of_sensor(evidence)))
    return effects


def _wave(evidence: Evidence, group: str) -> tuple[Indices, Cause]:
    """Parameters (2,) of the wave of a joint's curve that changed most, and the cause."""
    best = evidence.best
    structure = best.reference.structure
    waves = structure.groups[group].reshape(2, HARMONICS)
    amplitudes = np.linalg.norm(evidence.change[waves], axis=0)
    amplitudes[~np.isin(waves[0], best.indices)] = 0.0
    order = int(np.argmax(amplitudes))
    wave = waves[:, order]
    amplitude = float(amplitudes[order])
    half = Z95 * float(np.linalg.norm(best.deviation[wave])) / math.sqrt(2.0)
    joint = structure.labels[wave[0]].joint
    size = quantity(amplitude, "rad", half)
    words = GROUPS["curve"].template.format(
        joint=joint, size=size, order=order + 1
    )
    cause = Cause(f"curve:{joint}", "curve", words, amplitude, unit="rad")
    return wave, cause.within(half)


def _half_width(evidence: Evidence, k: int) -> float:
    """Half of the 95 % interval of the change of parameter `k`.

    It covers the intervals of all explanations that are about as likely as the best: rows that
    determine the sum of two changes need not determine each.
    """
    best = evidence.best
    half = 0.0
    for other in evidence.explanations:
        if other.log_evidence > best.log_evidence - NATS:
            distance = abs(float(other.beta[k] - best.beta[k]))
            half = max(half, distance + Z95 * float(other.deviation[k]))
    return half


def _of_parameter(evidence: Evidence, k: int, part: Indices) -> Cause:
    """The change of parameter `k` as a cause.

    part : all parameters of the cause
    """
    structure = evidence.reference.structure
    label = structure.labels[k]
    old = float(evidence.prior.beta[k])
    change = float(structure.senses[k] * evidence.change[k])
    half = _half_width(evidence, k)
    value = math.expm1(change) if label.group == "view.scale" else change
    share = abs(change / old) if old else math.nan
    most = float(np.abs(evidence.change[part]).max())
    group = GROUPS[label.group]
    kind = label.group.removeprefix("view.")
    about = evidence.rows.model.about
    revolute = by_name(about.joint_names, about.revolute)
    if kind == "length" and not revolute.get(label.joint or "", True):
        kind = "offset"  # the length of a planar slide's link is its zero
        group = GROUPS[kind]
    words = group.template.format(
        joint=label.joint,
        name=label.name,
        most=two_digits(math.degrees(most)),
        size=quantity(value, label.unit, half, "+"),
        length=quantity(abs(change), label.unit, half),
        share=f"{100 * share:.2g} %",
        longer="longer" if change > 0 else "shorter",
    )
    name = f"{kind}:{label.joint}" if label.joint else kind
    cause = Cause(name, label.group, words, change, unit=label.unit)
    return cause.within(half)


def _move_of_sensor(evidence: Evidence) -> Cause:
    """The sensor's frame as one cause, its rotation as the number."""
    best = evidence.best
    structure = best.reference.structure
    turn = structure.groups["view.rotation"]
    frame_move = frame_between(evidence, best.beta)
    half = Z95 * float(np.linalg.norm(best.deviation[turn]))
    squares = np.zeros(len(frame_move.shift))
    for k in indices_of(structure, FRAME).tolist():
        nearby = best.beta.copy()
        nearby[k] += best.deviation[k]
        squares += (
            frame_between(evidence, nearby).shift - frame_move.shift
        ) ** 2
    value = frame_move.angle
    if len(turn) == 1:  # with its sign, also of a mirrored one
        value = math.remainder(float(evidence.change[turn[0]]), 2 * math.pi)
    size = frame_move.words(evidence.unit, half, Z95 * np.sqrt(squares))
    words = f"the sensor's frame moved: {size}"
    cause = Cause("sensor", "view.rotation", words, value, unit="rad")
    return cause.within(half)


def _rivals(evidence: Evidence, named: Set[str]) -> list[str]:
    """A note on the next explanation that is nearly as likely as the named causes, if any."""
    best = evidence.best
    for other in evidence.explanations:
        if other.log_evidence < best.log_evidence - MARGIN:
            break
        if np.isin(best.indices, other.indices).all():
            continue
        effects = _effects(replace(evidence, explanations=(other,)))
        if effects and not named >= {cause.cause for _, cause in effects}:
            words = [cause.words for _, cause in effects]
            return [f"nearly as likely: {', '.join(words)}"]
    return []


def _twins(
    evidence: Evidence, changes: Sequence[Cause]
) -> tuple[list[Cause], list[str]]:
    """Causes that a log cannot distinguish from changes, and notes on them."""
    causes = {change.cause: change for change in changes}
    about = evidence.rows.model.about
    first, *_ = about.joint_names
    twins: list[Cause] = []
    notes: list[str] = []
    offset = causes.get(f"offset:{first}")
    if offset is not None and about.revolute[0] and "mirror" not in causes:
        notes.append(
            "an offset of the first joint and a turn of the sensor about its axis "
            + _WHICH
        )
        if "sensor" not in causes:
            low, high = offset.interval or (0.0, 0.0)
            turn = quantity((low + high) / 2, "rad", (high - low) / 2, "+")
            words = (
                f"the sensor turned by {turn} about {first} would look the same"
            )
            twin = replace(offset, cause="sensor", group=FRAME[0], words=words)
            twins.append(twin)
    scale = causes.get("scale")
    has_links = "length" in evidence.rows.body.structure.groups
    is_scaled = has_links and scale is not None and scale.interval is not None
    lengths = {f"length:{name}" for name in about.joint_names}
    if all(about.revolute) and (is_scaled or lengths <= causes.keys()):
        notes.append(
            "a sensor that shows all larger and links that are all longer "
            + _WHICH
        )
    return twins, notes
