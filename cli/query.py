"""Queries: one question or a table of them, answered for people, as a document or as a table.

It needs NumPy: commands import it when they run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

import calib
from calib.common.arrays import Array, Index, Mask
from calib.common.rows import finite_rows
from calib.common.scale import METRES
from calib.common.wording import error_size, for_people, listing
from calib.model.space import Space
from calib.use import assessment

from .logs import check_sensor
from .output import EXIT_ACT, Outcome, TextTable, note, say, with_decimals
from .parsing import TABLES, BadOption, bad_value, check_file, refuse
from .units import JointFormat, units_of

if TYPE_CHECKING:
    from calib.samples.batch import Batch

BOUNDS = ("expected_error", "model_error")
UNDETERMINED = (
    "the base frame's turn about and shift along the first axis, which no reading of a sensor "
    "with a fitted frame determines"
)
# columns in the unit of the positions
_LENGTHS = ("x", "y", "z", "distance", *BOUNDS)

Columns = Mapping[str, ArrayLike]
Failures = Mapping[str, tuple[Index, str]]
"""Rows that fail, counted from 0, and why, by the key of a document."""


def model_in(path: str, frame: str, *, base: bool = False) -> calib.Model:
    """Load a model as one of its sensors sees the arm; as the first one in the `base` frame."""
    model = calib.load(path)
    check_sensor(model, frame, *(["base"] if base else []))
    if frame in model.sensors:
        model = model.by(frame)
    say(assessment.bound_warnings(model.about))
    return model


def _refuse_no_camera(path: str, model: calib.Model) -> None:
    """Refuse pixels of a sensor of the model in a file that is no camera, where another one is."""
    if Space.of(model).camera:
        return
    whole = calib.load(path)
    cameras = [
        name for name in whole.sensors if Space.of(whole.by(name)).camera
    ]
    if cameras:
        expected = f"expected --in {' or '.join(cameras)}"
        raise BadOption(f"--on: {model.about.sensor} is no camera: {expected}")


@dataclass(frozen=True)
class PositionFormat:
    """How positions are typed and printed."""

    unit: str  # of the model's answers
    to_typed: float  # factor from it to what is typed, and written to tables
    to_printed: float
    printed: str  # unit

    @classmethod
    def of(cls, unit: str, typed: str | None) -> PositionFormat:
        """Return the format of positions, which may be typed and printed in another unit."""
        if typed is None:
            return cls(unit, 1.0, *for_people(unit))
        factors = METRES if unit in METRES else {unit: 1.0}
        if typed not in factors:
            expected = (
                f"a unit that positions in {unit} have: {', '.join(factors)}"
            )
            raise bad_value(typed, expected, "--unit")
        factor = factors[typed] / factors[unit]
        return cls(unit, factor, factor, typed)

    def words(self, length: float) -> str:
        """Return a length [unit] in words."""
        return f"{error_size(length * self.to_printed)} {self.printed}"


@dataclass(frozen=True)
class Files:
    """A table of queries, if there is one, and the table of their answers."""

    input: str | None
    columns: Mapping[str, str] | None = None  # names of its columns by role
    output: str | None = None  # None and "-" are standard output
    values: Sequence[float] | None = None  # of one query, in place of a table

    def __post_init__(self) -> None:
        """Refuse files that answer nothing, or that cannot be written."""
        if self.input is None:
            why = "is for many queries: expected --input FILE too"
            refuse({"output": self.output, "columns": self.columns}, why)
        elif self.values:
            raise BadOption(
                f"--input {self.input!r} and {len(self.values)} values: expected one"
            )
        check_file(self.output, TABLES, stream=True)


@dataclass(frozen=True)
class Query:
    """A model to query in a frame, and how joints and positions are typed and printed."""

    model: calib.Model
    frame: str  # "sensor" or "base"
    joints: JointFormat
    positions: PositionFormat
    files: Files
    is_relative: bool = False  # whether readings determine no base frame

    @classmethod
    def of(
        cls,
        path: str,
        files: Files,
        unit: str | None,
        degrees: bool,
        frame: str = "sensor",
        *,
        of_pixel: bool = False,
    ) -> Query:
        """Return a query of the model in a file, in the frame of a sensor or of the base.

        of_pixel : whether a camera's pixel is asked about, and answered in the frame of the base
        """
        model = model_in(path, frame, base=True)
        if of_pixel:
            _refuse_no_camera(path, model)
            frame = "base"
        frame = "base" if frame == "base" else "sensor"
        unit_of_answers = "m" if frame == "base" else model.about.unit
        joints = JointFormat(model.about, degrees)
        positions = PositionFormat.of(unit_of_answers, unit)
        is_relative = False
        if frame == "base":
            from calib.model.nominal import has_free_frame

            is_relative = has_free_frame(model)
        return cls(model, frame, joints, positions, files, is_relative)

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the coordinates of a position."""
        return ("x", "y", "z") if self.frame == "base" else self.model.axes

    @property
    def bounds(self) -> tuple[str, ...]:
        """Bounds that are printed: one where both are the same."""
        is_one = self.frame == "base" or self.model.about.source != "log"
        return BOUNDS[:1] if is_one else BOUNDS

    def explain(self) -> dict[str, object]:
        """Return what the numbers of an answer mean as JSON; print what its bounds leave out."""
        about = self.model.about
        in_base = self.frame == "base"
        unit = self.positions.unit
        meaning: dict[str, object] = {
            "unit": unit,
            "bound_of": "true position" if in_base else about.bound_of,
            "units": units_of(about, unit),
        }
        if in_base:
            meaning["frame"] = "base"
            if self.is_relative:
                meaning["not_in_bound"] = UNDETERMINED
                note(f"the bound leaves out {UNDETERMINED}")
        elif about.sensor:
            meaning["sensor"] = about.sensor
        return meaning

    def within_range(
        self, option: str, typed: Sequence[float] | None
    ) -> Array | None:
        """Return joint values (dof,) [rad or m] of an option, within what was learned."""
        values = self.joints.one_each(option, typed)
        if values is None:
            return None
        q = np.array(values)
        beyond = self.model.beyond_range(q, degrees=self.joints.degrees)
        if beyond is not None:
            raise BadOption(f"{option} {beyond}")
        return q

    def table(
        self, q: Array, quantities: Columns, title: str = ""
    ) -> TextTable:
        """Return answers (n, dof), a line each, an angle in deg, lengths in the positions' unit."""
        header = self.joints.header
        rows = [self.joints.cells(joints) for joints in q.tolist()]
        for name, values in quantities.items():
            factor = self.positions.to_printed
            unit = self.positions.printed
            if name == "turned":
                factor, unit = for_people("rad")
            header.append(f"{name.replace('_', ' ')} [{unit}]")
            for row, value in zip(rows, np.asarray(values), strict=True):
                row.append(with_decimals(factor * float(value), 4))
        return TextTable(header, rows, title, left=0)

    def read(
        self, names: Sequence[str], more: Sequence[Sequence[str]] = ()
    ) -> tuple[Batch, Mask]:
        """Read queries, positions in the model's unit, and which rows (n,) are numbers."""
        from calib.samples.batch import read_batch

        files = self.files
        if files.input is None:
            raise BadOption(
                "--input FILE is missing: expected a table of queries"
            )
        batch = read_batch(files.input, names, more, files.columns or {})
        if not len(batch.values):
            name = "standard input" if files.input == "-" else files.input
            note(f"{name} has no rows below its header")
        lengths = {*_LENGTHS} - {*self.joints.names}
        factors = [
            self.positions.to_typed if name in lengths else 1.0
            for name in batch.names
        ]
        batch = replace(batch, values=batch.values / factors)
        return batch, finite_rows(batch.values)

    def write(
        self,
        batch: Batch,
        columns: Columns | None,
        failures: Failures,
        *,
        count: int | None = None,
        key: str = "answers",
        lines: Sequence[str] = (),
        facts: Mapping[str, object] | None = None,
    ) -> Outcome:
        """Write a table of answers, None for no table, and report which rows fail.

        count : number of rows of the table, if not that of the queries
        key : of the answers in a document that no file has
        """
        queries = len(batch.values)
        rows_of_table = queries if count is None else count
        output = None if self.files.output == "-" else self.files.output
        why_invalid = "not all values are numbers, no answer"
        note_rows(batch.invalid, queries, why_invalid)
        document: dict[str, object] = {
            "output": None if columns is None else output,
            "rows": rows_of_table,
            "invalid": batch.invalid,
        }
        code = 0
        for name, (rows, why) in failures.items():
            numbers = (rows + 1).tolist()
            note_rows(numbers, rows_of_table, why)
            document[name] = numbers
            if numbers:
                code = EXIT_ACT
        if batch.invalid:
            code = 1
        document |= {**(facts or {}), **self.explain()}
        if columns is None:
            return Outcome(document, lines, code=code)
        typed = dict(columns)
        for name in typed.keys() & set(_LENGTHS):
            lengths = np.asarray(columns[name], float)
            typed[name] = lengths * self.positions.to_typed
        if output is not None:
            from calib.samples.tables import write_table

            write_table(output, typed)
            return Outcome(document, lines, code=code)
        in_si = dict(columns)
        joints = self.joints
        for name, factor in zip(joints.names, joints.to_typed, strict=True):
            in_si[name] = np.asarray(columns[name]) / factor
        document[key] = in_si
        return Outcome(document, lines, result=(), columns=typed, code=code)


def with_answers(batch: Batch, added: Columns) -> Columns:
    """Return the columns of queries with answers of those that are numbers, else NaN or 0."""
    valid = finite_rows(batch.values)
    answers: dict[str, ArrayLike] = {}
    for name, column in added.items():
        whole = np.full(len(valid), 0 if name == "reachable" else np.nan)
        whole[valid] = column
        answers[name] = whole
    return batch.with_answers(answers)


def note_rows(numbers: Sequence[int], count: int, what: str) -> None:
    """Report what is wrong with some rows, if there are any, naming the first."""
    if numbers:
        rows = "row" if len(numbers) == 1 else "rows"
        note(f"{rows} {listing(map(str, numbers))} of {count}: {what}")
