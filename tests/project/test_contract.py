"""The contract: what `train` learns, every command knows.

A row for each ability of training, a column for each command.  A model is trained on a log that
needs the ability; then fresh rows of the unchanged arm are unchanged for every command.  A new
ability is a row of `ABILITIES`.
"""

import shutil
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from models import log_of
from touching import World

import calib
from calib.arm.rotations import exponential, quaternion_of
from calib.body.spatial import structure_of
from calib.samples.camera import Camera
from calib.samples.sockets import Touches

NOISE = 1e-4  # [m]
PIXELS = 0.2  # [px]
TRAINED = 150
FRESH = 60
LENS = (900.0, 640.0, 360.0, -0.1)
CAMERA = Camera((1280, 720), LENS, (0.0,) * 4)


class Robot:
    """`spatial_three` as it was built, before a sensor that stands anywhere."""

    def __init__(self, view="rigid", **changes):
        self.arm = calib.load_arm("spatial_three")
        self.truth = structure_of(self.arm, view)
        if view == "pinhole":
            self.truth = structure_of(self.arm, view, unit="px", lens=LENS, lens_sd=(0.0,) * 4)
        rng = np.random.default_rng(7)
        groups = self.truth.groups
        self.beta = self.truth.neutral()
        self.beta[self.truth.shifts] = rng.normal(0.0, 5e-4, self.truth.shifts.shape)
        self.beta[self.truth.turns] = rng.normal(0.0, 2e-3, self.truth.turns.shape)
        self.beta[groups["tool"]] = rng.normal(0.0, 5e-3, 3)
        self.beta[groups["view.rotation"]] = (0.3, -0.2, 1.0)
        self.beta[groups["view.shift"]] = (0.4, -0.1, 0.2)
        if view == "pinhole":
            self.beta[groups["view.rotation"]] = (-1.3, 0.2, 0.1)
            self.beta[groups["view.shift"]] = (0.05, 0.1, 2.0)
        for name, value in changes.items():
            self.beta[groups[name]] = value

    def draw(self, rows, rng):
        return rng.uniform(self.arm.lower, self.arm.upper, (rows, self.arm.dof))

    def log(self, q, rng, noise=NOISE, stand=None, **facts):
        """A log of joints (n, dof) that stood elsewhere, where `stand` (n, dof) says so."""
        x = self.truth.predict(q if stand is None else stand, self.beta)[:, :3]
        x = x + noise * rng.standard_normal(x.shape)
        return log_of(self.arm, q, x, **facts)


def random_rows(robot, **facts):
    """Rows to train from, and fresh ones."""
    rng = np.random.default_rng(1)
    return [robot.log(robot.draw(n, rng), rng, **facts) for n in (TRAINED, FRESH)]


def joint_curves():
    waves = np.zeros(96)
    waves[[9, 48 + 14]] = (8e-4, -6e-4)
    robot = Robot(**{"curve.0": waves, "curve.1": waves, "curve.2": waves})
    rng = np.random.default_rng(1)
    return [robot.log(robot.draw(n, rng), rng, 2e-5) for n in (300, FRESH)]


def encoders_that_tremble():
    """Poses that were read again, by encoders that read each a little otherwise."""
    logs = repeated_poses()
    rng = np.random.default_rng(2)
    return [replace(log, q=log.q + 2e-6 * rng.standard_normal(log.q.shape)) for log in logs]


def rows_left_out():
    """Backlash in a log of which some rows were left out when it was read."""
    trained, fresh = backlash()
    rows = np.random.default_rng(3).permutation(len(trained))[:200]
    return trained.take(np.sort(rows)), fresh


def poses():
    robot = Robot("pose")
    rng = np.random.default_rng(1)
    logs = []
    for rows in (TRAINED, FRESH):
        q = robot.draw(rows, rng)
        seen = robot.truth.predict(q, robot.beta)
        turns = seen[:, 3:] + 2e-4 * rng.standard_normal((rows, 3))

        log = robot.log(q, rng)
        logs.append(replace(log, orientation=quaternion_of(exponential(turns))))
    return logs


def repeated_poses():
    robot = Robot()
    rng = np.random.default_rng(1)
    logs = []
    for rows in (50, 20):
        q = np.tile(robot.draw(rows, rng), (3, 1))
        logs.append(robot.log(q, rng))
    return logs


def backlash():
    robot = Robot()
    rng = np.random.default_rng(1)
    half = np.array([0.0, 4e-3, 0.0])
    logs = []
    for rows in (300, 100):
        q = robot.draw(rows, rng)
        side = np.sign(np.diff(q, axis=0, prepend=q[:1]))
        logs.append(robot.log(q, rng, stand=q - half * side))
    return logs


