"""A log from pictures: one posture each, joints beside them."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..arm.rotations import quaternion_of
from ..common.arrays import Array
from ..common.parallel import one_blas_thread
from ..errors import LogError
from ..samples.recorded import Recorded, told
from .joint_table import JointTable
from .pictures import list_pictures, match_rows, read_series
from .reference import PlaneReference, PositionReference, square_pose
from .setting import Setup
from .sight import LOOKS, sight
from .tags import Tag
from .track import check_motion, row_shift, stuck
from .watch import watch


def log_pictures(
    source: str | os.PathLike[str] | Sequence[str],
    joints: JointTable,
    setting: Setup,
) -> Recorded:
    """Make a log from pictures of an arm with a printed tag on its tip.

    source : a folder, a pattern such as `shots/*.jpg`, or several names
    joints : one row for each picture, by their column of names or in natural order
    Raises LogError in one line, if no log can be made.
    """
    pairs, notes = match_rows(joints, list_pictures(source))
    names = [path.name for _, path in pairs]
    damaged: list[str] = []
    series = read_series([path for _, path in pairs], damaged)
    frames = ((number, names[number], grey) for number, grey in series)
    seen = sight(frames, setting, "pictures", max(1, len(pairs) // LOOKS))
    notes += [f"{text}; left out" for text in damaged[:5]]
    reasons = seen.reasons
    reasons["cut off or damaged"] = len(damaged)
    q, pixels = joints.q[[pairs[number][0] for number in seen.numbers]], seen.pixels
    if len(q) > 1:
        check_motion(q, pixels, setting.tag, f"{len(q)} pictures")
    reference, off = watch(setting.layout, seen.marks, setting.lens, setting.tag_height)
    with one_blas_thread():
        start, shift, own, other = row_shift(q, pixels)
    if shift:
        where = f"{abs(shift)} row{'s' * (abs(shift) > 1)} further {'down' if shift > 0 else 'up'}"
        raise LogError(
            f"the joints are shifted against the pictures from {names[seen.numbers[start]]} on: "
            f"those {where} predict the tag to {other:.2g} px, a picture's own to {own:.2g} px; is "
            "one missing there?"
        )
    # single rows that contradict the others are found by those who learn from the log
    twin, bumped = stuck(q, pixels), np.isin(seen.numbers, list(off))
    reasons["at one place while the joints move: a second tag?"] = int(twin.sum())
    reasons["the reference is elsewhere in them: camera bumped, shaken, refocused?"] = int(
        (bumped & ~twin).sum()
    )
    rows = np.flatnonzero(~twin & ~bumped)
    return assemble(
        setting,
        reference,
        [seen.tags[k] for k in rows],
        reasons,
        "pictures",
        joint_names=joints.names,
        q=q[rows],
        source={"source": "pictures", "size": list(seen.size)},
        pictures=tuple(names[number] for number in seen.numbers[rows]),
        notes=notes,
    )


def assemble(
    setting: Setup,
    reference: PositionReference,
    tags: Sequence[Tag],
    reasons: Mapping[str, int],
    what: str,
    **more: Any,
) -> Recorded:
    """Put a log together from the tags of some pictures, and why others, of `what`, have none.

    `more` are further fields of the log; its source and notes are completed.
    """
    pixels = np.array([tag.centre for tag in tags])
    x, (scale, common) = reference.positions(pixels), reference.noise(pixels)
    unit, quaternion = "px" if setting.layout is None else "m", None
    noise = np.array([tag.noise for tag in tags]) * scale
    if setting.pose:
        x, quaternion, unit = *_poses(setting, tags, reference), "m"
    shared = float(np.sqrt(np.mean(common**2)))
    notes = [*more.pop("notes"), *told(reasons, what)]
    if steep := sum(tag.upright < 0.5 for tag in tags):
        notes.append(f"the tag is seen at more than 60 deg in {steep} rows: let it face the camera")
    return Recorded(
        x=x,
        unit=unit,
        noise=float(np.hypot(np.sqrt(np.mean(noise**2)), shared)),
        common=shared,
        pixels=pixels,
        source={**more.pop("source"), **setting.about(reference)},
        quaternion=quaternion,
        dropped={why: count for why, count in reasons.items() if count},
        notes=tuple(notes),
        **more,
    )


def _poses(
    setting: Setup, tags: Sequence[Tag], reference: PositionReference
) -> tuple[Array, Array]:
    """Places (n, 3) [m] and quaternions (n, 4) of tags, by the reference, else the camera."""
    lens, size = setting.lens, setting.tag_size
    assert lens is not None and size is not None  # noqa: S101, PT018 - the setting was checked
    poses = [square_pose(lens, tag.corners, size) for tag in tags]
    turns, places = np.array([p.rotation for p in poses]), np.array([p.shift for p in poses])
    if isinstance(reference, PlaneReference):
        frame = reference.pose.rotation
        turns, places = frame.T @ turns, (places - reference.pose.shift) @ frame
    return places, quaternion_of(turns)
