"""A camera watched while the arm stands in one posture after the other: a picture for each.

Use it where no program of the robot's takes pictures: joints come line by line, such as from a
pipe, and the folder that is filled becomes a log as any folder of pictures does.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from ..common.atomic import atomic_write
from ..errors import LogError
from .opencv import opencv
from .setting import Setup

_JOINTS = "joints.csv"
"""The table of joints beside the pictures."""

_HELD = 5  # frames that drivers keep: older than the line of joints, so they are thrown away


def record_live(
    device: str,
    lines: Iterable[str],
    folder: Path,
    setting: Setup,
    say: Callable[[str], None] = lambda _: None,
) -> Path:
    """Take a picture for each line of joints, until the lines end or Ctrl-C.

    device : str; the camera's number, such as `0`, or a stream that OpenCV opens.
    lines : iterable of str; CSV: the joints' names, then their values [rad or m], a line when the
        arm has come to rest.
    folder : Path; where pictures and `joints.csv` go; new, or empty.
    setting : names the tag; `say` tells for each picture whether it was seen.
    Returns Path; the table of joints, with a column `picture`.
    Raises LogError if there is no such camera, it stops, or a line has no joints.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise LogError(f"{str(folder)!r} is not empty: expected a new folder for the pictures")
    capture = opencv().VideoCapture(int(device) if device.isdecimal() else device)
    if not capture.isOpened():
        raise LogError(f"there is no camera {device!r} that OpenCV can open: expected 0, 1, ...")
    folder.mkdir(parents=True, exist_ok=True)
    rows = csv.reader(lines, skipinitialspace=True)
    names = next(rows, [])
    if not names or any(not name or name[0] in "-+.0123456789" for name in names):
        raise LogError(
            "the joints' stream begins without names: expected a line such as shoulder,elbow"
        )
    table = [",".join(("picture", *names))]
    try:
        for number, row in enumerate(filter(None, rows), start=1):
            where = f"line {number + 1} of the joints' stream"
            if len(row) != len(names):
                raise LogError(f"{where} has {len(row)} values, expected {len(names)}")
            try:
                q = [float(cell) for cell in row]
            except ValueError as error:
                raise LogError(f"{where}: {error}; expected the joints' values") from None
            grey = _newest(capture, device)
            seen = [tag for tag in setting.finder.find(grey) if tag.number == setting.tag]
            place = f"at {seen[0].centre.round(1).tolist()} px" if seen else "not seen"
            name = f"img_{number}.png"
            say(f"{name}: tag {setting.tag} {place}")
            atomic_write(folder / name, opencv().imencode(".png", grey)[1].tobytes())
            table.append(",".join((name, *map(repr, q))))
            # after each row: what was recorded stays, whatever ends the recording
            atomic_write(folder / _JOINTS, ("\n".join(table) + "\n").encode())
    except KeyboardInterrupt:  # the usual end: a person has seen enough
        pass
    finally:
        capture.release()
    if len(table) == 1:
        raise LogError("the joints' stream ended before its first posture: no picture was taken")
    return folder / _JOINTS


def _newest(capture: Any, device: str) -> Any:
    """Return the first grey frame that was taken after now."""
    cv2 = opencv()
    there = all(capture.grab() for _ in range(_HELD))
    there, frame = capture.read() if there else (False, None)
    if not there or frame is None:
        raise LogError(f"camera {device!r} gives no more pictures: is it in use, or unplugged?")
    return frame if frame.ndim == 2 else cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
