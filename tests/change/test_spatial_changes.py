"""An arm in space: `check` and `adapt` name what changed, in numbers and words."""

from dataclasses import replace
from functools import cache

import models
import numpy as np
import pytest
from chains import SLIDE, chain_urdf, turning
from reference import ROBOTS, needs_robots
from scipy.spatial.transform import Rotation

import calib
from calib.arm.loading import arm_from_urdf
from calib.change.noise import Reference, sd_of_changes
from calib.use.geometry_fit import fit_geometry

NOISE = 2e-4
FRAME = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
ARM = calib.load_arm("spatial_three")
SIX = calib.load_arm("six_axis")


def log_of(seed, n=150, turn=FRAME, shift=(1.0, 0.5, 0.2)):
    return models.sensed(ARM, n, seed, lambda q: ARM.forward(q) @ turn.T + shift, NOISE, unit="m")


def errors(model, rows):
    """Mean distance [m] from exact rows, and the share of them within the model's bound."""
    return models.accuracy(model, rows.q, rows.x, "expected_error")


def assert_cause(cause, name, size):
    """See that a cause has this name, and an interval that holds its size."""
    assert cause.cause == name
    assert cause.interval[0] < size < cause.interval[1]


@pytest.mark.parametrize("seed", [3, 11])
def test_what_ten_rows_left_open_is_no_change(seed):
    """Links 2 % longer than drawn, held as drawn by ten rows, were told as changed ever after."""
    changes = ["shoulder_lift.length=+2%", "elbow.length=-2%", "elbow.offset=0.01"]
    model = calib.train(models.bare(ARM, 10, seed, *changes, noise=1e-4), size=6)
    error, covered = errors(model, models.bare(ARM, 30, 9, *changes, noise=0.0))
    assert error < 5e-4
    assert covered > 0.93
    log = calib.babble(ARM, 30, seed=9, noise=1e-4, changes=changes)
    assert not calib.check(model, log).drifted


def test_rows_all_over_what_a_log_taught_are_all_over_the_range():
    """Part of each joint's range was a corner: a real arm's bound was fifteen errors."""
    model = calib.train(log_within(0.4, 1), size=4)
    adapted = calib.adapt(model, log_within(0.4, 2, moved=True))
    assert adapted.everywhere
    assert adapted.coverage > 0.9
    corner = calib.adapt(model, log_within(0.1, 3, moved=True))
    assert not corner.everywhere
    assert corner.coverage < 0.5


def log_within(share, seed, *, moved=False):
    """Rows within a share of each joint's range of `six_axis`; the sensor may be elsewhere."""
    rng = np.random.default_rng(seed)
    middle = (SIX.lower + SIX.upper) / 2
    q = middle + share * (SIX.upper - middle) * rng.uniform(-1.0, 1.0, (100, 6))
    x = SIX.forward(q)
    if moved:
        x = x @ FRAME.T + (1.0, 0.5, 0.2)
    return models.log_of(SIX, q, x + rng.normal(0.0, NOISE, x.shape), unit="m")


@cache
def simulated():
    return calib.train(calib.babble(SIX, 1500), size=4)


@pytest.mark.parametrize("joint", ["elbow", "wrist_1", "wrist_2"])
@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_one_degree_of_a_simulated_arm_is_named(joint, noise):
    """The tolerances of an arm's making explain it nearly as well: they named no cause."""
    log = calib.babble(SIX, 60, seed=5, noise=noise, changes=[f"{joint}.offset=0.0175"])
    cause = calib.check(simulated(), log).causes[0]
    assert_cause(cause, f"offset:{joint}", 0.0175)
    assert np.ptp(cause.interval) < np.radians(0.9)


def test_a_simulated_arm_that_was_adapted_promises_readings():
    """Its bound on the true position was compared with noisy rows, of which it covered 58 %."""
    log = calib.babble(SIX, 60, seed=3, noise=5e-4, changes=["wrist_2.offset=0.0175"])
    about = calib.adapt(simulated(), log).model.about
    assert about.within["covered"] > 0.9
    assert about.bound_holds


