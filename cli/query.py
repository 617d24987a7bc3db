"""Queries: one question or a table of them, answered for people, as a document or as a table.

It needs NumPy: commands import it when they run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

import calib
from calib.common.arrays import Array, Mask
from calib.common.choices import FRAMES
from calib.common.scale import METRES
from calib.common.wording import for_people
from calib.samples.tables import Batch, read_batch, write_table

from .output import NO, Outcome, TextTable, fixed, note, say
from .parsing import TABLES, BadOption, bad_value, check_file, refuse
from .summary import contradicted
from .units import JointFormat, units_of

BOUNDS = ("expected_error", "model_error")
UP_TO_SCALE = "expected_error_up_to_scale"
"""Key and column of a bound in a camera's base frame that leaves out the arm's size."""
TURN = ("qx", "qy", "qz", "qw")
# columns in the unit of the positions
_LENGTHS = ("x", "y", "z", "distance", *BOUNDS, UP_TO_SCALE)
_MOST = 10  # row numbers in a message

Columns = Mapping[str, ArrayLike]


def model_in(path: str, frame: str) -> calib.Model:
    """Load a model as one of its sensors sees the arm; as the first one in other frames."""
    model = calib.load(path)
    if frame in model.sensors:
        model = model.by(frame)
    elif frame not in FRAMES:
        names = ", ".join(name for name in model.sensors if name)
        raise BadOption(
            f"--in {frame!r}: expected base or a sensor: {names or 'sensor'}"
        )
    say(contradicted(model.about))
    return model


class Query:
    """A model that is asked, and how its joints and positions are typed and printed."""

    def __init__(
        self,
        path: str,
        input_: str | None,
        columns: Mapping[str, str] | None,
        output: str | None,
        unit: str | None,
        degrees: bool,
        frame: str = "sensor",
        values: Sequence[float] | None = None,
    ) -> None:
        if input_ is None:
            why = "is for many queries: expected --input FILE too"
            refuse({"output": output, "columns": columns}, why)
        elif values:
            raise BadOption(
                f"--input {input_!r} and {len(values)} values: expected one"
            )
        check_file(output, TABLES, stream=True)
        self.model = model_in(path, frame)
        frame = "base" if frame == "base" else "sensor"
        self.frame = frame
        self.unit = "m" if frame == "base" else self.model.about.unit
        self.factor, self.shown = for_people(self.unit)
        self.typed = 1.0
        """Factor from the model's unit to what is typed, and written to tables of answers."""
        if unit is not None:
            fitting = METRES if self.unit in METRES else {self.unit: 1.0}
            if unit not in fitting:
                units = ", ".join(fitting)
                expected = f"a unit that positions in {self.unit} have: {units}"
                raise bad_value(unit, expected, "--unit")
            self.typed = fitting[unit] / fitting[self.unit]
            self.factor = self.typed
            self.shown = unit
        self.input = input_
        self.degrees = degrees
        self._columns = columns or {}
        self._output = output
        about = self.model.about
        base = frame == "base"
        self.joints = JointFormat(about, degrees)
        self.axes = ("x", "y", "z") if base else self.model.axes
        # what the numbers of an answer mean, for JSON
        self.meaning: dict[str, object] = {
            **({"frame": frame} if base else {}),
            **({"sensor": about.sensor} if about.sensor and not base else {}),
            "unit": self.unit,
            "bound_of": "true position" if base else about.bound_of,
            "units": units_of(about, self.unit),
        }
        # of a simulation, and in the base frame, both bounds are the same: one is printed
        self.bounds = (
            BOUNDS if about.source == "log" and not base else BOUNDS[:1]
        )

    def words(self, length: float) -> str:
        """Return a length [the model's unit] in words."""
        return f"{length * self.factor:.4g} {self.shown}"

    def table(
        self,
        q: Array,
        position: Array,
        quantities: Mapping[str, Array],
        title: str = "",
    ) -> TextTable:
        """Return answers (n, ...), a line each, an angle in deg, lengths in the positions' unit."""
        header = self.joints.header
        columns = []
        axes = dict(zip(self.axes, position.T, strict=True))
        for name, values in {**axes, **quantities}.items():
            factor, unit = self.factor, self.shown
            if name == "turned":
                factor, unit = for_people("rad")
            header.append(f"{name.replace('_', ' ')} [{unit}]")
            columns.append(factor * np.asarray(values))
        cells = np.transpose(columns)
        rows = [
            [*self.joints.cells(joints), *(fixed(value, 4) for value in row)]
            for joints, row in zip(q.tolist(), cells.tolist(), strict=True)
        ]
        return TextTable(header, rows, title, left=0)

    def read(
        self, names: Sequence[str], more: Sequence[Sequence[str]] = ()
    ) -> tuple[Batch, Mask]:
        """Read queries, positions in the model's unit, and which rows (n,) are numbers."""
        if self.input is None:
            raise BadOption(
                "--input FILE is missing: expected a table of queries"
            )
        batch = read_batch(self.input, names, more, self._columns)
        lengths = [
            n in _LENGTHS and n not in self.joints.names for n in batch.names
        ]
        values = batch.values / np.where(lengths, self.typed, 1.0)
        return replace(batch, values=values), np.asarray(
            np.isfinite(values).all(axis=1)
        )

    def answer(
        self,
        batch: Batch,
        columns: Columns | None,
        failures: Mapping[str, tuple[Sequence[int], str]],
        *,
        count: int | None = None,
        key: str = "answers",
        lines: Sequence[str] = (),
        facts: Mapping[str, object] | None = None,
    ) -> Outcome:
        """Write a table of answers, None for no table, and say which rows fail.

        `failures` have the numbers of rows and why they fail, by the key of a document; `count` is
        the number of rows of the table, if not that of the queries.
        """
        n = len(batch.values)
        _note_rows(batch.invalid, n, "not all values are numbers, no answer")
        n = n if count is None else count
        for rows, why in failures.values():
            _note_rows(rows, n, why)
        failed = {name: list(rows) for name, (rows, _) in failures.items()}
        code = NO if any(failed.values()) else 0
        if batch.invalid:
            code = 1
        to_file = self._output is not None and self._output != "-"
        document: dict[str, object] = {
            "output": self._output if to_file and columns is not None else None,
            "rows": n,
            "invalid": batch.invalid,
            **failed,
            **(facts or {}),
            **self.meaning,
        }
        if columns is None:
            return Outcome(document, lines, code=code)
        written = dict(columns)
        if self.typed != 1.0:
            for name in written.keys() & set(_LENGTHS):
                written[name] = np.asarray(written[name], float) * self.typed
        if to_file:
            write_table(str(self._output), written)
            return Outcome(document, lines, code=code)
        in_si = dict(columns)
        for name, typed in zip(
            self.joints.names, self.joints.typed, strict=True
        ):
            in_si[name] = np.asarray(columns[name]) / typed
        document[key] = in_si
        return Outcome(document, lines, result=(), columns=written, code=code)


