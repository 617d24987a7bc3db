"""Check and recognise: what undisturbed, changed and misread logs look like, and what is named."""

import re
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from conftest import refused
from models import accuracy, arm, babbled, bare, learned, log_of, model, trained
from reference import random_joints

import calib

NOISE = 2e-4
TRACKER = Path(__file__).parents[3] / "shared/data/ur10_laser_tracker"


def names(drift):
    return {cause.cause for cause in drift.causes}


def at(u):
    """Joints (n, 2) of two_link at shares of their ranges."""
    return arm().lower + u * (arm().upper - arm().lower)


def alarms(monitor, q, x):
    """Whether each sample of a stream finds drift."""
    return [monitor.update(*sample).drifted for sample in zip(q, x, strict=True)]


@pytest.mark.parametrize("change", ["sensor.rotate=0.02", "shoulder.offset=0.02"])
def test_a_turned_sensor_and_an_offset_of_the_first_joint_are_the_same(change):
    drift = calib.check(model(1e-3), babbled(change))
    assert any("are the same" in text for text in drift.notes)
    sizes = {cause.cause: cause.value for cause in drift.causes}
    for cause in ("sensor", "offset:shoulder"):
        assert sizes[cause] == pytest.approx(0.02, abs=2e-3)
    assert any(text.endswith(" would look the same") for text in drift.explanations)


def test_sizes_are_told_to_the_digits_of_their_intervals():
    """-0.01112, -0.002138 mm were told of a sensor whose place is known to .1 mm."""
    (moved,) = calib.check(model(1e-3), babbled("sensor.shift=0.02,0")).explanations
    size = r"-?\d+\.\d{1,3} ± \d\.\d{1,3}"
    assert re.search(f"frame moved: turned {size} deg, shifted {size} mm, {size} mm$", moved)


def test_each_episode_of_a_log_has_a_verdict():
    calm, bumped = babbled(n=60, seed=1), babbled("elbow.offset=0.02", n=60, seed=2)
    columns = ("q", "x", "side")
    rows = {n: np.vstack([getattr(log, n) for log in (calm, bumped)]) for n in columns}
    verdict = calib.check(model(1e-3), replace(calm, **rows, episode=np.repeat([4.0, 7.0], 60)))
    assert verdict.drifted
    assert not verdict.is_calm
    told = [(each.episode, each.samples, each.drifted) for each in verdict.episodes]
    assert told == [(4, 60, False), (7, 60, True)]
    assert verdict.drifted_episodes[0].main_cause.startswith("elbow is off by")
    assert calib.check(model(1e-3), calm).episodes == ()


@pytest.mark.parametrize(("change", "at"), [("elbow.offset=0.005", 30), ("sensor.rotate=0.01", 45)])
def test_a_log_within_which_something_changed_is_split_there(change, at):
    """An offset of half the size was told, +.14 +- .04 deg for 0 and .29."""
    old, new = bare("two_link", 60, 1), bare("two_link", 60, 1, change)
    log = replace(old, x=np.where(np.arange(60)[:, None] < at, old.x, new.x))
    found = calib.adapt(learned(), log)
    (cause,) = found.changed
    assert cause.cause == "step"
    assert abs(int(re.search(r"near row (\d+)", cause.words)[1]) - at) < 4
    assert "before: still calibrated; after: " in cause.words
    assert not found.improved
    assert found.verdict.hint.startswith("split the log")
    # in no order of time there is nothing to split
    mixed = log.take(np.random.default_rng(0).permutation(60))
    assert "step" not in names(calib.check(learned(), mixed))


def test_what_grows_along_a_log_or_gets_noisier_is_no_step():
    """Of six logs whose last fifth was 20 times noisier all were split there."""
    old, new = (bare("two_link", 200, 1, *change) for change in ((), ("elbow.offset=0.005",)))
    growing = old.x + np.linspace(0.0, 1.0, 200)[:, None] * (new.x - old.x)
    (cause,) = calib.check(learned(), replace(old, x=growing)).causes
    assert "bit by bit" in cause.words
    noise = np.random.default_rng(0).normal(0.0, 20 * NOISE, (200, 2))
    noisier = replace(old, x=np.where(np.arange(200)[:, None] < 160, old.x, old.x + noise))
    assert "step" not in names(calib.check(learned(), noisier))


