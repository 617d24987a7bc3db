"""A log from pictures: one posture each, joints beside them."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..arm.rotations import quaternion_of
from ..common.arrays import Array
from ..common.parallel import one_blas_thread
from ..common.wording import listed
from ..errors import LogError
from .board import BoardFinder
from .joint_table import JointTable
from .opencv import Picture
from .pictures import list_pictures, match_rows, read_series
from .plane import square_pose
from .recorded import Recorded, told
from .reference import PlaneReference
from .setting import Setup
from .tags import Tag, TagFinder
from .track import TipTags, astray, check_motion, row_shift, stuck, unrelated
from .watch import Marks, Watched


def log_pictures(
    source: str | os.PathLike[str],
    joints: JointTable,
    setting: Setup,
    *,
    since: Mapping[str, Any] | None = None,
) -> Recorded:
    """Make a log from pictures of an arm with a printed tag on its tip.

    The source is a folder, or a pattern such as `shots/*.jpg`; `joints` have one row for each
    picture, by their column of names or in natural order. `since` is what an earlier log tells of
    its source (`read_about`): how far the camera moved since is told.

    Raises LogError in one line, if no log can be made: no such tag, twice in a picture, at one
        place while joints move, rows shifted against the pictures, and the like.
    """
    pairs, notes = match_rows(joints, list_pictures(source))
    boards = BoardFinder(setting.board) if setting.board is not None else None
    tips = TipTags(setting.tag)
    rows: list[int] = []
    tags: list[Tag] = []
    marks: list[tuple[int, Marks]] = []
    damaged: list[str] = []
    size = (0, 0)
    sample: list[Picture] = []
    for number, grey in read_series([path for _, path in pairs], damaged):
        name, size = pairs[number][1].name, (grey.shape[1], grey.shape[0])
        setting.check_size(name, size)
        # a dozen pictures tell which tags are there, should this one not be
        if number % max(1, len(pairs) // 12) == 0:
            sample.append(grey)
        found = setting.finder.find(grey)
        if setting.layout is not None:
            marks.append((number, setting.marks(grey, found, boards)))
        _, tip = tips.pick(found, name)
        if tip is not None:
            rows.append(number)
            tags.append(tip)
    reasons = tips.reasons
    notes += [f"{text}; left out" for text in damaged[:5]]
    reasons["cut off or damaged"] = len(damaged)
    tips.check_single(f"{len(tips.twice)} of {len(pairs)} pictures ({listed(tips.twice, 3)})")
    if not tags:
        raise unseen(setting, sample, f"{len(pairs)} pictures")
    what = f"{len(tags)} pictures"
    index = np.array([pairs[number][0] for number in rows])
    q, pixels = joints.q[index], np.array([t.centre for t in tags])
    if len(tags) > 1:
        check_motion(q, pixels, setting.tag, what)
    watched = setting.watch(marks, since)
    notes += watched.notes
    with one_blas_thread():
        notes += _check_order(q, pixels, [pairs[number][1].name for number in rows])
        good = ~stuck(q, pixels)
        reasons["at one place while the joints move: a second tag?"] = int((~good).sum())
        shaken = good & np.isin(rows, list(watched.off))
        reasons["the reference is elsewhere in them: camera shaken, refocused?"] = int(shaken.sum())
        good &= ~shaken
        lost = astray(q[good], pixels[good])
    reasons["far from where the joints put the tip"] = int(lost.sum())
    good[np.flatnonzero(good)[lost]] = False
    numbers = np.array(rows)[good]
    kept = [tag for tag, ok in zip(tags, good, strict=True) if ok]
    return assemble(
        setting,
        watched,
        kept,
        numbers,
        joint_names=joints.names,
        q=q[good],
        source={"source": "pictures", "size": list(size)},
        pictures=tuple(pairs[number][1].name for number in numbers),
        dropped={why: count for why, count in reasons.items() if count},
        notes=[*notes, *told(reasons, "pictures")],
    )


def assemble(
    setting: Setup,
    watched: Watched,
    tags: Sequence[Tag],
    numbers: Array,
    **more: Any,
) -> Recorded:
    """Put a log together from tags that were seen in the pictures of these numbers (n,).

    `more` are further fields of the log; its source is completed.
    """
    pixels = np.array([tag.centre for tag in tags])
    x, scale, common = watched.positions(pixels, numbers)
    unit, quaternion, notes = "px" if setting.layout is None else "m", None, list(more.pop("notes"))
    noise = np.array([tag.noise for tag in tags]) * scale
    if setting.pose:
        x, quaternion, unit = *_poses(setting, tags, watched.parts[-1]), "m"
    shared = float(np.sqrt(np.mean(common**2)))
    if steep := sum(tag.upright < 0.5 for tag in tags):
        notes.append(f"the tag is seen at more than 60 deg in {steep} rows: let it face the camera")
    return Recorded(
        x=x,
        unit=unit,
        noise=float(np.hypot(np.sqrt(np.mean(noise**2)), shared)),
        common=shared,
        pixels=pixels,
        source={**more.pop("source"), **setting.about(watched)},
        quaternion=quaternion,
        notes=tuple(notes),
        **more,
    )


def unseen(setting: Setup, greys: Sequence[Picture], what: str) -> LogError:
    """Return the error for a tag that is in none of `what`; some pictures tell which tags are."""
    finder, seen = TagFinder(setting.dictionary), Counter[int]()
    for grey in greys:
        seen.update({tag.number for tag in finder.find(grey)})
    shown = listed([f"{number} ({times} times)" for number, times in seen.most_common()], 6)
    instead = f"{len(greys)} of them show {shown} of {setting.dictionary}"
    if not seen:
        instead = (
            f"no tag of {setting.dictionary} is in {len(greys)} of them; check that it is sharp, "
            "has a white border and is of this dictionary"
        )
    return LogError(f"tag {setting.tag} is in none of {what}: {instead}")


def _check_order(q: Array, pixels: Array, pictures: Sequence[str]) -> list[str]:
    """Refuse joints that are shifted against the pictures; doubt those that say nothing of them."""
    start, shift, own, other = row_shift(q, pixels)
    if shift:
        where = f"{abs(shift)} row{'s' if abs(shift) > 1 else ''} further "
        where += "down" if shift > 0 else "up"
        raise LogError(
            f"the joints are shifted against the pictures from {pictures[start]} on: those {where} "
            f"predict the tag to {other:.2g} px, a picture's own to {own:.2g} px; is one missing "
            "there?"
        )
    if not unrelated(q, pixels):
        return []
    return ["the joints predict the tag no better than those of other pictures: of another run?"]


def _poses(setting: Setup, tags: Sequence[Tag], reference: object) -> tuple[Array, Array]:
    """Return places (n, 3) [m] and quaternions (n, 4) of tags, in the reference's frame.

    Without a reference the frame is the camera's: x right, y down, z ahead.
    """
    lens, size = setting.lens, setting.tag_size
    assert lens is not None and size is not None  # noqa: S101, PT018 - the setting was checked
    poses = [square_pose(lens, tag.corners, size) for tag in tags]
    turns, places = np.array([p.rotation for p in poses]), np.array([p.shift for p in poses])
    if isinstance(reference, PlaneReference):
        frame = reference.pose.rotation
        turns, places = frame.T @ turns, (places - reference.pose.shift) @ frame
    return places, quaternion_of(turns)
