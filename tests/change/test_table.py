"""What changed, what is named, in the plane and in space, through Python and the command line."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from models import bare, learned
from reference import random_joints

import calib

NOISE = 2e-4
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
    model = learned()
    found = calib.adapt(model, replace(log, x=log.x + 1e-3 * log.side[:, :1]))
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
    miss = np.linalg.norm(adapted.forward(probes) - seen(probes), axis=1)
    assert np.mean(miss <= adapted.expected_error(probes)) > 0.9
