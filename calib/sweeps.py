"""Sweeps: a training for every combination of options, on all cores or where joblib is told to."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from importlib.util import find_spec
from typing import Any

from .arm.arm import Arm
from .arm.loading import load_arm
from .common.choices import READOUTS
from .common.parallel import keep_one_blas_thread, one_blas_thread
from .common.wording import one_line, suggestion
from .errors import CalibError, OptionError
from .samples.samples import Samples, babble
from .training.learn import Progress, TrainingOptions
from .training.train import train

Source = str | Arm | Samples

_BABBLED = {"samples": "n", "noise": "noise"}  # by parameters of calib.babble
_TRIED = (*_BABBLED, *(f.name for f in fields(TrainingOptions) if f.name != "seed"))
_MOST = 10_000  # more trainings are more likely a slip than a wish


@dataclass(frozen=True, eq=False)
class Trial:
    """One training: where its samples came from, its options and seed, and what came of it."""

    source: str
    options: Mapping[str, Any]
    seed: int
    unit: str = ""
    errors: Mapping[str, Any] = field(
        default_factory=dict
    )  # as `calib evaluate --json` has them
    seconds: float = math.nan
    notes: tuple[str, ...] = ()
    error: str = ""  # why it failed, in one line

    def distance(self, readout: str, direction: str, statistic: str) -> float:
        """Error of the tip [unit] ("forward" or "inverse", "mean", "p99" or "max"), else NaN."""
        value = (
            self.errors.get(readout, {})
            .get(direction, {})
            .get("distance", {})
            .get(statistic)
        )
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
        names = dict.fromkeys(name for row in self.rows for name in row.options)
        table: dict[str, list[Any]] = {"source": [row.source for row in self.rows]}
        table |= {
            name: [_typed(row.options.get(name)) for row in self.rows] for name in names
        }
        for name in ("seed", "unit", "seconds", "error"):
            table[name] = [getattr(row, name) for row in self.rows]
        for part in itertools.product(
            READOUTS, ("forward", "inverse"), ("mean", "p99", "max")
        ):
            table["_".join(part)] = [row.distance(*part) for row in self.rows]
        return table


def sweep(
    sources: Source | Sequence[Source] | Mapping[str, Source],
    grid: Mapping[str, Sequence[Any]] | None = None,
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
    for name, values in grid.items():
        if name not in _TRIED:
            raise OptionError(
                f"grid: {name!r:.60} is unknown; {suggestion(name, _TRIED)}"
            )
        if isinstance(values, str) or not hasattr(values, "__len__"):
            raise OptionError(f"grid: {name} {values!r:.60}: expected a list of values")
    if not isinstance(sources, Mapping):
        several = [sources] if isinstance(sources, str | Arm | Samples) else sources
        pairs = [
            (s if isinstance(s, str) else getattr(s, "name", "log"), s) for s in several
        ]
    else:
        pairs = list(sources.items())
    count = len(pairs) * seeds * math.prod(map(len, grid.values()))
    if not 0 < count <= _MOST:
        raise OptionError(f"{count:,} trainings: expected 1 to {_MOST:,}")
    tasks = [
        (Trial(name, dict(zip(grid, chosen, strict=True)), seed), source)
        for name, source in pairs
        for chosen in itertools.product(*grid.values())
        for seed in range(seeds)
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


def _side_by_side(tasks: Sequence[tuple[Trial, Source]], jobs: int | None) -> Any:
    if jobs == 1 or find_spec("joblib") is None:
        return map(_trained, tasks)
    import joblib

    pool = joblib.Parallel(jobs, return_as="generator", batch_size=1)
    if jobs is None and pool.n_jobs == 1:  # no context of the user's: all cores
        pool = joblib.Parallel(-1, return_as="generator", batch_size=1)
    return pool(joblib.delayed(_trained)(task) for task in tasks)


def _trained(task: tuple[Trial, Source]) -> Trial:
    """Train one model, or tell why that failed; this is what a worker runs."""
    row, source = task
    keep_one_blas_thread()  # for good: the first of a worker's threads to end would lift it
    started = time.perf_counter()
    try:
        options = dict(row.options)
        babbled = {_BABBLED[n]: options.pop(n) for n in _BABBLED if n in options}
        arm = load_arm(source) if isinstance(source, str) else source
        if isinstance(arm, Samples) and babbled:
            raise OptionError(
                f"{', '.join(babbled)}: for simulated babbling, not for a log"
            )
        samples = (
            arm if isinstance(arm, Samples) else babble(arm, **babbled, seed=row.seed)
        )
        model = train(samples, seed=row.seed, **options)
    except Exception as error:  # one that fails is a row, whatever the reason
        kind = "" if isinstance(error, CalibError) else f"{type(error).__name__}: "
        return replace(row, error=one_line(kind + str(error)))
    about = model.about
    seconds = time.perf_counter() - started
    return replace(
        row, unit=about.unit, errors=about.errors, seconds=seconds, notes=about.notes
    )


def _typed(value: Any) -> Any:
    """An option's value as it is typed: `30x40`, `2:0.5`, `vdsom`, or nothing for None."""
    if isinstance(value, tuple | list):
        mark = "x" if all(isinstance(v, int) for v in value) else ":"
        return mark.join(f"{v:g}" for v in value)
    return "" if value is None else getattr(value, "__name__", value)