def test_play_of_all_joints_along_a_path_is_no_change_within_the_log():
    three, t = calib.load_arm("spatial_three"), np.linspace(0, 20, 200)[:, None]
    middle, half = (three.lower + three.upper) / 2, (three.upper - three.lower) / 3
    rng, phase = np.random.default_rng(1), t * [0.5, 0.9, 1.3] + np.arange(3)
    path, q = middle + half * np.sin(phase), rng.uniform(three.lower, three.upper, (300, 3))

    def log(q, tip_joints):
        x = three.forward(tip_joints)
        return log_of(three, q, x + rng.normal(0.0, 1e-4, x.shape))

    model = calib.train(log(q, q), size=4)
    verdict = calib.check(model, log(path, path - 5e-3 * np.sign(np.cos(phase))))
    assert "step" not in names(verdict)
    assert verdict.drifted


def test_one_joint_in_degrees_is_named():
    """All were said to be: `degrees=True` then turns the others' radians into next to none."""
    rows = babbled(n=60)
    for joint, name in enumerate(arm().joint_names):
        q = np.where(np.arange(2) == joint, np.degrees(rows.q), rows.q)
        mixed = replace(rows, q=q, lower=q.min(0) - 1.0, upper=q.max(0) + 1.0, simulation=None)
        refused(calib.LogError, f"{name} = ", calib.check, model(1e-3), mixed)


def test_what_is_known_of_a_change_is_believed():
    turned, longer = babbled("sensor.rotate=0.02"), babbled("elbow.length=+5%")
    assert names(calib.check(model(1e-3), turned, cause="joints")) == {"offset:shoulder"}
    assert "length:elbow" in names(calib.check(model(1e-3), longer, cause="joints"))
    assert "length:elbow" not in names(calib.check(model(1e-3), longer, cause="sensor"))
    refused(calib.OptionError, "sensor, joints", calib.check, model(1e-3), longer, cause="wind")


def test_a_log_of_the_poses_that_were_learned_covers_what_the_model_knows():
    def sides(seed):
        rows = babbled(n=900, seed=seed)
        return rows.take(rows.q[:, 0] < at(0.3)[0])

    learned = calib.train(replace(sides(1), simulation=None), size=12)
    assert not any("covers" in note for note in calib.check(learned, sides(2)).notes)
    assert any("covers" in note for note in calib.check(model(1e-3), sides(2)).notes)


def test_rows_that_show_too_little_say_so():
    rows = babbled(n=2000)
    corner = rows.take((rows.q < at(0.15)).all(axis=1))
    fine, coarse = (calib.check(model(1e-3), s) for s in (babbled(n=400), corner))
    assert coarse.smallest > 3 * fine.smallest
    between = (fine.smallest * coarse.smallest) ** 0.5
    assert calib.check(model(1e-3), babbled(n=400), tolerance=between).drifted is False
    assert calib.check(model(1e-3), corner, tolerance=between).drifted is None
    # what changed has changed, whatever is tolerated
    assert calib.check(model(1e-3), babbled("elbow.length=+5%"), tolerance=1e-9).drifted is True


@pytest.mark.parametrize("spoil", ["shuffled", "lag", "other"])
def test_a_log_that_nothing_explains(spoil):
    rng = np.random.default_rng(0)
    q = at(0.5 + 0.45 * np.sin(3 * np.cumsum(rng.normal(0, 0.03, (400, 2)), axis=0)))
    x = arm().forward(q) + 1e-3 * rng.standard_normal((400, 2))
    if spoil == "shuffled":
        x = x[rng.permutation(400)]
    elif spoil == "lag":
        q, x = q[12:], x[:-12]
    else:
        q = at(rng.random((400, 2)))
    bad = replace(babbled(n=len(q)), q=q, x=x, simulation=None)
    found = calib.adapt(model(1e-3), bad)
    assert found.verdict.drifted
    assert names(found.verdict) == {"unknown"}
    assert "nothing explains the log" in found.verdict.explanations[0]
    assert ("12 rows" in found.verdict.explanations[0]) == (spoil == "lag")
    assert found.model is model(1e-3)
    assert any("nothing explains the log" in note for note in found.notes)


