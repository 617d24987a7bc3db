"""Queries: one question or a table of them, answered for people, as a document or as a table.

It needs NumPy: commands import it when they run.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

import calib
from calib.common.arrays import Array, Mask
from calib.common.scale import METRES
from calib.common.wording import for_people, listing
from calib.samples.batch import Batch, read_batch
from calib.samples.tables import write_table

from .output import NO, Outcome, TextTable, note, number, say, with_decimals
from .parsing import TABLES, BadOption, bad_value, check_file, refuse
from .summary import bound_warnings
from .units import JointFormat, units_of

BOUNDS = ("expected_error", "model_error")
TURN = ("qx", "qy", "qz", "qw")
# columns in the unit of the positions
_LENGTHS = ("x", "y", "z", "distance", *BOUNDS)

Columns = Mapping[str, ArrayLike]


def model_in(path: str, frame: str, *, base: bool = False) -> calib.Model:
    """Load a model as one of its sensors sees the arm; as the first one in the `base` frame."""
    model = calib.load(path)
    names = [name for name in model.sensors if name]
    if frame in names:
        model = model.by(frame)
    elif frame != "sensor" and not (base and frame == "base"):
        choices = names or ["sensor"]
        if base:
            choices.append("base")
        raise BadOption(f"--in {frame!r}: expected {', '.join(choices)}")
    say(bound_warnings(model.about))
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
        self.model = model_in(path, frame, base=True)
        self.input = input_
        self.degrees = degrees
        self._columns = columns
        self._output = None if output == "-" else output
        about = self.model.about
        self.joints = JointFormat(about, degrees)
        based = frame == "base"
        self.frame = "base" if based else "sensor"
        self.axes = ("x", "y", "z") if based else self.model.axes
        self.unit = "m" if based else about.unit
        # of a simulation, and in the base frame, both bounds are the same: one is printed
        one_bound = based or about.source != "log"
        self.bounds = BOUNDS[:1] if one_bound else BOUNDS
        self.meaning: dict[str, object] = {
            "unit": self.unit,
            "bound_of": "true position" if based else about.bound_of,
            "units": units_of(about, self.unit),
        }
        """What the numbers of an answer mean, for JSON."""
        if based:
            self.meaning["frame"] = frame
        elif about.sensor:
            self.meaning["sensor"] = about.sensor
        self.factor, self.shown = for_people(self.unit)
        self.typed = 1.0
        """Factor from the model's unit to what is typed, and written to tables of answers."""
        if unit is not None:
            factors = METRES if self.unit in METRES else {self.unit: 1.0}
            if unit not in factors:
                units = ", ".join(factors)
                expected = f"a unit that positions in {self.unit} have: {units}"
                raise bad_value(unit, expected, "--unit")
            self.typed = factors[unit] / factors[self.unit]
            self.factor = self.typed
            self.shown = unit

    def words(self, length: float) -> str:
        """Return a length [the model's unit] in words."""
        return f"{number(length * self.factor)} {self.shown}"

    def within_range(
        self, option: str, typed: Sequence[float] | None
    ) -> Array | None:
        """Return joint values (dof,) [rad or m] of an option, within what was learned."""
        q = self.joints.one_each(option, typed)
        if q is None:
            return None
        beyond = self.joints.beyond(self.model, q)
        if beyond is not None:
            raise BadOption(f"{option} {beyond}")
        return np.array(q)

    def table(
        self, q: Array, quantities: Columns, title: str = ""
    ) -> TextTable:
        """Return answers (n, dof), a line each, an angle in deg, lengths in the positions' unit."""
        header = self.joints.header
        rows = [self.joints.cells(joints) for joints in q.tolist()]
        for name, values in quantities.items():
            factor, unit = self.factor, self.shown
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
        if self.input is None:
            raise BadOption(
                "--input FILE is missing: expected a table of queries"
            )
        batch = read_batch(self.input, names, more, self._columns or {})
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
        note_rows(batch.invalid, n, "not all values are numbers, no answer")
        code = 0
        document: dict[str, object] = {
            "output": None if columns is None else self._output,
            "rows": n if count is None else count,
            "invalid": batch.invalid,
        }
        for name, (rows, why) in failures.items():
            note_rows(rows, count or n, why)
            document[name] = list(rows)
            if rows:
                code = NO
        document |= {**(facts or {}), **self.meaning}
        if batch.invalid:
            code = 1
        if columns is None:
            return Outcome(document, lines, code=code)
        written = dict(columns)
        for name in written.keys() & set(_LENGTHS):
            written[name] = np.asarray(written[name], float) * self.typed
        if self._output is not None:
            write_table(self._output, written)
            return Outcome(document, lines, code=code)
        in_si = dict(columns)
        for name, typed in zip(
            self.joints.names, self.joints.typed, strict=True
        ):
            in_si[name] = np.asarray(columns[name]) / typed
        document[key] = in_si
        return Outcome(document, lines, result=(), columns=written, code=code)


def columns_with(batch: Batch, valid: Mask, added: Columns) -> Columns:
    """Columns of a table of queries with answers of rows that are `valid` (n,), else NaN or 0."""
    answers: dict[str, ArrayLike] = {}
    for name, column in added.items():
        whole = np.full(len(valid), 0 if name == "reachable" else np.nan)
        whole[valid] = column
        answers[name] = whole
    return batch.with_answers(answers)


def note_rows(numbers: Sequence[int], count: int, what: str) -> None:
    """Say what is the matter with some rows, the first of which are named, if there are any."""
    if numbers:
        rows = "row" if len(numbers) == 1 else "rows"
        note(f"{rows} {listing(map(str, numbers))} of {count}: {what}")