@pytest.mark.parametrize("seed", [0, 1])
def test_an_arm_that_is_built_a_little_off_its_drawing_has_no_step(seed):
    """What a play explained by chance, of residuals 20 times the noise, was left as a step."""
    body = simulated().body
    groups = body.structure.groups
    beta = body.beta.copy()
    beta[groups["placement"]] += np.random.default_rng(seed).normal(0.0, 1.5e-3, 36)
    beta[groups["offset"][2]] += 0.0175
    q = np.random.default_rng(0).uniform(SIX.lower, SIX.upper, (100, 6))
    x = body.structure.predict(q, beta)[:, :3]
    x += np.random.default_rng(99).normal(0.0, 1e-4, (100, 3))
    verdict = calib.check(simulated(), models.log_of(SIX, q, x, unit="m"))
    assert verdict.drifted
    assert not verdict.has_step


def test_a_cause_that_is_nearly_as_likely_is_told():
    arm = calib.load_arm("so101")
    model = calib.train(calib.babble(arm, 1500), size=6)
    log = calib.babble(arm, 60, seed=2, noise=3e-3, changes=["shoulder_lift.gear=1.01"])
    verdict = calib.check(model, log)
    assert verdict.causes[0].cause == "gain:shoulder_lift"
    (note,) = [note for note in verdict.notes if note.startswith("nearly as likely: ")]
    assert "elbow_flex moves with the joint before it, by +1." in note


def of_two_joints(second, seed):
    """Logs of an arm of two joints that was built a little off its drawing."""
    rng = np.random.default_rng(seed)

    def chain(turned, shifted):
        axis, place = np.add((1.0, 0.3, 0.2), turned), np.add((0.2, 0.1, 0.1), shifted)
        texts = [" ".join(map(str, vector)) for vector in (axis, place)]
        first = turning("0 0 1", "0 0 0.1", "-1.2", "1.4")
        return arm_from_urdf(chain_urdf(first, second(*texts), tip="0.2 0.15 0.1"))

    drawn = chain(0.0, 0.0)
    built = chain(rng.normal(0.0, 0.003, 3), rng.normal(0.0, 6e-4, 3))
    zeros = rng.normal(0.0, 0.01, 2) * np.where(drawn.revolute, 1.0, 0.1)

    def log(rows, seed, change=0.0):
        off = np.add(zeros, (0.0, change))
        return models.sensed(drawn, rows, seed, lambda q: built.forward(q + off) + 1.0)

    return log


def test_a_chain_that_few_rows_left_as_drawn_is_no_change():
    log = of_two_joints(lambda axis, place: turning(axis, place, "-1.2", "1.4"), 11)
    model = calib.train(log(16, 105), size=4)
    assert model.body.member == "frame"
    assert max(calib.check(model, log(60, seed)).score for seed in range(3)) < 0.5


@pytest.mark.parametrize("seed", [0, 1])
def test_a_slide_that_was_set_anew_is_off_by_a_length(seed):
    log = of_two_joints(lambda axis, place: turning(axis, place, "-0.1", "0.2") + SLIDE, seed)
    model = calib.train(log(16, 105), size=4)
    (cause,) = calib.check(model, log(60, 9, 0.003)).causes
    assert_cause(cause, "offset:j2", 0.003)


@needs_robots
def test_what_rows_contradict_does_not_widen_a_bound():
    """Errors fell from 3 mm to .07, under a bound of a tenth of the reach: nothing was written."""
    finger = calib.load_arm(ROBOTS / "allegro_hand_description/urdf/allegro_left_hand.urdf")
    model = calib.train(calib.babble(finger, 400), size=4)
    changes = ["joint_12.0.gear=1.01", "joint_14.0.offset=0.03"]
    adapted = calib.adapt(model, calib.babble(finger, 80, seed=3, noise=4e-5, changes=changes))
    assert adapted.improved, adapted.notes
    error, covered = errors(adapted.model, models.bare(finger, 200, 9, *changes, noise=0.0))
    assert error < 1e-4
    assert covered > 0.95


def test_a_slide_in_the_plane_that_was_set_anew_is_off_by_a_length():
    slide = turning("1 0.8 0", "0.2 0.1 0", "0", "0.2") + SLIDE
    arm = arm_from_urdf(chain_urdf(turning(), slide, turning(xyz="0.1 0 0")))
    model = calib.train(models.bare(arm, 60, 0), size=4)
    (cause,) = calib.check(model, models.bare(arm, 40, 1, "j2.offset=0.003")).causes
    assert cause.words.startswith("j2 is off by ")
    assert_cause(cause, "offset:j2", 0.003)


