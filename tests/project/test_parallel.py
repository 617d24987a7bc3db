"""Two tasks at the same time."""

import threading

import pytest

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
