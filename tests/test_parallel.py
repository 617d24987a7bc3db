"""Two tasks at the same time."""

import threading

import pytest

from calib.parallel import side_by_side


def test_both_results_come_back_in_order():
    assert side_by_side(lambda: 1, lambda: 2) == (1, 2)


def test_both_run_at_the_same_time():
    barrier = threading.Barrier(2, timeout=20)  # one after the other it would break
    side_by_side(barrier.wait, barrier.wait)


def test_the_second_task_runs_in_the_calling_thread():
    _, here = side_by_side(lambda: None, threading.current_thread)
    assert here is threading.current_thread()


@pytest.mark.parametrize("order", [(True, False), (False, True)])
def test_an_error_of_either_task_is_raised(order):
    def fail():
        raise ValueError("wrong")

    tasks = [fail if wrong else (lambda: None) for wrong in order]
    with pytest.raises(ValueError, match="wrong"):
        side_by_side(*tasks)


def test_an_error_here_does_not_wait_for_the_other_task():
    stop = threading.Event()

    def fail():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        side_by_side(lambda: stop.wait(60), fail)
    assert not stop.is_set()
    stop.set()
