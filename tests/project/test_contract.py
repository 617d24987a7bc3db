"""The contract: what `train` learns, every command knows.

A model is trained on a log that needs an ability of training; then fresh rows of the unchanged arm
are unchanged for every command.  A new ability is a row of `ABILITIES`.
"""

from dataclasses import replace

import numpy as np
import pytest
from models import log_of, seen_through, warm
from touching import World

import calib
from calib.arm.rotations import exponential, quaternion_of
from calib.body.spatial import structure_of

NOISE = 1e-4  # [m]
PIXELS = 0.2  # [px]
TRAINED = 100
FRESH = 40
TURNS = np.array([0.31, 0.53, 0.79, 0.67, 0.43, 0.59])  # [rad/s]
LENS = (900.0, 640.0, 360.0, -0.1)
FROM_THE_SIDE = {"view.rotation": (-1.3, 0.2, 0.1), "view.shift": (0.05, 0.1, 2.0)}


class Robot:
    """An arm as it was built, before a sensor that stands anywhere."""

    def __init__(self, view="rigid", arm="spatial_three", **changes):
        self.arm = calib.load_arm(arm)
        lens = {"unit": "px", "lens": LENS, "lens_sd": (0.0,) * 4} if view == "pinhole" else {}
        self.truth = structure_of(self.arm, view, **lens)
        rng, groups = np.random.default_rng(7), self.truth.groups
        self.beta = self.truth.neutral()
        self.beta[self.truth.shifts] = rng.normal(0.0, 5e-4, self.truth.shifts.shape)
        self.beta[self.truth.turns] = rng.normal(0.0, 2e-3, self.truth.turns.shape)
        self.beta[groups["tool"]] = rng.normal(0.0, 5e-3, 3)
        self.beta[groups["view.rotation"]] = (0.3, -0.2, 1.0)
        self.beta[groups["view.shift"]] = (0.4, -0.1, 0.2)
        for name, value in changes.items():
            self.beta[groups[name]] = value

    def log(self, q, stand, rng, noise=NOISE, **facts):
        """A log of what encoders read, (n, dof), of joints that stand at `stand` (n, dof)."""
        x = self.truth.predict(stand, self.beta)[:, :3]
        return log_of(self.arm, q, x + noise * rng.standard_normal(x.shape), **facts)


def random_rows(robot, poses=(TRAINED, FRESH), repeats=1, stand=lambda q: q, **facts):
    """Rows to train from, and fresh ones: of so many poses, read so often, of joints at `stand`."""
    rng = np.random.default_rng(1)
    draws = (rng.uniform(robot.arm.lower, robot.arm.upper, (n, 3)) for n in poses)
    joints = (np.tile(q, (repeats, 1)) for q in draws)
    return [robot.log(q, stand(q), rng, **facts) for q in joints]


def joint_curves():
    waves = np.zeros(96)
    waves[[9, 48 + 14]] = (8e-4, -6e-4)
    robot = Robot(**{"curve.0": waves, "curve.1": waves, "curve.2": waves})
    return random_rows(robot, (200, FRESH), noise=2e-5)


def encoders_that_tremble():
    """Poses that were read again, by encoders that read each a little otherwise."""
    logs = repeated_poses()
    rng = np.random.default_rng(2)
    return [replace(log, q=log.q + 2e-6 * rng.standard_normal(log.q.shape)) for log in logs]


def rows_left_out():
    """Backlash in a log of which some rows were left out when it was read."""
    trained, fresh = backlash()
    rows = np.random.default_rng(3).permutation(len(trained))[:140]
    return trained.take(np.sort(rows)), fresh


def a_lens():
    robot = Robot("pinhole", **FROM_THE_SIDE)
    return [seen_through(log, LENS) for log in random_rows(robot, noise=PIXELS, unit="px")]


def poses():
    robot, rng = Robot("pose"), np.random.default_rng(2)
    logs = []
    for log in random_rows(robot):
        rotvec = robot.truth.predict(log.q, robot.beta)[:, 3:]
        rotvec += 2e-4 * rng.standard_normal(rotvec.shape)
        logs.append(replace(log, orientation=quaternion_of(exponential(rotvec))))
    return logs


def repeated_poses():
    return random_rows(Robot(), (40, 15), repeats=3)


def backlash():
    def stand(q):
        return q - [0.0, 4e-3, 0.0] * np.sign(np.diff(q, axis=0, prepend=q[:1]))

    return random_rows(Robot(), (200, 60), stand=stand)