@pytest.mark.parametrize(("n", "every"), [(25, 3), (100, 4), (100, 3)])
def test_rows_of_another_sensor_are_no_noise_and_no_calm(n, every):
    """A scatter of 10 mm beside .2 was called noise; with rows left out it was still calibrated."""
    rows = bare("two_link", n, 11)
    x = rows.x.copy()
    x[::every] += 0.055 * np.random.default_rng(n).standard_normal(x[::every].shape)
    verdict = calib.check(learned(), replace(rows, x=x))
    assert (verdict.drifted, verdict.is_calm, verdict.causes) == (False, False, ())
    assert verdict.covered == pytest.approx(1 - 1 / every, abs=0.09)
    assert "no noise, wrong rows" in verdict.notes[-1]


@pytest.mark.parametrize("changes", [(), ("elbow.offset=0.02",)])
def test_a_simulated_arm_holds_as_its_queries_promise(changes):
    """1 deg was within a bound of 0.0000 mm, and 40 exact rows were too few to say."""
    simulated = trained("six_axis", 400, 6)
    rows = bare("six_axis", 40, 3, *changes, noise=0.0)
    stages = []
    verdict = calib.check(simulated, rows, progress=lambda *step: stages.append(step[:2]))
    off = np.linalg.norm(simulated.forward(rows.q) - rows.x, axis=1)
    share = np.mean(off <= simulated.expected_error(rows.q) + 1e-9)
    within = calib.evaluate(simulated, rows).within["covered"]
    assert (verdict.drifted, verdict.bound_holds) == (bool(changes), not changes)
    assert (verdict.covered, within) == (share, share)
    assert stages[:3] == [(0.0, "rows"), (0.2, "tests"), (0.4, "causes")]


def test_rows_that_a_model_learned_show_nothing_new():
    """They hid a knock from `check` that `evaluate` saw; where there are no others they count."""
    rows = bare("two_link", 400, 7)
    new = bare("two_link", 40, 8, "elbow.offset=0.01")
    names = ("q", "x", "side")
    both = replace(rows, **{n: np.vstack([getattr(rows, n), getattr(new, n)]) for n in names})
    for log, count in ((both, 40), (rows, 400)):
        verdict = calib.check(learned(), log)
        assert (verdict.samples, verdict.drifted) == (count, count == 40)
        assert any("has learned 400 of these rows" in note for note in verdict.notes)
    assert calib.evaluate(learned(), both).verdict.causes == calib.check(learned(), both).causes


def test_few_rows_say_nothing_but_of_a_clear_cause():
    simulated = trained("six_axis", 400, 6, NOISE)
    verdict = calib.check(simulated, bare("six_axis", 11, 3))
    assert verdict.changed is verdict.drifted is None
    assert verdict.words == "too few rows to say"
    assert calib.recognise([simulated], bare("six_axis", 11, 3)).index is None
    (cause, *_) = calib.check(simulated, bare("six_axis", 11, 3, "elbow.offset=0.005")).causes
    assert cause.cause == "offset:elbow"
    assert cause.interval[0] < 0.005 < cause.interval[1]


@pytest.mark.parametrize(
    ("robot", "n", "seed"), [("two_link", 10, 8), ("three_link", 10, 6), ("three_link", 12, 0)]
)
def test_few_rows_ten_times_noisier_show_no_waves_of_joints(robot, n, seed):
    """Of 400 waves one explains all that ten rows leave to the noise."""
    assert calib.check(learned(robot), bare(robot, n, seed, noise=10 * NOISE)).drifted is not True


def test_the_drawing_is_trusted_but_the_zeros():
    degree = float(np.radians(1.0))
    rows = bare("six_axis", 60, 11, f"elbow.offset={degree}")
    made = calib.adapt(learned("six_axis"), rows, free="offsets")
    (cause,) = made.changed
    assert cause.cause == "offset:elbow"
    assert cause.interval[0] < degree < cause.interval[1]
    assert made.after["mean"] < 2 * NOISE
    words = "free 'links': expected one of"
    refused(calib.OptionError, words, calib.adapt, learned("six_axis"), rows, free="links")