@pytest.mark.parametrize("seed", [0, 1])
def test_a_zero_and_a_gain_that_nearly_cancel_are_both_named(seed):
    """Neither alone explains anything: they passed for waves of the joints."""
    lower, upper = np.append(ARM.lower[:2], -2.2), np.append(ARM.upper[:2], -0.8)

    def log(n, seed, gain, zero):
        rng = np.random.default_rng(seed)
        q = rng.uniform(lower, upper, (n, 3))
        x = ARM.forward(q * (1.0, 1.0, gain) + (0.0, 0.0, zero))
        return models.log_of(ARM, q, x + rng.normal(0.0, 1e-4, x.shape))

    model = calib.train(log(20, seed, 1.0, 0.0), size=4)
    causes = calib.check(model, log(40, seed + 10, 1.01, 0.015)).causes
    for name, size in (("gain:elbow", 0.01), ("offset:elbow", 0.015)):
        assert_cause(next(cause for cause in causes if cause.cause == name), name, size)


def test_a_tracker_that_stands_elsewhere_is_told_by_its_turn_and_its_shift():
    model = calib.train(log_of(0), size=6, motor_size=6)
    elsewhere = {"turn": np.eye(3), "shift": (0.0, 3.0, 0.0)}
    adapted = calib.adapt(model, log_of(4, **elsewhere))
    (cause,) = adapted.verdict.causes
    assert cause.cause == "sensor"
    assert "turned 90.00" in cause.words
    assert cause.value == pytest.approx(np.pi / 2, abs=1e-3)
    assert errors(adapted.model, log_of(5, **elsewhere))[0] < 3 * NOISE
    assert "the lens" not in adapted.kept
    assert adapted.coverage > 0.3


def posed(seed, bend=0.0, turn=FRAME, n=60):
    """A log with orientations of 0.3 mrad noise, of a tool that is bent by `bend` [rad]."""
    log = log_of(seed, n, turn)
    tips = Rotation.from_quat(ARM.pose(log.q)[1]) * Rotation.from_rotvec((0.0, bend, 0.0))
    noise = Rotation.from_rotvec(np.random.default_rng(seed).normal(0.0, 3e-4, (n, 3)))
    return replace(log, orientation=(noise * Rotation.from_matrix(turn) * tips).as_quat())


@pytest.fixture(scope="module")
def oriented():
    return calib.train(posed(10), size=6, motor_size=6)


def test_a_tool_that_is_bent_in_its_orientation_only_is_noticed(oriented):
    bend = np.radians(0.3)
    assert not calib.check(oriented, posed(11)).drifted
    adapted = calib.adapt(oriented, posed(12, bend))
    assert adapted.verdict.drifted
    (cause,), (mended,) = adapted.verdict.causes, adapted.changed
    assert cause.group == mended.group == "tool.rotation"
    assert cause.interval[0] < bend < cause.interval[1]
    assert np.degrees(cause.value) == pytest.approx(0.3, abs=0.02)
    assert adapted.improved
    fresh = posed(15, bend)
    for model, least, most in ((oriented, 0.28, 0.32), (adapted.model, 0.0, 0.05)):
        answered = Rotation.from_quat(model.pose(fresh.q)[1])
        turned = (Rotation.from_quat(fresh.orientation) * answered.inv()).magnitude()
        assert least < np.degrees(np.median(turned)) < most
        assert errors(model, fresh)[0] < 3 * NOISE
    # its interval holds, and a turned tracker bends none
    inside = 0
    for seed in range(12, 18):
        (cause,) = calib.check(oriented, posed(seed, bend)).causes
        inside += cause.interval[0] < bend < cause.interval[1]
    assert inside >= 5
    (cause,) = calib.check(oriented, posed(13, turn=np.eye(3))).causes
    assert cause.cause == "sensor"


def test_a_tracker_before_a_simulated_arm_moves_neither_its_commands_nor_its_drawing(tmp_path):
    simulated = calib.train(calib.babble(ARM, 100), size=3, motor_size=3)
    log = log_of(8, n=24, turn=np.eye(3), shift=(0.01, -0.004, 0.006))
    made = calib.adapt(simulated, log)
    assert [cause.cause for cause in made.changed] == ["sensor"]
    made.model.save(tmp_path / "moved.calib")
    moved, q = calib.load(tmp_path / "moved.calib"), log.q[:5] * 0.5
    away = ARM.forward(calib.correct(moved, q).q) - ARM.forward(q)
    assert np.nanmedian(np.linalg.norm(away, axis=1)) < 1e-3  # once 11.8 mm
    for offset in fit_geometry(moved).offsets().values():
        assert abs(offset.value) < np.radians(0.05)


