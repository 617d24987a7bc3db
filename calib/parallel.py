"""Two tasks, on two cores or in turn."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

S = TypeVar("S")
T = TypeVar("T")


def side_by_side(aside: Callable[[], S], here: Callable[[], T]) -> tuple[S, T]:
    """Results of two independent tasks that run at the same time.

    `aside` runs in a thread, `here` in the calling one, so that only the latter may report
    progress and that Ctrl-C ends the work at once: a thread left behind ends by itself and
    never keeps the program alive.  NumPy's and SciPy's loops release the interpreter's
    lock, so two cores are used.  What each computes cannot depend on the other's pace.

    Parameters
    ----------
    aside, here : callable
        The tasks.  An error of either is raised.
    """
    task = _Aside(aside)
    thread = threading.Thread(target=task.run, daemon=True)
    thread.start()
    result = here()
    thread.join()
    return task.result(), result


def in_turn(first: Callable[[], S], second: Callable[[], T]) -> tuple[S, T]:
    """Results of two tasks that run one after the other."""
    return first(), second()


class _Aside(Generic[S]):
    def __init__(self, task: Callable[[], S]) -> None:
        self._task = task
        self._error: BaseException | None = None
        self._value: list[S] = []

    def run(self) -> None:
        try:
            self._value.append(self._task())
        except BaseException as error:  # noqa: BLE001, RUF100 - raised again by result()
            self._error = error

    def result(self) -> S:
        if self._error is not None:
            raise self._error
        return self._value[0]
