"""Two tasks on two cores, and matrices on one."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import ExitStack, contextmanager
from functools import cache
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController

_S = TypeVar("_S")
_T = TypeVar("_T")


def side_by_side(
    aside: Callable[[], _S], here: Callable[[], _T]
) -> tuple[_S, _T]:
    """Results of two independent tasks that run at the same time; an error of either is raised.

    `aside` runs in a thread, `here` in the calling one, so that only the latter may report
    progress and is where Ctrl-C arrives.
    """
    task: Future[_S] = Future()

    def run() -> None:
        try:
            task.set_result(aside())
        except BaseException as error:  # noqa: BLE001, RUF100 - raised again by result()
            task.set_exception(error)

    # a pool's threads are waited for when the program ends, a daemon is not
    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        result = here()
    except Exception:
        thread.join()  # no thread runs on after an error
        raise
    return task.result(), result


@cache
def _libraries() -> ThreadpoolController:
    """The libraries of this process that multiply matrices; their look-up takes 2 ms."""
    import scipy.linalg  # noqa: F401 - brings its own BLAS, to be found as well
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


_lock = threading.Lock()
_limits: list[ExitStack] = []  # the one limit of this process, while it holds


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Multiply matrices in one thread, so that bytes do not depend on how many there are.

    Open the block before starting threads: during an import in another thread the look-up of the
    libraries can wait for ever.  Within another block it does nothing.
    """
    with _lock:  # imports as well: another thread's would be in the way
        first = not _limits
        if first:
            limit = ExitStack()
            limit.enter_context(_libraries().limit(limits=1, user_api="blas"))
            _limits.append(limit)
    try:
        yield
    finally:
        if first:
            with _lock:
                _limits.pop().close()