@cache
def sparse(arm):
    """A model of fifteen rows of a six-joint arm."""
    return calib.train(models.bare(arm, 15, 0, noise=1e-4), size=6)


ALL = [f"{joint}.length=+{2 + k}%" for k, joint in enumerate(SIX.joint_names[1:])]
OF_FIFTEEN = [  # an arm, its changes, rows with their noise, mean error [m] if that is mended
    # all placements cost more than fifteen rows tell: they stayed 11.6 mm off
    (SIX, ["elbow.length=+3%", "wrist_1.length=-2%"], (15, 1e-4), 5e-4),
    # what nothing mends: 11.6 mm off, 1.4 mm told; without masses 16.1 mm off, .6 mm told
    (SIX, ALL, (12, 0.0), np.inf),
    (models.without_masses(SIX), ALL, (12, 0.0), np.inf),
]


@pytest.mark.parametrize(("arm", "changes", "rows", "most"), OF_FIFTEEN)
def test_rows_mend_a_model_of_fifteen_or_widen_its_bound(arm, changes, rows, most):
    n, noise = rows
    made = calib.adapt(sparse(arm), calib.babble(arm, n, seed=9, noise=noise, changes=changes))
    error, covered = errors(made.model, models.bare(arm, 200, 9, *changes, noise=0.0))
    assert made.improved == (most < np.inf)
    assert error < most
    assert covered > 0.93


def test_the_model_that_is_written_is_the_one_that_is_praised(tmp_path):
    """Of an arm without a drawing origins are held by wide priors: a linear step leads far off."""
    change = f"{SIX.joint_names[2]}.offset=0.0174533"
    model = calib.train(replace(models.bare(SIX, 400, 20, noise=1e-4), arm=None), size=6)
    found = calib.adapt(model, replace(models.bare(SIX, 60, 60, change, noise=1e-4), arm=None))
    found.model.save(tmp_path / "after.calib")
    fresh = models.bare(SIX, 300, 5, change, noise=0.0)
    error, _ = errors(calib.load(tmp_path / "after.calib"), fresh)
    assert found.improved
    assert error < 2 * found.after["mean"]  # before .17 mm was told and 12.7 mm written


def test_rows_that_say_more_than_a_model_of_a_few_are_learned_as_training_does():
    """Without a drawing thirty rows leave a curved posterior, which an update takes for flat.

    What such rows leave open bends far: undamped steps from there end nowhere.
    """

    def rows(n, seed, noise=1e-5):
        log = models.bare(SIX, n, seed, noise=noise)
        real = log.q + 3e-4 * np.sin(9 * log.q + np.arange(6))
        return replace(log, x=log.x + SIX.forward(real) - SIX.forward(log.q), arm=None)

    adapted = calib.adapt(calib.train(rows(30, 1), size=4), rows(150, 51))
    error, covered = errors(adapted.model, rows(400, 9, noise=0.0))
    assert adapted.improved
    assert error < 8e-5  # .18 mm before, .11 by the update alone
    assert covered > 0.93


def test_a_wrist_that_moves_with_its_neighbour_is_named_and_mended():
    """It was called a noisy encoder, and the arm calibrated, .7 mm beside the bound."""
    share = 6e-3

    def rows(n, seed, coupling=share, noise=1e-4):
        coupled = np.eye(6)
        coupled[3, 4] = coupling
        return models.sensed(SIX, n, seed, lambda q: SIX.forward(q @ coupled), noise)

    model = calib.train(rows(300, 1, 0.0), size=6)
    assert not calib.check(model, rows(60, 3, 0.0)).drifted
    adapted = calib.adapt(model, rows(60, 2))
    (cause,) = adapted.changed
    assert_cause(cause, "coupling:wrist_2", share)
    error, covered = errors(adapted.model, rows(200, 9, noise=0.0))
    assert error < 1e-4
    assert covered > 0.93


def test_a_turn_about_the_first_joint_is_free_once():
    """It was free as the frame's turn and as the joint's offset: twice as wide as told."""
    body = calib.train(log_of(0), size=4, motor_size=4).body
    sd, groups = sd_of_changes(Reference(body, body.beta)), body.structure.groups
    assert (sd[groups["view.rotation"]] > 0.0).all()
    assert not sd[groups["offset"]][0]
    assert (sd[groups["offset"]][1:] > 0.0).all()
