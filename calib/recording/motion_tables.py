"""Tables of joints for pictures, and the picture of each row."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..common.arrays import Array
from ..common.atomic import FilePath
from ..common.choices import PICTURES
from ..common.rows import finite_rows
from ..common.wording import by_name, listing
from ..errors import LogError
from ..samples.column_units import name_and_unit
from ..samples.tables import UNNAMED, Source, open_source
from .pictures import Shot, list_pictures, read_series

_OTHERS = r"picture|time|timestamp|episode|q?[xyz]|qw"
# [rad]; joints that go beyond two turns are taken for degrees
_TURNS = 4.0 * np.pi


def joint_columns(header: Sequence[str]) -> tuple[str, ...]:
    """Return the columns of a table that are not a time, a picture or a position."""
    return tuple(
        name
        for name in header
        if not re.fullmatch(_OTHERS, name_and_unit(name)[0].lower())
    )


@dataclass(frozen=True, eq=False)
class JointTable:
    """Recorded joints without rows that miss a value, which are counted."""

    label: str
    names: tuple[str, ...]
    q: Array  # (n, joints) [rad or m]
    time: Array | None = (
        None  # times of the rows, by the joints' clock (n,) [s]
    )
    pictures: Sequence[str] | None = None  # names of the rows' pictures
    dropped: int = 0
    episodes: Array | None = None  # (n,), number of the series of each row
    revolute: Sequence[bool] | None = None  # which joints turn; None: all

    @property
    def what(self) -> str:
        """What messages call the rows' numbers."""
        return "joints" if self.names else "poses"


def read_joints(
    path: FilePath | Source,
    joints: Sequence[str] | None = None,
    *,
    degrees: bool = False,
    prismatic: Sequence[str] = (),
) -> JointTable:
    """Read a table of joints; a column `time` [s], or one of pictures, assigns the rows.

    joints : the joints' columns, by default all other columns of numbers; for an array, or lists in
        JSON, the names of its columns
    degrees, prismatic : whether joints that turn are in degrees, and which slide [m]
    Raises LogError if there are no joints, or they look like degrees without a declaration.
    """
    source = open_source(path)
    unnamed = [name for name in source.header if name.startswith(UNNAMED)]
    if joints is not None and len(joints) == len(unnamed):
        table = source.table.rename(by_name(unnamed, joints))
        source = replace(source, table=table)
    names = tuple(joint_columns(source.header) if joints is None else joints)
    if joints is None:
        is_number = np.isfinite(source.numbers(names)).any(axis=0)
        names = tuple(np.array(names, object)[is_number])
    beside = [name for name in ("time", "episode") if name in source.header]
    rows = number_rows_of(source, [*names, *beside])
    if not names or not len(rows.q):
        raise LogError(
            f"{source.label} has no row with numbers for {listing(names)}: expected a column for "
            f"each joint, decimals with a point; columns: {listing(source.header)}"
        )
    q, about = np.split(rows.q, [len(names)], axis=1)
    revolute = np.array([name not in prismatic for name in names])
    if degrees:
        q[:, revolute] = np.deg2rad(q[:, revolute])
    most = np.where(revolute, np.abs(q).max(axis=0), 0.0)
    if not degrees and most.max() > _TURNS:
        raise LogError(
            f"{source.label}: {names[most.argmax()]} goes to {most.max():.4g} rad, more than two "
            "turns: are these degrees? expected rad in each column, or `degrees=True`"
        )
    columns = by_name(beside, about.T)
    return replace(
        rows,
        names=names,
        q=q,
        time=columns.get("time"),
        episodes=columns.get("episode"),
        revolute=tuple(revolute.tolist()),
    )


def number_rows_of(source: Source, columns: Sequence[str]) -> JointTable:
    """Read columns of numbers as `q`, without rows that miss one, which are counted."""
    numbers = source.numbers(columns)
    good = np.flatnonzero(finite_rows(numbers))
    pictures = None
    column = picture_column(source)
    if column is not None:
        cells = source.read([column])[column].to_list()
        pictures = [file_name(str(cells[k] or "")) for k in good]
    return JointTable(
        source.label,
        tuple(columns),
        numbers[good],
        pictures=pictures,
        dropped=len(numbers) - len(good),
    )


def file_name(path: str) -> str:
    """The name of a file without its folders, of this system or another."""
    return path.replace("\\", "/").strip().rpartition("/")[2]


def picture_column(source: Source) -> str | None:
    """The column `picture`, or else the first whose cells end as names of pictures do."""
    for name in source.header:
        if name.lower() == "picture":
            return name
    for name, cells in source.read(source.header).head(20).to_dict().items():
        if any(str(cell).lower().endswith(PICTURES) for cell in cells):
            return name
    return None


def read_shots(
    table: JointTable, source: FilePath | Sequence[str]
) -> tuple[list[int], Iterator[Shot], list[str]]:
    """Rows (p,) of the joints in their order, the shot of each, and notes of what is left out.

    Reading the shots adds notes of damaged pictures.
    Raises LogError if names of pictures do not fit, or without names their counts.
    """
    paths = list_pictures(source)
    total = len(paths)
    rows = list(range(len(table.q)))
    notes: list[str] = []
    words = ""
    is_fitting = len(rows) == total and not table.dropped
    if table.pictures is not None:
        by_name = {path.stem: path for path in reversed(paths)}
        by_name |= {path.name: path for path in paths}
        names = table.pictures
        rows = [row for row, name in enumerate(names) if name in by_name]
        paths = [by_name[names[row]] for row in rows]
        words = f", which name {listing(names, 3)}"
        is_fitting = bool(rows) and len(set(paths)) == len(rows)
        lonely = {
            f"rows of {table.what}, without a picture": len(names) - len(rows),
            f"pictures, without {table.what}": total - len(rows),
        }
        for what, number in lonely.items():
            if number > 0:
                notes.append(f"{number} {what}, are left out")
    if not is_fitting:
        raise LogError(
            f"{total} pictures and {len(table.q) + table.dropped} rows of {table.what} in "
            f"{table.label} "
            f"({table.dropped} with a missing value){words}: expected one row for each picture, in "
            "the order of names or by a column 'picture'"
        )
    return rows, read_series(paths, notes), notes