def a_late_clock(robot=None, noise=NOISE, late=0.03, play=0.0):
    robot, rng = robot or Robot(), np.random.default_rng(1)
    middle = 0.5 * (robot.arm.lower + robot.arm.upper)
    swing = 0.4 * (robot.arm.upper - robot.arm.lower)

    def path(time):
        return middle + swing * np.sin(TURNS[: robot.arm.dof] * time[:, None])

    logs = []
    for start, rows in ((0.0, 400), (57.3, 200)):
        time = start + 0.05 * np.arange(rows)
        stand = path(time - late)
        stand[:, 1] -= play * np.sign(path(time)[:, 1] - path(time - 0.05)[:, 1])
        logs.append(robot.log(path(time), stand, rng, noise, time=time))
    return logs


def two_sensors(scale=1.0):
    left = Robot()
    right = Robot(**{"view.rotation": (0.0, 0.5, -2.0), "view.shift": (1.0, 0.0, 0.5)})
    logs = [random_rows(robot, sensor=name) for robot, name in ((left, "left"), (right, "right"))]
    logs[1] = [replace(log, x=scale * log.x) for log in logs[1]]
    return [logs[0][0], logs[1][0]], logs[1][1]


def touches():
    world = World(2, each=21)
    log = world.log(known=world.known((0, 1)))
    fresh = np.arange(len(log)) % 3 == 2
    return log.take(~fresh), log.take(fresh)


ABILITIES = {
    "a mount": lambda: random_rows(Robot()),
    "joint curves": joint_curves,
    "elasticity": lambda: random_rows(Robot(elastic=-3e-3), noise=5e-5),
    "a payload": lambda: random_rows(Robot(elastic=-2e-3, payload=-2e-3), noise=5e-5),
    "wrong gears": lambda: random_rows(Robot(gain=(1.0, 1.02, 0.997))),
    "coupled joints": lambda: random_rows(Robot(coupling=(0.0, 6e-3))),
    "a scale": lambda: [replace(a, x=1.7 * a.x, unit="sensor") for a in random_rows(Robot())],
    "millimetres": lambda: [replace(a, x=1e3 * a.x, unit="mm") for a in random_rows(Robot())],
    "a lens": a_lens,
    "poses": poses,
    "repeated poses": repeated_poses,
    "encoders that tremble": encoders_that_tremble,
    "backlash": backlash,
    "rows left out": rows_left_out,
    "backlash along a path": lambda: a_late_clock(late=0.0, play=4e-3),
    "a late clock": a_late_clock,
    "a clock that is hardly late": lambda: a_late_clock(noise=1e-3, late=0.004),
    "a late clock and backlash": lambda: a_late_clock(Robot(arm="six_axis"), 2e-4, play=3e-3),
    "a late clock of an elastic arm": lambda: a_late_clock(Robot(arm="so101", elastic=-2e-3), 5e-5),
    "two sensors": two_sensors,
    "two sensors of two scales": lambda: two_sensors(1.003),
    "touches": touches,
}


@pytest.mark.parametrize("ability", ABILITIES)
def test_a_fresh_log_of_the_unchanged_arm_is_unchanged_to_every_command(ability, tmp_path):
    trained, fresh = ABILITIES[ability]()
    model = calib.train(trained, size=4)
    verdict = calib.check(model, fresh)
    assert verdict.drifted is False, verdict.explanations
    evaluation = calib.evaluate(model, fresh)
    assert evaluation.learned == 0
    if evaluation.touch:
        assert evaluation.touch["scatter"]["covered"] >= 0.85
    else:
        assert evaluation.bound_holds, evaluation.within
    assert not calib.adapt(model, fresh).improved
    assert calib.recognise([model], fresh).index == 0
    # a file answers the same
    model.save(tmp_path / "m.calib")
    loaded = calib.load(tmp_path / "m.calib")
    for sensor in model.sensors:
        answers = [m.by(sensor).forward(fresh.q).tobytes() for m in (model, loaded)]
        assert answers[0] == answers[1]
    assert model.sensors == loaded.sensors
    # and so does compiled C
    compiled = warm(model)
    assert compiled.kernel is not None
    single = [compiled.forward(q) for q in fresh.q[:5]]
    np.testing.assert_allclose(single, model.forward(fresh.q[:5]), atol=1e-9)
