"""Table 1 and Table 2 of the paper, ours next to the paper's."""

import csv
import io
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from .setting import NETWORKS, Setting
from .trial import (
    SAME_SCHEDULE,
    Candidate,
    NetworkTrial,
    Row,
    Schedule,
    best_trial,
)


class PaperErrors(NamedTuple):
    """Mean and largest error of one column of a table [mm or deg]."""

    mean: float
    max: float


UNITS = {"x": "mm", "y": "mm", "shoulder": "deg", "elbow": "deg"}
"""Units of both tables' columns: X, Y, theta_1 and theta_2 by our joints' names."""

COLUMNS = tuple(UNITS)


def _row(*figures: float) -> dict[str, PaperErrors]:
    """Means and largest errors, in turn, of the four columns."""
    return {
        name: PaperErrors(*figures[2 * k : 2 * k + 2])
        for k, name in enumerate(COLUMNS)
    }


TABLE1 = {
    "som": _row(2.6, 26.0, 2.9, 29.0, 0.37, 3.45, 0.61, 6.70),
    "vdsom": _row(1.15, 11.7, 1.26, 15.0, 0.31, 2.25, 0.44, 5.36),
}
"""SOM and VDSOM of 70x70 nodes."""

TABLE2 = {
    30: _row(4.16, 36.3, 3.93, 21.1, 0.91, 4.60, 1.53, 7.62),
    50: _row(2.13, 13.5, 2.11, 15.3, 0.52, 2.80, 0.80, 5.05),
    70: TABLE1["vdsom"],
}
"""VDSOM by the nodes along each side of its lattices."""

FACTORS = {"mm": 1000.0, "deg": 180.0 / math.pi}
"""From SI units to those of the tables."""

Cells = list[str | float | None]
"""A row of a table: words and numbers; None is an empty cell."""

READOUTS = ("winner", "activity", "linear")
"""In the order of the tables."""

# {column: {"mean", "max"}} [m, rad]
_Columns = Mapping[str, Mapping[str, float]]


# errors of a trial, and those that the paper has
_Line = tuple[Row, Mapping[str, PaperErrors] | None]


@dataclass(frozen=True)
class Table:
    """A table as it is printed and as a CSV file."""

    name: str  # of the file
    title: str  # what it shows
    header: Sequence[str]  # names of the columns
    rows: Sequence[Sequence[str | float | None]]

    def csv(self) -> str:
        """Content of a CSV file, numbers in full."""
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows(
            [self.header, *self.rows]
        )
        return text.getvalue()


@dataclass(frozen=True)
class Result:
    """What an experiment found."""

    data: dict[str, object]  # for JSON, in SI units
    tables: tuple[Table, ...]  # for people and for CSV files, in mm and degrees


def table1(setting: Setting) -> Result:
    """SOM against VDSOM: each at its own best schedule, then both at the same one."""
    best: dict[str, Row] = {}
    same: dict[str, Row] = {}
    rankings: dict[str, list[Candidate]] = {}
    for network in NETWORKS:
        trial, rankings[network] = best_trial(setting, network)
        best[network] = trial.row(setting)
    for network in NETWORKS:
        same_trial = NetworkTrial(network, SAME_SCHEDULE, setting.side)
        same[network] = same_trial.row(setting)
    paper = _in_si_units(TABLE1)
    setting.report(1.0, "the default varying density")
    default_trial = NetworkTrial("vdsom:residual", Schedule(), setting.side)
    default = default_trial.row(setting)
    schedules = {
        network: str(ranking[0].schedule)
        for network, ranking in rankings.items()
    }
    ratios = {
        "best": _ratio_of_networks(best, "activity"),
        "same_schedule": _ratio_of_networks(same, "activity"),
        "linear": _ratio_of_networks(best, "linear"),
        "default_linear": _ratios(best["som"]["linear"], default["linear"]),
        "paper": _ratios(paper["som"], paper["vdsom"]),
    }
    data: dict[str, object] = {
        **best,
        "paper": paper,
        "same_schedule": {**same, "schedule": str(SAME_SCHEDULE)},
        "default": default,
        "schedules": schedules,
        "ratios": ratios,
        **_size_of(setting),
    }
    # small lattices are not the paper's
    printed = dict.fromkeys(TABLE1) if setting.quick else TABLE1
    lines: dict[str, _Line] = {}
    for network in NETWORKS:
        label = f"{network.upper()}, best: {schedules[network]}"
        lines[label] = (best[network], printed[network])
    for network in NETWORKS:
        label = f"{network.upper()}, same: {SAME_SCHEDULE}"
        lines[label] = (same[network], printed[network])
    lines["VDSOM:residual, the default"] = (default, printed["vdsom"])
    size = f"{setting.side}x{setting.side}"
    title = f"Table 1, {size} nodes, {_conditions(setting)}"
    tables = (
        _comparison("table1", title, lines),
        _ratio_table(ratios),
        _schedule_table(rankings),
    )
    return Result(data, tables)