def test_a_flipped_elbow_is_told_and_the_shoulder_is_not_blamed():
    rows = bare("two_link_full", 100, 1)
    made = calib.adapt(learned("two_link_full"), replace(rows, q=rows.q * [1.0, -1.0]))
    for causes in (made.verdict.causes, made.changed):
        assert [cause.cause for cause in causes] == ["sign:elbow"]
        assert "elbow turns the other way" in causes[0].words
    assert made.verdict.drifted
    assert made.improved
    assert made.after["mean"] < 5e-4


def lasting(n, alike, rng, dim=2):
    """Noise (n, dim) of standard deviation 1 that is alike from row to row."""
    noise = np.zeros((n, dim))
    for k in range(1, n):
        noise[k] = alike * noise[k - 1] + np.sqrt(1 - alike**2) * rng.standard_normal(dim)
    return noise


@pytest.mark.parametrize("ripple", [0.0, 3e-4])
def test_the_scatter_of_an_exact_models_log_is_noise_or_the_arms(ripple):
    q = at(np.tile(0.01 + 0.98 * np.random.default_rng(0).random((100, 2)), (2, 1)))
    error = ripple * np.sin(np.array([37.0, 41.0]) * q + 29.0 * q[:, ::-1])
    noise = np.random.default_rng(1).normal(0.0, 3e-4 - 0.9 * ripple, q.shape)
    verdict = calib.check(model(0.0), log_of(arm(), q, arm().forward(q) + error + noise))
    assert ("no noise" in verdict.explanations[-1]) == (ripple > 0.0)
    assert ("or an error of the arm" in verdict.explanations[-1]) == (ripple == 0.0)


def test_noise_that_lasts_is_no_drift_along_a_path_and_raises_no_alarm():
    """Of noise alike from sample to sample (.98) 12 alarms rose in 10,000 samples."""
    t = np.linspace(0.0, 8.0, 400)
    for seed in range(6):
        q = at(0.5 + 0.45 * np.stack([np.sin(1.1 * t + seed), np.sin(1.7 * t)], axis=1))
        noise = NOISE * lasting(400, 0.9, np.random.default_rng(seed))
        rows = replace(bare("two_link", 400, 0), q=q, x=arm().forward(q) + noise, in_time=True)
        assert not calib.check(learned(), rows).drifted
    rng = np.random.default_rng(0)
    q = rng.uniform(arm().lower, arm().upper, (1500, 2))
    x = arm().forward(q) + NOISE * lasting(1500, 0.98, rng)
    assert not any(alarms(calib.monitor(learned()), q, x))


def test_a_stream_in_space_names_a_large_change_and_forgives_noise_that_lasts():
    """Of chances too small for a number the first was named; of these six streams six alarmed."""
    rows, moved = bare("six_axis", 300, 1), bare("six_axis", 600, 2, "elbow.offset=0.003")
    in_space = calib.train(rows, size=6)
    monitor = calib.monitor(in_space)
    alarms(monitor, moved.q, moved.x)
    assert monitor.state.fired == ("offset:elbow",)
    alarmed = 0
    for seed in (5, 6, 9, 13, 14, 19):
        rng = np.random.default_rng([seed, 3])
        q = rng.uniform(rows.lower, rows.upper, (200, 6))[:60]
        x = rows.arm.forward(q) + NOISE * lasting(60, 0.95, rng, 3)
        alarmed += any(alarms(calib.monitor(in_space), q, x))
    assert alarmed <= 1


@pytest.fixture(scope="module")
def maps_alone():
    return calib.train(bare("two_link", 1500, 0, noise=1e-3), body="none", size=20)


@pytest.mark.parametrize("change", ["sensor.rotate=0.05", "sensor.mirror=x", "elbow.length=+10%"])
def test_a_change_beyond_errors_of_maps_is_drift_and_learned_from_a_stream_only(maps_alone, change):
    found = calib.adapt(maps_alone, bare("two_link", 200, 5, change, noise=1e-3))
    drift = found.verdict
    assert drift.drifted
    assert not drift.adapts
    assert found.model is maps_alone
    assert drift.hint.endswith("method online")
    assert any("method=online" in note for note in found.notes)


