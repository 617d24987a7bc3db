"""The commands `calib query forward` and `calib query inverse`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from calib.common.wording import for_people

from .. import options as o
from ..answers import answers, show_answers
from ..output import NO, fixed, note, show_json
from ..parsing import Numbers, finite, height, numbers
from ..units import JointFormat, meaning, one_each, why_outside
from ..usage import BadOption, argument, bad_option, flag, one_document, option
from .path import path

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from calib import Answer, Model

    Array = NDArray[np.float64]


query_app = typer.Typer(
    add_completion=False,
    help="Ask a model for positions or for joint values.",
    rich_markup_mode=None,
)

_NEGATIVE = {"ignore_unknown_options": True}  # -0.1 is a number, not an option


@query_app.command(context_settings=_NEGATIVE)
def forward(
    model: o.ModelArgument,
    values: Annotated[
        list[str] | None, argument("Q1 Q2", "Joint values, base to tip [rad or m].")
    ] = None,
    readout: o.ReadoutOption = None,
    input_: o.InputOption = None,
    output: o.AnswersOption = None,
    frame: o.FrameOption = "sensor",
    degrees: o.DegreesOption = False,
    as_json: o.JsonOption = False,
) -> None:
    """Position of the tip for joint values; exit code 3 outside of what was learned."""
    typed = _numbers(values or [])
    _check_streams(typed, input_, output, as_json)
    loaded = _load(model)
    joints = JointFormat(loaded.about, degrees)
    if input_ is not None:
        from ..batch import Streams, forward_batch

        streams = Streams(input_, output, as_json)
        raise typer.Exit(forward_batch(loaded, joints, streams, readout, frame))
    _check_count(typed, loaded.about.joint_names, "joint value")
    q = [value / factor for value, factor in zip(typed, joints.typed, strict=True)]
    position = loaded.forward(q, readout)
    from calib.model.answers import forward_bounds

    expected, known = forward_bounds(loaded, q, position, readout)
    bounds = float(expected), float(known)
    more: dict[str, float] = {}
    split: dict[str, list[float]] = {}
    if len(loaded.axes) == 3 or frame == "base":
        from ..space import UP_TO_SCALE, seen_forward

        more = {k: float(v[0]) for k, v in seen_forward(loaded, [q], frame).items()}
        split = {UP_TO_SCALE: [more[UP_TO_SCALE]]} if UP_TO_SCALE in more else {}
    if frame == "base":
        import numpy as np

        position = np.array([more[axis] for axis in "xyz"])
        bounds = more["expected_error"], more["model_error"]
    turn = [more[name] for name in ("qx", "qy", "qz", "qw")] if "qw" in more else None
    outside = loaded.outside(q)
    (answer,) = answers(
        joints,
        [q],
        position=[position],
        **({} if turn is None else {"quaternion": [turn]}),
        expected_error=[bounds[0]],
        model_error=[bounds[1]],
        **split,
    )
    if as_json:
        show_json({**answer, **meaning(loaded.about, frame)})
    if outside is not None:
        note(f"no answer: {why_outside(joints, loaded, q) or outside}")
        raise typer.Exit(NO)
    if not as_json:
        in_base = frame == "base"
        unit, axes = ("m", "xyz") if in_base else (loaded.about.unit, loaded.axes)
        show_answers(joints, [answer], unit, axes, _bounds(loaded, frame))
        if turn is not None:
            print("quaternion " + " ".join(fixed(value, 6) for value in turn))
        if split:
            from ..space import say_size

            say_size(split)


@query_app.command(context_settings=_NEGATIVE)
def inverse(
    model: o.ModelArgument,
    target: Annotated[
        list[str] | None, argument("X Y [Z]", "Position wanted [m, or the sensor's unit].")
    ] = None,
    near: o.NearOption = None,
    every: o.AllOption = False,
    readout: o.ReadoutOption = None,
    input_: o.InputOption = None,
    output: o.AnswersOption = None,
    frame: o.FrameOption = "sensor",
    quaternion: Annotated[
        Numbers | None,
        option(
            "--quaternion QX,QY,QZ,QW", "Of an arm in space: the orientation wanted too.", numbers
        ),
    ] = None,
    rpy: Annotated[
        Numbers | None,
        option("--rpy R,P,Y", "The same as roll, pitch and yaw, as in a URDF [rad].", numbers),
    ] = None,
    keep: Annotated[
        bool, flag("--keep-orientation", "Turn the tool as little as possible from --near.")
    ] = False,
    on: Annotated[
        float | None,
        option("--on z=H", "The pixel X Y lies on this plane of the base frame [m].", height),
    ] = None,
    degrees: o.DegreesOption = False,
    as_json: o.JsonOption = False,
) -> None:
    """Joint values that bring the tip to a position; exit code 3 if it is out of reach."""
    typed = _numbers(target or [])
    _check_streams(typed, input_, output, as_json)
    if every and readout is not None:
        raise BadOption(f"--all answers by the default readout: expected no --readout {readout}")
    loaded = _load(model)
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


def _load(path: str) -> Model:
    import calib

    return calib.load(path)


def _numbers(values: Sequence[str]) -> list[float]:
    """Parse arguments; among them are options that do not exist."""
    result = []
    for text in values:
        try:
            result.append(finite(text))
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
    if near is None:
        return None
    q = one_each("--near", near, joints.names, joints.typed)
    about, turns_round = model.about, model.motor.scale.periodic
    for k, value in enumerate(q):
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