def _schedule_table(rankings: Mapping[str, Sequence[Candidate]]) -> Table:
    """Schedules of each network by their validation error."""
    rows: list[Cells] = [
        [network, str(candidate.schedule), candidate.score]
        for network, ranking in rankings.items()
        for candidate in ranking
    ]
    title = "validation error of each schedule, mean of the columns as a share of the range"
    return Table("schedules", title, ("network", "schedule", "error"), rows)


def table2(setting: Setting) -> Result:
    """VDSOM of three sizes, at the best schedule of the largest."""
    trial, _ = best_trial(setting, "vdsom")
    data: dict[str, object] = {}
    lines: dict[str, _Line] = {}
    for k, side in enumerate(setting.sides):
        setting.report(k / len(setting.sides), f"{side}x{side}")
        row = NetworkTrial("vdsom", trial.schedule, side).row(setting)
        data[f"{side}x{side}"] = row
        paper = None if setting.quick else TABLE2.get(side)
        lines[f"VDSOM {side}x{side}"] = (row, paper)
    printed = {f"{side}x{side}": errors for side, errors in TABLE2.items()}
    data["paper"] = _in_si_units(printed)
    data |= {"schedule": str(trial.schedule), **_size_of(setting)}
    title = f"Table 2, {trial.schedule}, {_conditions(setting)}"
    return Result(data, (_comparison("table2", title, lines),))


def _comparison(name: str, title: str, lines: Mapping[str, _Line]) -> Table:
    """Mean and largest errors, their spread and share of the range, next to the paper's."""
    header = ["network", "readout", "error", "mean", "+-", "max", "+-"]
    header += ["% of range", "max %", "paper mean", "paper max"]
    rows: list[Cells] = []
    for (label, (row, paper)), readout in itertools.product(
        lines.items(), READOUTS
    ):
        for column in COLUMNS:
            cell = row[readout][column]
            unit = UNITS[column]
            keys = ("mean", "mean_spread", "max", "max_spread")
            values: Cells = [cell[k] * FACTORS[unit] for k in keys]
            values += [100 * cell["mean_of_range"], 100 * cell["max_of_range"]]
            values += list(paper[column]) if paper else [None, None]
            rows.append([label, readout, f"{column} [{unit}]", *values])
    return Table(name, title, header, rows)


def _ratio_of_networks(
    rows: Mapping[str, Row], readout: str
) -> dict[str, dict[str, float]]:
    """Errors of the VDSOM over those of the SOM, per column."""
    return _ratios(rows["som"][readout], rows["vdsom"][readout])


def _ratios(columns: _Columns, others: _Columns) -> dict[str, dict[str, float]]:
    """Errors of `others` over those of `columns`, per column."""
    ratios: dict[str, dict[str, float]] = {}
    for name in COLUMNS:
        other = others[name]
        column = columns[name]
        ratios[name] = {
            key: other[key] / column[key] for key in ("mean", "max")
        }
    return ratios


def _ratio_table(ratios: Mapping[str, _Columns]) -> Table:
    words = {
        "best": "best against best",
        "same_schedule": f"same schedule, {SAME_SCHEDULE}",
        "linear": "best against best, readout linear",
        "default_linear": "default (vdsom:residual) against the best SOM, readout linear",
        "paper": "the paper",
    }
    header = ["VDSOM over SOM, readout activity", "error", "mean", "max"]
    rows: list[Cells] = [
        [words[name], column, ratio["mean"], ratio["max"]]
        for name, columns in ratios.items()
        for column, ratio in columns.items()
    ]
    return Table(
        "ratios", "errors of the VDSOM over those of the SOM", header, rows
    )


def _conditions(setting: Setting) -> str:
    """How large an experiment was, in words."""
    return (
        f"{setting.samples:,} samples, {len(setting.seeds)} seeds, 10,000 exact test points for "
        "each"
    )


def _size_of(setting: Setting) -> dict[str, object]:
    return {
        "samples": setting.samples,
        "seeds": list(setting.seeds),
        "quick": setting.quick,
    }


def _in_si_units(
    table: Mapping[str, Mapping[str, PaperErrors]],
) -> dict[str, dict[str, dict[str, float]]]:
    """A table of the paper for JSON, in SI units."""
    return {
        name: {
            column: {
                key: value / FACTORS[UNITS[column]]
                for key, value in cell._asdict().items()
            }
            for column, cell in columns.items()
        }
        for name, columns in table.items()
    }