def a_late_clock():
    robot = Robot()
    rng = np.random.default_rng(1)
    middle = 0.5 * (robot.arm.lower + robot.arm.upper)
    swing = 0.4 * (robot.arm.upper - robot.arm.lower)
    speed = np.array([0.31, 0.53, 0.79])

    def path(time):
        return middle + swing * np.sin(speed * time[:, None])

    logs = []
    for start, rows in ((0.0, 400), (57.3, 200)):
        time = start + 0.05 * np.arange(rows)
        logs.append(robot.log(path(time), rng, stand=path(time - 0.03), time=time))
    return logs


def two_sensors():
    left = Robot()
    right = Robot(**{"view.rotation": (0.0, 0.5, -2.0), "view.shift": (1.0, 0.0, 0.5)})
    logs = [random_rows(robot, sensor=name) for robot, name in ((left, "left"), (right, "right"))]
    return [logs[0][0], logs[1][0]], logs[1][1]


def touches():
    world = World(2, each=30)
    order = np.arange(len(world.q))
    fresh = order % 3 == 2
    logs = []
    for rows in (~fresh, fresh):
        sockets = tuple(("", "ABCD"[k]) for k in range(4))
        touch = Touches(world.number[rows], sockets, tuple(world.known((0, 1))))
        logs.append(log_of(world.arm, world.q[rows], np.zeros((rows.sum(), 3)), touch=touch))
    return logs


ABILITIES = {
    "a mount": lambda: random_rows(Robot()),
    "joint curves": joint_curves,
    "elasticity": lambda: random_rows(Robot(elastic=-3e-3), noise=5e-5),
    "a payload": lambda: random_rows(Robot(elastic=-2e-3, payload=-2e-3), noise=5e-5),
    "wrong gears": lambda: random_rows(Robot(gain=(1.0, 1.02, 0.997))),
    "coupled joints": lambda: random_rows(Robot(coupling=(0.0, 6e-3))),
    "a scale": lambda: [replace(a, x=1.7 * a.x, unit="sensor") for a in random_rows(Robot())],
    "millimetres": lambda: [replace(a, x=1e3 * a.x, unit="mm") for a in random_rows(Robot())],
    "a lens": lambda: random_rows(Robot("pinhole"), noise=PIXELS, unit="px", camera=CAMERA),
    "poses": poses,
    "repeated poses": repeated_poses,
    "encoders that tremble": encoders_that_tremble,
    "backlash": backlash,
    "rows left out": rows_left_out,
    "a late clock": a_late_clock,
    "two sensors": two_sensors,
    "touches": touches,
}


@cache
def learned(ability):
    """The model of an ability, and a fresh log of the unchanged arm."""
    trained, fresh = ABILITIES[ability]()
    return calib.train(trained, size=4), fresh


def check_finds_no_change(model, fresh, folder):
    drift = calib.check(model, fresh)
    assert drift.drifted is False, drift.explanations


def evaluate_holds_the_bound(model, fresh, folder):
    evaluation = calib.evaluate(model, fresh)
    assert evaluation.learned == 0
    if evaluation.touch:
        assert evaluation.touch["scatter"]["covered"] >= 0.85
    else:
        assert evaluation.bound_holds, evaluation.within


def adapt_writes_nothing(model, fresh, folder):
    assert not calib.adapt(model, fresh).improved


def recognise_names_it(model, fresh, folder):
    assert calib.recognise([model], fresh).index == 0


def a_file_answers_the_same(model, fresh, folder):
    model.save(folder / "m.calib")
    loaded = calib.load(folder / "m.calib")
    for sensor in model.sensors:
        answers = [each.by(sensor).forward(fresh.q).tobytes() for each in (model, loaded)]
        assert answers[0] == answers[1]
    assert model.sensors == loaded.sensors


def c_agrees(model, fresh, folder):
    if shutil.which("cc") is None:
        pytest.skip("no C compiler")
    compiled = replace(model)
    expected = model.forward(fresh.q[:5])
    compiled.warm_up()
    assert compiled.kernel is not None
    single = np.array([compiled.forward(q) for q in fresh.q[:5]])
    np.testing.assert_allclose(single, expected, atol=1e-9)


COMMANDS = (
    check_finds_no_change,
    evaluate_holds_the_bound,
    adapt_writes_nothing,
    recognise_names_it,
    a_file_answers_the_same,
    c_agrees,
)


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.__name__)
@pytest.mark.parametrize("ability", ABILITIES)
def test_a_fresh_log_of_the_unchanged_arm_is_unchanged(ability, command, tmp_path):
    model, fresh = learned(ability)
    command(model, fresh, tmp_path)
