"""Backends: many independent tasks on the cores of one machine, or of a cluster."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import dataclass
from importlib.util import find_spec
from multiprocessing import resource_tracker
from typing import Any, TypeVar

from ..common.choices import BACKENDS
from ..errors import OptionError

_S = TypeVar("_S")
_T = TypeVar("_T")

_NEEDED = {"dask": "distributed", "ray": "ray"}
_LOOK = 0.2  # how often a worker looks whether it is still wanted [s]


@dataclass(frozen=True)
class Backend:
    """Where tasks run."""

    name: str  # one of :data:`BACKENDS`, or "" for one after the other in this process
    jobs: int  # how many at the same time; -1 for all that a cluster offers
    note: str = ""  # what the user should be told ("" for nothing)

    def run(self, work: Callable[[_T], _S], tasks: Sequence[_T]) -> Iterator[tuple[int, _S]]:
        """Yield the number and the result of each task, as they are completed.

        work : takes a task. It goes to other processes by its module and name.
        tasks : what it is called with
        """
        if not self.name:
            for k, task in enumerate(tasks):
                yield k, work(task)
            return
        import joblib

        own: dict[str, Any] = {}  # what processes of our own need
        limit: dict[str, Any] = {}  # threads share this process, whose limit its caller sets
        if self.name == "loky":
            own = {"initializer": _end_with, "initargs": (os.getpid(),)}
            limit = {"inner_max_num_threads": 1}
        with _surroundings(self), joblib.parallel_config(self.name, n_jobs=self.jobs, **limit):
            # one task at a time: they are long. Arrays are sent, not mapped: a process that is
            # killed leaves no file behind. Ray's hands out nothing before the end
            when = "list" if self.name == "ray" else "generator_unordered"
            pool = joblib.Parallel(return_as=when, batch_size=1, max_nbytes=None, **own)
            calls = (joblib.delayed(_called)(work, k, task) for k, task in enumerate(tasks))
            with _shielded() if own else nullcontext():  # the workers start here
                results = pool(calls)
            yield from results


def choose_backend(name: str, jobs: int | None, tasks: int) -> Backend:
    """Choose where so many tasks run, with what is installed.

    name : one of :data:`BACKENDS`
    jobs : how many at the same time; all cores, or all of a cluster, if None
    tasks : how many there are
    Raises OptionError if there is no such backend, or it is not installed.
    """
    if name not in BACKENDS:
        raise OptionError(f"backend {name!r}: expected one of {', '.join(BACKENDS)}")
    if jobs is not None and (isinstance(jobs, bool) or not isinstance(jobs, int) or jobs < 1):
        raise OptionError(f"jobs {jobs!r}: expected a whole number, 1 or more")
    joblib = find_spec("joblib") is not None  # the extra "sweep"
    if name in _NEEDED:
        missing = [p for p in ("joblib", _NEEDED[name]) if find_spec(p) is None]
        if missing:
            raise OptionError(
                f"backend {name!r} needs packages that are not installed: "
                f"pip install {' '.join(missing)}"
            )
        return Backend(name, jobs or -1)
    if not joblib and jobs != 1:
        said = (
            "joblib is not installed: one training after the other; pip install 'calib-arm[sweep]'"
        )
        return Backend("", 1, said)
    jobs = min(jobs or _cores(), max(tasks, 1))
    return Backend(name if jobs > 1 else "", jobs)


def _cores() -> int:
    import joblib

    return int(joblib.cpu_count())


def _surroundings(backend: Backend) -> AbstractContextManager[Any]:
    if backend.name == "loky":
        return _quiet_tracker()
    if backend.name == "dask":
        return _dask(backend.jobs)
    if backend.name == "ray":
        from ray.util.joblib import register_ray

        register_ray()
    return nullcontext()


@contextmanager
def _shielded() -> Iterator[None]:
    """Start processes that Ctrl-C, which goes to all of a terminal, does not reach.

    They end with this one, and have nothing to say about it.
    """
    if sys.platform == "win32":
        yield
        return
    # starting these lifts the mask, so they start before it is set; without that, or without the
    # quiet tracker below, words were left on standard error in half of the runs
    with suppress(ImportError, AttributeError):
        from joblib.externals.loky.backend import resource_tracker as loky_tracker

        loky_tracker.ensure_running()
        resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _quiet_tracker() -> Iterator[None]:
    """Keep the process that tidies up after Ctrl-C, which loky starts, from telling of it."""
    before = os.environ.get("PYTHONWARNINGS")
    quiet = "ignore:resource_tracker:UserWarning"
    os.environ["PYTHONWARNINGS"] = ",".join(filter(None, (before, quiet)))
    try:
        yield
    finally:
        os.environ.pop("PYTHONWARNINGS")
        if before is not None:
            os.environ["PYTHONWARNINGS"] = before


@contextmanager
def _dask(jobs: int) -> Iterator[None]:
    """Connect to the cluster that the user has, else make one on this machine."""
    import dask
    from distributed import Client, get_client

    try:
        get_client()
    except ValueError:  # there is none yet
        own = {"n_workers": jobs if jobs > 0 else _cores(), "threads_per_worker": 1}
        found = dask.config.get("scheduler-address", None)
        with Client() if found else Client(**own, dashboard_address=None):
            yield
    else:
        yield


def _called(work: Callable[[_T], _S], k: int, task: _T) -> tuple[int, _S]:
    """Do one task, most often in a process of its own."""
    return k, work(task)


def _end_with(parent: int) -> None:
    """Make a worker end with the process that started it, whatever ended that one."""
    if sys.platform == "win32":
        return

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_LOOK)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
