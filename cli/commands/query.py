"""The commands `calib query forward` and `calib query inverse`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import typer

from calib.common.wording import for_people

from ..options import takes
from ..output import NO, fixed, note, show_json
from ..parsing import finite_number, height, reals
from ..units import JointFormat, answers, meaning, show_answers, why_outside
from ..usage import BadOption, argument, bad_option, flag, one_document, option
from .path import path

if TYPE_CHECKING:
    from calib import Answer, Model


query_app = typer.Typer(
    add_completion=False,
    help="Ask a model for positions or for joint values.",
    rich_markup_mode=None,
)

_NEGATIVE = {"ignore_unknown_options": True}  # -0.1 is a number, not an option


@query_app.command(context_settings=_NEGATIVE)
@takes(values=argument("Q1 Q2", "Joint values, base to tip [rad or m]."))
def forward(
    model: str,
    values: list[str] | None = None,
    readout: str | None = None,
    input_: str | None = None,
    output: str | None = None,
    frame: str = "sensor",
    degrees: bool = False,
    as_json: bool = False,
) -> None:
    """Position of the tip for joint values; exit code 3 outside of what was learned."""
    import calib

    from ..batch import BOUNDS, UP_TO_SCALE, Streams, forward_batch, told_at

    typed = _numbers(values or [])
    _check_streams(typed, input_, output, as_json)
    loaded = calib.load(model)
    joints = JointFormat(loaded.about, degrees)
    if input_ is not None:
        streams = Streams(input_, output, as_json)
        raise typer.Exit(forward_batch(loaded, joints, streams, readout, frame))
    _check_count(typed, loaded.about.joint_names, "joint value")
    q = [value / factor for value, factor in zip(typed, joints.typed, strict=True)]
    told = {name: float(value) for name, value in told_at(loaded, q, readout, frame).items()}
    in_base = frame == "base"
    unit, axes = ("m", "xyz") if in_base else (loaded.about.unit, loaded.axes)
    quantities: dict[str, Any] = {"position": [told[axis] for axis in axes]}
    if "qw" in told:
        quantities["quaternion"] = [told[name] for name in ("qx", "qy", "qz", "qw")]
    quantities |= {name: told[name] for name in (*BOUNDS, UP_TO_SCALE) if name in told}
    (answer,) = answers(joints, [q], **{name: [value] for name, value in quantities.items()})
    if as_json:
        show_json({**answer, **meaning(loaded.about, frame)})
    if (outside := loaded.outside(q)) is not None:
        note(f"no answer: {why_outside(joints, loaded, q) or outside}")
        raise typer.Exit(NO)
    if not as_json:
        show_answers(joints, [answer], unit, axes, _bounds(loaded, frame))
        if "quaternion" in answer:
            print("quaternion " + " ".join(fixed(value, 6) for value in answer["quaternion"]))
        if UP_TO_SCALE in told:
            from ..space import say_size

            say_size(told[UP_TO_SCALE])


@query_app.command(context_settings=_NEGATIVE)
@takes(
    target=argument("X Y [Z]", "Position wanted [m, or the sensor's unit]."),
    near=option("--near Q1,Q2", "Answer with the branch nearest to these joint values.", reals),
    every=flag("--all", "Answer with every branch."),
    quaternion=option(
        "--quaternion QX,QY,QZ,QW", "Of an arm in space: the orientation wanted too.", reals
    ),
    rpy=option("--rpy R,P,Y", "The same as roll, pitch and yaw, as in a URDF [rad].", reals),
    keep=flag("--keep-orientation", "Turn the tool as little as possible from --near."),
    on=option("--on z=H", "The pixel X Y lies on this plane of the base frame [m].", height),
)
def inverse(
    model: str,
    target: list[str] | None = None,
    near: tuple[float, ...] | None = None,
    every: bool = False,
    readout: str | None = None,
    input_: str | None = None,
    output: str | None = None,
    frame: str = "sensor",
    quaternion: tuple[float, ...] | None = None,
    rpy: tuple[float, ...] | None = None,
    keep: bool = False,
    on: float | None = None,
    degrees: bool = False,
    as_json: bool = False,
) -> None:
    """Joint values that bring the tip to a position; exit code 3 if it is out of reach."""
    import calib

    typed = _numbers(target or [])
    _check_streams(typed, input_, output, as_json)
    if every and readout is not None:
        raise BadOption(f"--all answers by the default readout: expected no --readout {readout}")
    loaded = calib.load(model)
    joints = JointFormat(loaded.about, degrees)
    anchor = _anchor(loaded, near, joints)
    one = keep or on is not None or quaternion is not None or rpy is not None
    if input_ is not None:
        from ..batch import Streams, inverse_batch

        if one:
            raise BadOption("--input has a column for each number: expected no other target")
        streams = Streams(input_, output, as_json)
        raise typer.Exit(
            inverse_batch(loaded, joints, streams, readout, anchor, frame, every=every)
        )
    if frame == "base" or one:
        if readout is not None:
            raise BadOption("--readout is for positions in the sensor's frame alone")
        from ..space import Asked, answer_inverse

        asked = Asked(frame, quaternion, rpy, keep, on)
        raise typer.Exit(
            answer_inverse(loaded, joints, asked, typed, anchor, every=every, as_json=as_json)
        )
    _check_count(typed, loaded.axes, "coordinate")
    answer = _branches(loaded, typed, anchor) if every else loaded.solve(typed, anchor, readout)
    reachable = bool(answer.reachable.any())
    solutions = answers(
        joints,
        answer.q,
        position=answer.position,
        distance=answer.distance,
        expected_error=answer.expected_error,
        model_error=answer.model_error,
    )
    if as_json:
        document = {"target": typed, "reachable": reachable, "solutions": solutions}
        show_json({**document, **meaning(loaded.about)})
    other = readout is not None and readout != loaded.default_readout
    missed = f"the answer of readout '{readout}'" if other else "nearest attainable point"
    if not as_json:
        quantities = ["distance", *_bounds(loaded)]
        title = "" if reachable else missed
        show_answers(joints, solutions, loaded.about.unit, loaded.axes, quantities, title)
    if not reachable:
        factor, unit = for_people(loaded.about.unit)
        away = f"{float(answer.distance.min()) * factor:.4g} {unit} away"
        # a coarser readout can miss a target that the arm reaches
        note(f"missed: {missed} is {away}" if other else f"out of reach: the {missed} is {away}")
        raise typer.Exit(NO)
    if loaded.body is not None and loaded.body.structure.kind == "spatial":
        from ..space import free_of, say_free

        say_free(joints, free_of(loaded, answer.q[0]), near is not None)


def _numbers(values: Sequence[str]) -> list[float]:
    """Parse arguments; among them are options that do not exist."""
    result = []
    for text in values:
        try:
            result.append(finite_number(text))
        except ValueError:
            if text.startswith("-") and not text[1:2].isdigit():
                raise BadOption(f"no such option or number: {text!r}") from None
            raise bad_option("value", text, "a finite number") from None
    return result


def _check_streams(
    typed: Sequence[float], input_: str | None, output: str | None, as_json: bool
) -> None:
    if input_ is not None and typed:
        raise BadOption(f"--input {input_!r} and {len(typed)} values: expected one of them")
    if output is not None and input_ is None:
        raise BadOption(f"--output {output!r} is for many queries: expected --input FILE too")
    one_document(output, as_json)


def _check_count(typed: Sequence[float], names: Sequence[str], what: str) -> None:
    if len(typed) != len(names):
        raise BadOption(
            f"{len(typed)} {what}s: expected {len(names)}, one each for {', '.join(names)}"
        )


def _anchor(model: Model, near: Sequence[float] | None, joints: JointFormat) -> list[float] | None:
    q = joints.one_each("--near", near)
    about, turns_round = model.about, model.motor.scale.periodic
    for k, value in enumerate(q or ()):
        slack = 1e-9 * (about.upper[k] - about.lower[k])
        inside = about.lower[k] - slack <= value <= about.upper[k] + slack
        if not (inside or turns_round[k]):
            expected = joints.learned_range(k) + joints.hint(k, value)
            raise bad_option("--near", joints.value(k, value), expected)
    return q


def _branches(model: Model, target: Sequence[float], anchor: Sequence[float] | None) -> Answer:
    """Every branch that reaches a target, those near the anchor first."""
    import numpy as np

    (answer,) = model.solve_all([target])
    if anchor is None:
        return answer
    scale = model.motor.scale
    gaps = scale.difference(scale.to_unit(answer.q), scale.to_unit(np.array([anchor])))
    order = np.argsort(np.linalg.norm(gaps, axis=1), kind="stable")
    return answer.take(order)


def _bounds(model: Model, frame: str = "sensor") -> list[str]:
    """Bounds that are printed: of a simulation, and in the base frame, both are the same."""
    both = model.about.source == "log" and frame == "sensor"
    return ["expected_error", "model_error"] if both else ["expected_error"]


query_app.command()(path)
