"""Evidence of what changed, and the posterior after it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from beliefs import L1, L2, body, compared, exact_body, joints, moved, noise, tip

from calib.change.decision import gain_on_held_out
from calib.change.explain import changed, likely
from calib.change.update import updated

pytestmark = pytest.mark.usefixtures("one_blas_thread")


def test_nothing_is_the_explanation_of_an_unchanged_arm():
    for seed in range(3):
        q = joints(120, 20 + seed)
        _, _, found, kept = compared(body(), q, tip(q) + noise(120, seed))
        assert not changed(found)
        assert found[0].member.groups == ()
        assert kept.all()


@pytest.mark.parametrize(
    ("truth", "group"),
    [
        (lambda q: tip(q, L1, 1.05 * L2), "length"),
        (lambda q: tip(moved(q, 0.02)), "offset"),
        (lambda q: tip(q * [1.0, 1.02]), "gain"),
        (lambda q: np.add(tip(q), [0.01, -0.02]), "view.shift"),
        # all links longer, or a sensor that shows all larger: the same
        (lambda q: 1.03 * tip(q), "length"),
    ],
)
def test_the_group_that_changed_is_freed(truth, group):
    q = joints(120, 6)
    _, _, found, _ = compared(body(), q, truth(q) + noise(120, 6))
    assert changed(found)
    assert group in {g for _, e in likely(found) for g in e.member.groups}
    assert sum(weight for weight, _ in likely(found)) == pytest.approx(1.0)


def test_parameters_after_a_change_are_the_true_ones_within_their_deviations():
    q = joints(200, 7)
    reference, log, found, _ = compared(body(), q, tip(q, L1, 1.06 * L2) + noise(200, 7))
    new, held = updated(reference, likely(found), log, joints(100, 8))
    elbow = new.structure.groups["length"][1]
    assert abs(new.beta[elbow] - 1.06 * L2) < 4 * new.deviations[elbow] * new.kappa
    assert new.deviations[elbow] * new.kappa < 2e-3
    # held-out rows show the noise, which the bound of a reading covers
    size = np.linalg.norm(held, axis=1)
    assert size.mean() == pytest.approx(1e-3 * np.sqrt(np.pi / 2), rel=0.2)
    asked = joints(1000, 9)
    miss = np.linalg.norm(new.predict(asked) - tip(asked, L1, 1.06 * L2), axis=1)
    assert np.mean(miss <= new.bound(asked, noise=False)) > 0.9
    assert miss.mean() < 3e-4


def test_more_rows_leave_less_doubt():
    spread = []
    for n in (20, 60, 200):
        q = joints(n, 10)
        reference, log, found, _ = compared(body(), q, tip(moved(q, 0.05)) + noise(n, 10))
        new, _ = updated(reference, likely(found), log, joints(60, 8))
        spread.append(new.deviations[new.structure.groups["offset"][1]])
    assert spread[0] > spread[1] > spread[2]


def test_scale_of_the_sensor_and_length_of_all_links_are_averaged_in_what_they_predict():
    q = joints(60, 11)
    reference, log, found, _ = compared(exact_body(), q, 1.05 * tip(q))
    groups = [e.member.groups for e in found]
    scale = found[groups.index(("view.rotation", "view.shift", "view.scale"))]
    length = found[groups.index(("view.rotation", "view.shift", "length"))]
    asked = joints(200, 12)
    new, _ = updated(reference, [(0.5, scale), (0.5, length)], log, joints(100, 8))
    assert np.abs(new.predict(asked) - 1.05 * tip(asked)).max() < 1e-6


def test_wrong_rows_are_told_from_the_others():
    q = joints(100, 13)
    z = tip(q, L1, 1.2 * L2) + noise(100, 13)
    z[[3, 50, 77]] += [0.05, -0.1]
    _, log, _, kept = compared(body(), q, z)
    assert np.flatnonzero(~kept).tolist() == [3, 50, 77]
    assert log.weight[~kept].max() < 0.05 * np.median(log.weight[kept])


def test_gain_of_held_out_blocks():
    before, after = np.full(50, 2.0), np.full(50, 1.0)
    ratio, sure = gain_on_held_out(before, after + 1e-3 * np.arange(50))
    assert ratio == pytest.approx(0.5, rel=0.05)
    assert sure > 50
    assert gain_on_held_out(before, before)[0] == 1.0


def test_a_belief_without_rows_to_spare_is_left_in_peace():
    """Ten rows of the same arm change next to nothing."""
    q = joints(10, 18)
    reference, log, found, _ = compared(body(), q, tip(q) + noise(10, 18))
    nothing = [(1.0, next(e for e in found if e.unchanged))]
    new, _ = updated(reference, nothing, log, joints(60, 8))
    asked = joints(100, 19)
    assert np.abs(new.predict(asked) - body().predict(asked)).max() < 2e-4
    assert replace(new, beta=body().beta).kappa == body().kappa