def beside(batch: Batch, valid: Mask, added: Columns) -> Columns:
    """Columns of a table of queries with answers of rows that are `valid` (n,), else NaN or 0."""
    answers: dict[str, ArrayLike] = {}
    for name, column in added.items():
        whole = np.full(len(valid), 0 if name == "reachable" else np.nan)
        whole[valid] = column
        answers[name] = whole
    return batch.answered(answers)


def _note_rows(numbers: Sequence[int], count: int, what: str) -> None:
    """Say what is the matter with some rows, the first of which are named, if there are any."""
    if not numbers:
        return
    rows = " " if len(numbers) == 1 else "s "
    rows += ", ".join(map(str, numbers[:_MOST]))
    if len(numbers) > _MOST:
        rows += f" and {len(numbers) - _MOST} more"
    note(f"row{rows} of {count}: {what}")


def up_to_scale(model: calib.Model, q: ArrayLike) -> dict[str, Array]:
    """The bound (n,) in the base frame of a camera [m], but for the arm's size; else nothing."""
    from calib.model.space import Space

    space = Space.of(model)
    return {UP_TO_SCALE: space.bound(q, size=False)} if space.camera else {}


def note_size(bounds: Mapping[str, Array]) -> None:
    """Say what of a bound in the base frame of a camera is the arm's size."""
    bound = bounds.get(UP_TO_SCALE)
    if bound is not None and np.isfinite(bound[0]):
        note(
            "one camera cannot tell the size of the arm: but for it, the expected error is "
            f"{1e3 * bound[0]:.2g} mm"
        )
