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
from .joint_table import JointTable, match_rows
from .pictures import list_pictures, read_series
from .reference import PlaneReference, square_pose, watch
from .setting import LOOKS, Setup, Sightings, sight
from .tags import Tag
from .track import row_shift

_STILL = 2.0  # [px]; a tag that moves less over a recording does not move


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
    seen = sight(frames, setting, "pictures", max(1, len(pairs) // LOOKS), 1)
    seen.reasons["cut off or damaged"] = len(damaged)
    q = joints.q[[pairs[number][0] for number in seen.numbers]]
    if len(q) > 1:
        check_motion(q, seen, setting.tag, f"{len(q)} pictures")
    reference, off = reference_of(setting, seen)
    with one_blas_thread():
        start, shift, own, other = row_shift(q, seen.pixels)
    if shift:
        where = f"{abs(shift)} row{'s' * (abs(shift) > 1)} further {'down' if shift > 0 else 'up'}"
        raise LogError(
            f"the joints are shifted against the pictures from {names[seen.numbers[start]]} on: "
            f"those {where} predict the tag to {other:.2g} px, a picture's own to {own:.2g} px; is "
            "one missing there?"
        )
    # rows that contradict the others, as a second tag makes them, are found by who learns from them
    bumped = np.isin(seen.numbers, list(off))
    seen.reasons["the reference is elsewhere in them: camera bumped, shaken, refocused?"] = int(
        bumped.sum()
    )
    rows = np.flatnonzero(~bumped)
    return assemble(
        setting,
        reference,
        [seen.tags[k] for k in rows],
        seen.reasons,
        "pictures",
        joint_names=joints.names,
        q=q[rows],
        source={"source": "pictures", "size": list(seen.size)},
        pictures=tuple(names[number] for number in seen.numbers[rows]),
        notes=[*notes, *damaged[:5]],
    )


def check_motion(q: Array, seen: Sightings, tag: int, what: str) -> None:
    """Raise LogError for a recording in which the arm, or the tag alone, stands still."""
    if np.ptp(q, axis=0).max() < 2e-3:
        raise LogError(f"the arm never moves in {what}: nothing to learn from")
    if np.linalg.norm(np.ptp(seen.pixels, axis=0)) < _STILL:
        u, v = np.median(seen.pixels, axis=0)
        raise LogError(
            f"tag {tag} stays at ({u:.0f}, {v:.0f}) px in all of {what} while the joints move: "
            "check that it is on the tip and that no second tag of this id is in view"
        )


def reference_of(setting: Setup, seen: Sightings) -> tuple[PlaneReference | None, frozenset[int]]:
    """What positions are told in, None for pixels; and the pictures in which it is elsewhere."""
    if setting.layout is None or setting.lens is None:
        return None, frozenset()
    return watch(setting.layout, seen.marks, setting.lens, setting.tag_height)


def assemble(
    setting: Setup,
    reference: PlaneReference | None,
    tags: Sequence[Tag],
    reasons: Mapping[str, int],
    what: str,
    **more: Any,
) -> Recorded:
    """Put a log together from the tags of some pictures, and why others, of `what`, have none.

    `more` are further fields of the log; its source and notes are completed.
    """
    pixels = np.array([tag.centre for tag in tags])
    x, unit, quaternion, scale, common = pixels, "px", None, np.ones(1), np.zeros(1)
    about: dict[str, Any] = {"tag": setting.tag, "dictionary": setting.dictionary}
    about["reference"] = {"kind": "pixels"}
    if reference is not None:
        x, unit, (scale, common) = reference.positions(pixels), "m", reference.noise(pixels)
        about["reference"] = reference.told()
    lens, size = setting.lens, setting.tag_size
    if lens is not None:
        about["lens"] = lens.to_json()
    if setting.pose and lens is not None and size is not None:
        poses = [square_pose(lens, tag.corners, size) for tag in tags]
        turns, x = np.array([p.rotation for p in poses]), np.array([p.shift for p in poses])
        if reference is None:
            scale = x[:, 2] / lens.focal.mean()
        else:
            frame = reference.pose.rotation
            turns, x = frame.T @ turns, (x - reference.pose.shift) @ frame
        quaternion, unit = quaternion_of(turns), "m"
    shared = float(np.sqrt(np.mean(common**2)))
    noise = np.array([tag.noise for tag in tags]) * scale
    notes = [*more.pop("notes"), *told(reasons, what)]
    if steep := sum(tag.upright < 0.5 for tag in tags):
        notes.append(f"the tag is seen at more than 60 deg in {steep} rows: let it face the camera")
    return Recorded(
        x=x,
        unit=unit,
        noise=float(np.hypot(np.sqrt(np.mean(noise**2)), shared)),
        common=shared,
        pixels=pixels,
        source={**more.pop("source"), **about},
        quaternion=quaternion,
        dropped={why: count for why, count in reasons.items() if count},
        notes=tuple(notes),
        **more,
    )