TOOL = "tip.offset=0.05,0"


@cache
def states():
    plain = calib.train(babbled(n=400, seed=0), size=8)
    return plain, calib.adapt(plain, babbled(TOOL, n=100)).model


@pytest.mark.parametrize(("change", "who"), [((), 0), ((TOOL,), 1), (("elbow.length=-20%",), None)])
def test_the_state_is_recognised_by_few_rows_or_none_is(change, who):
    for seed in (5, 6):
        assert calib.recognise(states(), babbled(*change, n=25, seed=seed)).index == who


def test_states_that_differ_by_less_than_the_noise_are_told_by_many_rows():
    """A median distance was right in 18 of 24 logs."""
    changes = ((), ("elbow.offset=0.0003",))
    states = [calib.train(bare("two_link", 400, 7, *change), size=6) for change in changes]
    right = 0
    for seed in range(400, 406):
        for index, change in enumerate(changes):
            right += calib.recognise(states, bare("two_link", 120, seed, *change)).index == index
    assert right >= 11


@pytest.mark.skipif(not TRACKER.exists(), reason="the laser tracker's series are not here")
def test_a_lens_that_folds_over_elsewhere_is_no_error():
    """Thirty rows of another day are explained best by a lens that sees nothing elsewhere."""
    joints = ["shoulder_lift_joint", "elbow_joint"]
    a, c = (calib.read_log(TRACKER / f"series_{name}.csv", joints=joints) for name in "ac")
    wide = {"lower": np.minimum(a.lower, c.lower), "upper": np.maximum(a.upper, c.upper)}
    learned = calib.train(replace(c, **wide))
    start = (len(a) - 30) * 3 // 9
    assert calib.check(learned, replace(a, **wide).take(slice(start, start + 30))).changed


DEGREE = "0.0174533"
LINKS = {"length:elbow", "placement:wrist_1"}  # of arms in the plane, and in space


@dataclass(frozen=True)
class Case:
    """A change, its causes, of which one is enough where there is a choice, and what is left."""

    robot: str
    changes: tuple[str, ...]
    causes: tuple[frozenset[str], ...]
    n: int = 60
    adapted: float = 2 * NOISE  # mean error after an adaptation [m]
    drifted: bool = True

    def __str__(self):
        return f"{self.robot}-{'+'.join(self.changes) or 'calm'}-{self.n}"


def case(robot, changes, *causes, **more):
    return Case(robot, tuple(changes.split()), tuple(map(frozenset, causes)), **more)


OFFSET = {"offset:elbow"}
SENSOR = {"sensor"}
LARGER = {"scale", "length:elbow"}  # the same to a log
CASES = [
    *(case(r, "", n=n, drifted=False) for r in ("two_link", "six_axis") for n in (20, 60, 200)),
    *(case(r, f"elbow.offset={DEGREE}", OFFSET, n=n) for r, n in (
        ("two_link", 12), ("two_link", 60), ("three_link", 20), ("six_axis", 20), ("six_axis", 60),
    )),
    case("six_axis", "shoulder_pan.offset=0.005", {"offset:shoulder_pan"}, n=30),
    case("two_link", "elbow.offset=0.5236", OFFSET),
    case("two_link", "elbow.length=+5%", LINKS, n=12),
    case("two_link", "elbow.length=-30%", LINKS),
    case("three_link", "shoulder.length=+3%", {"length:shoulder"}, n=20),
    case("six_axis", "elbow.length=+3%", LINKS),
    case("two_link", "elbow.gear=1.02", {"gain:elbow"}),
    case("six_axis", "shoulder_lift.gear=1.02", {"gain:shoulder_lift"}),
    case("two_link", f"elbow.offset={DEGREE} shoulder.length=+2%", OFFSET, {"length:shoulder"}),
    case("three_link", f"elbow.offset={DEGREE} sensor.scale=1.01", OFFSET, LARGER),
    case("six_axis", f"elbow.offset={DEGREE} shoulder_lift.gear=1.02", OFFSET,
         {"gain:shoulder_lift"}),
    case("two_link", "sensor.shift=0.01,0", SENSOR),
    case("two_link", "sensor.mirror=x", SENSOR, {"mirror"}),
    case("two_link", "sensor.scale=1000", SENSOR, {"scale"}, adapted=1e3 * NOISE),
    case("two_link", "sensor.scale=1.02", LARGER),
    case("two_link", "tip.offset=0.01,0.02", {"length:elbow"}, OFFSET),
    case("two_link", "elbow.backlash=0.02", {"backlash:elbow"}, adapted=np.inf),
    case("six_axis", "elbow.backlash=0.02", {"backlash:elbow"}, n=100, adapted=np.inf),
    case("two_link", "shoulder.noise=0.003", {"noise:shoulder"}, drifted=False),
    case("six_axis", "elbow.noise=0.005", {"noise:elbow"}, n=100, drifted=False),
    case("two_link", "sensor.outliers=0.05", n=200, drifted=False),
]  # fmt: skip


