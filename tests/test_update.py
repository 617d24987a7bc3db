"""Beliefs after a log: members, evidence, posterior, tests of groups, residuals of a log."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from calib.body.fitting import fit_body
from calib.body.likeness import kernel
from calib.change.comparison import carried
from calib.change.explain import changed, explain, likely
from calib.change.group_tests import group_tests
from calib.change.lag import lag_of
from calib.change.members import as_built, drift, freedom, members_of
from calib.change.own_residual import own_residual
from calib.change.reference import kept_reference, reference_of
from calib.change.rows import weighted
from calib.change.update import settled, updated
from calib.common.rows import thinned

pytestmark = pytest.mark.usefixtures("one_blas_thread")

LOWER, UPPER = np.radians([0.0, 15.0]), np.radians([90.0, 150.0])
L1, L2 = 0.30, 0.25


def tip(q, first=L1, second=L2):
    a, b = q[:, 0], q[:, 0] + q[:, 1]
    return np.stack(
        [first * np.cos(a) + second * np.cos(b), first * np.sin(a) + second * np.sin(b)], axis=1
    )


def joints(n, seed=0):
    return np.random.default_rng(seed).uniform(LOWER, UPPER, (n, 2))


def noise(n, seed=0, size=1e-3):
    return size * np.random.default_rng(1000 + seed).standard_normal((n, 2))


def moved(q, offset):
    """The joints with another offset of the elbow."""
    return q + np.array([0.0, offset])


@cache
def body():
    """What 4,000 rows at 1 mm say of the arm."""
    q = joints(4000)
    names = ("shoulder", "elbow")
    made = fit_body(q, tip(q) + noise(4000), joint_names=names, revolute=(True, True))
    return made.body


@cache
def exact_body():
    q = joints(800)
    names = ("shoulder", "elbow")
    made = fit_body(q, tip(q), joint_names=names, revolute=(True, True), simulated=True)
    return made.body


def compared(belief, q, z, cause=None):
    reference = reference_of(belief, q, z)
    log, robust, kept = weighted(reference, q, z, cause)
    return reference, log, explain(reference, log, robust, cause), kept


# --- members ----------------------------------------------------------------------------


def test_members_go_from_nothing_to_everything_and_respect_what_is_known():
    every = members_of(body().structure)
    assert every[0].groups == ()
    assert len({m.name for m in every}) == len(every)
    sensor = members_of(body().structure, "sensor")
    assert all(g.startswith("view.") or g == "lens" for m in sensor for g in m.groups)
    arm = members_of(body().structure, "joints")
    assert not any(g.startswith("view.") or g == "lens" for m in arm for g in m.groups)
    assert {m.name for m in sensor} | {m.name for m in arm} <= {m.name for m in every}


def test_the_first_joints_offset_is_the_frames_unless_the_arm_alone_has_changed():
    groups = body().structure.groups
    first, second = groups["offset"]
    offset = next(m for m in members_of(body().structure) if m.groups == ("offset",))
    assert freedom(body(), offset)[first] == 0.0
    assert freedom(body(), offset)[second] > 0.0
    assert freedom(body(), offset, "joints")[first] > 0.0
    # nothing of the sensor creeps
    for name, indices in groups.items():
        if name.startswith("view.") or name == "lens":
            assert not drift(body())[indices].any()


def test_an_exact_simulation_is_an_arm_as_it_is_built():
    built = as_built(exact_body())
    sd = built.deviations
    groups = built.structure.groups
    np.testing.assert_allclose(sd[groups["length"]], 1e-3)
    np.testing.assert_allclose(sd[groups["offset"][1:]], np.radians(0.1))
    assert sd[groups["offset"][0]] == 0.0
    np.testing.assert_array_equal(built.beta, exact_body().beta)
    assert as_built(body()) is body()


# --- the frame of a log -------------------------------------------------------------------


def test_a_log_in_the_old_frame_stays_there():
    q = joints(60, 3)
    reference = reference_of(body(), q, tip(q) + noise(60))
    assert not reference.new
    np.testing.assert_array_equal(reference.beta, body().beta)


@pytest.mark.parametrize(
    ("truth", "found"),
    [
        (lambda q: tip(q) * [-1.0, 1.0], ("mirrored", True)),
        (lambda q: tip(q * [1.0, -1.0]), ("turned", (1,))),
        (lambda q: tip(np.stack([q[:, 0], np.full(len(q), 0.8)], axis=1)), ("locked", (1,))),
        (lambda q: 1000.0 * tip(q) + [5.0, -80.0], ("scale", 1000.0)),
        (lambda q: 39.37 * tip(q) @ [[0.0, 1.0], [1.0, 0.0]], ("mirrored", True)),
    ],
)
def test_another_sense_or_unit_is_found_before_anything_else(truth, found):
    q = joints(80, 4)
    reference = reference_of(exact_body(), q, truth(q))
    name, value = found
    assert reference.new
    assert getattr(reference, name) == pytest.approx(value)
    said = reference.structure.predict(q, reference.beta)
    # a lock is known to a step of the search, all else exactly
    share = 0.05 if name == "locked" else 1e-6
    assert np.abs(said - truth(q)).max() < share * np.ptp(truth(q))


def test_a_turn_is_found_by_the_short_way_round():
    q = joints(80, 5)
    for angle in (-2.5, -0.4, 0.4, 3.0):
        c, s = np.cos(angle), np.sin(angle)
        reference = reference_of(exact_body(), q, tip(q) @ [[c, s], [-s, c]])
        rotation = reference.structure.groups["view.rotation"][0]
        change = reference.beta[rotation] - exact_body().beta[rotation]
        assert change == pytest.approx(angle, abs=1e-6)


def test_positions_that_follow_the_joints_are_found_out():
    t = np.linspace(0, 12, 300)
    u = 0.5 + 0.4 * np.stack([np.sin(t), np.sin(1.7 * t + 1)], axis=1)
    q = LOWER + u * (UPPER - LOWER)
    reference = kept_reference(body())
    assert lag_of(reference, q, tip(q)) == 0
    for lag in (4, -9):
        shifted = np.roll(tip(q), lag, axis=0)
        rows = slice(20, 280)
        assert lag_of(reference, q[rows], shifted[rows]) == lag
    assert lag_of(reference, joints(300), tip(joints(300, 1))) == 0


# --- evidence and update ------------------------------------------------------------------


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


def test_what_maps_add_turns_with_the_sensor():
    q = joints(50, 14)
    offset = 1e-3 * np.stack([np.sin(5 * q[:, 0]), np.cos(4 * q[:, 1])], axis=1)
    turned = body().beta.copy()
    turned[body().structure.groups["view.rotation"]] += 0.7
    turned[body().structure.groups["view.shift"]] += [0.2, -0.1]
    moved = carried(body(), body(), turned, q, offset)
    c, s = np.cos(0.7), np.sin(0.7)
    np.testing.assert_allclose(moved, offset @ [[c, s], [-s, c]], atol=1e-12)


# --- tests of groups ------------------------------------------------------------------------


def checked(z, q):
    reference = kept_reference(body())
    log, _, _ = weighted(reference, q, z)
    return group_tests(body(), reference, log, joints(80, 8))


def test_statistics_of_an_unchanged_arm_are_those_of_chance():
    rounds = [checked(tip(joints(150, s)) + noise(150, s), joints(150, s)) for s in range(30, 50)]
    assert not any(t.fired for t in rounds)
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


# --- the residual of a log ------------------------------------------------------------------


def test_a_smooth_residual_is_kept_and_fades():
    q = joints(200, 15)
    wave = 2e-3 * np.stack([np.sin(2 * q[:, 0]), np.cos(2 * q[:, 1])], axis=1)
    rows = wave + noise(200, 15, 1e-4)
    lengths = np.array([0.5, 0.5])
    own = own_residual(q, rows, rows, np.ones(200), lengths)
    assert own is not None
    fresh = joints(100, 16)
    truth = 2e-3 * np.stack([np.sin(2 * fresh[:, 0]), np.cos(2 * fresh[:, 1])], axis=1)
    assert np.abs(own.value(fresh) - truth).mean() < 2e-4
    far = fresh + 20.0
    assert np.abs(own.value(far)).max() < 1e-9
    np.testing.assert_allclose(own.deviation(far), own.sd)
    assert own.deviation(fresh).mean() < 0.2 * own.sd


def test_noise_is_no_residual():
    for seed in range(5):
        rows = noise(150, seed)
        assert own_residual(joints(150, seed), rows, rows, np.ones(150), np.ones(2)) is None


def test_a_correlation_is_one_at_home_and_falls():
    q = joints(30, 17)
    alike = kernel(q, q, np.array([0.3, 0.6]))
    np.testing.assert_allclose(np.diag(alike), 1.0)
    assert np.linalg.eigvalsh(alike).min() > -1e-10
    line = np.stack([np.linspace(0, 3, 20), np.zeros(20)], axis=1)
    falling = kernel(line, line[:1], np.ones(2))[:, 0]
    assert (np.diff(falling) < 0).all()


def test_gain_of_held_out_blocks():
    before, after = np.full(50, 2.0), np.full(50, 1.0)
    ratio, sure = settled(before, after + 1e-3 * np.arange(50))
    assert ratio == pytest.approx(0.5, rel=0.05)
    assert sure > 50
    assert settled(before, before)[0] == 1.0


def test_rows_are_thinned_evenly_and_in_order():
    rows = thinned(1000, 10)
    assert rows[0] == 0
    assert rows[-1] == 999
    assert (np.diff(rows) == 111).all()
    np.testing.assert_array_equal(thinned(5, 10), np.arange(5))


def test_a_belief_without_rows_to_spare_is_left_in_peace():
    """Ten rows of the same arm change next to nothing."""
    q = joints(10, 18)
    reference, log, found, _ = compared(body(), q, tip(q) + noise(10, 18))
    nothing = [(1.0, next(e for e in found if e.unchanged))]
    new, _ = updated(reference, nothing, log, joints(60, 8))
    asked = joints(100, 19)
    assert np.abs(new.predict(asked) - body().predict(asked)).max() < 2e-4
    assert replace(new, beta=body().beta).kappa == body().kappa


def test_a_residual_of_single_places_is_not_carried_elsewhere():
    """Rows of each place tell of that place alone: half of the log says nothing of the other."""
    rng = np.random.default_rng(5)
    places = rng.uniform(0.0, 3.0, (20, 2))
    q = np.repeat(places, 6, axis=0) + 0.005 * rng.standard_normal((120, 2))
    q = q[np.argsort(np.tile(np.arange(6), 20), kind="stable")]  # six rounds of all places
    value = np.tile(rng.standard_normal((20, 2)), (6, 1))
    kept = own_residual(q, value, value, np.ones(120), np.full(2, 0.5))
    assert kept is not None  # every block has seen all the places
    order = np.argsort(np.tile(np.arange(20), 6), kind="stable")  # one place after another
    q, value = q[order], value[order]
    assert own_residual(q, value, value, np.ones(120), np.full(2, 0.5)) is None
