"""The command `calib query inverse`: joint values for positions, or for poses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import typer

from calib.common.wording import for_people

from ..options import takes
from ..output import NO, note, show_json
from ..parsing import height, reals
from ..units import JointFormat, meaning
from ..usage import BadOption, argument, check_count, check_streams, flag, option, typed_numbers

if TYPE_CHECKING:
    from calib import Answer, Model
    from calib.common.arrays import Array


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

    typed = typed_numbers(target)
    check_streams(typed, input_, output, as_json)
    turned = quaternion is not None or rpy is not None
    if every and readout is not None:
        raise BadOption(f"--all answers by the default readout: expected no --readout {readout}")
    if input_ is not None and (turned or keep or on is not None):
        raise BadOption("--input has a column for each number: expected no other target")
    if keep and (turned or near is None):
        raise BadOption("--keep-orientation keeps that of --near: expected --near alone beside it")
    loaded = calib.load(model)
    joints = JointFormat(loaded.about, degrees)
    anchor = joints.one_each("--near", near)
    if anchor is not None and (beyond := joints.beyond(loaded, anchor)):
        raise BadOption(f"--near {beyond}")
    if input_ is not None:
        streams = (output, as_json)
        raise typer.Exit(_batch(loaded, joints, input_, readout, anchor, streams, frame, every))
    told: dict[str, Any] = {"target": typed}
    turn: Array | None = None
    x: Any = typed
    in_space = frame == "base" or turned or keep or on is not None
    if in_space:
        from calib.model.space import Space

        from ..space import orientation, pixel_on_plane

        if Space.of(loaded).camera and frame == "sensor" and on is None:
            raise calib.QueryError(
                "a pixel alone is no position in space; give --on z=H or --in base"
            )
        turn = orientation(quaternion, rpy, degrees)
        told["frame"] = "sensor" if on is None and frame == "sensor" else "base"
    if on is None:
        check_count(typed, "xyz" if frame == "base" else loaded.axes, "coordinate")
    else:
        x = pixel_on_plane(loaded, typed, on)
        told["on_plane"] = {"z": on, "position": x, "unit": "m"}
    if turn is not None:
        told["quaternion"] = turn
    asked = _Asked(loaded, x, turn, anchor, told.get("frame", "sensor"), readout, in_space, keep)
    raise typer.Exit(_show(asked, joints, told, every, as_json))


@dataclass(frozen=True)
class _Asked:
    """One question, or many."""

    model: Model
    x: Any  # (2,), (3,) or (n, 2), (n, 3), positions in the frame
    turn: Array | None  # (4,) or (n, 4), orientations wanted as quaternions
    near: Any  # (dof,) or (n, dof) [rad or m], or None
    frame: str  # "sensor" or "base"
    readout: str | None
    in_space: bool  # whether the chain of an arm in space answers rather than the model itself
    keep: bool = False  # whether the orientation at `near` is kept

    def answer(self, every: bool) -> dict[str, Any]:
        """Return what an `Answer` or `PoseAnswers` holds, by name, for each answer."""
        if not self.in_space:
            solve, given = self.model.solve, (self.x, self.near, self.readout)
            return {**(self._branches() if every else solve(*given))._asdict()}
        if self.readout is not None:
            raise BadOption("--readout is for positions in the sensor's frame alone")
        from calib.model.poses import solve_poses

        from ..space import up_to_scale

        ways = {"every": every, "keep": self.keep}
        found = solve_poses(self.model, self.x, self.turn, self.near, frame=self.frame, **ways)
        scaled = up_to_scale(self.model, found.q) if self.frame == "base" else {}
        return {**found._asdict(), **scaled}

    def _branches(self) -> Answer:
        """Every branch that reaches a target, those near the anchor first."""
        import numpy as np

        (answer,) = self.model.solve_all([self.x])
        if self.near is None:
            return answer
        scale = self.model.motor.scale
        gaps = scale.difference(scale.to_unit(answer.q), scale.to_unit(np.array([self.near])))
        return answer.take(np.argsort(np.linalg.norm(gaps, axis=1), kind="stable"))


def _show(
    asked: _Asked, joints: JointFormat, told: dict[str, Any], every: bool, as_json: bool
) -> int:
    """Print the answer to one question and return the exit code; `told` begins its document."""
    from ..answers import UP_TO_SCALE, answers, bounds_shown, show_answers

    model, posed = asked.model, asked.turn is not None
    # of a pose all branches are looked for, so that the nearest is found
    found = asked.answer(every or asked.in_space)
    found.pop("target", None)
    q, reachable = found.pop("q"), bool(found.pop("reachable").any())
    solutions = answers(joints, q, **found)[: None if every else 1]
    free = _free(asked, q[0]) if reachable else q[:0]
    if as_json:
        told |= {"reachable": reachable, "solutions": solutions}
        if asked.in_space:
            told["free"] = [dict(zip(joints.names, row, strict=True)) for row in free]
        show_json({**told, **meaning(model.about, asked.frame)})
    other = asked.readout is not None and asked.readout != model.default_readout
    missed = "nearest attainable pose" if posed else "nearest attainable point"
    missed = f"the answer of readout '{asked.readout}'" if other else missed
    unit = "m" if asked.frame == "base" else model.about.unit
    if not as_json:
        axes = "xyz" if asked.in_space else model.axes
        shown = ["distance", *(["turned"] if posed else []), *bounds_shown(model, asked.frame)]
        show_answers(joints, solutions, unit, axes, shown, "" if reachable or posed else missed)
    if asked.frame == "base":
        from calib.model.space import Space

        from ..space import say_size

        if UP_TO_SCALE in found:
            say_size(float(found[UP_TO_SCALE][0]))
        if not Space.of(model).sees(asked.x).all():
            note("the camera's picture does not show the target")
    if not reachable:
        factor, unit = for_people(unit)
        away = f"{float(found['distance'].min()) * factor:.4g} {unit}"
        if posed:
            away += f" and {math.degrees(float(found['turned'][0])):.3g} deg"
        few = "; so few joints reach few poses, ask for a position alone"
        hint = few if posed and len(joints.names) < 6 else ""
        # a coarser readout can miss a target that the arm reaches
        note(f"{'missed:' if other else 'out of reach: the'} {missed} is {away} away{hint}")
        return NO
    if len(free):
        from ..space import say_free

        say_free(joints, free, asked.near is not None)
    return 0


def _free(asked: _Asked, q: Array) -> Array:
    """Directions of the joints (k, dof) that leave the answer of an arm in space where it is."""
    model = asked.model
    spatial = model.body is not None and model.body.structure.kind == "spatial"
    if not (asked.in_space or spatial):
        return q[:0]
    from ..space import free

    return free(model, q, (3 if asked.turn is None else 6) if asked.in_space else None)


def _batch(
    model: Model,
    joints: JointFormat,
    source: str,
    readout: str | None,
    near: Sequence[float] | None,
    streams: tuple[str | None, bool],
    frame: str,
    every: bool,
) -> int:
    """Answer a table of positions or poses with joint values; return the exit code.

    A target out of reach has no joint values, but its distance from the nearest
    attainable point.

    source : the table.  Columns near_JOINT, one for each, choose the branch row by row; of an arm
        in space with six joints, qx, qy, qz, qw ask for an orientation too.
    every : whether to write all branches of each pose, a row each
    """
    import numpy as np

    from calib.samples.roles import QUATERNION
    from calib.samples.tables import read_batch

    from ..answers import over_all_rows, write_batch

    base, beside = frame == "base", [f"near_{name}" for name in joints.names]
    axes = "xyz" if base else model.axes
    # fewer than six joints reach almost no pose that is given: its columns go along unread
    turns = QUATERNION if len(joints.names) >= 6 and len(axes) == 3 else ()
    batch = read_batch(source, axes, (beside, turns))
    posed = bool(turns) and "qw" in batch.names
    if every and not posed:
        raise BadOption("--all of many targets is for poses: expected columns qx, qy, qz, qw")
    n = len(batch.values)
    valid: Any = np.isfinite(batch.values).all(axis=1)
    given = dict(zip(batch.names, batch.values[valid].T, strict=True))
    x, turn = batch.values[valid, : len(axes)], None
    anchor: Any = near
    if beside[0] in given:
        anchor = np.stack([given[name] for name in beside], axis=1) / joints.typed
    if posed:
        turn = np.stack([given[name] for name in QUATERNION], axis=1)
    found = _Asked(model, x, turn, anchor, frame, readout, posed or base).answer(every)
    # with every branch a target has several answers
    rows = np.flatnonzero(valid)[found.pop("target", slice(None))]
    reachable, q = found["reachable"], found.pop("q")
    q = np.where(reachable[:, None], q * joints.typed, np.nan)
    for name in ("position", "quaternion", *([] if posed else ["turned"])):
        found.pop(name, None)
    # rows without numbers stand where they stood, between the answers of the others
    index = np.sort(np.concatenate([rows, np.flatnonzero(~valid)]))
    answers = over_all_rows(valid[index], {**dict(zip(joints.names, q.T, strict=True)), **found})
    if every:
        answers, batch = {"row": index + 1, **answers}, batch.take(index)
    missed = (rows[~reachable] + 1).tolist()
    return write_batch(model, joints, batch, answers, missed, "out of reach", streams, frame, n)