@pytest.mark.parametrize("case", CASES, ids=str)
def test_a_change_is_named_and_mended(case):
    arm, model = calib.load_arm(case.robot), learned(case.robot)
    found = calib.adapt(model, bare(arm, case.n, 11, *case.changes))
    verdict = found.verdict
    named = {cause.cause: cause.interval for cause in verdict.causes}
    assert verdict.changed is case.drifted
    assert (verdict.score > 1.0) is case.drifted
    assert len(named) <= 2 * len(case.causes)
    for causes in case.causes:
        assert named.keys() & causes, named
    # intervals hold what was changed
    for change in case.changes:
        if change.endswith(DEGREE):
            low, high = named["offset:elbow"]
            assert low < float(DEGREE) < high
        if change.endswith("backlash=0.02"):
            assert verdict.causes[0].interval[0] < 0.02 < verdict.causes[0].interval[1]
            # play that no model knows stays an error: a tenth of it was told
            assert found.after["mean"] > 0.5 * found.before["mean"]
    if not case.drifted:
        assert not found.improved
        assert case.changes or verdict.covered > 0.8
        return
    assert verdict.held_out == pytest.approx((found.before["mean"], found.after["mean"]), rel=0.2)
    q = random_joints(arm, 300, seed=5)
    truth = calib.Simulation(arm, changes=case.changes).exact(q)
    assert np.nanmean(np.linalg.norm(found.model.forward(q) - truth, axis=1)) < case.adapted


@pytest.mark.parametrize("times", [2, 5, 10])
def test_a_noisier_sensor_is_no_drift(times):
    model = learned()
    for n, seed in ((10, 50), (10, 51), (20, 50), (20, 51)):
        assert not calib.check(model, bare("two_link", n, seed, noise=times * NOISE)).drifted
    verdict = calib.check(model, bare("two_link", 100, 11, noise=times * NOISE))
    assert verdict.changed is False
    assert {cause.cause for cause in verdict.causes} == {"noise"}
    assert verdict.noise == pytest.approx(times * NOISE, rel=0.15)
    assert times == 2 or verdict.words == "the bound does not hold"


def test_an_error_that_follows_a_joints_direction_is_no_noise():
    """It was 5.3 times the usual scatter, the exit code 0, and 0 % of the rest within the bound."""
    log = bare("two_link", 100, 3)
    found = calib.adapt(learned(), replace(log, x=log.x + 1e-3 * log.side[:, :1]))
    assert not found.verdict.is_calm
    assert np.all(found.model.expected_error(log.q) > 1e-3)


def test_a_corner_that_no_cause_explains_to_the_noise_says_little_of_the_rest():
    """Of a lens, taken for placements, the bound covered 62 % and the error had doubled."""
    arm, model = calib.load_arm("six_axis"), learned("six_axis")

    def seen(q):
        x = arm.forward(q)
        return x * (1.0 + 0.02 * (x**2).sum(axis=1, keepdims=True))

    log, probes = bare("six_axis", 100, 1), random_joints(arm, 300, seed=5)
    q = arm.lower + 0.1 * (arm.upper - arm.lower) + 0.4 * (log.q - arm.lower)
    corner = replace(log, q=q, x=seen(q) + log.x - arm.forward(log.q), side=None)
    adapted = calib.adapt(model, corner).model
    assert accuracy(adapted, probes, seen(probes), "expected_error")[1] > 0.9
