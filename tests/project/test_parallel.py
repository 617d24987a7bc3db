"""Two tasks at the same time."""

import threading

import pytest
import threadpoolctl

import calib
from calib.common.parallel import side_by_side


@pytest.mark.parametrize("order", [(True, False), (False, True)])
def test_an_error_of_either_task_is_raised(order):
    def fail():
        raise ValueError("wrong")

    tasks = [fail if wrong else (lambda: None) for wrong in order]
    with pytest.raises(ValueError, match="wrong"):
        side_by_side(*tasks)


def test_ctrl_c_does_not_wait_for_the_other_task():
    stop = threading.Event()

    def fail():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        side_by_side(lambda: stop.wait(60), fail)
    assert not stop.is_set()
    stop.set()


def test_libraries_are_looked_up_by_the_main_thread_before_others_start(monkeypatch):
    """Beside an import in another thread the look-up can wait for it, and it for the look-up."""
    where, limits = [], threadpoolctl.threadpool_limits

    def spy(*args, **options):
        where.append(threading.current_thread())
        return limits(*args, **options)

    monkeypatch.setattr(threadpoolctl, "threadpool_limits", spy)
    calib.train(calib.babble(calib.load_arm("two_link"), 200, seed=0), size=5)
    assert where
    assert set(where) == {threading.main_thread()}
