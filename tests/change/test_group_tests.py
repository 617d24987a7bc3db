"""Statistics of single groups: chance where nothing changed, the change where something did."""

from __future__ import annotations

import numpy as np
import pytest
from beliefs import body, joints, moved, noise, tip

from calib.change.group_tests import group_tests
from calib.change.reference import kept_reference
from calib.change.rows import weighted

pytestmark = pytest.mark.usefixtures("one_blas_thread")


def checked(z, q):
    reference = kept_reference(body())
    return group_tests(reference, weighted(reference, q, z), joints(80, 8))


def test_statistics_of_an_unchanged_arm_are_those_of_chance():
    rounds = [checked(tip(joints(150, s)) + noise(150, s), joints(150, s)) for s in range(30, 50)]
    assert not any(t.score > 1.0 for t in rounds)
    by_name = {g.name: [] for g in rounds[0].groups}
    for one in rounds:
        for group in one.groups:
            by_name[group.name].append(group.statistic / group.freedom)
    # the belief's own doubt and a residual of the log make them a little smaller than chance
    for name, values in by_name.items():
        assert 0.15 < np.mean(values) < 1.5, name
    assert np.mean([t.noise for t in rounds]) == pytest.approx(1e-3, rel=0.1)


def test_estimates_are_the_changes_and_the_smallest_is_found_nine_times_in_ten():
    q = joints(150, 61)
    calm = {g.name: g for g in checked(tip(q) + noise(150, 61), q).groups}
    slope = np.sqrt(np.mean(np.sum((tip(moved(joints(80, 8), 1e-6)) - tip(joints(80, 8))) ** 2, 1)))
    size = calm["offset:elbow"].smallest / (slope / 1e-6)
    found, estimates = 0, []
    for seed in range(20):
        q = joints(150, 100 + seed)
        groups = {g.name: g for g in checked(tip(moved(q, size)) + noise(150, seed), q).groups}
        found += groups["offset:elbow"].score > 1.0
        estimates.append(groups["offset:elbow"].estimate[0])
    assert 13 <= found <= 20
    assert np.mean(estimates) == pytest.approx(size, rel=0.15)
