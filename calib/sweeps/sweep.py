"""Sweeping: a grid of training options over robots and logs."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, cast

import numpy as np

from ..arm.arm import Arm
from ..arm.loading import load_arm
from ..common.parallel import keep_one_blas_thread, one_blas_thread
from ..common.wording import clipped, one_line, suggestion
from ..errors import CalibError, OptionError
from ..samples.babbling import babble
from ..samples.samples import Samples
from ..training.learn import Progress
from ..training.train import train
from .backends import choose_backend
from .trials import Sweep, Trial

_Source = str | Arm | Samples | Callable[[], Arm | Samples]
_Grid = Mapping[str, Sequence[Any]]

_BABBLED = {"samples": "n", "noise": "noise", "motion": "method"}
"""Options of the grid that belong to simulated babbling, and parameters of :func:`calib.babble`."""

_LEARNED = ("size", "motor_size", "sensory_size", "map", "rule", "epochs", "sigma", "links")
"""Options of the grid that :func:`calib.train` takes."""

_MOST = 10_000
"""More trainings than this are more likely a slip than a wish."""


def sweep(
    sources: _Source | Sequence[_Source] | Mapping[str, _Source],
    grid: _Grid | None = None,
    *,
    seeds: int | Sequence[int] = 1,
    jobs: int | None = None,
    backend: str = "loky",
    progress: Progress | None = None,
) -> Sweep:
    """Train with every combination of options, on all cores or on a cluster.

    The numbers depend on the seeds alone, not on how many trainings run at the same time
    or where. One that fails is a row with its error, the others go on.

    Parameters
    ----------
    sources : robot, log, or several of them, by name or in a sequence
        A robot is what `calib.load_arm` returns, or the path or the name that it takes; a
        log is what `calib.read_log` returns. A function is called for either.
    grid : dict of str to list, optional
        Values to try for options of `calib.train` ("size", "motor_size", "sensory_size",
        "map", "rule", "epochs", "sigma", "links") and, for robots, of `calib.babble`
        ("samples", "noise", "motion").
    seeds : int or sequence of int
        The seeds, or how many of them: 0, 1, 2 and so on.
    jobs : int, optional
        How many trainings at the same time: all cores by default.
    backend : {"loky", "threading", "dask", "ray"}
        Where: joblib's processes or threads, or the workers of a Dask or Ray cluster.
        Dask uses the client that there is, else the one that DASK_SCHEDULER_ADDRESS
        names, else a cluster on this machine.
    progress : callable, optional
        Called with the share of the trainings done, how many that are, and the mean
        error of the latest.

    Returns
    -------
    Sweep

    Raises
    ------
    OptionError
        If the grid is none, or the backend is not installed.

    Examples
    --------
    >>> import calib
    >>> found = calib.sweep("two_link", {"size": [5, 8], "samples": [500]}, jobs=1)
    >>> [row.options["size"] for row in found.rows]
    [5, 8]
    >>> fine, coarse = (row.distance("winner", "forward", "mean") for row in found.rows[::-1])
    >>> fine < coarse
    True
    """
    every = _named(sources)
    options = _combinations(grid or {})
    drawn = _seeds(seeds)
    count = len(every) * len(options) * len(drawn)
    if count > _MOST:
        raise OptionError(
            f"{count:,} trainings: expected at most {_MOST:,}, give fewer values or seeds"
        )
    where = choose_backend(backend, jobs, count)
    report = progress or (lambda *_: None)
    # before the sources are loaded, which may take as long as a training
    report(0.0, f"0 of {count} trainings", math.nan)
    rows = [Trial(name, o, s) for name in every for o in options for s in drawn]
    loaded = {name: _loaded(source) for name, source in every.items()}
    tasks = []
    for k, row in enumerate(rows):
        ready = loaded[row.source]
        if isinstance(ready, str):
            rows[k] = replace(row, error=ready)
        else:
            tasks.append((row, ready))
    waiting = [k for k, row in enumerate(rows) if not row.error]
    left, lost = set(waiting), ""
    with one_blas_thread():
        try:
            for number, row in where.run(_trained, tasks):
                rows[waiting[number]] = row
                left.discard(waiting[number])
                done = count - len(left)
                mean = row.distance("local", "forward", "mean")
                report(done / count, f"{done} of {count} trainings", mean)
        except Exception as error:  # a worker was killed, the cluster is gone
            lost = _told(error)
    for k in left:
        rows[k] = replace(rows[k], error=f"not trained, the backend failed: {lost}")
    return Sweep(tuple(rows), where.name, where.jobs, (where.note,) if where.note else ())


def _trained(task: tuple[Trial, Arm | Samples]) -> Trial:
    """Train one model, or tell why that failed; this is what a worker runs."""
    row, source = task
    keep_one_blas_thread()  # for good: the first of a worker's threads to end would lift it
    started = time.perf_counter()
    try:
        options = dict(row.options)
        babbled = {name: options.pop(name) for name in _BABBLED if name in options}
        if isinstance(source, Arm):
            given = {_BABBLED[name]: value for name, value in babbled.items()}
            samples = babble(source, **given, seed=row.seed)
        elif babbled:
            raise OptionError(f"{', '.join(babbled)}: for simulated babbling, not for a log")
        else:
            samples = source
        model = train(samples, seed=row.seed, **options)
    except Exception as error:
        return replace(row, error=_told(error))
    about, seconds = model.about, time.perf_counter() - started
    return replace(row, unit=about.unit, errors=about.errors, seconds=seconds, notes=about.notes)


def _told(error: Exception) -> str:
    """Return an error in one line; one that is not ours says of which kind it is."""
    if isinstance(error, CalibError):
        return str(error)
    if isinstance(error, MemoryError):
        return "not enough memory: give a smaller size, fewer samples or fewer jobs"
    return one_line(" ".join(f"{type(error).__name__}: {error}".split()))


def _named(sources: _Source | Iterable[_Source] | Mapping[str, _Source]) -> dict[str, _Source]:
    if isinstance(sources, Mapping):
        named = {str(name): source for name, source in sources.items()}
    else:
        several = not (isinstance(sources, str | Arm | Samples) or callable(sources))
        each = list(cast("Iterable[_Source]", sources if several else [sources]))
        names = [_name(source) for source in each]
        again = [names[:k].count(name) for k, name in enumerate(names)]
        names = [f"{name} ({k + 1})" if k else name for name, k in zip(names, again, strict=True)]
        named = dict(zip(names, each, strict=True))
    if not named:
        raise OptionError("nothing to learn from: expected a robot or a log")
    return named


def _name(source: _Source) -> str:
    if isinstance(source, str):
        return source
    if isinstance(source, Arm):
        return source.name
    return "log" if isinstance(source, Samples) else getattr(source, "__name__", "source")


def _loaded(source: _Source) -> Arm | Samples | str:
    """Return an arm or samples, or in words why there are none."""
    try:
        if isinstance(source, str):
            return load_arm(source)
        return source if isinstance(source, Arm | Samples) else source()
    except Exception as error:
        return _told(error)


def _combinations(grid: _Grid) -> list[dict[str, Any]]:
    known = (*_BABBLED, *_LEARNED)
    for name, values in grid.items():
        if name not in known:
            raise OptionError(f"grid: {clipped(str(name))!r} is unknown; {suggestion(name, known)}")
        if isinstance(values, str) or not isinstance(values, Sequence | np.ndarray | range):
            raise OptionError(f"grid: {name} {values!r}: expected a list of values")
        if not len(values):
            raise OptionError(f"grid: {name}: expected one value or more")
    if math.prod(map(len, grid.values())) > _MOST:  # before they are written out
        raise OptionError(f"grid: more than {_MOST:,} combinations, give fewer values")
    return [dict(zip(grid, values, strict=True)) for values in itertools.product(*grid.values())]


def _seeds(seeds: int | Sequence[int]) -> Sequence[int]:
    found = range(seeds) if isinstance(seeds, int) and not isinstance(seeds, bool) else seeds
    if isinstance(found, bool) or not isinstance(found, Sequence) or not len(found):
        raise OptionError(f"seeds {seeds!r}: expected how many, 1 or more, or a list of them")
    return found
