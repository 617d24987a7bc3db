"""Sweeps: a training for every combination of options, on all cores or where joblib is told to."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from importlib.util import find_spec
from typing import Any

from .arm.arm import Arm
from .arm.loading import load_arm
from .common.choices import READOUTS
from .common.parallel import keep_one_blas_thread, one_blas_thread
from .common.wording import one_line, suggestion
from .errors import CalibError, OptionError
from .model.facts import Errors
from .model.model import Model
from .samples.samples import Samples, babble
from .training.learn import Progress, TrainingOptions
from .training.train import train

Source = str | Arm | Samples

_BABBLED = {"samples": "n", "noise": "noise"}  # by parameters of calib.babble
_OPTIONS = {option.name for option in fields(TrainingOptions)} - {"seed"}
_MOST = 10_000  # more trainings are more likely a slip than a wish


@dataclass(frozen=True, eq=False)
class Trial:
    """One training: where its samples came from, its options and seed, and what came of it."""

    source: str
    options: Mapping[str, object]
    seed: int
    unit: str = ""
    errors: Errors = field(
        default_factory=dict
    )  # as `calib evaluate --json` has them
    seconds: float = math.nan
    notes: tuple[str, ...] = ()
    error: str = ""  # why it failed, in one line

    def distance(self, readout: str, direction: str, statistic: str) -> float:
        """Error of the tip [unit] ("forward" or "inverse", "mean", "p99" or "max"), else NaN."""
        if readout not in self.errors:
            return math.nan
        value = self.errors[readout][direction]["distance"][statistic]
        return math.nan if value is None else float(value)


@dataclass(frozen=True, eq=False, repr=False)
class Sweep:
    """What came out of a grid of options: a row for each training, in the order given."""

    rows: tuple[Trial, ...]

    def __repr__(self) -> str:
        """Say in a line how many trainings there are."""
        return f"Sweep of {len(self.rows)} trainings, {len(self.failed)} failed"

    @property
    def failed(self) -> tuple[Trial, ...]:
        """The trainings that failed."""
        return tuple(row for row in self.rows if row.error)

    def columns(self) -> dict[str, list[Any]]:
        """A row for each training, by columns, as they are written to a table."""
        table: dict[str, list[Any]] = {
            "source": [row.source for row in self.rows]
        }
        for name in {name: None for row in self.rows for name in row.options}:
            table[name] = [_typed(row.options.get(name)) for row in self.rows]
        for name in ("seed", "unit", "seconds", "error"):
            table[name] = [getattr(row, name) for row in self.rows]
        sizes = (READOUTS, ("forward", "inverse"), ("mean", "p99", "max"))
        for part in itertools.product(*sizes):
            table["_".join(part)] = [row.distance(*part) for row in self.rows]
        return table


def sweep(
    sources: Source | Sequence[Source] | Mapping[str, Source],
    grid: Mapping[str, Sequence[object]] | None = None,
    *,
    seeds: int = 1,
    jobs: int | None = None,
    progress: Progress | None = None,
) -> Sweep:
    """Train with every combination of options; one that fails is a row with its error.

    Parameters
    ----------
    sources : robot, log, or several of them, by name or in a sequence
        What `calib.load_arm` or `calib.read_log` returns, or a robot's path or name.
    grid : dict of str to list, optional
        Values to try for attributes of `calib.TrainingOptions` and, for robots, "samples" and
        "noise" of the babbling.
    seeds : int
        How many seeds: 0, 1, 2 and so on; the numbers depend on these alone.
    jobs : int, optional
        How many at the same time: all cores by default, or what `joblib.parallel_config` says:
        `with joblib.parallel_config("dask"):` sends them to the workers of your Dask client.
        Without joblib one after the other.
    progress : callable, optional
        Called with the share of the trainings done, how many that are, and the latest mean error.

    Examples
    --------
    >>> import calib
    >>> found = calib.sweep("two_link", {"size": [5, 8], "samples": [500]}, jobs=1)
    >>> [row.options["size"] for row in found.rows]
    [5, 8]
    """
    grid = grid or {}
    options = [*_BABBLED, *sorted(_OPTIONS)]
    for name, values in grid.items():
        if name not in options:
            raise OptionError(
                f"grid: {name!r:.60} is unknown; {suggestion(name, options)}"
            )
        if isinstance(values, str) or not hasattr(values, "__len__"):
            raise OptionError(
                f"grid: {name} {values!r:.60}: expected a list of values"
            )
    by_name = _by_name(sources)
    count = len(by_name) * seeds * math.prod(map(len, grid.values()))
    if not 0 < count <= _MOST:
        raise OptionError(f"{count:,} trainings: expected 1 to {_MOST:,}")
    tasks = []
    for name, source in by_name:
        for values in itertools.product(*grid.values()):
            chosen = dict(zip(grid, values, strict=True))
            tasks += [
                (Trial(name, chosen, seed), source) for seed in range(seeds)
            ]
    rows: list[Trial] = []
    with one_blas_thread():
        for row in _side_by_side(tasks, jobs):
            rows.append(row)
            if progress is not None:
                error = row.distance("local", "forward", "mean")
                words = f"{len(rows)} of {count} trainings"
                progress(len(rows) / count, words, error)
    return Sweep(tuple(rows))


def _by_name(
    sources: Source | Sequence[Source] | Mapping[str, Source],
) -> list[tuple[str, Source]]:
    """Return what is learned from, each with its name."""
    if isinstance(sources, Mapping):
        return list(sources.items())
    if isinstance(sources, str | Arm | Samples):
        sources = [sources]
    return [
        (
            source
            if isinstance(source, str)
            else getattr(source, "name", "log"),
            source,
        )
        for source in sources
    ]


def _side_by_side(
    tasks: Sequence[tuple[Trial, Source]], jobs: int | None
) -> Iterable[Trial]:
    if jobs == 1 or find_spec("joblib") is None:
        return map(_trained, tasks)
    import joblib

    pool = joblib.Parallel(jobs, return_as="generator", batch_size=1)
    if jobs is None and pool.n_jobs == 1:  # no context of the user's: all cores
        pool = joblib.Parallel(-1, return_as="generator", batch_size=1)
    trials: Iterable[Trial] = pool(
        joblib.delayed(_trained)(task) for task in tasks
    )
    return trials


def _trained(task: tuple[Trial, Source]) -> Trial:
    """Train one model, or say why that failed; this is what a worker runs."""
    row, source = task
    keep_one_blas_thread()  # for good: the first of a worker's threads to end would lift it
    started = time.perf_counter()
    try:
        about = _train(row, source).about
    except Exception as error:  # one that fails is a row, whatever the reason
        kind = (
            "" if isinstance(error, CalibError) else f"{type(error).__name__}: "
        )
        return replace(row, error=one_line(kind + str(error)))
    seconds = time.perf_counter() - started
    return replace(
        row,
        unit=about.unit,
        errors=about.errors,
        seconds=seconds,
        notes=about.notes,
    )


def _train(row: Trial, source: Source) -> Model:
    options: dict[str, Any] = dict(row.options)
    babbled = {_BABBLED[n]: options.pop(n) for n in _BABBLED if n in options}
    if isinstance(source, Samples):
        if babbled:
            names = ", ".join(babbled)
            raise OptionError(f"{names}: for simulated babbling, not for a log")
        return train(source, seed=row.seed, **options)
    arm = load_arm(source) if isinstance(source, str) else source
    return train(
        babble(arm, **babbled, seed=row.seed), seed=row.seed, **options
    )


def _typed(value: object) -> object:
    """An option's value as it is typed: `30x40`, `2:0.5`, `vdsom`, or nothing for None."""
    if isinstance(value, tuple | list):
        mark = "x" if all(isinstance(v, int) for v in value) else ":"
        return mark.join(f"{v:g}" for v in value)
    return "" if value is None else getattr(value, "__name__", value)
