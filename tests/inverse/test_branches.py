"""Every branch is found and none is invented; folds, turns, limits and `near`."""

import numpy as np
import pytest
from models import draw, trained, turning, two_link, two_link_inverse
from planar import branches_2r

import calib
from calib.common.scale import TURN


def gaps(found, expected):
    """Largest joint difference of each pair, (found, expected)."""
    return np.abs(found[:, None] - expected[None]).max(axis=2)


@pytest.mark.parametrize("robot", ["scara", "two_link", "two_link_full"])
def test_all_branches_and_no_others(robot):
    model = trained(robot)
    arm = calib.load_arm(robot)
    x = arm.forward(draw(model, 4000, seed=1))
    expected, found = branches_2r(arm, x), model.inverse_all(x)
    missed = invented = total = 0
    for e, f in zip(expected, found, strict=True):
        gap = gaps(f, e)
        missed += np.count_nonzero(gap.min(axis=0) > 2e-3)
        invented += np.count_nonzero(gap.min(axis=1) > 2e-3)
        total += len(e)
    assert total > 4000 or robot == "two_link"
    assert invented == 0
    assert missed <= 1e-3 * total


def test_both_branches_right_beside_the_fold():
    model, arm = trained("two_link_full"), calib.load_arm("two_link_full")
    for bend in (0.1, 0.01, 1e-3, 1e-4):
        q = np.array([[0.8, bend]])
        (found,) = model.inverse_all(two_link(q))
        assert len(found) == 2
        other = two_link_inverse(two_link(q), -1.0)
        np.testing.assert_allclose(found[np.argsort(-found[:, 1])], [q[0], other[0]], atol=1e-5)
        np.testing.assert_allclose(arm.forward(found), two_link(q).repeat(2, 0), atol=1e-9)


def test_near_is_the_closest_of_all_branches():
    for robot in ("two_link_full", "scara"):
        model = trained(robot)
        x, near = model.forward(draw(model, 500, seed=3)), draw(model, 500, seed=4)
        span = model.about.upper - model.about.lower
        away = np.linalg.norm((model.inverse(x, near=near) - near) / span, axis=1)
        for i, branches in enumerate(model.inverse_all(x)):
            assert away[i] <= np.linalg.norm((branches - near[i]) / span, axis=1).min() + 1e-6


def test_without_near_the_middle_of_the_ranges_decides():
    model = trained("two_link_full")
    x = model.forward(draw(model, 300, seed=5))
    middle = (model.about.lower + model.about.upper) / 2
    np.testing.assert_array_equal(model.inverse(x), model.inverse(x, near=middle))
    first = [branches[0] for branches in model.inverse_all(x)]
    np.testing.assert_allclose(model.inverse(x), first, atol=1e-6)


def test_answers_do_not_depend_on_what_was_asked_before():
    samples = calib.babble(calib.load_arm("two_link_full"), 2000, seed=0)
    one, other = (calib.train(samples, size=15) for _ in range(2))
    x = one.forward(draw(one, 200, seed=6))
    one.inverse(x[::-1])  # fills what is kept of the starts in another order
    np.testing.assert_allclose(one.inverse(x), other.inverse(x), atol=1e-12)


def test_near_goes_the_short_way_round():
    model = turning()
    q = np.array([[np.pi - 0.01, 1.0]])
    said = model.inverse(two_link(q), near=[-np.pi + 0.02, 1.0])
    assert np.abs((said - q + np.pi) % TURN - np.pi).max() < 2e-3
