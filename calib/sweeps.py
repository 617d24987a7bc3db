"""Sweeps: a training for every combination of options, on all cores or where joblib is told to."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from typing import Any

from .arm.arm import Arm
from .arm.loading import load_arm
from .common.choices import READOUTS
from .common.parallel import keep_one_blas_thread, one_blas_thread
from .common.wording import INSTALL, one_line, suggestion
from .errors import CalibError, OptionError
from .samples.babbling import babble
from .samples.samples import Samples
from .training.learn import Progress
from .training.train import train

Source = str | Arm | Samples | Callable[[], Arm | Samples]

_BABBLED = {"samples": "n", "noise": "noise", "motion": "method"}  # by parameters of calib.babble
_LEARNED = ("size", "motor_size", "sensory_size", "map", "rule", "epochs", "sigma", "links")
_MOST = 10_000  # more trainings are more likely a slip than a wish


@dataclass(frozen=True, eq=False)
class Trial:
    """One training: where its samples came from, its options and seed, and what came of it."""

    source: str
    options: Mapping[str, Any]
    seed: int
    unit: str = ""
    errors: Mapping[str, Any] = field(default_factory=dict)  # as `calib evaluate --json` has them
    seconds: float = math.nan
    notes: tuple[str, ...] = ()
    error: str = ""  # why it failed, in one line

    def distance(self, readout: str, direction: str, statistic: str) -> float:
        """Error of the tip [unit] ("forward" or "inverse", "mean", "p99" or "max"), else NaN."""
        value = self.errors.get(readout, {}).get(direction, {}).get("distance", {}).get(statistic)
        return math.nan if value is None else float(value)


@dataclass(frozen=True, eq=False, repr=False)
class Sweep:
    """What came out of a grid of options: a row for each training, in the order given."""

    rows: tuple[Trial, ...]
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """Say in a line how many trainings there are."""
        bad = f", {len(self.failed)} failed" if self.failed else ""
        return f"Sweep of {len(self)} trainings{bad}"

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def failed(self) -> tuple[Trial, ...]:
        """The trainings that failed."""
        return tuple(row for row in self.rows if row.error)

    def columns(self) -> dict[str, list[Any]]:
        """A row for each training, by columns, as they are written to a table."""
        names = dict.fromkeys(name for row in self.rows for name in row.options)
        table: dict[str, list[Any]] = {"source": [row.source for row in self.rows]}
        for name in names:
            table[name] = [written(row.options.get(name)) for row in self.rows]
        for name in ("seed", "unit", "seconds", "error"):
            table[name] = [getattr(row, name) for row in self.rows]
        every = itertools.product(READOUTS, ("forward", "inverse"), ("mean", "p99", "max"))
        for part in every:
            table["_".join(part)] = [row.distance(*part) for row in self.rows]
        return table


def sweep(
    sources: Source | Sequence[Source] | Mapping[str, Source],
    grid: Mapping[str, Sequence[Any]] | None = None,
    *,
    seeds: int | Sequence[int] = 1,
    jobs: int | None = None,
    progress: Progress | None = None,
) -> Sweep:
    """Train with every combination of options; one that fails is a row with its error.

    The numbers depend on the seeds alone, not on how many trainings run at the same time or where.

    Parameters
    ----------
    sources : robot, log, or several of them, by name or in a sequence
        What `calib.load_arm` or `calib.read_log` returns, a robot's path or name, or a function
        that is called for either.
    grid : dict of str to list, optional
        Values to try for options of `calib.train` and, for robots, "samples", "noise" and
        "motion" of the babbling.
    seeds : int or sequence of int
        The seeds, or how many of them: 0, 1, 2 and so on.
    jobs : int, optional
        How many at the same time: all cores by default, or what `joblib.parallel_config` says:
        `with joblib.parallel_config("dask"):` sends them to the workers of your Dask client.
    progress : callable, optional
        Called with the share of the trainings done, how many that are, and the latest mean error.

    Examples
    --------
    >>> import calib
    >>> found = calib.sweep("two_link", {"size": [5, 8], "samples": [500]}, jobs=1)
    >>> [row.options["size"] for row in found.rows]
    [5, 8]
    """
    named, combinations = _named(sources), _combinations(grid or {})
    drawn = range(seeds) if isinstance(seeds, int) else seeds
    tasks = [
        (Trial(name, options, int(seed)), source)
        for (name, source), options, seed in itertools.product(named.items(), combinations, drawn)
    ]
    if not 0 < len(tasks) <= _MOST:
        raise OptionError(f"{len(tasks):,} trainings: expected 1 to {_MOST:,}")
    if jobs is not None and (isinstance(jobs, bool) or jobs < 1):
        raise OptionError(f"jobs {jobs!r}: expected a whole number, 1 or more")
    rows, report = [], progress or (lambda *_: None)
    notes: tuple[str, ...] = ()
    report(0.0, f"0 of {len(tasks)} trainings", math.nan)
    with one_blas_thread():
        if jobs == 1 or find_spec("joblib") is None:
            found = map(_trained, tasks)
            if jobs != 1:
                told = f"joblib is not installed: one training after the other; {INSTALL}"
                notes = (told.format("sweep"),)
        else:
            import joblib

            own = joblib.Parallel(jobs, return_as="generator", batch_size=1)
            # a user's own context counts; without one all cores
            if jobs is None and own.n_jobs == 1:
                own = joblib.Parallel(-1, return_as="generator", batch_size=1)
            found = own(joblib.delayed(_trained)(task) for task in tasks)
        for row in found:
            rows.append(row)
            told = f"{len(rows)} of {len(tasks)} trainings"
            report(len(rows) / len(tasks), told, row.distance("local", "forward", "mean"))
    return Sweep(tuple(rows), notes)


def _trained(task: tuple[Trial, Source]) -> Trial:
    """Train one model, or tell why that failed; this is what a worker runs."""
    row, source = task
    keep_one_blas_thread()  # for good: the first of a worker's threads to end would lift it
    started = time.perf_counter()
    try:
        if not isinstance(source, Arm | Samples):
            source = load_arm(source) if isinstance(source, str) else source()
        options = dict(row.options)
        babbled = {_BABBLED[n]: options.pop(n) for n in _BABBLED if n in options}
        if isinstance(source, Arm):
            source = babble(source, **babbled, seed=row.seed)
        elif babbled:
            raise OptionError(f"{', '.join(babbled)}: for simulated babbling, not for a log")
        model = train(source, seed=row.seed, **options)
    except CalibError as error:
        return replace(row, error=str(error))
    except Exception as error:
        told = one_line(" ".join(f"{type(error).__name__}: {error}".split()))
        return replace(row, error=told)
    about, seconds = model.about, time.perf_counter() - started
    return replace(row, unit=about.unit, errors=about.errors, seconds=seconds, notes=about.notes)


def _named(sources: Any) -> dict[str, Source]:
    if isinstance(sources, Mapping):
        return {str(name): source for name, source in sources.items()}
    single = isinstance(sources, str | Arm | Samples) or callable(sources)
    named: dict[str, Source] = {}
    for source in [sources] if single else sources:
        name = source if isinstance(source, str) else getattr(source, "name", "log")
        several = sum(known == name or known.startswith(f"{name} (") for known in named)
        named[f"{name} ({several + 1})" if several else name] = source
    return named


def _combinations(grid: Mapping[str, Sequence[Any]]) -> list[dict[str, Any]]:
    known = (*_BABBLED, *_LEARNED)
    for name, values in grid.items():
        if name not in known:
            raise OptionError(f"grid: {name!r:.60} is unknown; {suggestion(name, known)}")
        if isinstance(values, str) or not hasattr(values, "__len__") or not len(values):
            raise OptionError(f"grid: {name} {values!r:.60}: expected a list of one value or more")
    if math.prod(map(len, grid.values())) > _MOST:
        raise OptionError(f"grid: expected at most {_MOST:,} combinations")
    return [dict(zip(grid, chosen, strict=True)) for chosen in itertools.product(*grid.values())]


def written(value: Any) -> Any:
    """An option's value as it is typed: `30x40`, `2:0.5`, `vdsom`, or nothing for None."""
    if isinstance(value, tuple | list):
        mark = "x" if all(isinstance(v, int) for v in value) else ":"
        return mark.join(f"{v:g}" for v in value)
    return "" if value is None else getattr(value, "__name__", value)
